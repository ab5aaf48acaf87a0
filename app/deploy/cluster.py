"""The runtime of an ingress: settles requests, and has the replicas of a cluster answer them."""

import asyncio
import json
import logging
from collections import deque
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import aclosing, suppress
from math import ceil
from time import perf_counter
from typing import Any, TypeAlias, TypeVar

import anyio.to_thread
from ray.exceptions import RayActorError

from app.deploy.admission import ClusterAdmission, order_of
from app.deploy.outcomes import Outcome, Raised
from app.deploy.routing import BOARD, TRIES, Order, now
from app.inference.model_card import ModelCard
from app.inference.model_store import ModelStore
from app.planning.control.step import ControlStep
from app.serving.batches import Batch, Describe
from app.serving.bodies import Body
from app.serving.control_session import Take
from app.serving.in_parts import as_done
from app.serving.rates import Rates
from app.serving.refusals import ClientGone, DeadlineExceeded, NotReady, Refused
from app.serving.runtime import Answered, Answers, Gone, Runtime, T
from app.serving.service import PlanningService, ResolvedRequest
from app.settings import Settings
from app.wire.batches import PlanBatchRequest
from app.wire.model import Asked
from app.wire.requests import MultistepPlanRequest

PROBLEMS_TOGETHER = 32
"""Of a batch that go to a replica in one call; it plans them a few together."""
PARTS_PER_REPLICA = 2
"""Of a batch: the next is there when one is done."""
GRACE_SECONDS = 1.0
"""A replica tells by itself that a deadline has passed; after so long nobody waits for it."""
STEP_SECONDS = 30.0
"""A step of a session takes milliseconds; so long is waited for a replica that can do it."""

Handle: TypeAlias = Any
"""A `DeploymentHandle` of replicas; Ray does not tell types apart by what a method returns."""
Step: TypeAlias = Callable[[str | None, Take, float], Awaitable[Outcome[tuple[ControlStep, float]]]]
R = TypeVar("R")
A = TypeVar("A", bound=Asked)

log = logging.getLogger(__name__)


class ClusterRuntime(Runtime):
    """Has replicas answer; a call that dies with its replica is made again.

    Args:
        settings: of the service.
        replicas: a handle of their deployment.
        cores: of each of them.
    """

    def __init__(self, settings: Settings, replicas: Handle, cores: int) -> None:
        rates = Rates()
        admission = ClusterAdmission(settings, rates, BOARD)
        super().__init__(settings, rates, admission, lambda: PinnedSteps(self._step).compute, cores)
        self._replicas = replicas

    async def load(self) -> ModelStore[ModelCard]:
        """Verify the models of the store, and have the replicas load what is new in it.

        The first time it waits for a replica, which loads them by itself.

        Raises:
            ModelRejected: a model is not what its manifest says; those in use stay.
            NotReady: the service is draining.
        """
        folder = self.settings.model_store
        models = await anyio.to_thread.run_sync(ModelStore.cards, folder, abandon_on_cancel=True)
        if self._service is None:
            self._state = "the service is starting: no replica is ready"
            outcome = await self._replicas.greet.remote(Order())
            BOARD.tell(outcome.replica, outcome.load, now())
        else:
            for raised in await self._replicas.broadcast("load").results_async():
                if raised:
                    raise raised.error()
        self._has_loops = True  # a replica is there when all is compiled
        self._put_in_place(PlanningService(self.settings, models, None, self.rates))
        return models

    async def answer(
        self,
        service: Answers[T],  # noqa: ARG002
        resolved: T,
        *,
        accepts_gzip: bool,
        gone: Gone,
    ) -> Answered:
        asked, work = resolved.settled, resolved.work

        async def ask(order: Order) -> Outcome[Any]:
            due = _due(asked, work.deadline)
            outcome: Outcome[Any] = await _result(
                self._replicas.answer.remote(order, due, accepts_gzip)
            )
            return outcome

        with self.admission.admitted(work):
            parts, is_gzip, timing = await self._ask(order_of(work), work.deadline, ask, gone)
        return Body(deque(parts), is_gzip), timing

    async def answer_in_segments(
        self,
        resolved: ResolvedRequest[MultistepPlanRequest],
        told: Callable[[bytes], None],
        gone: Gone,
    ) -> Answered:
        asked, work = resolved.settled, resolved.work
        num_told = 0

        async def ask(order: Order) -> Outcome[Any]:
            nonlocal num_told
            due = _due(asked, work.deadline)
            stream = self._replicas.options(stream=True).answer_in_segments.remote(order, due)
            num_come = 0
            try:
                async for item in stream:
                    if isinstance(item, Outcome):
                        return item
                    num_come += 1
                    if num_come > num_told:  # not told before another replica died
                        told(item)
                        num_told = num_come
            except asyncio.CancelledError:
                stream.cancel()
                raise
            raise RuntimeError("a replica's segments ended without an outcome")

        with self.admission.admitted(work):
            parts, is_gzip, timing = await self._ask(order_of(work), work.deadline, ask, gone)
        return Body(deque(parts), is_gzip), timing

    async def answer_batch(
        self, batch: Batch, describe: Describe, gone: Gone
    ) -> AsyncGenerator[tuple[range, list[bytes]], None]:
        deadline, count = batch.work.deadline, len(batch.request.problems)
        shared = batch.request.model_copy(update={"problems": [], "seed": batch.seed})
        order = order_of(batch.work)
        left = asyncio.ensure_future(gone())

        def orders(part: range) -> Order:
            share = len(part) / count
            rows, steps = round(order.rows * share), round(order.steps * share)
            return order._replace(rows=rows, steps=steps)

        async def answer(part: range) -> list[bytes]:
            problems = batch.request.problems[part.start : part.stop]
            asked = shared.model_copy(update={"problems": problems})

            async def ask(order: Order) -> Outcome[list[bytes]]:
                due: PlanBatchRequest = _due(asked, deadline)
                outcome: Outcome[list[bytes]] = await _result(
                    self._replicas.answer_part.remote(order, due, part.start)
                )
                return outcome

            try:
                return await self._ask(orders(part), deadline, ask, lambda: asyncio.shield(left))
            except ClientGone:
                raise
            except Exception as error:
                told = describe(error).model_dump(exclude_none=True)
                return [
                    json.dumps({"index": index, "problem": told}).encode() + b"\n" for index in part
                ]

        parts = (
            range(first, min(first + PROBLEMS_TOGETHER, count))
            for first in range(0, count, PROBLEMS_TOGETHER)
        )

        def forget() -> None:
            left.cancel()

        at_once = PARTS_PER_REPLICA * max(1, len(BOARD))
        async with aclosing(as_done(parts, answer, at_once, forget)) as done:
            async for part, lines in done:
                yield part, lines

    def abort(self) -> None:
        """Nothing is computed here: what was asked for is dropped with the connections."""

    def close(self) -> None:
        """Nothing is left here: Ray ends the replicas."""

    async def _step(
        self, pinned: str | None, take: Take, expected_seconds: float
    ) -> Outcome[tuple[ControlStep, float]]:
        """Have a step done by the replica that it is pinned to, or else by another; see `_ask`."""

        async def ask(order: Order) -> Outcome[Any]:
            response = self._replicas.step.remote(order, take, expected_seconds)
            outcome: Outcome[Any] = await _result(response)
            return Outcome(outcome.replica, outcome.load, outcome)

        deadline = perf_counter() + STEP_SECONDS
        outcome: Outcome[tuple[ControlStep, float]] = await self._ask(
            Order(pinned=pinned), deadline, ask, _never
        )
        return outcome

    async def _ask(
        self,
        order: Order,
        deadline: float,
        ask: Callable[[Order], Awaitable[Outcome[R]]],
        gone: Gone,
    ) -> R:
        """Return what a replica answers, in time and while somebody waits for it.

        Where the replica dies another one is asked; where it has no time for it, too.

        Raises:
            DeadlineExceeded: the deadline passes, by `perf_counter`, and a little more.
            ClientGone: nobody waits for it any more.
            NotReady: one replica after the other died.
            Exception: what the replica raised.
        """
        leaving = asyncio.ensure_future(gone())
        try:
            for tries_left in reversed(range(TRIES)):
                asking = asyncio.ensure_future(ask(order))
                seconds = deadline + GRACE_SECONDS - perf_counter()
                await asyncio.wait(
                    {asking, leaving}, timeout=seconds, return_when=asyncio.FIRST_COMPLETED
                )
                if not asking.done():
                    asking.cancel()
                    if leaving.done():
                        raise ClientGone("the client has gone")
                    raise DeadlineExceeded("the deadline has passed")
                if asking.cancelled():  # by Serve, with the request that it was asked for
                    raise ClientGone("the client has gone")
                try:
                    outcome = asking.result()
                except RayActorError as error:
                    log.warning("a replica died, and its request goes to another: %s", error)
                    order = order._replace(pinned=None)
                    continue
                BOARD.tell(outcome.replica, outcome.load, now())
                refused = isinstance(outcome.result, Raised) and outcome.result.kind is Refused
                if refused and tries_left and len(BOARD) > len(order.avoided) + 1:
                    order = order._replace(avoided=order.avoided | {outcome.replica})
                    continue
                return outcome.unwrap()
            raise NotReady("one replica after the other has died")
        finally:
            leaving.cancel()


class PinnedSteps:
    """Has the steps of one session done by one replica, and by another when that one dies.

    What a step needs travels with it: the session goes on where the last one left it.

    Args:
        step: has a step done by a replica, if it is there, or by another one.
    """

    def __init__(self, step: Step) -> None:
        self._step = step
        self._replica: str | None = None

    async def compute(self, take: Take, expected_seconds: float) -> tuple[ControlStep, float]:
        """Return a step, and the seconds that it took."""
        outcome = await self._step(self._replica, take, expected_seconds)
        self._replica = outcome.replica
        return outcome.unwrap()


def _due(asked: A, deadline: float) -> A:
    """Return a request with the time that is left for it, ms: no replica knows our clock.

    Raises:
        DeadlineExceeded: there is none.
    """
    left = deadline - perf_counter()
    if left <= 0:
        raise DeadlineExceeded("the deadline has passed")
    return asked.model_copy(update={"deadline_ms": ceil(1e3 * left)})


async def _result(response: Any) -> Any:
    """Return what a call comes to; who is cancelled while it waits cancels the call."""
    try:
        return await response
    except asyncio.CancelledError:
        with suppress(Exception):
            response.cancel()
        raise


async def _never() -> None:
    await asyncio.Event().wait()
