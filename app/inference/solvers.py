"""Solvers: generators that turn noise into control sequences over explicit timestep pairs.

They know neither networks nor guidance: a solver yields what it wants a prediction of, is sent the
prediction, and in the end returns the controls. Between two predictions it stands still, so that
whoever predicts may do so for many of them at once. A solver is the algorithm; the sampler of a
request is a solver with its number of steps, times and guidance.
"""

from collections.abc import Callable, Generator, Sequence
from itertools import pairwise
from typing import TypeAlias

import torch
from torch import Tensor

from app.inference.diffusion_times import CLEAN
from app.inference.manifest import Prediction
from app.inference.noise_levels import NoiseLevel

Steps: TypeAlias = Generator[tuple[Tensor, int], Tensor, Tensor]
"""Yields u_t (K, H) and t, is sent the prediction (K, H), returns the controls (K, H)."""


def ddim(
    noise: Tensor,
    times: Sequence[int],
    levels: Sequence[NoiseLevel],
    predicts: Prediction,
    bound: float = 1.0,
) -> Steps:
    """Deterministic DDIM (Song et al. 2021, Eq. 12 with sigma = 0; paper, Sect. 3.4).

    On the straight paths of a flow it is Euler's method: u' = u + (noise' - noise) velocity.

    Args:
        noise: (K, H), standard normal.
        times: falling diffusion times, `CLEAN` last (see `diffusion_times`).
        levels: one for each diffusion time, and last that at `CLEAN` (see `noise_levels`).
        predicts: what is sent.
        bound: the predicted clean sequence is clamped to [-bound, bound] at every step, and the
            noise derived from the clamped one.

    Returns:
        (K, H), within the bound.
    """
    u = noise
    for t, next_t in pairwise(times):
        level, next_level = levels[t], levels[next_t]
        clean = _clean(level, u, (yield u, t), predicts).clamp(-bound, bound)
        u = _step(level, u, clean, next_level)
    return u


def dpm_solver(
    noise: Tensor,
    times: Sequence[int],
    levels: Sequence[NoiseLevel],
    predicts: Prediction,
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
        level, next_level = levels[t], levels[next_t]
        clean = extrapolated = _clean(level, u, (yield u, t), predicts).clamp(-bound, bound)
        if previous_clean is not None and previous_level is not None and next_t != CLEAN:
            h = next_level.log_ratio - level.log_ratio
            previous_h = level.log_ratio - previous_level.log_ratio
            extrapolated = torch.lerp(previous_clean, clean, 1 + h / (2 * previous_h))
        u = _step(level, u, extrapolated, next_level)
        previous_clean, previous_level = clean, level
    return u


def _clean(level: NoiseLevel, u: Tensor, prediction: Tensor, predicts: Prediction) -> Tensor:
    """Return the clean sequence that the noise was added to, by the prediction."""
    match predicts:
        case "noise":
            return torch.add(u, prediction, alpha=-level.noise).div_(level.signal)
        case "clean":
            return prediction
        case "velocity":
            return torch.mul(u, level.noise_rate).add_(prediction, alpha=-level.noise)


def _step(level: NoiseLevel, u: Tensor, clean: Tensor, next_level: NoiseLevel) -> Tensor:
    """Go to another level: signal' clean + noise' (u - signal clean) / noise."""
    ratio = next_level.noise / level.noise
    return torch.mul(u, ratio).add_(clean, alpha=next_level.signal - ratio * level.signal)


Solve: TypeAlias = Callable[[Tensor, Sequence[int], Sequence[NoiseLevel], Prediction], Steps]
SOLVERS: dict[str, Solve] = {"dpm_solver": dpm_solver, "ddim": ddim}
