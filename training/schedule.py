"""The way from a clean sequence to noise: the schedules (paper, Sect. 3.2)."""

import math

import numpy as np

from app.inference.noise_levels import ModelKind
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


def straight_alphas_cumprod(num_timesteps: int) -> FloatArray:
    """Return the same of a flow, whose share of noise grows evenly: (t + 1/2) / T, shape (T,)."""
    noise = (np.arange(num_timesteps) + 0.5) / num_timesteps
    signal = 1 - noise
    return np.asarray(signal**2 / (signal**2 + noise**2))


def alphas_cumprod(kind: ModelKind, num_timesteps: int) -> FloatArray:
    """Return the schedule of a kind of model, shape (T,)."""
    schedule = straight_alphas_cumprod if kind == "flow" else cosine_alphas_cumprod
    return schedule(num_timesteps)
