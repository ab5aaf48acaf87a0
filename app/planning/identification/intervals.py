"""Estimates with their intervals, and what of them cannot be told."""

from collections.abc import Mapping

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.identification.advice import why_not_told
from app.planning.identification.estimate import Parameter
from app.planning.identification.fitting import Fit
from app.planning.identification.motion import Motion
from app.planning.identification.parameters import BIAS, COULOMB, NOISES, STATIC
from app.planning.identification.posterior import Sample

COVERED = 0.95
"""By the intervals."""
TOUCHING = 0.1
"""An interval that begins at less than this share of its end begins at nothing."""


def estimates(
    fit: Fit,
    middle: FloatArray,
    sample: Sample,
    wider: float,
    motion: Motion,
    condition_number: float,
) -> tuple[Parameter, ...]:
    """Return the estimates of all that is not known, and of what cannot be told, why."""
    space = fit.space
    values, at = space.values(sample.points), space.values(middle[np.newaxis])
    parameters = []
    for name in space.names:
        if name in NOISES:
            continue
        key = key_of(name, values)
        value = float(at[key][0])
        low, high = _shortest(values[key])
        if name.startswith(STATIC):
            coulomb = values[key.replace(STATIC, COULOMB)]
            excess, most = _shortest(values[key] - coulomb)
            if excess < TOUCHING * most:  # it may as well be no more than Coulomb friction
                low = min(low, _shortest(coulomb)[0])
        lower, upper = value - wider * (value - low), value + wider * (high - value)
        if name != BIAS:
            lower = max(0.0, lower)
        error = wider * float(np.std(values[key]))
        half = 0.5 * (upper - lower)
        reason = why_not_told(name, value, half, space.scale, motion, condition_number)
        parameters.append(
            Parameter(name, value, error, (float(lower), float(upper)), reason is None, reason)
        )
    if space.fixed_bias is not None:
        parameters.append(
            Parameter(
                "bias",
                space.fixed_bias,
                0.0,
                (space.fixed_bias, space.fixed_bias),
                False,
                "a bias and frictions that differ by direction move a mass alike; it is taken as "
                f"{space.fixed_bias:.3g}, and the frictions are those beside it",
            )
        )
    return tuple(parameters)


def _shortest(values: FloatArray) -> tuple[float, float]:
    """Return the shortest interval with 95 % of the values (N,): it begins at a bound they pile up
    at, where one with as many below as above would leave the bound out."""
    ordered = np.sort(values)
    within = int(np.ceil(COVERED * ordered.size))
    widths = ordered[within - 1 :] - ordered[: ordered.size - within + 1]
    first = int(np.argmin(widths))
    return float(ordered[first]), float(ordered[first + within - 1])


def key_of(name: str, values: Mapping[str, FloatArray]) -> str:
    """Return where the values of an unknown are: of both directions the first."""
    return name if name in values else f"{name}.forward"
