"""The engine: one thread that owns the network, and takes the samplings of all requests together.

Each tick it runs one batch: rows of as many samplings as fit, each at its own step, with its own
solver, guidance and condition. It waits for nobody: an idle engine begins at once, and a sampling
joins or leaves between any two ticks. shares.py says whose rows go next.
"""

import logging
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from time import perf_counter
from typing import NamedTuple, TypeAlias

import numpy as np
import torch

from app.inference.courtesy import give_way
from app.inference.job import Job
from app.inference.manifest import Manifest
from app.inference.model import Model
from app.inference.model_card import ModelCard
from app.inference.model_store import ModelStore
from app.inference.networks import Kind
from app.inference.row_threads import RowThreads
from app.inference.sampling import Sampling
from app.inference.shares import Share, half_least_half_urgent
from app.planning.arrays import FloatArray
from app.planning.methods.base import Finish
from app.planning.methods.sampler import Sampler
from app.planning.plant.spread import CERTAIN, Told
from app.planning.problem import Candidates, PlanningError, Problem

MEMORY_TICKS = 10

log = logging.getLogger(__name__)


class Tick(NamedTuple):
    """What one batch was."""

    model: Model
    rows: int
    seconds: float
    """Since the batch before, or since there was work."""
    is_crowded: bool
    """Whether some of the cores were lent."""


Watch: TypeAlias = Callable[[Tick], None]


def _ignore(_: Tick) -> None:
    pass


@dataclass(eq=False, slots=True)
class _Order:
    """A sampling that somebody waits for."""

    job: Job
    prepare: Callable[[], Sampling]
    done: "Future[tuple[FloatArray, float]]"
    """The controls (K, H), and the time at which the first tick with them began."""
    begun: float | None = None


class Engine:
    """Takes samplings through their networks, a share of each at a time.

    Args:
        num_threads: CPU threads of the network.
        watch: called with every batch, in the engine's thread.
        share: says whose rows go next.
    """

    def __init__(
        self,
        num_threads: int,
        watch: Watch = _ignore,
        share: Share = half_least_half_urgent,
    ) -> None:
        self.row_threads = RowThreads(num_threads)
        self._watch = watch
        self._share = share
        self._inbox: SimpleQueue[_Order | None] = SimpleQueue()
        self._closing = threading.Lock()
        self._closed = False
        self._running: dict[Sampling, _Order] = {}
        self._tick_seconds = 0.0
        self._thread = threading.Thread(target=self._run, name="engine", daemon=True)
        self._thread.start()

    def load(
        self,
        store: Path,
        device: torch.device,
        kinds: Sequence[Kind] | None = None,
        serving: Sequence[Model] | None = None,
        wanted: Callable[[Manifest], bool] = lambda _: True,
    ) -> ModelStore[Model]:
        """Verify, load and warm up the models of a store, in the calling thread; see `ModelStore`.

        Raises:
            ModelRejected: one of them is not what its manifest says; none is loaded then.
        """
        _use_no_threads_of_pytorch()
        return ModelStore.load(store, device, self.row_threads, kinds, serving, wanted)

    def bind(
        self, model: ModelCard, job: Job, told: Told | None = None, *, keeps_steps: bool = False
    ) -> "EngineProposal":
        """Return `model`, loaded here, as a learned proposal; arguments as for its class."""
        assert isinstance(model, Model)
        return EngineProposal(self, model, job, told, keeps_steps=keeps_steps)

    def submit(
        self, job: Job, prepare: Callable[[], Sampling]
    ) -> "Future[tuple[FloatArray, float]]":
        """Take on the sampling that `prepare` makes, in the engine's thread.

        Returns:
            The controls (K, H) in units of control and when their first tick began, or what went
            wrong: what `prepare` raised, the network or the reason of the job's stop.

        Raises:
            RuntimeError: the engine is closed.
        """
        order = _Order(job, prepare, Future())
        with self._closing:
            if self._closed:
                raise RuntimeError("the engine is closed")
            self._inbox.put(order)
        return order.done

    def close(self) -> None:
        """Finish what was submitted, then end the threads."""
        with self._closing:
            if not self._closed:
                self._closed = True
                self._inbox.put(None)
        self._thread.join()
        self.row_threads.close()

    @torch.inference_mode()
    def _run(self) -> None:
        give_way()
        _use_no_threads_of_pytorch()
        is_open, began = True, perf_counter()
        while is_open or self._running:
            while is_open and (not self._running or not self._inbox.empty()):
                was_idle = not self._running
                # No variable here holds an order: an idle engine keeps no old model alive.
                is_open = self._begin(self._inbox.get())
                if was_idle:
                    began = perf_counter()
            try:
                began = self._tick(began)
            except Exception as error:
                log.exception("a tick failed; so do the requests that were under way")
                for sampling in list(self._running):
                    self._fail(sampling, error)

    def _begin(self, order: _Order | None) -> bool:
        """Prepare the sampling that was ordered; return whether there may be more."""
        if order is None:
            return False
        try:
            order.job.stop.check()
            sampling = order.prepare()
        except Exception as error:
            order.done.set_exception(error)
        else:
            self._running[sampling] = order
        return True

    def _tick(self, began: float) -> float:
        """Run a batch of each model that has rows in this tick; return when it ended."""
        for sampling in list(self._running):
            try:
                sampling.job.stop.check()
            except Exception as error:
                self._fail(sampling, error)
        if not self._running:
            return began
        samplings = list(self._running)
        budget = max(sampling.model.pace.rows_at_once for sampling in samplings)
        shares = self._share(samplings, budget, self._tick_seconds)
        last = began
        for model in {sampling.model for sampling in shares}:
            own = {sampling: rows for sampling, rows in shares.items() if sampling.model is model}
            is_crowded = self.row_threads.lent > 0
            self._run_batch(model, own)
            now = perf_counter()
            self._watch(Tick(model, sum(own.values()), now - last, is_crowded))
            last = now
        # The mean of the last ones, about.
        self._tick_seconds += (last - began - self._tick_seconds) / MEMORY_TICKS
        return last

    def _run_batch(self, model: Model, shares: dict[Sampling, int]) -> None:
        now = perf_counter()
        for sampling in shares:
            order = self._running[sampling]
            order.begun = order.begun or now
        self._predict(model, shares)

    def _predict(self, model: Model, shares: dict[Sampling, int]) -> None:
        """Take these rows through the model; a failure is that of the sampling it belongs to."""
        try:
            parts = [sampling.take(count) for sampling, count in shares.items()]
            batch = (torch.cat(rows) for rows in zip(*parts, strict=True))
            predictions = torch.split(model.network.predict(*batch), list(shares.values()))
        except Exception as error:
            if len(shares) > 1:
                for sampling, count in shares.items():
                    self._predict(model, {sampling: count})
                return
            log.warning("%s failed", model.label, exc_info=error)
            for sampling in shares:
                self._fail(sampling, PlanningError(f"{model.label} failed: {error}"))
            return
        for sampling, own in zip(shares, predictions, strict=True):
            try:
                sampling.give(own)
            except Exception as error:
                self._fail(sampling, error)
                continue
            if sampling.controls is not None:
                order = self._running.pop(sampling)
                assert order.begun is not None
                order.done.set_result((sampling.controls, order.begun))

    def _fail(self, sampling: Sampling, error: Exception) -> None:
        self._running.pop(sampling).done.set_exception(error)


def _use_no_threads_of_pytorch() -> None:
    """Leave the cores to the row threads; PyTorch's own wait spinning for its next operation."""
    torch.set_num_threads(1)
    # A thread's own number is settled when it is first asked for: now, not by whoever sets another.
    torch.get_num_threads()


class EngineProposal:
    """A `LearnedProposal`: one model of an engine, for one request.

    Args:
        engine: samples.
        model: that it samples from.
        job: whose work the samplings are.
        told: what the model is told of plants that may be the true one; None: nothing.
        keeps_steps: whether candidates come with every step of their denoising.
    """

    def __init__(
        self,
        engine: Engine,
        model: Model,
        job: Job,
        told: Told | None = None,
        *,
        keeps_steps: bool = False,
    ) -> None:
        self._engine = engine
        self._model = model
        self._job = job
        self._told = told
        self._keeps_steps = keeps_steps

    def begin(self, problem: Problem, noise: FloatArray, sampler: Sampler) -> Finish:
        """Begin to denoise `noise` (K, H) into controls (K, H); what returns them blocks until
        the engine is done.

        Raises:
            ValueError: the model does not cover the problem's plant and horizon.

        What is returned raises:
            InvalidStepCount: the model has fewer diffusion times than the sampler has steps.
            PlanningError: the network fails, or predicts what is not finite.
            Stopped: the job is not wanted any more.
        """
        if not self._model.covers(problem.system, problem.horizon):
            raise ValueError(
                f"the model was trained for another plant or horizon: {self._model.coverage}"
            )
        submitted = perf_counter()
        steps: list[FloatArray] = []
        record = steps.append if self._keeps_steps else None
        spread = self._told.spread if self._told else CERTAIN
        done = self._engine.submit(
            self._job,
            lambda: Sampling(self._job, self._model, problem, noise, sampler, record, spread),
        )

        def finish() -> Candidates:
            controls, begun = done.result()
            denoising = np.array(steps) if steps else None
            return Candidates(controls, (begun - submitted) * 1e3, denoising, self._told)

        return finish
