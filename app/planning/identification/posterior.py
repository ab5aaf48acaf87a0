"""A weighted sample of what the unknowns may be: adaptive importance sampling, and its calibration.

Sampling is AMIS (Cornuet, Marin, Mira and Robert 2012): all samples of all rounds count, each
weighed by the mixture of what they were drawn from. Nothing here knows what the unknowns are.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from app.planning.arrays import FloatArray

FREEDOM = 6.0
"""Degrees of freedom of the proposals, multivariate t: heavier tails than any posterior's."""
WIDER = 1.2
"""By how much proposals are wider than the sample so far."""
ENOUGH = 40.0
"""Effective samples below which weights are flattened until there are as many."""
RIDGE = 1e-9


class Sample(NamedTuple):
    """Points and their weights."""

    points: FloatArray
    """(N, d)."""
    weights: FloatArray
    """(N,), they add up to 1."""
    blocks: FloatArray
    """(N, B), the log-likelihood by blocks of the log."""
    effective: float
    """So many independent points are worth as much."""

    @property
    def mean(self) -> FloatArray:
        """(d,)."""
        return np.asarray(self.weights @ self.points)

    @property
    def covariance(self) -> FloatArray:
        """(d, d)."""
        deviations = self.points - self.mean
        return np.asarray((deviations.T * self.weights) @ deviations)


def draw_sample(
    log_density: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    mean: FloatArray,
    covariance: FloatArray,
    rng: np.random.Generator,
    *,
    rounds: int,
    count: int,
) -> Sample:
    """Draw a sample of a density.

    Args:
        log_density: of points (N, d): values (N,), -inf where there is nothing, and blocks (N, B).
        mean: (d,), about where most of it is.
        covariance: (d, d), of about its shape; its size is found here.
        rng: draws.
        rounds: of proposals, each made of what was found before.
        count: points in each.
    """
    size = mean.size
    covariance = _scaled(log_density, mean, covariance, rng)
    points, values, blocks = np.empty((0, size)), np.empty(0), None
    proposals: list[tuple[FloatArray, FloatArray]] = []
    for _ in range(rounds):
        factor = _factor(covariance)
        draws = rng.standard_normal((count, size))
        radii = np.sqrt(FREEDOM / rng.chisquare(FREEDOM, count))
        drawn = mean + WIDER * (draws * radii[:, np.newaxis]) @ factor.T
        value, block = log_density(drawn)
        points, values = np.concatenate([points, drawn]), np.concatenate([values, value])
        blocks = block if blocks is None else np.concatenate([blocks, block])
        proposals.append((mean, factor))
        weights, effective = _weights(values, _mixture(points, proposals))
        sample = Sample(points, weights, blocks, effective)
        mean, covariance = sample.mean, sample.covariance
    return sample


def _scaled(
    log_density: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    mean: FloatArray,
    covariance: FloatArray,
    rng: np.random.Generator,
) -> FloatArray:
    """Return a covariance of the density's size, where only its shape is known.

    Of a normal density the logarithm falls by d/2 on average from its peak.
    """
    size, factor = mean.size, _factor(covariance)
    draws = rng.standard_normal((16, size)) @ factor.T
    peak = float(log_density(mean[np.newaxis])[0][0])
    scale = 1.0
    for _ in range(8):
        values, _ = log_density(mean + scale * draws)
        fall = peak - float(np.median(values))
        if not np.isfinite(fall):
            scale *= 0.3
        elif not 0.2 * size < fall < 2.0 * size:
            scale *= float(np.clip(np.sqrt(0.5 * size / max(fall, 1e-3)), 0.1, 10.0))
        else:
            break
    return scale**2 * covariance


def _factor(covariance: FloatArray) -> FloatArray:
    """Return a root of a covariance that rounding may have left a little indefinite."""
    deviations = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlations = covariance / np.outer(deviations, deviations)
    lengths, axes = np.linalg.eigh(correlations)
    return np.asarray(deviations[:, np.newaxis] * axes * np.sqrt(np.maximum(lengths, RIDGE)))


def _mixture(points: FloatArray, proposals: list[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """Return the logarithm of the proposals' mean density at points, up to a constant."""
    size = points.shape[1]
    logs = []
    for mean, factor in proposals:
        whitened = np.linalg.solve(factor, (points - mean).T) / WIDER
        _, log_volume = np.linalg.slogdet(factor)
        squares = np.sum(whitened**2, axis=0)
        logs.append(-0.5 * (FREEDOM + size) * np.log1p(squares / FREEDOM) - log_volume)
    return np.asarray(np.logaddexp.reduce(logs, axis=0)) - np.log(len(proposals))


def _weights(values: FloatArray, proposed: FloatArray) -> tuple[FloatArray, float]:
    """Return weights and their effective number, flattened where there would be too few."""
    logs = values - proposed
    logs -= logs.max()
    flat, steep = 0.0, 1.0
    power = 1.0
    effective = _effective(np.exp(logs))
    if effective < ENOUGH:
        for _ in range(30):
            power = 0.5 * (flat + steep)
            if _effective(np.exp(power * logs)) < ENOUGH:
                steep = power
            else:
                flat = power
        power = flat
    weights = np.exp(power * logs)
    return weights / weights.sum(), effective


def _effective(weights: FloatArray) -> float:
    return float(weights.sum() ** 2 / np.sum(weights**2))


def inflation(sample: Sample) -> tuple[float, FloatArray]:
    """Return by how much the sample's variances fall short: of all together, and of each (d,).

    The log-likelihood of a block, regressed on the points, has the block's mean slope over the
    sample (Stein's identity). The slopes of all blocks vary as much as the sample's inverse
    covariance says, if the likelihood is right; if its errors are not independent, more. As the
    sandwich covariance of a misspecified likelihood has it (White 1982), with slopes over the
    width of the sample, for the likelihood is not smooth.
    """
    factor = _factor(sample.covariance)
    whitened = np.linalg.solve(factor, (sample.points - sample.mean).T)
    finite = sample.weights > 0.0
    weights = sample.weights[finite]
    blocks = sample.blocks[finite]
    slopes = (whitened[:, finite] * weights) @ (blocks - weights @ blocks)
    num_blocks = slopes.shape[1]
    slopes = slopes - slopes.mean(axis=1, keepdims=True)
    spread = slopes @ slopes.T * num_blocks / (num_blocks - 1)
    each = np.einsum("ij,jk,ik->i", factor, spread, factor) / np.sum(factor**2, axis=1)
    return float(np.trace(spread)) / len(factor), each


def quantiles(values: FloatArray, weights: FloatArray, levels: tuple[float, ...]) -> FloatArray:
    """Return weighted quantiles of values (N,), at each of the levels."""
    order = np.argsort(values)
    cumulated = np.cumsum(weights[order]) - 0.5 * weights[order]
    return np.asarray(np.interp(levels, cumulated, values[order]))
