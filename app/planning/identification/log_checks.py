"""What cannot be a log of one machine in motion, and is refused with the reason."""

from dataclasses import replace

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.identification.log import Log
from app.planning.plant.system import SMALLEST, ControlLimits

LEAST_STEPS = 30
"""Fewer samples than this say nothing about five parameters and their noise."""
LEAST_TIME_STEP, MOST_TIME_STEP = 1e-5, 5.0
"""s: no controller is faster, no machine with friction moves so slowly."""
FASTEST = 100.0
"""m/s or rad/s: as good as sure that positions are in mm, or time steps in ms."""
SLOWEST = 1e-7
"""m/s: as good as sure that time steps are in ms, or positions in km."""
JUMP = 20.0
"""An acceleration so many times as large as that of nearly all other steps is none."""
MOVES = 4.0
"""A machine has moved if its positions differ by so many times their noise."""
LEAST_MOVING_STEPS = 8
"""Of a log that ends soon after its first motion: from fewer nothing follows."""
INCONSISTENT = 0.2
"""By what share velocities may differ from what positions say."""


BEYOND_LIMIT = 0.05
"""By what share a control may be greater than the limit: currents are measured, with noise."""


class UnusableLog(ValueError):
    """From this log nothing follows; the message says why.

    Args:
        field: that is at fault: time_step, controls, positions, velocities, delay_steps, known, or
            a field of what is known, as in known/control_limit.
        message: in words.
    """

    def __init__(self, field: str, message: str) -> None:
        super().__init__(message)
        self.field = field


def checked_log(
    time_step: float,
    controls: FloatArray,
    positions: FloatArray,
    velocities: FloatArray | None = None,
) -> Log:
    """Return a log of controls (N,) and as many positions, or one more.

    Args:
        time_step: s.
        controls: units of control.
        positions: m.
        velocities: as many as positions, m/s; None where they are not measured.

    Raises:
        UnusableLog: it cannot be a log of one machine in motion.
    """
    log = Log(time_step, controls, positions, velocities)
    _check_time_step(time_step)
    _check_series(log)
    if len(positions) == len(controls):
        # The last control shows in nothing that was measured.
        log = replace(log, controls=controls[:-1])
    _check_motion(log)
    return log


def check_control_limit(log: Log, limit: float | ControlLimits | None) -> None:
    """Check that the limit of control that is known allows for the controls of a log.

    Args:
        log: checked.
        limit: units of control, both ways or each; None where it is not known.

    Raises:
        UnusableLog: the log holds a control that lies clearly beyond it.
    """
    if limit is None:
        return
    if not isinstance(limit, ControlLimits):
        limit = ControlLimits(-limit, limit)
    beyond = BEYOND_LIMIT * max(abs(limit.lower), abs(limit.upper))
    lowest, highest = float(np.min(log.controls)), float(np.max(log.controls))
    for control, is_beyond in (
        (highest, highest > limit.upper + beyond),
        (lowest, lowest < limit.lower - beyond),
    ):
        if is_beyond:
            raise UnusableLog(
                "known/control_limit",
                f"the log holds a control of {control:.6g}, beyond the limits of {limit.lower:g} "
                f"and {limit.upper:g}: are both in the same unit?",
            )


def _check_time_step(time_step: float) -> None:
    if not LEAST_TIME_STEP <= time_step <= MOST_TIME_STEP:
        unit = "are times in ms?" if time_step > MOST_TIME_STEP else "are times in another unit?"
        raise UnusableLog(
            "time_step",
            f"{time_step:g} s lies beyond {LEAST_TIME_STEP:g} to {MOST_TIME_STEP:g} s: {unit}",
        )


def _check_series(log: Log) -> None:
    """Refuse what is not a series of numbers, or constant."""
    series = {"controls": log.controls, "positions": log.positions}
    if log.velocities is not None:
        series["velocities"] = log.velocities
    for field, values in series.items():
        wrong = np.flatnonzero(~np.isfinite(values))
        if wrong.size:
            raise UnusableLog(
                field,
                f"{wrong.size} of {len(values)} are not finite numbers, the first at index "
                f"{wrong[0]}",
            )
    samples, steps = len(log.positions), len(log.controls)
    if not steps <= samples <= steps + 1:
        raise UnusableLog(
            "positions",
            f"there are {samples} positions to {steps} controls; there must be one to each, or one "
            "more",
        )
    if log.velocities is not None and len(log.velocities) != samples:
        raise UnusableLog(
            "velocities", f"there are {len(log.velocities)} velocities to {samples} positions"
        )
    if steps < LEAST_STEPS:
        raise UnusableLog("controls", f"{steps} steps are too few; {LEAST_STEPS} are the least")
    if np.ptp(log.controls) == 0.0:
        raise UnusableLog(
            "controls",
            f"the control is {log.controls[0]:g} throughout; what it does cannot be told from what "
            "else there is",
        )
    if np.max(np.abs(log.controls)) < SMALLEST:
        raise UnusableLog(
            "controls",
            f"the largest is {np.max(np.abs(log.controls)):.2g}; take a smaller unit of control",
        )
    if np.ptp(log.positions) == 0.0:
        raise UnusableLog(
            "positions", f"the position is {log.positions[0]:g} throughout; nothing moved"
        )


def _check_motion(log: Log) -> None:
    """Refuse what does not move, moves as no machine does, or is two logs in one."""
    positions, step = log.positions, log.time_step
    noise = log.position_noise
    # Of means: noise alone has a range of several standard deviations.
    few = max(2, min(10, log.num_steps // 20))
    means = np.convolve(positions, np.full(few, 1.0 / few), mode="valid")
    if np.ptp(means) < MOVES * noise:
        raise UnusableLog(
            "positions",
            f"nothing moved: positions differ by {np.ptp(means):.2g}, and their noise is about "
            f"{noise:.2g}",
        )
    changes = np.diff(positions)
    bends = np.abs(np.diff(changes))
    worst = int(np.argmax(bends))
    usual = max(float(np.quantile(np.delete(bends, _near(worst, bends.size)), 0.99)), 4.0 * noise)
    if bends[worst] > JUMP * usual:
        at = worst + 1 if abs(changes[worst + 1]) > abs(changes[worst]) else worst
        left = changes.size - at
        if left < LEAST_MOVING_STEPS and np.ptp(positions[: at + 1]) <= MOVES * noise:
            # A break-away from rest jumps as well, and what follows it has not been recorded.
            raise UnusableLog(
                "positions",
                f"too short: the machine moves in the last {left} of {changes.size} steps only; "
                "record a few seconds of motion in each direction",
            )
        raise UnusableLog(
            "positions",
            f"the position jumps from {positions[at]:.6g} to {positions[at + 1]:.6g} at index "
            f"{at + 1}, as nothing that has a mass does: is it two logs in one, or a sample gone "
            "wrong?",
        )
    speed = float(np.quantile(np.abs(changes), 0.95)) / step
    if speed > FASTEST or np.max(np.abs(changes)) / step < SLOWEST:
        raise UnusableLog(
            "positions",
            f"a speed of {speed:.2g} m/s (or rad/s) is no machine's with friction: are positions "
            "in another unit than m, or the time step in another than s?",
        )
    if log.velocities is not None:
        _check_velocities(log)


def _near(index: int, size: int) -> list[int]:
    return [i for i in range(index - 2, index + 3) if 0 <= i < size]


def _check_velocities(log: Log) -> None:
    """Refuse velocities that the positions contradict."""
    assert log.velocities is not None
    # Over as many steps as noise asks for.
    span = max(1, log.num_steps // 50)
    changes = (log.positions[span:] - log.positions[:-span]) / log.time_step
    sums = np.concatenate([[0.0], np.cumsum(log.velocities)])
    # Semi-implicit: a position is the one before and the velocity after the step.
    travelled = sums[span + 1 :] - sums[1:-span]
    explained = float(np.dot(changes, travelled))
    of_positions, of_velocities = float(np.dot(changes, changes)), float(travelled @ travelled)
    if of_velocities == 0.0 or explained**2 < 0.5 * of_positions * of_velocities:
        raise UnusableLog(
            "velocities", "they do not go with how the positions change: is it the same axis?"
        )
    ratio = explained / of_positions
    if not 1.0 - INCONSISTENT <= ratio <= 1.0 + INCONSISTENT:
        raise UnusableLog(
            "velocities",
            f"they are {ratio:.3g} times what the positions change by in {log.time_step:g} s: are "
            "both in the same unit, and is the time step right?",
        )
