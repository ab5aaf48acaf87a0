"""A full-covariance evolution strategy: CMA-ES (Hansen 2016, "The CMA evolution strategy").

The valley of static friction, Coulomb friction and gain is narrow, oblique and not smooth:
searches that adapt each coordinate for itself stop in it. Nothing here knows what is searched for.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from app.planning.arrays import FloatArray

MOST_GROWTH = 1.0
"""Of the logarithm of the step size, in a generation."""
TOLERANCE = 0.5
PATIENCE = 10


class Found(NamedTuple):
    """Where a search ended."""

    best: FloatArray
    """(d,)."""
    value: float
    """There."""
    mean: FloatArray
    """(d,)."""
    covariance: FloatArray
    """(d, d), of the last generation."""


def maximise(
    function: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    covariance: FloatArray,
    rng: np.random.Generator,
    *,
    generations: int,
    population: int,
    spread: float,
) -> Found:
    """Search for a maximum.

    Args:
        function: of points (N, d), values (N,); -inf where there is none.
        start: (d,).
        covariance: (d, d), of where the maximum may be.
        rng: draws the points.
        generations: at most.
        population: points in each.
        spread: the search ends once half of a generation is within so much of the best value, and
            the best of ten generations is no better by `TOLERANCE`.
    """
    size, half = start.size, population // 2
    weights = np.log(half + 0.5) - np.log(np.arange(1, half + 1))
    weights /= weights.sum()
    effective = 1.0 / np.sum(weights**2)
    # The constants of Hansen's tutorial, Table 1.
    damp_sigma = (effective + 2.0) / (size + effective + 5.0)
    sigma_damping = 1.0 + damp_sigma + 2.0 * max(0.0, np.sqrt((effective - 1) / (size + 1)) - 1.0)
    path_share = (4.0 + effective / size) / (size + 4.0 + 2.0 * effective / size)
    rank_one = 2.0 / ((size + 1.3) ** 2 + effective)
    rank_many = min(
        1.0 - rank_one, 2.0 * (effective - 2.0 + 1.0 / effective) / ((size + 2) ** 2 + effective)
    )
    expected_length = np.sqrt(size) * (1.0 - 1.0 / (4.0 * size) + 1.0 / (21.0 * size**2))
    mean, sigma = start.copy(), 1.0
    path, sigma_path = np.zeros(size), np.zeros(size)
    best, best_value = start.copy(), float(function(start[np.newaxis])[0])
    recent: list[float] = []
    for generation in range(generations):
        lengths, axes = np.linalg.eigh(covariance)
        lengths = np.sqrt(np.maximum(lengths, 1e-300))
        draws = rng.standard_normal((population, size))
        steps = (draws * lengths) @ axes.T
        values = function(mean + sigma * steps)
        order = np.argsort(-values)[:half]
        if values[order[0]] > best_value:
            best_value = float(values[order[0]])
            best = mean + sigma * steps[order[0]]
        step = weights @ steps[order]
        mean = mean + sigma * step
        sigma_path = (1.0 - damp_sigma) * sigma_path + np.sqrt(
            damp_sigma * (2.0 - damp_sigma) * effective
        ) * (axes @ ((axes.T @ step) / lengths))
        length = float(np.linalg.norm(sigma_path))
        normal = np.sqrt(1.0 - (1.0 - damp_sigma) ** (2 * (generation + 1)))
        is_short = length / normal < (1.4 + 2.0 / (size + 1)) * expected_length
        path = (1.0 - path_share) * path
        if is_short:
            path += np.sqrt(path_share * (2.0 - path_share) * effective) * step
        chosen = steps[order]
        covariance = (
            (1.0 - rank_one - rank_many) * covariance
            + rank_one * np.outer(path, path)
            + rank_many * (chosen.T * weights) @ chosen
        )
        growth = damp_sigma / sigma_damping * (length / expected_length - 1.0)
        sigma *= float(np.exp(min(growth, MOST_GROWTH)))
        recent.append(best_value)
        if (
            generation >= PATIENCE
            and best_value - float(np.median(values)) < spread
            and recent[-1] - recent[-1 - PATIENCE] < TOLERANCE
        ):
            break
    return Found(best, best_value, mean, sigma**2 * covariance)
