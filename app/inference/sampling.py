"""One sampling on its way through the network: rows that wait for a prediction, step after step.

Prepare, step, finish: a sampling does not run the network. Whoever does may take any number of the
rows that wait, beside rows of other samplings.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from app.inference.job import Job
from app.inference.model import Model
from app.inference.solvers import SOLVERS
from app.planning.arrays import FloatArray
from app.planning.methods.sampler import Sampler
from app.planning.plant.natural_units import natural_units
from app.planning.plant.spread import CERTAIN, Spread
from app.planning.problem import PlanningError, Problem


class Rows(NamedTuple):
    """Rows of a batch: the arguments of `Network.predict`."""

    u_t: Tensor
    """(B, H)."""
    times: Tensor
    """(B,) int64."""
    embedding: Tensor
    """(B, E)."""


class Sampling:
    """Controls in the making, with classifier-free guidance (Ho and Salimans 2022; paper, Eq. 4).

    The unconditional and the conditional prediction of a candidate are rows like others; where the
    guidance scale leaves only one of them (0 or 1), the other is not asked for.

    Args:
        job: whose work this is.
        model: predicts.
        problem: start and target.
        noise: (K, H), standard normal; a regression has no use for it.
        sampler: solver, steps and guidance.
        record: called with the controls (K, H), in units of control, before the first step and
            after each.
        spread: by how much the plant may be off.

    Raises:
        InvalidStepCount: the model has fewer diffusion times than the sampler has steps.
    """

    def __init__(
        self,
        job: Job,
        model: Model,
        problem: Problem,
        noise: FloatArray,
        sampler: Sampler,
        record: Callable[[FloatArray], None] | None = None,
        spread: Spread = CERTAIN,
    ) -> None:
        self.job = job
        self._record = record
        self.model = model
        settings, manifest = sampler.settings, model.manifest
        self._guidance_scale = settings.guidance_scale
        self._units = natural_units(problem.system.plant)
        start = torch.tensor(noise, dtype=torch.float32, device=model.device)
        self._steps = SOLVERS[sampler.solver](
            start.zero_() if manifest.kind == "regression" else start,
            manifest.times(settings),
            model.noise_levels,
            manifest.predicts,
        )
        conditional, unconditional = model.network.embed(model.condition(problem, spread))
        needed = {0.0: [unconditional], 1.0: [conditional]}
        self._embeddings = torch.stack(
            needed.get(self._guidance_scale, [unconditional, conditional])
        )
        self._u_t, self._time = next(self._steps)
        if record:
            record(self._in_units(self._u_t))
        num_rows = len(self._embeddings) * len(noise)
        # Row r belongs to candidate r % K and to embedding r // K.
        self._predictions = self._u_t.new_empty(num_rows, self._u_t.shape[1])
        self._predicted = 0
        self.controls: FloatArray | None = None
        """(K, H) in units of control, once they are done."""

    @property
    def rows_waiting(self) -> int:
        """How many rows of this step are not predicted yet."""
        return len(self._predictions) - self._predicted

    def ticks_left(self, budget: int) -> float:
        """Return in how many ticks at least the job's rows can go, with `budget` rows of each.

        No tick takes more of them than one step has.
        """
        return self.job.rows_left / min(budget, len(self._predictions))

    def take(self, count: int) -> Rows:
        """Return the next `count` rows."""
        device = self._u_t.device
        rows = torch.arange(self._predicted, self._predicted + count, device=device)
        return Rows(
            self._u_t[rows % len(self._u_t)],
            torch.full((count,), self._time, dtype=torch.int64, device=device),
            self._embeddings[rows // len(self._u_t)],
        )

    def give(self, predictions: Tensor) -> None:
        """Take the predictions (N, H) of the rows taken last; after the step's last ones, go on.

        Raises:
            PlanningError: they are not finite.
        """
        if not torch.isfinite(predictions).all():
            raise PlanningError(f"{self.model.label} predicts what is not finite")
        count = len(predictions)
        self._predictions[self._predicted : self._predicted + count] = predictions
        self._predicted += count
        self.job.rows_left -= count
        if not self.rows_waiting:
            self._step()

    def _step(self) -> None:
        predicted = self._predictions
        if len(self._embeddings) > 1:
            without, with_condition = predicted.chunk(2)
            predicted = torch.lerp(without, with_condition, self._guidance_scale)
        try:
            self._u_t, self._time = self._steps.send(predicted)
        except StopIteration as done:
            self.controls = self._in_units(done.value)
        else:
            self._predicted = 0
        if self._record:
            self._record(self._in_units(self._u_t) if self.controls is None else self.controls)

    def _in_units(self, controls: Tensor) -> FloatArray:
        middle, half, *_ = self._units
        return middle + half * controls.cpu().numpy().astype(np.float64)


@torch.inference_mode()
def sample_alone(
    model: Model,
    problem: Problem,
    noise: FloatArray,
    sampler: Sampler,
) -> FloatArray:
    """Return the controls (K, H), in units of control, of a sampling without an engine.

    Arguments and errors as for `Sampling`; what the network raises as it is.
    """
    sampling = Sampling(Job(rows_left=0), model, problem, noise, sampler)
    while sampling.controls is None:
        sampling.give(model.network.predict(*sampling.take(sampling.rows_waiting)))
    return sampling.controls
