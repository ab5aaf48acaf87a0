"""Uniform random shooting (paper, Sect. 1): every control uniform within the limits."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from app.planning.methods.base import LearnedProposal
from app.planning.options import OPTION_CHECKS
from app.planning.problem import Candidates, Cost, Problem
from app.planning.stop import NEVER, Stop


@dataclass(frozen=True, slots=True)
class Uniform:
    """Uniform random shooting; it has no options."""

    __pydantic_config__ = OPTION_CHECKS

    name: Literal["uniform"] = "uniform"

    def propose(
        self,
        problem: Problem,
        num_candidates: int,
        rng: np.random.Generator,
        learned: LearnedProposal | None,
        stop: Stop = NEVER,
    ) -> Candidates:
        """Draw (K, H) controls, independent and uniform on [-u_max, u_max]."""
        limit = problem.system.control_limit
        return Candidates(rng.uniform(-limit, limit, (num_candidates, problem.horizon)))

    def cost(self, num_candidates: int) -> Cost:
        """Sampling alone costs nothing that is counted."""
        return Cost()
