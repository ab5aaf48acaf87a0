"""What a planning method is, and what a learned proposal offers to one."""

from typing import Protocol

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.methods.sampler import Sampler
from app.planning.problem import Candidates, Cost, Problem
from app.planning.stop import NEVER, Stop


class Named(Protocol):
    """A method by name and options: what it costs may depend on a model."""

    @property
    def name(self) -> str: ...


class MethodOptions(Named, Protocol):
    """A method with nothing left open: what it costs is known, whether it can propose or not."""

    def cost(self, num_candidates: int) -> Cost:
        """Return what proposing takes."""
        ...


class Method(MethodOptions, Protocol):
    """Proposes candidate control sequences. An instance is a method with its options."""

    def propose(
        self, problem: Problem, num_candidates: int, rng: np.random.Generator, stop: Stop = NEVER
    ) -> Candidates:
        """Return controls of shape (num_candidates, problem.horizon); the planner clips them.

        Raises:
            Stopped: `stop` said so.
        """
        ...


class InvalidStepCount(ValueError):
    """The number of steps does not fit the number of diffusion times."""


class LearnedProposal(Protocol):
    """A generative model of control sequences, p_theta(u | x0, x*) (paper, Eq. 1)."""

    def sample(self, problem: Problem, noise: FloatArray, sampler: Sampler) -> Candidates:
        """Turn standard normal `noise` (K, H) into control sequences (K, H) for `problem`."""
        ...
