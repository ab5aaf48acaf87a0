"""Uniform random shooting (paper, Sect. 1): every control uniform within the limits."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from app.planning.options import Options
from app.planning.problem import Candidates, Cost, Problem
from app.planning.stop import NEVER, Stop


@dataclass(frozen=True, slots=True)
class Uniform(Options):
    """Uniform random shooting; it has no options."""

    name: Literal["uniform"] = "uniform"

    def propose(
        self, problem: Problem, num_candidates: int, rng: np.random.Generator, stop: Stop = NEVER
    ) -> Candidates:
        """Draw (K, H) controls, independent and uniform within the limits."""
        plant = problem.system.plant
        shape = (num_candidates, problem.horizon)
        return Candidates(rng.uniform(plant.lowest_control, plant.highest_control, shape))

    def cost(self, num_candidates: int) -> Cost:
        """Sampling alone costs nothing that is counted."""
        return Cost()
