"""All control sessions: how many there may be, and their end.

What comes of a session's messages is in control_session.py.
"""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from app.serving.control_session import Compute, Loop, Session
from app.serving.refusals import Refused
from app.settings import Settings

MOST_LOAD = 0.8
"""Of the event loop's time, for which all sessions together may keep it busy."""
POLL_SECONDS = 0.02


class ControlSessions:
    """Lets sessions in, and ends them all.

    Args:
        settings: how many there may be.
        steps_of_session: returns what has the steps of one session computed.
    """

    def __init__(self, settings: Settings, steps_of_session: Callable[[], Compute]) -> None:
        self._settings = settings
        self._steps_of_session = steps_of_session
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
        session = Session(self._admit, self._steps_of_session())
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

    def _admit(self, loop: Loop) -> None:
        """Refuse a loop whose steps would make those of all late."""
        loads = [session.loop.load for session in self._open if session.loop]
        total = sum(loads) + loop.load
        if total > MOST_LOAD:
            detail = f"the sessions would need {total:.0%} of the time, and get {MOST_LOAD:.0%}"
            raise Refused("queue_full", detail, 1.0)
