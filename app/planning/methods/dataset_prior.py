"""Random shooting from the prior of the training data (paper, Sect. 4.2), unconditioned."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from app.planning.options import Options
from app.planning.prior import ControlPrior
from app.planning.problem import Candidates, Cost, Problem
from app.planning.stop import NEVER, Stop


@dataclass(frozen=True, slots=True)
class DatasetPrior(Options):
    """Dataset-prior random shooting, with the prior that it draws from."""

    name: Literal["dataset_prior"] = "dataset_prior"
    prior: ControlPrior = field(default_factory=ControlPrior)

    def propose(
        self, problem: Problem, num_candidates: int, rng: np.random.Generator, stop: Stop = NEVER
    ) -> Candidates:
        """Draw (K, H) controls from the prior."""
        plant = problem.system.plant
        return Candidates(self.prior.sample(num_candidates, problem.horizon, plant, rng))

    def cost(self, num_candidates: int) -> Cost:
        """Sampling alone costs nothing that is counted."""
        return Cost()
