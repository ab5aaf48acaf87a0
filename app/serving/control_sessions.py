"""All control sessions: how many there may be, where their steps are computed, and their end.

What comes of a session's messages is in control_session.py.
"""

import asyncio
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from time import perf_counter

from app.planning.control.step import ControlStep
from app.serving.control_session import Loop, Session
from app.serving.refusals import Refused
from app.settings import Settings

AT_ONCE_SECONDS = 5e-4
"""A step that takes no longer is computed where its message is read: to hand it to a thread and
back takes as long, and both have to wait for a core."""
MOST_LOAD = 0.8
"""Of the event loop's time, for which all sessions together may keep it busy."""
POLL_SECONDS = 0.02


class ControlSessions:
    """Lets sessions in, sees to it that their steps are computed, and ends them all.

    No step waits for a plan or for the network: short ones are done at once, others in threads that
    do nothing else.

    Args:
        settings: how many there may be.
        num_threads: that compute long steps; those of one session follow each other.
    """

    def __init__(self, settings: Settings, num_threads: int) -> None:
        self._settings = settings
        self._threads = ThreadPoolExecutor(num_threads, "control")
        self._open: dict[Session, Callable[[], None]] = {}
        self.is_draining = False

    def __len__(self) -> int:
        return len(self._open)

    @contextmanager
    def opened(self, wake: Callable[[], None]) -> Iterator[Session]:
        """Let a session in until the context ends.

        Args:
            wake: called when it has to end, if it waits for its client.

        Raises:
            Refused: there are too many.
        """
        most = self._settings.max_sessions
        if len(self._open) >= most:
            raise Refused("queue_full", f"{most} control sessions are open, as many as may be", 1.0)
        session = Session(self._admit, self._compute)
        self._open[session] = wake
        try:
            yield session
        finally:
            del self._open[session]

    async def drain(self) -> None:
        """Have every session end, and return when they have."""
        self.is_draining = True
        for wake in list(self._open.values()):
            wake()
        while self._open:
            await asyncio.sleep(POLL_SECONDS)

    def close(self) -> None:
        """End the threads, when no session is open any more."""
        self._threads.shutdown(wait=False)

    def _admit(self, loop: Loop) -> None:
        """Refuse a loop whose steps would make those of all late."""
        loads = [session.loop.load for session in self._open if session.loop]
        total = sum(loads) + loop.load
        if total > MOST_LOAD:
            detail = f"the sessions would need {total:.0%} of the time, and get {MOST_LOAD:.0%}"
            raise Refused("queue_full", detail, 1.0)

    async def _compute(
        self, loop: Loop, take: Callable[[], ControlStep]
    ) -> tuple[ControlStep, float]:
        """Return a step, and the seconds that it took."""

        def timed() -> tuple[ControlStep, float]:
            began = perf_counter()
            taken = take()
            return taken, perf_counter() - began

        if loop.seconds.seconds_per_unit <= AT_ONCE_SECONDS:
            return timed()
        return await asyncio.get_running_loop().run_in_executor(self._threads, timed)
