"""What a planning method is, and what a learned proposal offers to one."""

from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias, runtime_checkable

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


@runtime_checkable
class Concurrent(Protocol):
    """A method that gains from proposing for several problems at once."""

    def propose_many(
        self,
        problems: Sequence[Problem],
        num_candidates: int,
        rngs: Sequence[np.random.Generator],
        stop: Stop = NEVER,
    ) -> list[Candidates]:
        """Return for each problem, with its own generator, what `Method.propose` returns."""
        ...


def propose_many(
    method: Method,
    problems: Sequence[Problem],
    num_candidates: int,
    rngs: Sequence[np.random.Generator],
    stop: Stop = NEVER,
) -> list[Candidates]:
    """Propose for each problem: all at once where the method can, or one after the other.

    Raises:
        Stopped: `stop` said so.
    """
    if isinstance(method, Concurrent):
        return method.propose_many(problems, num_candidates, rngs, stop)
    return [
        method.propose(problem, num_candidates, rng, stop)
        for problem, rng in zip(problems, rngs, strict=True)
    ]


class InvalidStepCount(ValueError):
    """The number of steps does not fit the number of diffusion times."""


Finish: TypeAlias = Callable[[], Candidates]
"""Waits for what was begun, and returns it."""


class LearnedProposal(Protocol):
    """A generative model of control sequences, p_theta(u | x0, x*) (paper, Eq. 1)."""

    def begin(self, problem: Problem, noise: FloatArray, sampler: Sampler) -> Finish:
        """Begin to turn standard normal `noise` (K, H) into controls (K, H) for `problem`."""
        ...
