"""Whether frictions differ by direction: the fit with the unknowns that the log asks for."""

from dataclasses import replace

import numpy as np

from app.planning.identification.evolution import Found
from app.planning.identification.fitting import NEARBY, Fit
from app.planning.identification.parameters import BIAS, COULOMB, STATIC

GLIMPSE_GENERATIONS, LOOK_GENERATIONS = 25, 45
HOPEFUL = 0.6
"""Of what the log has to say: where a glimpse shows less, no one looks."""


def by_direction(
    fit: Fit, same: Found, rng: np.random.Generator, *, is_asked_for: bool
) -> tuple[Fit, Found]:
    """Return the fit with frictions by direction where that is asked for, or told by the log.

    A bias and frictions that differ by the same in the other sense move a mass alike: the bias is
    left at zero, or where that would make a friction negative, where it is.
    """
    space = fit.space
    values = {name: float(value[0]) for name, value in space.values(same.best[np.newaxis]).items()}
    fixed = None
    if BIAS not in space.known:
        takes_it = abs(values[BIAS]) < 0.8 * values[f"{COULOMB}.forward"]
        fixed = 0.0 if takes_it and COULOMB not in space.known else values[BIAS]
    base = space.base._replace(bias=fixed) if fixed is not None else space.base
    other = Fit(
        replace(space, by_direction=True, fixed_bias=fixed, base=base), fit.record, fit.stop
    )
    if other.space.names == space.names:
        return fit, same
    shift = values[BIAS] - (fixed if fixed is not None else values[BIAS])
    for field_name in (COULOMB, STATIC):
        values[f"{field_name}.forward"] -= shift
        values[f"{field_name}.backward"] += shift
    # Schwarz's criterion; a log that is badly explained has to say it more clearly.
    measurements = fit.record.controls.size / fit.record.stride
    more = len(other.space.names) - len(space.names)
    asked = 0.5 * (more + 1) * np.log(measurements)
    seen = other.climb(
        other.across_ridges(other.space.point(values)),
        other.around(NEARBY),
        rng,
        GLIMPSE_GENERATIONS,
    )
    if not is_asked_for and seen.value - same.value < HOPEFUL * asked:
        return fit, same
    found = other.climb(seen.best, seen.covariance, rng, LOOK_GENERATIONS)
    if is_asked_for or found.value - same.value > asked:
        return other, other.settle(other.climb(found.best, found.covariance, rng), rng)
    return fit, same
