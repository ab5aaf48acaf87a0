"""What an ingress does when replicas die, refuse, or take too long: behind it are stand-ins."""

import asyncio
from collections.abc import AsyncIterator, Callable
from time import perf_counter
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("ray")

from ray.exceptions import ActorDiedError

from app.deploy.cluster import ClusterRuntime, PinnedSteps
from app.deploy.outcomes import Outcome, Raised
from app.deploy.router import SECONDS_PER_REPLICA, by_outstanding_rows
from app.deploy.routing import BOARD, TRIES, Load, Order
from app.planning.methods.uniform import Uniform
from app.serving.refusals import ClientGone, DeadlineExceeded, NotReady, Refused
from app.settings import Settings
from app.wire.requests import MultistepPlanRequest, PlanRequest

ASKED = PlanRequest(initial_state=(0, 0), target_state=(0.2, 0), method=Uniform())
MANY = MultistepPlanRequest(initial_state=(0, 0), targets=[(0.2, 0), (0, 0)], method=Uniform())
SENT = ([b"{}"], False, {"total": 1.0})
BUSY = Raised.of(Refused("deadline", "there is no time", 1.0))


class Replicas:
    """Calls of theirs end as they are told to, one after the other."""

    def __init__(self, *ends: Any) -> None:
        self._ends = list(ends)
        self.asked: list[tuple[Any, ...]] = []

    @property
    def answer(self) -> Any:
        return SimpleNamespace(remote=self._call)

    @property
    def answer_in_segments(self) -> Any:
        return SimpleNamespace(remote=self._stream)

    @property
    def step(self) -> Any:
        return SimpleNamespace(remote=self._call)

    def options(self, **_: Any) -> "Replicas":
        return self

    async def _call(self, *arguments: Any) -> Any:
        self.asked.append(arguments)
        end = self._ends.pop(0)
        if end is None:
            await asyncio.sleep(60)
        if isinstance(end, BaseException):
            raise end
        return Outcome(f"replica {len(self.asked)}", Load(), end)

    async def _stream(self, *arguments: Any) -> AsyncIterator[Any]:
        for item in self._ends[0][:-1]:
            yield item
        self._ends[0] = self._ends[0][-1]
        yield await self._call(*arguments)


@pytest.fixture(autouse=True)
def _nobody_known() -> None:
    BOARD.keep([])


async def never() -> None:
    await asyncio.Event().wait()


def ask(replicas: Replicas, asked: PlanRequest = ASKED, gone: Callable[[], Any] = never) -> Any:
    async def answer() -> Any:
        runtime = await started(replicas)
        resolved = runtime.service.resolve(asked)
        return await runtime.answer(runtime.service, resolved, accepts_gzip=False, gone=gone)

    return asyncio.run(answer())


async def started(replicas: Replicas) -> ClusterRuntime:
    runtime = ClusterRuntime(Settings(), replicas, cores=1)
    replicas_greet = SimpleNamespace(remote=greet)
    replicas.greet = replicas_greet  # type: ignore[attr-defined]
    await runtime.load()
    return runtime


async def greet(_: Order) -> Outcome[int]:
    return Outcome("replica", Load(), 1)


def test_a_death_costs_one_more_try_with_the_same_request() -> None:
    replicas = Replicas(ActorDiedError(), SENT)
    body, timing = ask(replicas)
    assert (list(body.parts), timing) == ([b"{}"], {"total": 1.0})
    (_, first, _), (_, second, _) = replicas.asked
    assert first.seed == second.seed is not None
    assert second.deadline_ms <= first.deadline_ms


def test_who_has_no_time_for_it_is_not_asked_again() -> None:
    replicas = Replicas(BUSY, SENT)
    ask(replicas)
    first, second = (order for order, *_ in replicas.asked)
    assert (first.avoided, second.avoided) == (frozenset(), {"replica 1"})


def test_when_nobody_has_time_the_client_is_told_when_to_come_back() -> None:
    with pytest.raises(Refused) as refused:
        ask(Replicas(*[BUSY] * TRIES))
    assert refused.value.retry_after_s == 1


def test_one_death_after_the_other_is_said() -> None:
    with pytest.raises(NotReady, match="died"):
        ask(Replicas(*[ActorDiedError()] * TRIES))


def test_nobody_waits_past_the_deadline_or_for_a_client_that_has_gone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("app.deploy.cluster.GRACE_SECONDS", 0.0)
    began = perf_counter()
    with pytest.raises(DeadlineExceeded):
        ask(Replicas(None), ASKED.model_copy(update={"deadline_ms": 50}))
    with pytest.raises(ClientGone):
        ask(Replicas(None), gone=lambda: asyncio.sleep(0))
    assert perf_counter() - began < 30


def test_serve_cancels_the_calls_of_a_client_that_has_gone() -> None:
    with pytest.raises(ClientGone):
        ask(Replicas(asyncio.CancelledError()))


def test_segments_that_were_sent_are_not_sent_again() -> None:
    async def answer() -> list[bytes]:
        replicas = Replicas([b"one", ActorDiedError()], [b"one", b"two", SENT])
        runtime = await started(replicas)
        told: list[bytes] = []
        await runtime.answer_in_segments(runtime.service.resolve(MANY), told.append, never)
        return told

    assert asyncio.run(answer()) == [b"one", b"two"]


def test_a_session_stays_with_its_replica_and_goes_on_with_another() -> None:
    async def steps() -> list[Any]:
        replicas = Replicas(("a", 0.1), ("b", 0.1), ActorDiedError(), ("c", 0.1), ("d", 0.1))
        runtime = await started(replicas)
        pinned = PinnedSteps(runtime._step)
        for _ in range(4):
            await pinned.compute(lambda: None, 0.1)  # type: ignore[arg-type, return-value]
        return [order.pinned for order, *_ in replicas.asked]

    assert asyncio.run(steps()) == [None, "replica 1", "replica 2", None, "replica 4"]


@pytest.mark.parametrize(
    ("rows", "seconds", "wanted"), [(0, 0, 1), (9000, 0, 3), (0, 2.5 * SECONDS_PER_REPLICA, 3)]
)
def test_replicas_follow_what_waits(rows: float, seconds: float, wanted: int) -> None:
    context: Any = SimpleNamespace(
        aggregated_metrics={"rows": {"a": rows / 2, "b": rows / 2}, "seconds": {"a": seconds}},
        capacity_adjusted_min_replicas=1,
        capacity_adjusted_max_replicas=10,
    )
    assert by_outstanding_rows(context)[0] == wanted
