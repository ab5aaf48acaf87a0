"""First guesses of a plant: linear least squares on windows of a log, and whether that is possible.

On differences of single steps least squares is worse than no identification: noise is all there is.
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from app.planning.arrays import FloatArray
from app.planning.identification.log import Log

SPANS = (2, 4, 8, 16, 32, 64, 128)
"""Steps of half a window."""
MOST_ROWS = 4000
LEAST_ROWS = 8
"""Windows that a guess is made of."""
CLEARLY = 4.0
"""A mass moves for certain if its speed is so many times the noise of the speed."""


@dataclass(frozen=True, slots=True)
class Guess:
    """A plant, roughly."""

    control_gain: float
    coulomb_friction: float
    viscous_damping: float
    bias: float
    residual: float
    """m/s^2, root mean square over the windows."""
    explained: float
    """Share of the accelerations' variance."""


def guesses(log: Log) -> list[Guess]:
    """Return a guess from windows of each length that a log has enough of, the shortest first.

    The second difference of positions over a window is a weighted mean of the accelerations in it,
    and so it is that of gain * u - coulomb * sign(v) - damping * v + bias.
    """
    found = []
    for span in SPANS:
        if log.num_steps < 4 * span:
            break
        guess = _guess(log, span)
        if guess is not None:
            found.append(guess)
    return found


def _guess(log: Log, span: int) -> Guess | None:
    positions, step = log.positions, log.time_step
    accelerations = positions[2 * span :] - 2.0 * positions[span:-span] + positions[: -2 * span]
    accelerations = accelerations / (span * step) ** 2
    velocities = np.diff(positions) / step
    # Control k acts on the velocity before it: the triangle's weights are two boxes.
    controls = _twice_averaged(log.controls[1:], span)
    speeds = _twice_averaged(velocities[:-1], span)
    half = max(1, span // 2)
    smooth = (positions[2 * half :] - positions[: -2 * half]) / (2 * half * step)
    noise = log.position_noise / (half * step)
    moving = sliding_window_view(smooth, 2 * span - 2 * half + 1)
    stride = max(1, len(controls) // MOST_ROWS)
    lowest, highest = moving[::stride].min(axis=1), moving[::stride].max(axis=1)
    chosen = (lowest > CLEARLY * noise) | (highest < -CLEARLY * noise)
    if chosen.sum() < LEAST_ROWS:
        return None
    u, v, a = (values[::stride][chosen] for values in (controls, speeds, accelerations))
    # In one direction a bias cannot be told from friction.
    both = np.any(v > 0.0) and np.any(v < 0.0)
    columns = np.column_stack([u, -np.sign(v), -v, np.full(u.size, float(both))])
    norms = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    solution, *_ = np.linalg.lstsq(columns / norms, a, rcond=1e-6)
    residuals = a - columns / norms @ solution
    gain, coulomb, damping, bias = (solution / norms).tolist()
    variance = float(np.var(a))
    return Guess(
        gain,
        coulomb,
        damping,
        bias,
        float(np.sqrt(np.mean(residuals**2))),
        1.0 - float(np.mean(residuals**2)) / variance if variance else 0.0,
    )


def _twice_averaged(values: FloatArray, span: int) -> FloatArray:
    """Return means with the weights of a triangle of 2 * `span` - 1 values."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    once = (sums[span:] - sums[:-span]) / span
    sums = np.concatenate([[0.0], np.cumsum(once)])
    return np.asarray((sums[span:] - sums[:-span]) / span)
