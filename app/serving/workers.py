"""Threads in which plans are made, so that the event loop never computes."""

import asyncio
import math
from collections.abc import Awaitable, Callable
from contextlib import nullcontext
from time import perf_counter
from typing import TypeVar

import anyio
import anyio.to_thread

from app.inference.row_threads import RowThreads
from app.planning.stop import Stopped
from app.serving.admission import Admission, Lane, Work
from app.serving.refusals import ClientGone, DeadlineExceeded

T = TypeVar("T")


class Workers:
    """A thread for each plan under way.

    Plans that need the network wait in theirs for the engine. Compiled ones compute in theirs, in
    each lane as many at once as there are cores; while the network has work, one fewer. The engine
    in turn leaves the long ones the cores that they are on; the short ones are soon done.

    Args:
        admission: says who may come in.
        row_threads: the engine's, which are lent to compiled plans.
    """

    def __init__(self, admission: Admission, row_threads: RowThreads) -> None:
        self._admission = admission
        self._row_threads = row_threads
        self._cores: dict[Lane, anyio.CapacityLimiter] = {
            "short": anyio.CapacityLimiter(row_threads.num_threads),
            "long": anyio.CapacityLimiter(row_threads.num_threads),
        }
        self._network_plans = 0
        # The admission bounds how many there are.
        self._threads = anyio.CapacityLimiter(math.inf)

    async def run(
        self, work: Work, function: Callable[[float], T], gone: Callable[[], Awaitable[None]]
    ) -> T:
        """Return `function(waited_ms)`, called in a thread.

        Args:
            work: what it takes; its job's stop is set when the deadline passes or the client goes.
            function: makes the plan.
            gone: returns when nobody waits for the result any more.

        Raises:
            Refused: the work was not taken on.
            Stopped: DeadlineExceeded, ClientGone, or whatever else the job was stopped with.
        """
        with self._admission.admitted(work) as lane:
            begun = perf_counter()
            queue = anyio.CancelScope()

            def stop(reason: Stopped) -> None:
                work.stop.set(reason)
                queue.cancel()

            async def watch_client() -> None:
                await gone()
                stop(ClientGone("the client has gone"))

            watch = asyncio.create_task(watch_client())
            timer = asyncio.get_running_loop().call_later(
                work.deadline - begun, stop, DeadlineExceeded("the deadline has passed")
            )
            try:
                if lane == "network":
                    return await self._run_network(function, begun)
                return await self._run_compiled(work, function, begun, queue, lane)
            finally:
                timer.cancel()
                watch.cancel()

    async def _run_network(self, function: Callable[[float], T], begun: float) -> T:
        self._change_network_plans(1)
        try:
            return await self._in_thread(function, begun)
        finally:
            self._change_network_plans(-1)

    def _change_network_plans(self, change: int) -> None:
        self._network_plans += change
        reserved = 1 if self._network_plans else 0
        for cores in self._cores.values():
            cores.total_tokens = max(1, self._row_threads.num_threads - reserved)

    async def _run_compiled(
        self,
        work: Work,
        function: Callable[[float], T],
        begun: float,
        queue: anyio.CancelScope,
        lane: Lane,
    ) -> T:
        cores = self._cores[lane]
        acquired = False
        try:
            with queue:
                await cores.acquire_on_behalf_of(work)
                acquired = True
            work.stop.check()
            with self._row_threads.lend() if lane == "long" else nullcontext():
                return await self._in_thread(function, begun)
        finally:
            if acquired:
                cores.release_on_behalf_of(work)

    async def _in_thread(self, function: Callable[[float], T], begun: float) -> T:
        return await anyio.to_thread.run_sync(
            lambda: function((perf_counter() - begun) * 1e3), limiter=self._threads
        )
