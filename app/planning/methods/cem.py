"""The Cross-Entropy Method (Rubinstein 1999; paper, Sect. 4.4), compiled from end to end."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from app.compilation import compiled
from app.planning.methods.base import LearnedProposal, check_initial_controls
from app.planning.options import OPTION_CHECKS, check_ranges
from app.planning.plant.system import FloatArray, Parameters, terminal_state
from app.planning.problem import Candidates, Cost, Problem
from app.planning.stop import NEVER, Flag, Stop


@dataclass(frozen=True, slots=True)
class CEM:
    """A Gaussian over control sequences, refitted to the elites of each iteration."""

    __pydantic_config__ = OPTION_CHECKS

    name: Literal["cem"] = "cem"
    iterations: Annotated[int, Ge(1), Le(1000)] = 40
    elite_fraction: Annotated[float, Gt(0), Le(1)] = 0.2
    """Share of the candidates that the Gaussian is refitted to; at least two of them."""
    initial_std: Annotated[float, Gt(0), Le(10)] = 1.5
    """Standard deviation of the first Gaussian, as a fraction of u_max; its mean is zero.

    Wide enough that half of the first controls are clipped to the limit: narrower ones seldom
    break away, and end worse at every K."""
    min_std: Annotated[float, Ge(0)] = 1e-3
    """Floor of the refitted standard deviation, m/s^2."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: an option is out of its range.
        """
        check_ranges(self)

    def propose(
        self,
        problem: Problem,
        num_candidates: int,
        rng: np.random.Generator,
        learned: LearnedProposal | None,
        stop: Stop = NEVER,
    ) -> Candidates:
        """Return the last population (K, H), with the best sequence of all iterations in it."""
        return self.improve(problem, num_candidates, rng, None, stop)

    def improve(
        self,
        problem: Problem,
        num_candidates: int,
        rng: np.random.Generator,
        initial_controls: FloatArray | None,
        stop: Stop = NEVER,
    ) -> Candidates:
        """Do as `propose` does, with `initial_controls` (K, H) for the first population, if given.

        Raises:
            ValueError: the initial controls are not of shape (K, H).
        """
        first = (
            np.empty((0, problem.horizon))
            if initial_controls is None
            else check_initial_controls(initial_controls, problem, num_candidates)
        )
        population = _optimise(
            rng,
            first,
            num_candidates,
            problem.horizon,
            problem.initial_state,
            problem.target_state,
            problem.system.parameters,
            self.iterations,
            min(num_candidates, max(2, int(self.elite_fraction * num_candidates))),
            float(self.initial_std),
            float(self.min_std),
            stop.flag,
        )
        stop.check()
        return Candidates(population)

    def cost(self, num_candidates: int) -> Cost:
        """One rollout for each candidate of each iteration."""
        return Cost(rollouts=self.iterations * num_candidates)


@compiled
def _optimise(
    rng: np.random.Generator,
    first: FloatArray,
    num_candidates: int,
    horizon: int,
    initial_state: FloatArray,
    target_state: FloatArray,
    parameters: Parameters,
    iterations: int,
    num_elites: int,
    initial_std: float,
    min_std: float,
    stopped: Flag,
) -> FloatArray:
    """Return the last population; the first is `first` (K, H), or drawn where that is (0, H)."""
    limit = parameters[3]
    population = np.empty((num_candidates, horizon))
    errors = np.empty(num_candidates)
    mean = np.zeros(horizon)
    std = np.full(horizon, initial_std * limit)
    best = np.zeros(horizon)
    best_error = np.inf
    for iteration in range(iterations):
        if stopped[0]:
            return population
        for candidate in range(num_candidates):
            if iteration == 0 and first.shape[0] > 0:
                population[candidate] = first[candidate]
            else:
                for k in range(horizon):
                    control = mean[k] + std[k] * rng.standard_normal()
                    population[candidate, k] = min(limit, max(-limit, control))
            p, v = terminal_state(
                population[candidate], initial_state[0], initial_state[1], parameters
            )
            errors[candidate] = math.hypot(p - target_state[0], v - target_state[1])
        order = np.argsort(errors)
        if errors[order[0]] < best_error:
            best_error = errors[order[0]]
            best[:] = population[order[0]]
        if iteration + 1 < iterations:
            _refit(population, order[:num_elites], mean, std, min_std)
    if best_error < errors[order[0]]:
        population[order[-1]] = best
    return population


@compiled
def _refit(
    population: FloatArray,
    elites: NDArray[np.int64],
    mean: FloatArray,
    std: FloatArray,
    min_std: float,
) -> None:
    """Set `mean` and `std` (H,) to those of the elites, the latter no smaller than `min_std`."""
    for k in range(mean.size):
        total = 0.0
        for elite in elites:
            total += population[elite, k]
        mean[k] = total / elites.size
        squares = 0.0
        for elite in elites:
            squares += (population[elite, k] - mean[k]) ** 2
        std[k] = max(min_std, math.sqrt(squares / elites.size))
