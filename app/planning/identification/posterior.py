"""A sample of what the unknowns may be, and by how much it is too narrow.

Sampling is differential evolution Markov chain Monte Carlo (ter Braak 2006): chains move by the
differences between others, and so in whatever oblique valley they are in. Importance sampling does
badly here, for break-aways cut the density off along planes. Nothing here knows what the unknowns
are.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from app.planning.arrays import FloatArray

CHAINS = 32
"""That exchange what they found; half of them moves at a time."""
BURN_IN = 0.4
"""Share of the generations that is not kept: the chains start beside the posterior."""
LEAP = 0.1
"""Share of the moves that are as long as two chains are apart, from one ridge to another."""
JITTER = 1e-2
"""Of the chains' spread, added to each move, so that they may leave any plane."""
DOUBLINGS = 16
FLAT = 2.0
"""By which the logarithm may fall where the density counts as flat."""
WIDE = 4.0
"""Standard deviations, over which it has to be."""
RIDGE = 1e-9


class Sample(NamedTuple):
    """Points, each as likely as another."""

    points: FloatArray
    """(N, d)."""
    blocks: FloatArray
    """(N, B), the log-likelihood by blocks of the log."""
    accepted: float
    """Share of the moves."""

    @property
    def mean(self) -> FloatArray:
        """(d,)."""
        return np.asarray(self.points.mean(axis=0))

    @property
    def covariance(self) -> FloatArray:
        """(d, d)."""
        return np.asarray(np.cov(self.points.T))


def draw_sample(
    log_density: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    mean: FloatArray,
    covariance: FloatArray,
    rng: np.random.Generator,
    *,
    generations: int,
) -> Sample:
    """Draw a sample of a density.

    Args:
        log_density: of points (N, d): values (N,), -inf where there is nothing, and blocks (N, B).
        mean: (d,), where there is some of it.
        covariance: (d, d), of about its shape; its size is found here.
        rng: draws.
        generations: moves of every chain.
    """
    size, half = mean.size, CHAINS // 2
    covariance = _scaled(log_density, mean, covariance, rng)
    chains = mean + rng.standard_normal((CHAINS, size)) @ _factor(covariance).T
    low, high = _extents(log_density, mean, np.sqrt(np.diag(covariance)))
    chains += rng.uniform(-low, high, chains.shape)
    values, blocks = log_density(chains)
    chains[~np.isfinite(values)] = mean
    values, blocks = log_density(chains)
    kept_points, kept_blocks, accepted, moves = [], [], 0, 0
    for generation in range(generations):
        for moving, others in ((slice(half), slice(half, None)), (slice(half, None), slice(half))):
            pool = chains[others]
            pairs = rng.integers(half, size=(2, half))
            lengths = np.where(rng.random(half) < LEAP, 1.0, 2.38 / np.sqrt(2.0 * size))
            steps = lengths[:, np.newaxis] * (pool[pairs[0]] - pool[pairs[1]])
            steps += JITTER * pool.std(axis=0) * rng.standard_normal((half, size))
            proposed = chains[moving] + steps
            value, block = log_density(proposed)
            goes = value > np.log(rng.random(half)) + values[moving]
            chains[moving] = np.where(goes[:, np.newaxis], proposed, chains[moving])
            values[moving] = np.where(goes, value, values[moving])
            blocks[moving] = np.where(goes[:, np.newaxis], block, blocks[moving])
            accepted, moves = accepted + int(goes.sum()), moves + half
        if generation >= BURN_IN * generations:
            kept_points.append(chains.copy())
            kept_blocks.append(blocks.copy())
    return Sample(np.concatenate(kept_points), np.concatenate(kept_blocks), accepted / moves)


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


def _extents(
    log_density: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    mean: FloatArray,
    deviations: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return how far the density goes on below and above along each axis (d,), where it is flat.

    What a log only brackets, such as static friction, a search leaves at some place in between;
    chains that began there would take long to fill the bracket. 0 where the density is as narrow as
    it is thought to be.
    """
    size = mean.size
    peak = float(log_density(mean[np.newaxis])[0][0])
    signs = np.concatenate([-np.eye(size), np.eye(size)])
    reached, goes_on = np.zeros(2 * size), np.ones(2 * size, dtype=bool)
    for doubling in range(DOUBLINGS):
        step = 2.0**doubling
        values, _ = log_density(mean + step * signs * deviations)
        goes_on &= values > peak - FLAT
        reached[goes_on] = step
        if not goes_on.any():
            break
    extents = np.where(reached >= WIDE, reached, 0.0) * np.tile(deviations, 2)
    return extents[:size], extents[size:]


def _factor(covariance: FloatArray) -> FloatArray:
    """Return a root of a covariance that rounding may have left a little indefinite."""
    deviations = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlations = covariance / np.outer(deviations, deviations)
    lengths, axes = np.linalg.eigh(correlations)
    return np.asarray(deviations[:, np.newaxis] * axes * np.sqrt(np.maximum(lengths, RIDGE)))


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
    slopes = whitened @ (sample.blocks - sample.blocks.mean(axis=0)) / len(sample.points)
    num_blocks = slopes.shape[1]
    slopes = slopes - slopes.mean(axis=1, keepdims=True)
    spread = slopes @ slopes.T * num_blocks / (num_blocks - 1)
    each = np.einsum("ij,jk,ik->i", factor, spread, factor) / np.sum(factor**2, axis=1)
    return float(np.trace(spread)) / len(factor), each
