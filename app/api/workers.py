"""Threads in which plans are made, so that the event loop never computes."""

from collections.abc import Callable
from time import perf_counter
from typing import TypeVar

import anyio
import anyio.to_thread

from app.api.errors import Busy

T = TypeVar("T")


class Workers:
    """A bounded number of requests at work or waiting.

    Args:
        max_pending: how many in all; one more is refused.
        num_cores: how many of those that compute in their own thread run at once. Those that wait
            for the network do not count: the engine's thread computes for them.
    """

    def __init__(self, max_pending: int, num_cores: int) -> None:
        self._max_pending = max_pending
        self._pending = 0
        self._cores = anyio.CapacityLimiter(num_cores)
        self._network = anyio.CapacityLimiter(max_pending)

    async def run(self, function: Callable[[float], T], *, needs_network: bool) -> T:
        """Return `function(waited_ms)`, called in a thread.

        Raises:
            Busy: too many requests are pending.
        """
        if self._pending >= self._max_pending:
            raise Busy(f"{self._pending} requests are pending; try again later")
        self._pending += 1
        submitted = perf_counter()
        try:
            return await anyio.to_thread.run_sync(
                lambda: function((perf_counter() - submitted) * 1e3),
                limiter=self._network if needs_network else self._cores,
            )
        finally:
            self._pending -= 1
