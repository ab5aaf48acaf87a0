"""First guesses of a plant: linear least squares on windows of a log, and whether that is possible.

On differences of single steps least squares is worse than no identification: noise is all there is.
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from app.planning.arrays import FloatArray
from app.planning.identification.log import Log
from app.planning.identification.parameters import Scale

SPANS = (2, 4, 8, 16, 32, 64, 128)
"""Steps of half a window."""
MOST_ROWS = 4000
LEAST_ROWS = 8
"""Windows that a guess is made of."""
CLEARLY = 4.0
"""A mass moves for certain if its speed is so many times the noise of the speed."""
MOST = 0.98
"""The share of a log's accelerations and speeds that is below its scale."""
SHARES = (0.5, 1.0, 2.0)
FRICTION = 0.6
"""What full control, and Coulomb friction of it, make of the mass, where windows do not tell."""
TINY = 1e-9


@dataclass(frozen=True, slots=True)
class Guess:
    """A plant, roughly."""

    control_gain: float
    coulomb_friction: float
    viscous_damping: float
    bias: float


def scale_of(log: Log) -> Scale:
    """Return how large things are in a log.

    Accelerations are taken over as few steps as noise allows, and of both the largest but a few.
    """
    accelerations = velocities = 0.0
    for span in SPANS:
        if log.num_steps < 4 * span:
            break
        seconds = span * log.time_step
        bends = np.abs(_second_differences(log, span))
        accelerations = max(float(np.quantile(bends, MOST)), TINY)
        changes = np.abs(log.positions[span:] - log.positions[:-span]) / seconds
        velocities = max(float(np.quantile(changes, MOST)), TINY)
        if accelerations > CLEARLY * np.sqrt(6.0) * log.position_noise / seconds**2:
            break
    return Scale(accelerations, velocities, float(np.max(np.abs(log.controls))))


def guesses(log: Log, scale: Scale) -> list[Guess]:
    """Return guesses from windows of each length that a log has enough of, and of the scale alone.

    The second difference of positions over a window is a weighted mean of the accelerations in it,
    and so it is that of gain * u - coulomb * sign(v) - damping * v + bias.
    """
    spans = [span for span in SPANS if log.num_steps >= 4 * span]
    by_windows = [guess for span in spans if (guess := _guess(log, span)) is not None]
    by_scale = [
        Guess(
            share * scale.acceleration / scale.control, FRICTION * share * scale.acceleration, 0, 0
        )
        for share in SHARES
    ]
    return [guess for guess in by_windows if guess.control_gain > 0.0] + by_scale


def _second_differences(log: Log, span: int) -> FloatArray:
    """Return mean accelerations over windows of twice `span` steps, m/s^2."""
    positions = log.positions
    bends = positions[2 * span :] - 2.0 * positions[span:-span] + positions[: -2 * span]
    return np.asarray(bends / (span * log.time_step) ** 2)


def _guess(log: Log, span: int) -> Guess | None:
    positions, step = log.positions, log.time_step
    accelerations = _second_differences(log, span)
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
    gain, coulomb, damping, bias = (solution / norms).tolist()
    return Guess(gain, coulomb, damping, bias)


def _twice_averaged(values: FloatArray, span: int) -> FloatArray:
    """Return means with the weights of a triangle of 2 * `span` - 1 values."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    once = (sums[span:] - sums[:-span]) / span
    sums = np.concatenate([[0.0], np.cumsum(once)])
    return np.asarray((sums[span:] - sums[:-span]) / span)
