"""Warm starts: any optimiser, begun from what another method proposes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from app.planning.methods.base import Method, MethodOptions, Named, propose_many
from app.planning.methods.optimiser import Optimiser
from app.planning.problem import Candidates, Cost, PlanningError, Problem
from app.planning.stop import NEVER, Stop

Initial_co = TypeVar("Initial_co", bound=Named, covariant=True)


@dataclass(frozen=True, slots=True)
class WarmStarted(Generic[Initial_co]):
    """`optimiser` with the candidates of `initial` for its first population."""

    optimiser: Optimiser[Any]
    initial: Initial_co

    @property
    def name(self) -> str:
        """The optimiser's: it is what plans."""
        return self.optimiser.name

    def propose(
        self: "WarmStarted[Method]",
        problem: Problem,
        num_candidates: int,
        rng: np.random.Generator,
        stop: Stop = NEVER,
    ) -> Candidates:
        """Return the optimiser's candidates (K, H), the best no worse than any initial one.

        Raises:
            PlanningError: the initial method proposed controls that are not finite.
            ValueError: it proposed another shape.
        """
        return self.propose_many([problem], num_candidates, [rng], stop)[0]

    def propose_many(
        self: "WarmStarted[Method]",
        problems: Sequence[Problem],
        num_candidates: int,
        rngs: Sequence[np.random.Generator],
        stop: Stop = NEVER,
    ) -> list[Candidates]:
        """Do the same for several problems; errors as for `propose`."""
        first = propose_many(self.initial, problems, num_candidates, rngs, stop)
        return [
            self._improved(problem, initial, num_candidates, rng, stop)
            for problem, initial, rng in zip(problems, first, rngs, strict=True)
        ]

    def _improved(
        self: "WarmStarted[Method]",
        problem: Problem,
        initial: Candidates,
        num_candidates: int,
        rng: np.random.Generator,
        stop: Stop,
    ) -> Candidates:
        if not np.all(np.isfinite(initial.controls)):
            raise PlanningError(f"{self.initial.name} proposed controls that are not finite")
        plant = problem.system.plant
        controls = initial.controls.clip(plant.lowest_control, plant.highest_control)
        improved = self.optimiser.improve(problem, num_candidates, rng, controls, stop)
        return Candidates(improved.controls, initial.queue_ms + improved.queue_ms)

    def cost(self: "WarmStarted[MethodOptions]", num_candidates: int) -> Cost:
        """What both take: the initial candidates are rolled out as the first population is."""
        return self.initial.cost(num_candidates) + self.optimiser.cost(num_candidates)
