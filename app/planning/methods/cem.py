"""The Cross-Entropy Method (Rubinstein 1999; paper, Sect. 4.4), compiled from end to end."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Gt, Le

from app.compilation import compiled
from app.planning.arrays import FloatArray, IntArray, copy_into
from app.planning.methods.optimiser import Optimiser, Scored, check_first, spread
from app.planning.plant.rollout import terminal_state
from app.planning.plant.task import Task
from app.planning.problem import Candidates, Cost, Problem
from app.planning.stop import NEVER, Flag, Stop


class Gaussian(NamedTuple):
    """Over control sequences, its steps independent of each other."""

    mean: FloatArray
    """(H,)."""
    std: FloatArray
    """(H,)."""
    least_std: float
    num_candidates: int
    """How many are drawn from it."""


@dataclass(frozen=True, slots=True)
class CEM(Optimiser[Gaussian]):
    """A Gaussian over control sequences, refitted to the elites of each iteration."""

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

    def rounds(self) -> int:
        return self.iterations

    def begin(self, problem: Problem, num_candidates: int, first: FloatArray | None) -> Gaussian:
        std = spread(problem, self.initial_std)
        return Gaussian(np.zeros(problem.horizon), std, self._least_std(problem), num_candidates)

    def draw(
        self, state: Gaussian, iteration: int, problem: Problem, rng: np.random.Generator
    ) -> FloatArray:
        noise = rng.standard_normal((state.num_candidates, problem.horizon))
        return state.mean + state.std * noise

    def learn(self, state: Gaussian, population: Scored) -> Gaussian:
        elites = population.best(self._num_elites(len(population.errors))).controls
        std = np.maximum(elites.std(axis=0), state.least_std)
        return state._replace(mean=elites.mean(axis=0), std=std)

    def candidates(self, best: Scored, last: Scored) -> FloatArray:
        """Return the last population, its worst sequence replaced by a better one of before."""
        population = last.controls.copy()
        if best.errors[0] < last.errors.min():
            population[np.argmax(last.errors)] = best.controls[0]
        return population

    def improve(
        self,
        problem: Problem,
        num_candidates: int,
        rng: np.random.Generator,
        first: FloatArray | None,
        stop: Stop = NEVER,
    ) -> Candidates:
        """Do what the loop of all optimisers does, in one kernel: the same draws, much sooner."""
        check_first(first, problem, num_candidates)
        population = _optimise(
            rng,
            np.empty((num_candidates, problem.horizon)) if first is None else first.copy(),
            first is not None,
            problem.task,
            self.iterations,
            self._num_elites(num_candidates),
            spread(problem, self.initial_std),
            self._least_std(problem),
            stop.flag,
        )
        stop.check()
        return Candidates(population)

    def cost(self, num_candidates: int) -> Cost:
        """One rollout for each candidate of each iteration."""
        return Cost(rollouts=self.iterations * num_candidates)

    def _least_std(self, problem: Problem) -> float:
        """Return the floor of the standard deviation, in units of control."""
        return float(self.min_std / problem.system.control_gain)

    def _num_elites(self, num_candidates: int) -> int:
        return min(num_candidates, max(2, int(self.elite_fraction * num_candidates)))


@compiled
def _optimise(
    rng: np.random.Generator,
    population: FloatArray,
    is_first_given: bool,
    task: Task,
    iterations: int,
    num_elites: int,
    std: FloatArray,
    least_std: float,
    stopped: Flag,
) -> FloatArray:
    """Return the last population; `population` (K, H) is overwritten, and may be the first one."""
    plant = task.plant
    num_candidates, horizon = population.shape
    errors = np.empty(num_candidates)
    mean = np.zeros(horizon)
    best = np.zeros(horizon)
    best_error = np.inf
    order = np.argsort(errors)
    for iteration in range(iterations):
        if stopped[0]:
            return population
        if iteration > 0 or not is_first_given:
            for candidate in range(num_candidates):
                for k in range(horizon):
                    control = mean[k] + std[k] * rng.standard_normal()
                    control = min(plant.highest_control, max(plant.lowest_control, control))
                    population[candidate, k] = control
        for candidate in range(num_candidates):
            p, v = terminal_state(population[candidate], task.position, task.velocity, plant)
            errors[candidate] = math.hypot(p - task.target_position, v - task.target_velocity)
        order = np.argsort(errors)
        if errors[order[0]] < best_error:
            best_error = errors[order[0]]
            copy_into(best, population[order[0]])
        if iteration + 1 < iterations:
            _refit(population, order[:num_elites], mean, std, least_std)
    if best_error < errors[order[0]]:
        copy_into(population[order[-1]], best)
    return population


@compiled
def _refit(
    population: FloatArray, elites: IntArray, mean: FloatArray, std: FloatArray, least_std: float
) -> None:
    """Set `mean` and `std` (H,) to those of the elites, the latter no smaller than `least_std`."""
    for k in range(mean.size):
        total = 0.0
        for elite in elites:
            total += population[elite, k]
        mean[k] = total / elites.size
        squares = 0.0
        for elite in elites:
            squares += (population[elite, k] - mean[k]) ** 2
        std[k] = max(least_std, math.sqrt(squares / elites.size))
