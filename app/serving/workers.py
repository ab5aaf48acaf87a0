"""Threads in which plans are made, so that the event loop never computes."""

import asyncio
import threading
from collections.abc import AsyncGenerator, AsyncIterator, Awaitable, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import (
    AbstractContextManager,
    aclosing,
    asynccontextmanager,
    contextmanager,
    nullcontext,
)
from contextvars import copy_context
from functools import partial
from time import perf_counter
from typing import TypeVar

from app.inference.courtesy import give_way
from app.inference.row_threads import RowThreads
from app.planning.stop import Stopped
from app.serving.admission import Admission, Lane, Work
from app.serving.cores import Cores
from app.serving.in_parts import as_done
from app.serving.refusals import ClientGone, DeadlineExceeded

P = TypeVar("P")
T = TypeVar("T")

MAX_THREADS = 1 << 16
"""As good as any number: the admission bounds how many there are."""


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
        self._short, self._long = Cores(row_threads.num_threads), Cores(row_threads.num_threads)
        self._network_plans = 0
        self._threads = ThreadPoolExecutor(MAX_THREADS, "plan", initializer=give_way)

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
            async with _while_wanted(work, gone) as waiting:
                if lane == "network":
                    return await self._run_network(function, begun)
                return await self._run_compiled(waiting, _checked(work, function), begun, lane)

    async def run_parts(
        self,
        work: Work,
        parts: Iterator[P],
        function: Callable[[P, float], T],
        at_once: int,
        gone: Callable[[], Awaitable[None]],
    ) -> AsyncGenerator[tuple[P, T], None]:
        """Yield each part of a work with `function(part, waited_ms)`, in whatever order they get
        done.

        Some are under way at once, each on a core for its own turn only; and whoever takes the
        results sets the pace: as many wait to be taken at most. The admission is the caller's.

        Args:
            work: what was admitted; its job's stop is set when the deadline passes, the client goes
                or nobody takes the results any more.
            parts: asked for the next one when it can be begun.
            function: does a part; past the deadline it says so of each thing in it.
            at_once: how many parts are under way, or wait to be taken.
            gone: returns when nobody waits for the results any more.

        Raises:
            Stopped: ClientGone, or whatever else the job was stopped with but its deadline.
        """

        def run(part: P) -> Awaitable[T]:
            return self._run_part(work, waiting, partial(function, part))

        def stop() -> None:  # threads cannot be cancelled; they heed it, and soon
            waiting.stop(ClientGone("nobody takes the results any more"))

        async with (
            _while_wanted(work, gone) as waiting,
            aclosing(as_done(parts, run, at_once, stop)) as done,
        ):
            async for part, result in done:
                yield part, result

    async def _run_part(self, work: Work, waiting: "_Waiting", function: Callable[[float], T]) -> T:
        begun = perf_counter()
        if work.model:
            return await self._run_network(function, begun)
        return await self._run_compiled(waiting, function, begun, "batch")

    async def _run_network(self, function: Callable[[float], T], begun: float) -> T:
        self._change_network_plans(1)
        try:
            return await self._in_thread(function, begun, nullcontext())
        finally:
            self._change_network_plans(-1)

    def _change_network_plans(self, change: int) -> None:
        self._network_plans += change
        reserved = 1 if self._network_plans else 0
        for cores in (self._short, self._long):
            cores.set_number(max(1, self._row_threads.num_threads - reserved))

    async def _run_compiled(
        self, waiting: "_Waiting", function: Callable[[float], T], begun: float, lane: Lane
    ) -> T:
        """Compute on a core, once there is one; at once for a work that is stopped meanwhile."""
        with waiting.until_stopped() as called:
            return await self._in_thread(function, begun, self._core(lane, called))

    @contextmanager
    def _core(self, lane: Lane, called: threading.Event) -> Iterator[None]:
        cores = self._short if lane == "short" else self._long
        with (
            cores.one(called) as is_there,
            self._row_threads.lend() if lane != "short" and is_there else nullcontext(),
        ):
            yield

    async def _in_thread(
        self, function: Callable[[float], T], begun: float, core: AbstractContextManager[None]
    ) -> T:
        def run() -> T:
            with core:
                return function((perf_counter() - begun) * 1e3)

        loop = asyncio.get_running_loop()
        running = loop.run_in_executor(self._threads, copy_context().run, run)
        try:
            return await asyncio.shield(running)
        except asyncio.CancelledError:  # a thread cannot be: its end is waited for
            await asyncio.wait([running])
            raise

    def close(self) -> None:
        """End the threads, when no plan is under way any more."""
        self._threads.shutdown(wait=False)


class _Waiting:
    """All that waits for a core on behalf of a work, and ends to when nobody wants it any more."""

    def __init__(self, work: Work) -> None:
        self._work = work
        self._events: set[threading.Event] = set()

    def stop(self, reason: Stopped) -> None:
        """Stop the work, and let nobody wait for it."""
        self._work.stop.set(reason)
        for event in self._events:
            event.set()

    @contextmanager
    def until_stopped(self) -> Iterator[threading.Event]:
        """Provide an event that is set when the work is stopped, or has been."""
        event = threading.Event()
        self._events.add(event)
        if self._work.stop.flag[0]:
            event.set()
        try:
            yield event
        finally:
            self._events.remove(event)


@asynccontextmanager
async def _while_wanted(work: Work, gone: Callable[[], Awaitable[None]]) -> AsyncIterator[_Waiting]:
    """Stop a work when its deadline passes or its client goes, until the context ends."""
    waiting = _Waiting(work)

    async def watch_client() -> None:
        await gone()
        waiting.stop(ClientGone("the client has gone"))

    watch = asyncio.create_task(watch_client())
    timer = asyncio.get_running_loop().call_later(
        work.deadline - perf_counter(),
        waiting.stop,
        DeadlineExceeded("the deadline has passed"),
    )
    try:
        yield waiting
    finally:
        timer.cancel()
        watch.cancel()


def _checked(work: Work, function: Callable[[float], T]) -> Callable[[float], T]:
    """Return what calls `function` if the work is still wanted."""

    def check_and_call(waited_ms: float) -> T:
        work.stop.check()
        return function(waited_ms)

    return check_and_call
