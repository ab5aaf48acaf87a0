"""Threads for plans: as many as there are cores, and none for a plan that nobody wants any more."""

import asyncio
import threading
import time
from collections.abc import Callable, Coroutine, Iterator
from contextlib import aclosing
from dataclasses import replace
from time import perf_counter
from types import SimpleNamespace
from typing import Any, TypeVar, cast

import pytest

from app.inference.model import Model
from app.inference.model_card import Pace
from app.inference.row_threads import RowThreads
from app.launch import START_SECONDS
from app.planning.stop import Stop
from app.serving.admission import Admission, Work
from app.serving.rates import Rates
from app.serving.refusals import ClientGone, DeadlineExceeded, Refused
from app.serving.workers import Workers
from app.settings import Settings

T = TypeVar("T")
MODEL = cast(Model, SimpleNamespace(label="fake/1", pace=Pace(16, 1e-6)))


def compiled(rollout_steps: int = 1) -> Work:
    return Work(
        0, model=None, rows_per_step=2, rollout_steps=rollout_steps, kind="cem", answer_bytes=0
    )


def long_one() -> Work:
    return compiled(rollout_steps=10**8)


def with_network() -> Work:
    return Work(
        1, model=MODEL, rows_per_step=2, rollout_steps=1, kind="action_diffusion", answer_bytes=0
    )


async def never() -> None:
    """The client waits for as long as it takes."""
    await asyncio.Event().wait()


async def soon() -> None:
    """The client leaves."""
    await asyncio.sleep(0.05)


def until_stopped(stop: Stop) -> Callable[[float], None]:
    def work(_: float) -> None:
        while True:
            stop.check()
            time.sleep(0.001)

    return work


class Service:
    """Workers on some cores, and the threads that the engine has left."""

    def __init__(self, num_cores: int, **settings: Any) -> None:
        self.row_threads = RowThreads(num_cores)
        self.admission = Admission(Settings(**settings), Rates(), num_cores)
        self.workers = Workers(self.admission, self.row_threads)

    async def run(
        self,
        work: Work,
        function: Callable[[float], T],
        seconds: float = START_SECONDS,
        gone: Callable[[], Coroutine[Any, Any, None]] = never,
    ) -> T:
        work.deadline = perf_counter() + seconds
        return await self.workers.run(work, function, gone)

    def assert_idle(self) -> None:
        assert len(self.admission) == 0
        assert self.row_threads.lent == 0


@pytest.fixture
def gate() -> Iterator[threading.Event]:
    gate = threading.Event()
    yield gate
    gate.set()


def test_a_plan_comes_back_with_the_time_that_it_waited() -> None:
    service, began = Service(1), perf_counter()
    waited_ms = asyncio.run(service.run(compiled(), lambda waited_ms: waited_ms))
    assert 0 <= waited_ms <= 1e3 * (perf_counter() - began)
    service.assert_idle()


@pytest.mark.parametrize("work", [compiled, with_network])
def test_a_plan_ends_at_its_deadline(work: Callable[[], Work]) -> None:
    service, plan = Service(1), work()
    with pytest.raises(DeadlineExceeded):
        asyncio.run(service.run(plan, until_stopped(plan.stop), seconds=0.2))
    service.assert_idle()


@pytest.mark.parametrize("work", [compiled, with_network])
def test_a_plan_ends_when_its_client_goes(work: Callable[[], Work]) -> None:
    service, plan = Service(1), work()
    with pytest.raises(ClientGone):
        asyncio.run(service.run(plan, until_stopped(plan.stop), gone=soon))
    service.assert_idle()


def test_a_plan_that_fails_says_so_and_leaves() -> None:
    def fail(_: float) -> None:
        raise ZeroDivisionError

    service = Service(1)
    with pytest.raises(ZeroDivisionError):
        asyncio.run(service.run(compiled(), fail))
    service.assert_idle()


@pytest.mark.parametrize(
    ("seconds", "gone", "reason"),
    [(0.2, never, DeadlineExceeded), (START_SECONDS, soon, ClientGone)],
)
def test_who_waits_for_a_core_in_vain_is_never_begun_and_holds_nothing(
    gate: threading.Event, seconds: float, gone: Any, reason: type[Exception]
) -> None:
    service = Service(1)
    begun: list[float] = []

    async def scenario() -> None:
        first = asyncio.create_task(service.run(compiled(), lambda _: gate.wait(START_SECONDS)))
        await asyncio.sleep(0.01)
        with pytest.raises(reason):
            await service.run(compiled(), begun.append, seconds, gone)
        assert not begun
        gate.set()
        assert await first
        await service.run(compiled(), begun.append)

    asyncio.run(scenario())
    assert len(begun) == 1
    service.assert_idle()


def test_compiled_plans_leave_a_core_to_the_network_while_it_has_work(
    gate: threading.Event,
) -> None:
    service = Service(3)
    most = 0

    def compute(_: float) -> None:
        nonlocal most
        most = max(most, service.row_threads.lent)
        time.sleep(0.01)

    async def compute_together() -> int:
        nonlocal most
        most = 0
        async with asyncio.TaskGroup() as group:
            for _ in range(8):
                group.create_task(service.run(long_one(), compute))
        return most

    async def scenario() -> None:
        assert await compute_together() == 3
        sampling = asyncio.create_task(
            service.run(with_network(), lambda _: gate.wait(START_SECONDS))
        )
        await asyncio.sleep(0.01)
        assert await compute_together() == 2
        gate.set()
        await sampling
        assert await compute_together() == 3

    asyncio.run(scenario())
    service.assert_idle()


def test_the_engine_shares_its_cores_with_short_plans_and_leaves_them_to_long_ones() -> None:
    service = Service(2)

    def lent(work: Work) -> int:
        return asyncio.run(service.run(work, lambda _: service.row_threads.lent))

    assert lent(compiled()) == 0
    assert lent(long_one()) == 1
    service.assert_idle()


def test_a_short_plan_waits_for_no_long_one(gate: threading.Event) -> None:
    service = Service(1)

    async def scenario() -> None:
        first = asyncio.create_task(service.run(long_one(), lambda _: gate.wait(START_SECONDS)))
        await asyncio.sleep(0.01)
        assert await service.run(compiled(), lambda _: "done") == "done"
        assert not first.done()
        gate.set()
        await first

    asyncio.run(scenario())
    service.assert_idle()


def test_plans_of_the_network_wait_for_no_core(gate: threading.Event) -> None:
    service = Service(1)

    async def scenario() -> None:
        async with asyncio.TaskGroup() as group:
            for _ in range(20):
                group.create_task(service.run(with_network(), lambda _: gate.wait(START_SECONDS)))
            await asyncio.sleep(0.05)
            assert len(service.admission) == 20
            gate.set()

    asyncio.run(scenario())
    service.assert_idle()


def test_what_is_refused_is_not_begun() -> None:
    service = Service(1, max_pending=1)
    begun: list[float] = []

    async def scenario() -> None:
        stop = compiled()
        first = asyncio.create_task(service.run(stop, until_stopped(stop.stop), 0.2))
        await asyncio.sleep(0.01)
        with pytest.raises(Refused):
            await service.run(compiled(), begun.append)
        with pytest.raises(DeadlineExceeded):
            await first

    asyncio.run(scenario())
    assert not begun
    service.assert_idle()


def a_batch() -> Work:
    return replace(long_one(), is_batch=True)


async def taken(
    service: Service, work: Work, count: int, function: Callable[[int, float], T], at_once: int = 2
) -> list[tuple[int, T]]:
    """Have that many parts done, and take all of them."""
    work.deadline = perf_counter() + START_SECONDS
    parts = service.workers.run_parts(work, iter(range(count)), function, at_once, never)
    async with aclosing(parts):
        return [result async for result in parts]


@pytest.mark.parametrize("make", [a_batch, with_network])
def test_every_part_is_done_once(make: Callable[[], Work]) -> None:
    service = Service(2)
    done = asyncio.run(taken(service, make(), 9, lambda part, waited_ms: (10 * part, waited_ms)))
    assert sorted((part, result) for part, (result, _) in done) == [(i, 10 * i) for i in range(9)]
    assert all(waited_ms >= 0 for _, (_, waited_ms) in done)
    service.assert_idle()


def test_no_more_parts_are_begun_than_are_taken() -> None:
    service, begun = Service(2), list[int]()

    def do(part: int, _: float) -> None:
        begun.append(part)

    async def scenario() -> None:
        work = a_batch()
        work.deadline = perf_counter() + START_SECONDS
        parts = service.workers.run_parts(work, iter(range(100)), do, 3, never)
        async with aclosing(parts):
            for number in range(1, 6):
                await anext(parts)
                await asyncio.sleep(0.02)  # whoever takes them is slow
                assert len(begun) <= 3 + number - 1

    asyncio.run(scenario())
    assert len(begun) < 10
    service.assert_idle()


def test_a_long_plan_comes_in_between_parts() -> None:
    service, order = Service(1), list[str]()

    def do(name: str) -> None:
        order.append(name)
        time.sleep(0.01)

    async def scenario() -> None:
        batch = asyncio.create_task(taken(service, a_batch(), 20, lambda *_: do("part")))
        await asyncio.sleep(0.03)
        await service.run(long_one(), lambda _: do("plan"))
        await batch

    asyncio.run(scenario())
    assert order.count("part") == 20
    assert "part" in order[order.index("plan") :]


def test_past_the_deadline_parts_are_done_at_once_and_can_say_so(gate: threading.Event) -> None:
    service, work = Service(1), a_batch()

    def do(_: int, __: float) -> str:
        try:
            work.stop.check()
        except DeadlineExceeded:
            return "late"
        return "done"

    async def scenario() -> list[str]:
        holding = asyncio.create_task(service.run(long_one(), lambda _: gate.wait(START_SECONDS)))
        await asyncio.sleep(0.01)
        work.deadline = perf_counter() + 0.2
        parts = service.workers.run_parts(work, iter(range(5)), do, 2, never)
        async with aclosing(parts):
            said = [result async for _, result in parts]
        gate.set()
        await holding
        return said

    assert asyncio.run(scenario()) == ["late"] * 5
    service.assert_idle()


def test_a_client_that_leaves_ends_the_parts() -> None:
    service, work = Service(1), a_batch()

    async def scenario() -> None:
        work.deadline = perf_counter() + START_SECONDS
        do = until_stopped(work.stop)
        parts = service.workers.run_parts(work, iter(range(5)), lambda _, w: do(w), 2, soon)
        async with aclosing(parts):
            with pytest.raises(ClientGone):
                await anext(parts)

    asyncio.run(scenario())
    service.assert_idle()
