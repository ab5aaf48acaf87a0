"""What a planning method and an optimiser are, and what a learned proposal offers to them.

The bookkeeping that optimisers share stands here too, no optimiser does.
"""

from typing import NamedTuple, Protocol

import numpy as np

from app.planning.metrics import terminal_error
from app.planning.plant.system import FloatArray, rollout
from app.planning.problem import Candidates, Cost, Problem
from app.planning.stop import NEVER, Stop


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
        stop: Stop = NEVER,
    ) -> Candidates:
        """Return controls of shape (num_candidates, problem.horizon); the planner clips them.

        Raises:
            Stopped: `stop` said so.
        """
        ...

    def cost(self, num_candidates: int) -> Cost:
        """Return what `propose` will take."""
        ...


class Optimiser(Method, Protocol):
    """A method that improves on a population: its own first draw, or one that it is given."""

    def improve(
        self,
        problem: Problem,
        num_candidates: int,
        rng: np.random.Generator,
        initial_controls: FloatArray | None,
        stop: Stop = NEVER,
    ) -> Candidates:
        """Return controls (K, H) no worse at best than `initial_controls` (K, H), m/s^2.

        These are the first population, in place of the first draw; None draws it. They lie within
        the control limits. `cost` is the same either way.

        Raises:
            Stopped: `stop` said so.
            ValueError: the initial controls are not of shape (K, H).
        """
        ...


class Scored(NamedTuple):
    """Control sequences (N, H) in m/s^2, and their terminal errors (N,) in m."""

    controls: FloatArray
    errors: FloatArray

    def with_(self, other: "Scored") -> "Scored":
        """Return these and the `other` sequences."""
        return Scored(
            np.concatenate([self.controls, other.controls]),
            np.concatenate([self.errors, other.errors]),
        )

    def best(self, count: int) -> "Scored":
        """Return the best `count` sequences (all, if they are fewer), the best first."""
        order = np.argsort(self.errors, kind="stable")[:count]
        return Scored(self.controls[order], self.errors[order])


def score(problem: Problem, controls: FloatArray) -> Scored:
    """Roll `controls` (N, H) out and measure how far from the target they end."""
    states = rollout(problem.system, problem.initial_state, controls)
    return Scored(controls, terminal_error(states[:, -1], problem.target_state))


def check_initial_controls(
    initial_controls: FloatArray, problem: Problem, num_candidates: int
) -> FloatArray:
    """Return `initial_controls` as contiguous float64.

    Raises:
        ValueError: not of shape (num_candidates, problem.horizon).
    """
    expected = (num_candidates, problem.horizon)
    if initial_controls.shape != expected:
        raise ValueError(f"the initial controls are {initial_controls.shape}, not {expected}")
    return np.ascontiguousarray(initial_controls, dtype=np.float64)
