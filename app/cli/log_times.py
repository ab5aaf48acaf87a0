"""Series at even times: slightly uneven ones are resampled, others refused, in words."""

from pathlib import Path

import numpy as np
import numpy.typing as npt

from app.failure import Failure

FloatArray = npt.NDArray[np.float64]
JITTER = 0.02
"""By what share time steps may differ to count as even."""
MOST_JITTER = 0.6
"""By more, samples are missing."""
GAP = 5.0
"""Time steps; a longer one divides two logs."""


def at_even_times(
    file: Path, times: FloatArray, series: dict[str, FloatArray]
) -> tuple[float, dict[str, FloatArray], list[str]]:
    """Return the time step, and the series at even times.

    Raises:
        Failure: time stands still, runs backwards, or has a gap.
    """
    steps = np.diff(times)
    if np.median(steps) < 0.0:
        raise Failure(f"{file}: time runs backwards: is the newest sample the first?")
    wrong = np.flatnonzero(steps <= 0.0)
    if wrong.size:
        row = wrong[0] + 1
        raise Failure(
            f"{file}: time does not go on from {times[row - 1]:g} to {times[row]:g} s, row {row}: "
            "is it two logs in one?"
        )
    usual = float(np.median(steps))
    longest = int(np.argmax(steps))
    if steps[longest] > GAP * usual:
        raise Failure(
            f"{file}: a gap of {steps[longest]:.3g} s after row {longest + 1}, where {usual:.3g} s "
            "are usual: it is two logs in one; give one of them"
        )
    off = float(np.max(np.abs(steps / usual - 1.0)))
    even = float(steps.mean())
    if off <= JITTER:
        return even, series, []
    if off > MOST_JITTER:
        raise Failure(
            f"{file}: time steps lie between {steps.min():.3g} and {steps.max():.3g} s, too uneven "
            "to be taken at even times: samples are missing"
        )
    at = times[0] + even * np.arange(len(times))
    before = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 1)
    resampled = {
        # A control holds until the next one; what is measured goes on meanwhile.
        role: values[before] if role == "control" else np.interp(at, times, values)
        for role, values in series.items()
    }
    note = f"time steps differ by up to {off:.0%}; samples are taken at even ones of {even:.4g} s"
    return even, resampled, [note]
