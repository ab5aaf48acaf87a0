"""iCEM (Pinneri et al. 2020, "Sample-efficient Cross-Entropy Method for Real-time Planning")."""

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Gt, Le, Lt

from app.planning.arrays import FloatArray
from app.planning.methods.optimiser import Optimiser, Scored, spread
from app.planning.problem import Cost, Problem


class Elites(NamedTuple):
    """A Gaussian over control sequences, and what it was fitted to."""

    mean: FloatArray
    """(H,)."""
    std: FloatArray
    """(H,)."""
    elites: Scored
    sizes: list[int]
    """How many sequences each iteration draws."""


@dataclass(frozen=True, slots=True)
class ICEM(Optimiser[Elites]):
    """The Cross-Entropy Method with coloured noise, kept elites and shrinking populations.

    Population decay, kept elites and momentum are the paper's, and so is trying the mean in the
    last iteration. Iterations, elites, noise exponent (0.25 to 3.5 in the paper, by task) and
    initial standard deviation (0.5 there) were measured to suit this plant. The paper's elites
    also move on from one control step to the next, shifted by a step: that is for receding
    horizons, and one open-loop plan has no next step.
    """

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

    def rounds(self) -> int:
        return self.iterations

    def begin(self, problem: Problem, num_candidates: int, first: FloatArray | None) -> Elites:
        """Begin with the mean and the standard deviation of the first population, if given."""
        if first is None:
            mean, std = np.zeros(problem.horizon), spread(problem, self.initial_std)
        else:
            mean, std = first.mean(axis=0), first.std(axis=0)
        sizes = self._population_sizes(num_candidates)
        return Elites(mean, std, Scored.none(problem.horizon), sizes)

    def draw(
        self, state: Elites, iteration: int, problem: Problem, rng: np.random.Generator
    ) -> FloatArray:
        noise = coloured_noise(rng, state.sizes[iteration], problem.horizon, self.noise_exponent)
        population = state.mean + state.std * noise
        if 0 < iteration == self.iterations - 1:
            population[0] = state.mean
        return population

    def learn(self, state: Elites, population: Scored) -> Elites:
        num_elites = self._num_elites(state.sizes[0])
        kept = state.elites.best(int(self.kept_elite_fraction * num_elites))
        elites = population.merged(kept).best(num_elites)
        mean = (1 - self.momentum) * elites.controls.mean(axis=0) + self.momentum * state.mean
        std = (1 - self.momentum) * elites.controls.std(axis=0) + self.momentum * state.std
        return Elites(mean, std, elites, state.sizes)

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
