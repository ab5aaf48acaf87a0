"""The loop that all optimisers share: draw a population, score it, learn from it, again.

An optimiser says how to begin, what to draw and what to learn; clipping, scoring, the best of all
iterations and the stop are settled here.
"""

from abc import ABC, abstractmethod
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.metrics import terminal_error
from app.planning.options import Options
from app.planning.plant.rollout import rollout
from app.planning.problem import Candidates, Cost, Problem
from app.planning.stop import NEVER, Stop

State = TypeVar("State")
"""What an optimiser knows between two iterations; a value that nothing changes."""


class Scored(NamedTuple):
    """Control sequences (N, H) and their terminal errors (N,) in m."""

    controls: FloatArray
    errors: FloatArray

    @classmethod
    def none(cls, horizon: int) -> "Scored":
        """Return no sequences of that horizon."""
        return cls(np.empty((0, horizon)), np.empty(0))

    def merged(self, other: "Scored") -> "Scored":
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


class Optimiser(Options, ABC, Generic[State]):
    """A method that improves on a population: its own first draw, or one that it is given."""

    __slots__ = ()

    @property
    @abstractmethod
    def name(self) -> str: ...

    @abstractmethod
    def cost(self, num_candidates: int) -> Cost:
        """Return what `propose` takes, and `improve` as well."""

    @abstractmethod
    def rounds(self) -> int:
        """Return how many populations are drawn."""

    @abstractmethod
    def begin(self, problem: Problem, num_candidates: int, first: FloatArray | None) -> State:
        """Return the state before the first population, which may be given: `first` (K, H)."""

    @abstractmethod
    def draw(
        self, state: State, iteration: int, problem: Problem, rng: np.random.Generator
    ) -> FloatArray:
        """Return the population (N, H) of an iteration; it is clipped afterwards."""

    @abstractmethod
    def learn(self, state: State, population: Scored) -> State:
        """Return the state after an iteration."""

    def candidates(self, best: Scored, last: Scored) -> FloatArray:
        """Return what is proposed (K, H): by default the best K of all iterations.

        Args:
            best: of all iterations, (K, H), the best first.
            last: the last population.
        """
        return best.controls

    def propose(
        self, problem: Problem, num_candidates: int, rng: np.random.Generator, stop: Stop = NEVER
    ) -> Candidates:
        """Return candidates (K, H), the best sequence of all iterations among them.

        Raises:
            Stopped: `stop` said so.
        """
        return self.improve(problem, num_candidates, rng, None, stop)

    def improve(
        self,
        problem: Problem,
        num_candidates: int,
        rng: np.random.Generator,
        first: FloatArray | None,
        stop: Stop = NEVER,
    ) -> Candidates:
        """Do as `propose` does, from a `first` population (K, H), if one is given.

        It lies within the control limits, and nothing that is returned is worse at best.

        Raises:
            Stopped: `stop` said so.
            ValueError: the first population is not of shape (K, H).
        """
        check_first(first, problem, num_candidates)
        plant = problem.system.plant
        state = self.begin(problem, num_candidates, first)
        best = last = Scored.none(problem.horizon)
        for iteration in range(self.rounds()):
            stop.check()
            if first is not None and iteration == 0:
                population = first
            else:
                population = self.draw(state, iteration, problem, rng)
            stop.check()
            last = score(problem, population.clip(plant.lowest_control, plant.highest_control))
            best = best.merged(last).best(num_candidates)
            state = self.learn(state, last)
        return Candidates(self.candidates(best, last))


def check_first(first: FloatArray | None, problem: Problem, num_candidates: int) -> None:
    """Check the shape of a first population.

    Raises:
        ValueError: it is not of shape (num_candidates, problem.horizon).
    """
    expected = (num_candidates, problem.horizon)
    if first is not None and first.shape != expected:
        raise ValueError(f"the first population is {first.shape}, not {expected}")


def spread(problem: Problem, fraction: float) -> FloatArray:
    """Return a standard deviation for each step (H,), as a fraction of half the control range."""
    plant = problem.system.plant
    half_range = 0.5 * (plant.highest_control - plant.lowest_control)
    return np.full(problem.horizon, fraction * half_range)
