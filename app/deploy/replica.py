"""A replica: the runtime of one process, behind calls instead of routes.

Whatever it is asked for is a pure function of what it is given: a call that died with its replica
is made again elsewhere, and gives the same. Each call's first argument is for the router.
"""

import asyncio
import os
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import aclosing
from dataclasses import asdict
from functools import partial
from time import perf_counter
from typing import Any, TypeAlias, TypeVar

from ray import serve

from app.api.errors import problem_of
from app.api.planning import BATCH_PATH
from app.deploy.outcomes import Outcome, Raised
from app.deploy.routing import Load, Order
from app.memory import use_few_arenas
from app.planning.control.step import ControlStep
from app.serving.control_session import Take
from app.serving.local_runtime import LocalRuntime
from app.serving.refusals import NotReady
from app.serving.runtime import Answered, Gone
from app.settings import Settings
from app.wire.batches import PlanBatchRequest
from app.wire.control import ControlRequest
from app.wire.identification import IdentifyRequest
from app.wire.model import Asked
from app.wire.requests import MultistepPlanRequest
from app.wire.simulation import SimulateRequest

Sent: TypeAlias = tuple[list[bytes], bool, dict[str, float]]
"""The parts of a body, whether they are compressed, and the answer's `timing_ms`."""
T = TypeVar("T")


class Replica:
    """Plans, runs, identifies and steps for the ingresses of a cluster.

    Args:
        settings: of the service.
        cores: that it computes on.
    """

    async def __init__(self, settings: Settings, cores: int) -> None:  # type: ignore[misc]
        use_few_arenas()
        self._id = serve.get_replica_context().replica_id.unique_id
        self._runtime = LocalRuntime(settings, lambda _: None, network_threads=cores)
        await self._runtime.start()
        if self._runtime.failed:
            raise NotReady("the replica could not start; its log tells more")

    async def answer(self, _: Order, asked: Asked, accepts_gzip: bool) -> Outcome[Sent]:
        """Answer a request whose seed is settled."""

        async def answer(gone: Gone) -> Sent:
            service = self._service(asked)
            resolved = service.resolve(asked)
            return _sent(
                await self._runtime.answer(service, resolved, accepts_gzip=accepts_gzip, gone=gone)
            )

        return await self._outcome(answer)

    async def answer_in_segments(
        self, _: Order, asked: MultistepPlanRequest
    ) -> AsyncIterator[bytes | Outcome[Sent]]:
        """Yield each segment's JSON as soon as it is planned, and at last the outcome."""
        told: asyncio.Queue[bytes | Outcome[Sent]] = asyncio.Queue()
        loop = asyncio.get_running_loop()

        def tell(segment: bytes) -> None:
            loop.call_soon_threadsafe(told.put_nowait, segment)

        async def answer(gone: Gone) -> Sent:
            resolved = self._runtime.service.resolve(asked)
            return _sent(await self._runtime.answer_in_segments(resolved, tell, gone))

        async def put_outcome() -> None:
            told.put_nowait(await self._outcome(answer))

        answering = asyncio.create_task(put_outcome())
        try:
            while isinstance(item := await told.get(), bytes):
                yield item
            yield item
        finally:
            answering.cancel()

    async def answer_part(
        self, _: Order, asked: PlanBatchRequest, first: int
    ) -> Outcome[list[bytes]]:
        """Return the lines of some of a batch's problems, which begin at index `first`.

        The ingress has admitted the batch.
        """
        describe = partial(problem_of, path=BATCH_PATH)

        async def answer(gone: Gone) -> list[bytes]:
            batch = self._runtime.batch(asked, perf_counter(), first)
            lines: list[bytes] = []
            with self._runtime.admission.taken_on(batch.work):
                async with aclosing(self._runtime.answer_batch(batch, describe, gone)) as parts:
                    async for part, text in parts:
                        batch.done(part)
                        lines += text
            return lines

        return await self._outcome(answer)

    async def step(
        self, _: Order, take: Take, expected_seconds: float
    ) -> Outcome[tuple[ControlStep, float]]:
        """Do a step of a control session."""
        return await self._outcome(lambda _: self._runtime.compute_step(take, expected_seconds))

    async def greet(self, _: Order) -> Outcome[int]:
        """Say that it is there, in which process."""
        return Outcome(self._id, self._load, os.getpid())

    async def load(self) -> "Raised | None":
        """Load what is new in the model store; return what was wrong with it."""
        try:
            await self._runtime.load()
        except Exception as error:
            return Raised.of(error)
        return None

    def record_routing_stats(self) -> dict[str, Any]:
        """Tell routers the fields of a `Load`."""
        return asdict(self._load)

    def record_autoscaling_stats(self) -> dict[str, float]:
        """Tell the autoscaler what waits here: rows, and seconds of compiled plans."""
        rows = sum(pending.rows for pending in self._runtime.admission.pending.values())
        queued = self._load.queued
        return {"rows": rows, "seconds": queued["short"] + queued["long"]}

    async def __del__(self) -> None:
        await self._runtime.drain()
        self._runtime.close()

    @property
    def _load(self) -> Load:
        """How it is; parts of batches are among what is long."""
        runtime = self._runtime
        rates, queued = runtime.rates, runtime.admission.queued
        return Load(
            models={
                model.label: rates.seconds_of_rows(model, 1, is_crowded=False)
                for model in runtime.service.models.models
            },
            kinds=rates.seconds_per_step,
            queued={
                "network": queued.get("network", 0.0),
                "short": queued.get("short", 0.0),
                "long": queued.get("long", 0.0) + queued.get("batch", 0.0),
            },
        )

    def _service(self, asked: Asked) -> Any:
        """Return what resolves and answers such requests."""
        runtime = self._runtime
        match asked:
            case SimulateRequest():
                return runtime.simulation
            case ControlRequest():
                return runtime.control
            case IdentifyRequest():
                return runtime.identification
            case _:
                return runtime.service

    async def _outcome(self, do: Callable[[Gone], Awaitable[T]]) -> Outcome[T]:
        """Return what comes of doing something; it is stopped when the call is cancelled."""
        gone = asyncio.Event()

        async def until_gone() -> None:
            await gone.wait()

        doing = asyncio.ensure_future(do(until_gone))
        result: T | Raised
        try:
            result = await asyncio.shield(doing)
        except asyncio.CancelledError:
            gone.set()
            doing.add_done_callback(lambda done: done.cancelled() or done.exception())
            raise
        except Exception as error:
            result = Raised.of(error)
        return Outcome(self._id, self._load, result)


def _sent(answered: Answered) -> Sent:
    body, timing = answered
    return [bytes(part[:]) for part in body.parts], body.is_gzip, timing
