"""MPPI (Williams et al. 2017, "Information Theoretic MPC for Model-Based Reinforcement Learning").

One open-loop plan of it: the nominal sequence is improved in place and never shifted in time, and
the cost of a sample is its terminal error alone.
"""

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Gt, Le

from app.planning.arrays import FloatArray
from app.planning.methods.icem import coloured_noise
from app.planning.methods.optimiser import Optimiser, Scored, spread
from app.planning.problem import Cost, Problem


class Nominal(NamedTuple):
    """The sequence that is improved, and within what."""

    controls: FloatArray
    """(H,)."""
    lowest: float
    highest: float
    num_candidates: int


@dataclass(frozen=True, slots=True)
class MPPI(Optimiser[Nominal]):
    """Model predictive path integral: a nominal sequence, moved to the weighted mean of samples.

    The update and the smoothing on request are the paper's. Its noise is white, which averages out
    below static friction; the coloured noise is that of Vlahov et al. 2024 ("Low Frequency
    Sampling in Model Predictive Path Integral Control"). The paper sets no defaults: these were
    measured to suit this plant.
    """

    name: Literal["mppi"] = "mppi"
    iterations: Annotated[int, Ge(1), Le(1000)] = 40
    noise_std: Annotated[float, Gt(0), Le(10)] = 1.0
    """Standard deviation of the noise around the nominal sequence, as a fraction of u_max."""
    noise_exponent: Annotated[float, Ge(0), Le(10)] = 2.0
    """beta: the power spectrum of the noise over time falls as 1/f^beta; 0 is white."""
    temperature: Annotated[float, Ge(1e-9), Le(1e6)] = 1e-3
    """lambda, m: a sample that ends this much further off weighs e times less."""
    smoothing_window: Annotated[int, Ge(1), Le(1023)] = 1
    """Steps of the moving average over each update of the nominal sequence, odd; 1 is none."""

    def check_combination(self) -> None:
        """Check what the range does not say.

        Raises:
            ValueError: the smoothing window is even.
        """
        if self.smoothing_window % 2 == 0:
            raise ValueError("smoothing_window must be odd")

    def rounds(self) -> int:
        """Return one more than the iterations: the last nominal sequence is rolled out, too."""
        return self.iterations + 1

    def begin(self, problem: Problem, num_candidates: int, first: FloatArray | None) -> Nominal:
        """Begin with the mean of the first samples, if given, else with zero."""
        controls = np.zeros(problem.horizon) if first is None else first.mean(axis=0)
        plant = problem.system.plant
        return Nominal(controls, plant.lowest_control, plant.highest_control, num_candidates)

    def draw(
        self, state: Nominal, iteration: int, problem: Problem, rng: np.random.Generator
    ) -> FloatArray:
        if iteration == self.iterations:
            return state.controls[None]
        noise = coloured_noise(rng, state.num_candidates, problem.horizon, self.noise_exponent)
        return state.controls + spread(problem, self.noise_std) * noise

    def learn(self, state: Nominal, population: Scored) -> Nominal:
        weights = path_integral_weights(population.errors, self.temperature)
        update = weights @ population.controls - state.controls
        controls = state.controls + moving_average(update, self.smoothing_window)
        return state._replace(controls=controls.clip(state.lowest, state.highest))

    def cost(self, num_candidates: int) -> Cost:
        """One rollout for each sample of each iteration, and one of the last nominal sequence."""
        return Cost(rollouts=self.iterations * num_candidates + 1)


def path_integral_weights(errors: FloatArray, temperature: float) -> FloatArray:
    """Return the weights (K,) of samples with `errors` (K,) m: their softmax, summing to one."""
    weights = np.exp(-(errors - errors.min()) / temperature)
    return np.asarray(weights / weights.sum())


def moving_average(values: FloatArray, window: int) -> FloatArray:
    """Return the mean (H,) of the odd `window` around each of `values` (H,), the ends repeated."""
    padded = np.pad(values, window // 2, mode="edge")
    return np.convolve(padded, np.full(window, 1 / window), mode="valid")
