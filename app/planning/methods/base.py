"""What a planning method is, and what a learned proposal offers to one."""

from typing import Protocol

import numpy as np

from app.planning.problem import Candidates, Cost, Problem
from app.planning.system import FloatArray


class LearnedProposal(Protocol):
    """A generative model of control sequences, p_theta(u | x0, x*) (paper, Eq. 1)."""

    def sample(
        self,
        problem: Problem,
        noise: FloatArray,
        sampler: str,
        steps: int,
        guidance_scale: float,
    ) -> Candidates:
        """Turn standard normal `noise` (K, H) into control sequences (K, H) for `problem`."""
        ...


class Method(Protocol):
    """Proposes candidate control sequences. An instance is a method with its options."""

    @property
    def name(self) -> str: ...

    def propose(
        self,
        problem: Problem,
        num_candidates: int,
        rng: np.random.Generator,
        learned: LearnedProposal | None,
    ) -> Candidates:
        """Return controls of shape (num_candidates, problem.horizon); the planner clips them."""
        ...

    def cost(self, num_candidates: int) -> Cost:
        """Return what `propose` will take."""
        ...
