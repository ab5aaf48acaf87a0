"""MPPI (Williams et al. 2017, "Information Theoretic MPC for Model-Based Reinforcement Learning").

One open-loop plan of it: the nominal sequence is improved in place and never shifted in time, and
the cost of a sample is its terminal error alone.
"""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le

from app.planning.methods.base import LearnedProposal, check_initial_controls, score
from app.planning.methods.icem import coloured_noise
from app.planning.options import OPTION_CHECKS, check_ranges
from app.planning.plant.system import FloatArray
from app.planning.problem import Candidates, Cost, Problem
from app.planning.stop import NEVER, Stop


@dataclass(frozen=True, slots=True)
class MPPI:
    """Model predictive path integral: a nominal sequence, moved to the weighted mean of samples.

    The update and the smoothing on request are the paper's. Its noise is white, which averages out
    below static friction; the coloured noise is that of Vlahov et al. 2024 ("Low Frequency
    Sampling in Model Predictive Path Integral Control"). The paper sets no defaults: these were
    measured to suit this plant.
    """

    __pydantic_config__ = OPTION_CHECKS

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

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: an option is out of its range, or the smoothing window is even.
        """
        check_ranges(self)
        if self.smoothing_window % 2 == 0:
            raise ValueError("smoothing_window must be odd")

    def propose(
        self,
        problem: Problem,
        num_candidates: int,
        rng: np.random.Generator,
        learned: LearnedProposal | None,
        stop: Stop = NEVER,
    ) -> Candidates:
        """Return the best K (K, H) of all samples and the last nominal sequence, best first."""
        return self.improve(problem, num_candidates, rng, None, stop)

    def improve(
        self,
        problem: Problem,
        num_candidates: int,
        rng: np.random.Generator,
        initial_controls: FloatArray | None,
        stop: Stop = NEVER,
    ) -> Candidates:
        """Do as `propose` does, with `initial_controls` (K, H) for the first samples, if given.

        Their mean is then the first nominal sequence, else zero.

        Raises:
            ValueError: the initial controls are not of shape (K, H).
        """
        limit = problem.system.control_limit
        nominal = np.zeros(problem.horizon)
        first = None
        if initial_controls is not None:
            first = check_initial_controls(initial_controls, problem, num_candidates)
            nominal = first.mean(axis=0)
        seen = score(problem, np.empty((0, problem.horizon)))
        for iteration in range(self.iterations):
            stop.check()
            if first is not None and iteration == 0:
                samples = first
            else:
                noise = coloured_noise(rng, num_candidates, problem.horizon, self.noise_exponent)
                samples = np.clip(nominal + self.noise_std * limit * noise, -limit, limit)
            stop.check()
            scored = score(problem, samples)
            seen = seen.with_(scored).best(num_candidates)
            update = path_integral_weights(scored.errors, self.temperature) @ samples - nominal
            nominal = nominal + moving_average(update, self.smoothing_window)
            nominal = np.clip(nominal, -limit, limit)
        last = score(problem, nominal[None])
        return Candidates(seen.with_(last).best(num_candidates).controls)

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
