"""Warm starts: any optimiser, begun from what another method proposes."""

from dataclasses import dataclass

import numpy as np

from app.planning.methods.base import LearnedProposal, Method, Optimiser
from app.planning.problem import Candidates, Cost, PlanningError, Problem
from app.planning.stop import NEVER, Stop


@dataclass(frozen=True, slots=True)
class Started:
    """`optimiser` with the candidates of `initial` for its first population."""

    optimiser: Optimiser
    initial: Method

    @property
    def name(self) -> str:
        """The optimiser's: it is what plans."""
        return self.optimiser.name

    def propose(
        self,
        problem: Problem,
        num_candidates: int,
        rng: np.random.Generator,
        learned: LearnedProposal | None,
        stop: Stop = NEVER,
    ) -> Candidates:
        """Return the optimiser's candidates (K, H), the best no worse than any initial one.

        Raises:
            PlanningError: the initial method proposed controls that are not finite.
            ValueError: it needs a learned proposal and was given none, or proposed another shape.
        """
        initial = self.initial.propose(problem, num_candidates, rng, learned, stop)
        if not np.all(np.isfinite(initial.controls)):
            raise PlanningError(f"{self.initial.name} proposed controls that are not finite")
        limit = problem.system.control_limit
        controls = np.clip(initial.controls, -limit, limit)
        improved = self.optimiser.improve(problem, num_candidates, rng, controls, stop)
        return Candidates(improved.controls, initial.queue_ms + improved.queue_ms)

    def cost(self, num_candidates: int) -> Cost:
        """What both take: the initial candidates are rolled out as the first population is."""
        return self.initial.cost(num_candidates) + self.optimiser.cost(num_candidates)
