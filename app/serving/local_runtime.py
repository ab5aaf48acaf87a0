"""The runtime that computes in this process: models, engine and workers, their start and end."""

import asyncio
import logging
import threading
from collections.abc import AsyncGenerator, Callable, Iterable, Sequence
from functools import partial
from time import perf_counter
from typing import Any, TypeVar

import anyio
import anyio.to_thread

from app.compilation.parts import Part, are_kept, compile_missing
from app.inference.device import choose_device
from app.inference.engine import Engine, Tick, Watch
from app.inference.model import Model
from app.inference.model_card import ModelCard
from app.inference.model_store import ModelStore
from app.inference.networks import KINDS
from app.inference.shares import Share, half_least_half_urgent
from app.memory import set_aside_what_stays
from app.planning.control.step import ControlStep
from app.planning.warm_up import warm_up, warm_up_loops
from app.serving.admission import Admission
from app.serving.batches import Batch, Describe
from app.serving.bodies import make_body
from app.serving.control_session import Take
from app.serving.json_parts import json_parts
from app.serving.kernels import LOOPS, NETWORK, PLANNING, available_cores
from app.serving.rates import Rates
from app.serving.refusals import NotReady, ShuttingDown
from app.serving.runtime import Answered, Answers, Gone, Runtime, T, reason
from app.serving.service import PlanningService, ResolvedRequest
from app.serving.step_threads import StepThreads
from app.serving.workers import Workers
from app.settings import Settings
from app.terminal import progress_line
from app.wire.requests import MultistepPlanRequest

R = TypeVar("R")

log = logging.getLogger(__name__)


class LocalRuntime(Runtime):
    """Computes what is asked for in this process.

    Args:
        settings: of the service.
        watch: told of every batch of the engine, in the engine's thread.
        share: says whose rows go through the network next.
        network_threads: cores that compute; by default all that the process may use.
    """

    def __init__(
        self,
        settings: Settings,
        watch: Watch,
        share: Share = half_least_half_urgent,
        network_threads: int | None = None,
    ) -> None:
        threads = network_threads or available_cores()
        rates = Rates()

        def watch_tick(tick: Tick) -> None:
            rates.add_tick(tick)
            watch(tick)

        self._steps = StepThreads(threads)
        # As if the network always had work: nobody is promised a core that it may need.
        admission = Admission(settings, rates, compiled_at_once=max(1, threads - 1))
        super().__init__(settings, rates, admission, lambda: self.compute_step, threads)
        self._device = choose_device()
        self._engine = Engine(threads, watch_tick, share)
        self._workers = Workers(admission, self._engine.row_threads)
        self._loading = asyncio.Lock()
        self._models: ModelStore[Model] | None = None
        self._stop = threading.Event()

    async def compute_step(self, take: Take, expected_seconds: float) -> tuple[ControlStep, float]:
        """Do a step of a control session, as `StepThreads` does."""
        return await self._steps.compute(take, expected_seconds)

    async def answer(
        self, service: Answers[T], resolved: T, *, accepts_gzip: bool, gone: Gone
    ) -> Answered:
        def work_out(waited_ms: float) -> Answered:
            answer = service.answer(resolved, waited_ms)
            body = make_body(answer, accepts_gzip=accepts_gzip, stop=resolved.work.stop)
            return body, answer["timing_ms"]

        return await self._workers.run(resolved.work, work_out, gone)

    async def answer_in_segments(
        self,
        resolved: ResolvedRequest[MultistepPlanRequest],
        told: Callable[[bytes], None],
        gone: Gone,
    ) -> Answered:
        service = self.service

        def tell(segment: dict[str, Any]) -> None:
            told(b"".join(json_parts(segment)))

        def work_out(waited_ms: float) -> Answered:
            answer = service.answer(resolved, waited_ms, tell)
            body = make_body(answer, accepts_gzip=False, stop=resolved.work.stop)
            return body, answer["timing_ms"]

        return await self._workers.run(resolved.work, work_out, gone)

    def answer_batch(
        self, batch: Batch, describe: Describe, gone: Gone
    ) -> AsyncGenerator[tuple[range, list[bytes]], None]:
        def answer(part: range, waited_ms: float) -> list[bytes]:
            return batch.answer(part, waited_ms, describe)

        parts, at_once = batch.parts(), batch.parts_at_once
        return self._workers.run_parts(batch.work, parts, answer, at_once, gone)

    async def start(self) -> None:
        """Load everything in a thread, while the probes answer; then compile what may wait."""
        await super().start()
        if self._service is None:
            return
        await self._compile_loops()
        await self._compile_network()

    async def load(self) -> ModelStore[ModelCard]:
        """Load what is new in the store beside the models in use, then put all in their place.

        Plans under way keep the models that they began with.

        Raises:
            ModelRejected: a model is not what its manifest says; those in use stay.
            NotReady: the service is draining.
        """
        async with self._loading:
            started = perf_counter()
            serving = self._models.models if self._models else None
            models = await self._in_thread(lambda: self._load(serving))
            self._serve(models)
            labels = ", ".join(model.label for model in models.models) or "no models"
            log.info("ready after %.1f s with %s", perf_counter() - started, labels)
            return models

    def _load(self, serving: Sequence[Model] | None) -> ModelStore[Model]:
        """Compile what planning needs, and load the models; blocks.

        Raises:
            ModelRejected: a model is not what its manifest says.
            NotReady: the service is draining.
        """
        with progress_line() as show:

            def tell(text: str) -> None:
                show(text)
                if self._service is None and not self._draining:
                    self._state = f"the service is starting: {text}"

            compile_missing(PLANNING, self.network_threads, tell, self._stop)
            if self._stop.is_set():
                raise NotReady(self._state)
            tell("loading models")
            warm_up()
            if are_kept(LOOPS):
                self._warm_up_loops()
            kinds = KINDS if are_kept(NETWORK) else KINDS[-1:]
            return self._engine.load(self.settings.model_store, self._device, kinds, serving)

    def _serve(self, models: ModelStore[Model]) -> None:
        self._put_in_place(PlanningService(self.settings, models, self._engine, self.rates))
        self._models = models
        set_aside_what_stays()

    async def _compile_loops(self) -> None:
        """Compile what plans do without, while they are served."""
        if self._has_loops:
            return
        log.info("plans are served; closed loops and machines from logs when they are compiled")
        try:
            await self._in_thread(partial(self._compile, LOOPS))
            if not self._draining:
                await self._in_thread(self._warm_up_loops)
                log.info("closed loops and machines from logs are served, too")
        except Exception as error:
            log.warning("no closed loops, and no machines from logs: %s", reason(error))

    async def _compile_network(self) -> None:
        """Put compiled networks in the place of TorchScript, which served until they were here."""
        if self._device.type != "cpu" or not self.service.models.models or are_kept(NETWORK):
            return
        log.info("TorchScript runs the models until their kernels are compiled")
        try:
            await self._in_thread(partial(self._compile, NETWORK))
            async with self._loading:
                store = self.settings.model_store
                models = await self._in_thread(lambda: self._engine.load(store, self._device))
                self._serve(models)
        except NotReady:
            pass
        except Exception as error:
            log.warning("TorchScript goes on running the models: %s", reason(error))
        else:
            log.info("the models run compiled")

    def _warm_up_loops(self) -> None:
        warm_up_loops()
        self._has_loops = True

    def _compile(self, parts: Iterable[Part]) -> None:
        compile_missing(parts, self.network_threads, lambda _: None, self._stop)

    async def _in_thread(self, function: Callable[[], R]) -> R:
        """Return `function()`, called in a thread that nobody waits for once the service ends."""
        return await anyio.to_thread.run_sync(function, abandon_on_cancel=True)

    async def drain(self) -> None:
        self._stop.set()
        await super().drain()

    def abort(self) -> None:
        for work in self.admission.works:
            work.stop.set(ShuttingDown("the service was told to end at once"))

    def close(self) -> None:
        self._steps.close()
        self._workers.close()
        self._engine.close()
