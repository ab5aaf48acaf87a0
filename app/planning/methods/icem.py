"""iCEM (Pinneri et al. 2020, "Sample-efficient Cross-Entropy Method for Real-time Planning")."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Lt

from app.planning.methods.base import LearnedProposal, check_initial_controls, score
from app.planning.options import OPTION_CHECKS, check_ranges
from app.planning.plant.system import FloatArray
from app.planning.problem import Candidates, Cost, Problem
from app.planning.stop import NEVER, Stop


@dataclass(frozen=True, slots=True)
class ICEM:
    """The Cross-Entropy Method with coloured noise, kept elites and shrinking populations.

    Population decay, kept elites and momentum are the paper's, and so is trying the mean in the
    last iteration. Iterations, elites, noise exponent (0.25 to 3.5 in the paper, by task) and
    initial standard deviation (0.5 there) were measured to suit this plant. The paper's elites
    also move on from one control step to the next, shifted by a step: that is for receding
    horizons, and one open-loop plan has no next step.
    """

    __pydantic_config__ = OPTION_CHECKS

    name: Literal["icem"] = "icem"
    iterations: Annotated[int, Ge(1), Le(1000)] = 40
    elite_fraction: Annotated[float, Gt(0), Le(0.5)] = 0.2
    """Share of the candidates that the Gaussian is refitted to; at least two of them."""
    noise_exponent: Annotated[float, Ge(0), Le(10)] = 2.0
    """beta: the power spectrum of the noise over time falls as 1/f^beta; 0 is white."""
    population_decay: Annotated[float, Ge(1), Le(10)] = 1.25
    """gamma: iteration i draws K * gamma^-i sequences, but no fewer than two for each elite."""
    kept_elite_fraction: Annotated[float, Ge(0), Le(1)] = 0.3
    """Share of the elites that compete again in the next iteration."""
    momentum: Annotated[float, Ge(0), Lt(1)] = 0.1
    """alpha: what the refitted mean and standard deviation keep of those before."""
    initial_std: Annotated[float, Gt(0), Le(10)] = 1.5
    """Standard deviation of the first Gaussian, as a fraction of u_max; its mean is zero."""

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
        """Return the best K sequences (K, H) of all iterations, the best first."""
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

        The momentum of the first refit is then that of their own mean and standard deviation.

        Raises:
            ValueError: the initial controls are not of shape (K, H).
        """
        limit, horizon = problem.system.control_limit, problem.horizon
        sizes, num_elites = self._population_sizes(num_candidates), self._num_elites(num_candidates)
        mean, std = np.zeros(horizon), np.full(horizon, self.initial_std * limit)
        if initial_controls is None:
            population = _draw(rng, sizes[0], mean, std, self.noise_exponent, limit)
        else:
            population = check_initial_controls(initial_controls, problem, num_candidates)
            mean, std = population.mean(axis=0), population.std(axis=0)
        scored = score(problem, population)
        seen, elites = scored.best(num_candidates), scored.best(num_elites)
        for iteration, size in enumerate(sizes[1:], start=1):
            stop.check()
            mean = (1 - self.momentum) * elites.controls.mean(axis=0) + self.momentum * mean
            std = (1 - self.momentum) * elites.controls.std(axis=0) + self.momentum * std
            population = _draw(rng, size, mean, std, self.noise_exponent, limit)
            if iteration == self.iterations - 1:
                population[0] = mean
            stop.check()
            scored = score(problem, population)
            seen = seen.with_(scored).best(num_candidates)
            kept = elites.best(int(self.kept_elite_fraction * num_elites))
            elites = scored.with_(kept).best(num_elites)
        return Candidates(seen.controls)

    def cost(self, num_candidates: int) -> Cost:
        """One rollout for each sequence drawn; those of kept elites are known."""
        return Cost(rollouts=sum(self._population_sizes(num_candidates)))

    def _num_elites(self, num_candidates: int) -> int:
        return min(num_candidates, max(2, int(self.elite_fraction * num_candidates)))

    def _population_sizes(self, num_candidates: int) -> list[int]:
        """Return how many sequences each iteration draws: N_i of the paper, and never above K."""
        least = min(num_candidates, 2 * self._num_elites(num_candidates))
        return [
            max(least, int(num_candidates * self.population_decay**-iteration))
            for iteration in range(self.iterations)
        ]


def _draw(
    rng: np.random.Generator,
    count: int,
    mean: FloatArray,
    std: FloatArray,
    noise_exponent: float,
    limit: float,
) -> FloatArray:
    """Return (count, H) sequences around `mean` (H,) with `std` (H,), clipped to the limits."""
    noise = coloured_noise(rng, count, mean.size, noise_exponent)
    return np.clip(mean + std * noise, -limit, limit)


def coloured_noise(
    rng: np.random.Generator, count: int, horizon: int, exponent: float
) -> FloatArray:
    """Draw (count, horizon) Gaussian noise whose power spectrum falls as 1/f^exponent.

    White noise filtered over the horizon as over a ring, so that every step has variance 1 exactly.
    The constant component has the power of the slowest wave, where the law itself has a pole.
    """
    wave_numbers = np.maximum(1, np.arange(horizon // 2 + 1))
    gain = wave_numbers ** (-exponent / 2)
    gain /= np.linalg.norm(np.fft.irfft(gain, horizon))
    white = rng.standard_normal((count, horizon))
    return np.fft.irfft(gain * np.fft.rfft(white), horizon)
