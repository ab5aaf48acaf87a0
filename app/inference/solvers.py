"""Solvers: generators that turn noise into control sequences over explicit timestep pairs.

They know neither networks nor guidance: a solver yields what it wants the noise of predicted, is
sent the prediction, and in the end returns the controls. Between two predictions it stands still,
so that whoever predicts may do so for many of them at once. A solver is the algorithm; the sampler
of a request is a solver with its number of steps and guidance, by name.
"""

import math
from collections.abc import Callable, Generator, Sequence
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np
import torch
from torch import Tensor

from app.planning.methods.base import InvalidStepCount

Steps: TypeAlias = Generator[tuple[Tensor, int], Tensor, Tensor]
"""Yields u_t (K, H) and t, is sent the predicted noise (K, H), returns the controls (K, H)."""
CLEAN = -1
"""The time after the last one, where no noise is left."""
MIDDLE = (0.7, 0.25)
"""Where `middle_times` begins and ends, as shares of T."""


def even_times(num_timesteps: int, steps: int) -> list[int]:
    """Return `steps` diffusion times, evenly spaced from T-1 down to 0, then `CLEAN`.

    Raises:
        InvalidStepCount: not 1 <= steps <= T.
    """
    return _times(num_timesteps - 1, 0, steps)


def middle_times(num_timesteps: int, steps: int) -> list[int]:
    """Return `steps` diffusion times, evenly spaced over the middle of the schedule, then `CLEAN`.

    The ends of a cosine schedule are not worth an evaluation. Near T there is hardly a signal: at
    T-1 an error in the predicted noise is amplified a hundredfold in the clean sequence, and
    clamping is all that holds it. Near 0 hardly any noise is left to remove.

    Raises:
        InvalidStepCount: there are fewer times than `steps` there, or none are asked for.
    """
    first, last = (min(round(share * num_timesteps), num_timesteps - 1) for share in MIDDLE)
    return _times(first, last, steps)


def _times(first: int, last: int, steps: int) -> list[int]:
    available = first - last + 1
    if not 1 <= steps <= available:
        raise InvalidStepCount(
            f"steps must be from 1 to {available}, the diffusion times that the model has for "
            "this sampler"
        )
    return [*np.linspace(first, last, steps).round().astype(int).tolist(), CLEAN]


def ddim(
    noise: Tensor,
    times: Sequence[int],
    alphas_cumprod: Sequence[float],
    bound: float = 1.0,
) -> Steps:
    """Deterministic DDIM (Song et al. 2021, Eq. 12 with sigma = 0; paper, Sect. 3.4).

    Args:
        noise: (K, H), standard normal.
        times: falling diffusion times, `CLEAN` last (see `even_times`).
        alphas_cumprod: cumulative products of alpha_t, one for each diffusion time.
        bound: the predicted clean sequence is clamped to [-bound, bound] at every step, and the
            noise derived from the clamped one.

    Returns:
        (K, H), within the bound.
    """
    u = noise
    for t, next_t in pairwise(times):
        level, next_level = (NoiseLevel.at(time, alphas_cumprod) for time in (t, next_t))
        clean = level.clean(u, (yield u, t), bound)
        u = level.step(u, clean, next_level)
    return u


def dpm_solver(
    noise: Tensor,
    times: Sequence[int],
    alphas_cumprod: Sequence[float],
    bound: float = 1.0,
) -> Steps:
    """DPM-Solver++ (2M), multistep, of second order (Lu et al. 2022, Algorithm 2).

    A DDIM step, but to a clean sequence that is extrapolated from this prediction and the one
    before. The first step has none before, and the last, which removes all noise, is of first
    order, too: there the extrapolation would weigh infinitely much.

    Arguments and result as for `ddim`; each predicted clean sequence is clamped to the bound.
    """
    u, previous_clean, previous_level = noise, None, None
    for t, next_t in pairwise(times):
        level, next_level = (NoiseLevel.at(time, alphas_cumprod) for time in (t, next_t))
        clean = extrapolated = level.clean(u, (yield u, t), bound)
        if previous_clean is not None and previous_level is not None and next_t != CLEAN:
            h = next_level.log_ratio - level.log_ratio
            previous_h = level.log_ratio - previous_level.log_ratio
            extrapolated = torch.lerp(previous_clean, clean, 1 + h / (2 * previous_h))
        u = level.step(u, extrapolated, next_level)
        previous_clean, previous_level = clean, level
    return u


class NoiseLevel(NamedTuple):
    """The shares of signal and noise in a sequence; their squares add up to one."""

    signal: float
    noise: float

    @classmethod
    def at(cls, t: int, alphas_cumprod: Sequence[float]) -> "NoiseLevel":
        """Return the level at a diffusion time, or at `CLEAN`."""
        alpha = 1.0 if t == CLEAN else alphas_cumprod[t]
        return cls(math.sqrt(alpha), math.sqrt(1 - alpha))

    @property
    def log_ratio(self) -> float:
        """Lambda: half the logarithm of the signal-to-noise ratio."""
        return math.log(self.signal / self.noise)

    def clean(self, u: Tensor, predicted_noise: Tensor, bound: float) -> Tensor:
        """Return the clean sequence that the noise was added to, by the prediction, clamped."""
        signal = torch.add(u, predicted_noise, alpha=-self.noise)
        return signal.div_(self.signal).clamp_(-bound, bound)

    def step(self, u: Tensor, clean: Tensor, level: "NoiseLevel") -> Tensor:
        """Go to another level: signal' clean + noise' (u - signal clean) / noise."""
        ratio = level.noise / self.noise
        return torch.mul(u, ratio).add_(clean, alpha=level.signal - ratio * self.signal)


class Solver(NamedTuple):
    """A way from noise to controls: where it asks for predictions, and what it makes of them."""

    times: Callable[[int, int], list[int]]
    """(T, steps) -> falling diffusion times, `CLEAN` last."""
    solve: Callable[[Tensor, Sequence[int], Sequence[float]], Steps]


SOLVERS = {
    "dpm_solver": Solver(middle_times, dpm_solver),
    "ddim": Solver(even_times, ddim),
}
