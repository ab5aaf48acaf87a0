"""Where a process computes the steps of control sessions: at once, or in threads."""

import asyncio
from concurrent.futures import ThreadPoolExecutor
from time import perf_counter

from app.planning.control.step import ControlStep
from app.serving.control_session import Take

AT_ONCE_SECONDS = 5e-4
"""A step that takes no longer is computed where its message is read: to hand it to a thread and
back takes as long, and both have to wait for a core."""


class StepThreads:
    """No step waits for a plan or for the network: these threads do nothing else.

    Args:
        num_threads: that compute long steps; those of one session follow each other.
    """

    def __init__(self, num_threads: int) -> None:
        self._threads = ThreadPoolExecutor(num_threads, "control")

    async def compute(self, take: Take, expected_seconds: float) -> tuple[ControlStep, float]:
        """Return a step, and the seconds that it took; it is expected to take about so many."""

        def timed() -> tuple[ControlStep, float]:
            began = perf_counter()
            taken = take()
            return taken, perf_counter() - began

        if expected_seconds <= AT_ONCE_SECONDS:
            return timed()
        return await asyncio.get_running_loop().run_in_executor(self._threads, timed)

    def close(self) -> None:
        """End the threads, when no session is open any more."""
        self._threads.shutdown(wait=False)
