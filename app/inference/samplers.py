"""Samplers: pure functions that turn noise into control sequences over explicit timestep pairs.

They know neither networks nor guidance: a sampler is given a function that predicts the noise.
"""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TypeAlias

import numpy as np
import torch
from torch import Tensor

NoisePredictor: TypeAlias = Callable[[Tensor, int], Tensor]
"""eps(u_t (K, H), t): the predicted noise (K, H)."""
CLEAN = -1
"""The time after the last one, where no noise is left."""


class InvalidStepCount(ValueError):
    """The number of steps does not fit the number of diffusion times."""


def sampling_times(num_timesteps: int, steps: int) -> list[int]:
    """Return `steps` diffusion times, evenly spaced from T-1 down, then `CLEAN`.

    Raises:
        InvalidStepCount: not 1 <= steps <= T.
    """
    if not 1 <= steps <= num_timesteps:
        raise InvalidStepCount(
            f"steps must be from 1 to {num_timesteps}, the diffusion times of the model"
        )
    return [*np.linspace(num_timesteps - 1, 0, steps).round().astype(int).tolist(), CLEAN]


def ddim(
    predict_noise: NoisePredictor,
    noise: Tensor,
    times: Sequence[int],
    alphas_cumprod: Sequence[float],
    bound: float = 1.0,
) -> Tensor:
    """Deterministic DDIM (Song et al. 2021, Eq. 12 with sigma = 0; paper, Sect. 3.4).

    Args:
        predict_noise: the noise predictor.
        noise: (K, H), standard normal.
        times: falling diffusion times, `CLEAN` last (see `sampling_times`).
        alphas_cumprod: cumulative products of alpha_t, one for each diffusion time.
        bound: the predicted clean sequence is clamped to [-bound, bound] at every step, and the
            noise derived from the clamped one.

    Returns:
        (K, H), within the bound.
    """
    u = noise
    for t, next_t in pairwise(times):
        alpha = alphas_cumprod[t]
        next_alpha = 1.0 if next_t == CLEAN else alphas_cumprod[next_t]
        epsilon = predict_noise(u, t)
        clean = (u - math.sqrt(1 - alpha) * epsilon) / math.sqrt(alpha)
        clean = clean.clamp(-bound, bound)
        epsilon = (u - math.sqrt(alpha) * clean) / math.sqrt(1 - alpha)
        u = math.sqrt(next_alpha) * clean + math.sqrt(1 - next_alpha) * epsilon
    return u


SAMPLERS = {"ddim": ddim}


def guided(
    unet: Callable[[Tensor, Tensor, Tensor, Tensor], Tensor],
    condition: Tensor,
    guidance_scale: float,
) -> NoisePredictor:
    """Return a noise predictor with classifier-free guidance (Ho and Salimans 2022; paper, Eq. 4).

    The conditional and the unconditional prediction share one batch; where the scale leaves only
    one of them (0 or 1), the other is not computed.

    Args:
        unet: eps(u_t (B, 1, H), t (B,), condition (B, 4), keep_condition (B,)), (B, 1, H).
        condition: (4,), standardised [x_0, x*].
        guidance_scale: s.
    """
    keeps = {0.0: [False], 1.0: [True]}.get(guidance_scale, [False, True])

    def predict_noise(u: Tensor, t: int) -> Tensor:
        rows = len(u)
        batch = len(keeps) * rows
        predictions = unet(
            u.unsqueeze(1).repeat(len(keeps), 1, 1),
            torch.full((batch,), t, dtype=torch.int64, device=u.device),
            condition.expand(batch, -1),
            torch.tensor(keeps, device=u.device).repeat_interleave(rows),
        ).squeeze(1)
        if len(keeps) == 1:
            return predictions
        unconditional, conditional = predictions.chunk(2)
        return unconditional + guidance_scale * (conditional - unconditional)

    return predict_noise
