"""What a fit is worth: the estimates with their intervals, what cannot be told, and why not."""

from dataclasses import dataclass

import numpy as np

from app.planning.arrays import BoolArray, FloatArray
from app.planning.identification.advice import advise, is_reversed
from app.planning.identification.estimate import Parameter
from app.planning.identification.evolution import Found
from app.planning.identification.fitting import Fit
from app.planning.identification.intervals import estimates, key_of
from app.planning.identification.log import Log
from app.planning.identification.log_checks import UnusableLog
from app.planning.identification.motion import Motion
from app.planning.identification.parameters import NOISES
from app.planning.identification.posterior import Sample, inflation
from app.planning.identification.prediction import Trace, Windows
from app.planning.plant.system import ControlLimits, Plant, System

LEAST_R2 = 0.3
"""Where less of the motion is explained, the plant is not of this kind."""
GOOD_R2 = 0.9
LOST_IN_NOISE = 4.0
"""Standard deviations of measured positions: less is hardly a motion between two of them."""


@dataclass(frozen=True, slots=True)
class Quality:
    """How well the plant explains the log that it was made from."""

    window_s: float
    """How far ahead the end position is predicted, s."""
    end_error_rms: float
    """Of those predictions, m."""
    r2: float
    """Share of the variance of what the machine moves in a window that they explain."""
    residual: float
    """Root mean square error of the position one measurement ahead, m."""
    acceleration_noise: float
    """Of what the plant does not explain, m/s^2 in each step."""
    position_noise: float
    """m."""
    velocity_noise: float | None
    """m/s."""
    condition_number: float
    """Of the estimates' correlations: 1 if each can be told by itself."""
    moving_steps: int


@dataclass(frozen=True, slots=True)
class Identification:
    """What a log says of a machine."""

    system: System
    parameters: tuple[Parameter, ...]
    systems: tuple[System, ...]
    """The ensemble: each as likely as another."""
    quality: Quality
    windows: Windows
    """Of the log without its first `delay_steps` samples, as they are predicted."""
    advice: tuple[str, ...]
    """What to record next."""
    warnings: tuple[str, ...] = ()
    delay_steps: int = 0
    position_lag: float = 0.0
    """s: positions were measured so long before."""


def judge(
    fit: Fit,
    log: Log,
    likeliest: Found,
    sample: Sample,
    num_systems: int,
    rng: np.random.Generator,
) -> Identification:
    """Return what a fit comes to.

    Args:
        fit: the unknowns.
        log: whose controls act at once.
        likeliest: point that was found.
        sample: of what else they may be.
        num_systems: of the ensemble.
        rng: chooses them.

    Raises:
        UnusableLog: the machine is none of this kind, or hardly moves.
    """
    space = fit.space
    middle = _middle(fit, likeliest, sample)
    trace = fit.trace(middle)
    motion = Motion.of(trace, log, fit.record.stride)
    if motion.moving_steps < motion.LEAST_STEPS:
        raise UnusableLog(
            "positions",
            f"the machine moves in {motion.moving_steps} steps only; {motion.LEAST_STEPS} are the "
            "least that anything follows from",
        )
    windows = Windows.of(fit.plant(middle), log, trace)
    quality = _quality(fit, log, middle, windows, trace, motion, sample)
    if quality.r2 < LEAST_R2 and quality.end_error_rms < LOST_IN_NOISE * quality.position_noise:
        raise UnusableLog(
            "positions",
            f"the machine moves by little more in {quality.window_s:.2g} s than the "
            f"{quality.position_noise:.2g} m by which positions are off: nothing follows from that",
        )
    is_moved = quality.r2 >= GOOD_R2 or _can_be_moved(fit.plant(middle), log)
    if quality.r2 < LEAST_R2 or not is_moved:
        raise UnusableLog(
            "controls",
            f"no plant of this kind explains the motion: the best one predicts {quality.r2:.0%} of "
            f"what the machine moves in {quality.window_s:.2g} s; are these the controls of this "
            "axis, in their order, and does a positive one push forward?",
        )
    overall, _ = inflation(sample)
    wider = float(np.sqrt(max(1.0, overall)))
    parameters = estimates(fit, middle, sample, wider, motion, quality.condition_number)
    limits = _limits(space.base)
    return Identification(
        system=space.system(middle, limits),
        parameters=parameters,
        systems=tuple(
            space.system(point, limits)
            for point in _ensemble(fit, middle, sample, wider, num_systems, rng)
        ),
        quality=quality,
        windows=windows,
        advice=advise(parameters, motion),
        warnings=tuple(_warnings(quality, overall, motion, log)),
    )


def _can_be_moved(plant: Plant, log: Log) -> bool:
    """Return whether the log's controls can keep it in motion, either way.

    If not, and what moves it is random, a mass that glides on still predicts some of the motion.
    """
    ways = log.controls.max(), -log.controls.min()
    forward, backward = (plant.control_gain * float(control) for control in ways)
    return (
        forward + plant.bias > plant.coulomb_forward
        or backward - plant.bias > plant.coulomb_backward
    )


def _middle(fit: Fit, likeliest: Found, sample: Sample) -> FloatArray:
    """Return the sample's mean, or the likeliest point where the mean lies beside all of it."""
    mean = sample.mean
    worst = float(fit.value(mean[np.newaxis])[0])
    return mean if worst > likeliest.value - 2.0 * mean.size else likeliest.best


def _quality(
    fit: Fit,
    log: Log,
    x: FloatArray,
    windows: Windows,
    trace: Trace,
    motion: Motion,
    sample: Sample,
) -> Quality:
    noises = fit.noises(x)
    measured = trace.squared_errors > 0.0
    return Quality(
        window_s=windows.steps * log.time_step,
        end_error_rms=float(np.sqrt(np.mean(windows.errors[:, -1] ** 2))),
        r2=windows.r2,
        residual=float(np.sqrt(np.mean(trace.squared_errors[measured]))) if measured.any() else 0.0,
        acceleration_noise=float(noises[0]),
        position_noise=float(noises[1]),
        velocity_noise=float(noises[2]) if NOISES[2] in fit.space.names else None,
        condition_number=_condition_number(fit, sample),
        moving_steps=motion.moving_steps,
    )


def _condition_number(fit: Fit, sample: Sample) -> float:
    """Return that of the correlations of the plant's parameters over the sample."""
    values = fit.space.values(sample.points)
    names = [name for name in fit.space.names if name not in NOISES]
    columns = [values[key_of(name, values)] for name in names]
    columns = [column for column in columns if column.std() > 0.0]
    if len(columns) <= 1:
        return 1.0
    return float(np.linalg.cond(np.corrcoef(columns)))


def _ensemble(
    fit: Fit,
    middle: FloatArray,
    sample: Sample,
    wider: float,
    num_systems: int,
    rng: np.random.Generator,
) -> FloatArray:
    """Return points (S, d) of the sample, as much wider as the intervals where they can be."""
    points = sample.points[rng.choice(len(sample.points), num_systems)]
    stretched = middle + wider * (points - middle)
    possible: BoolArray = fit.space.plants(fit.space.values(stretched))[2]
    return np.where(possible[:, np.newaxis], stretched, points)


def _limits(plant: Plant) -> float | ControlLimits:
    lowest, highest = plant.lowest_control, plant.highest_control
    return highest if lowest == -highest else ControlLimits(lowest, highest)


def _warnings(quality: Quality, overall: float, motion: Motion, log: Log) -> list[str]:
    warnings = []
    if quality.r2 < GOOD_R2:
        warnings.append(
            f"the plant predicts {quality.r2:.0%} of what the machine moves in "
            f"{quality.window_s:.2g} s: something else moves it, too"
        )
        if is_reversed(log):
            warnings.append(
                "a positive control seems to push backward: is the sign of the control or of the "
                "positions reversed?"
            )
    if overall > OVERCONFIDENT:
        warnings.append(
            "prediction errors are not independent of each other: the machine has more to it than "
            f"the plant; intervals are {np.sqrt(overall):.1f} times as wide as errors alone ask for"
        )
    if motion.moving_steps < motion.FEW_STEPS:
        warnings.append(f"the machine moves in {motion.moving_steps} steps only")
    return warnings


OVERCONFIDENT = 1.5
"""Variances that are so many times as large as the likelihood says."""
