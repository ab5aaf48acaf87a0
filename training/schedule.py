"""The forward diffusion process: cosine schedule and noising (paper, Sect. 3.2)."""

import math

import numpy as np

from app.planning.arrays import FloatArray

OFFSET = 0.008
MAX_BETA = 0.999


def cosine_alphas_cumprod(num_timesteps: int) -> FloatArray:
    """Return the cumulative products of alpha_t for t = 0 ... T-1, shape (T,).

    Cosine schedule of Nichol and Dhariwal (2021), Eq. 17, each beta capped at 0.999.
    """
    times = np.arange(num_timesteps + 1) / num_timesteps
    signal = np.cos((times + OFFSET) / (1 + OFFSET) * math.pi / 2) ** 2
    betas = np.minimum(1 - signal[1:] / signal[:-1], MAX_BETA)
    return np.asarray(np.cumprod(1 - betas))
