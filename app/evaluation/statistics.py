"""Statistics of measures over tasks, and how tables write them: deterministic, paired."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import bootstrap, trim_mean

RESAMPLES = 2000
QUARTILE = 0.25
TIE = 1e-6
"""Errors that differ by no more are equal (m)."""


class Interval(NamedTuple):
    """An estimate with its 95 % bootstrap interval."""

    estimate: float
    low: float
    high: float

    def shown(self, digits: int, sign: str = "") -> str:
        """Write estimate and interval; `sign` "+" shows the signs of differences."""
        # Rounded before it is written, and 0 added: -0.0004 is "0.000" and not "-0.000".
        estimate, low, high = (f"{round(value, digits) + 0.0:{sign}.{digits}f}" for value in self)
        return f"{estimate} [{low}, {high}]"


def interquartile_mean(values: NDArray[np.float64], axis: int = -1) -> NDArray[np.float64]:
    """Return the mean of the middle half along `axis`: sharper than a median, as robust."""
    return np.asarray(trim_mean(values, QUARTILE, axis=axis))


def interval(
    values: NDArray[np.float64], statistic: Callable[..., NDArray[np.float64]] = np.mean
) -> Interval:
    """Return `statistic` of `values` (tasks,), and its percentile bootstrap interval over tasks."""
    estimate = float(statistic(values, axis=-1))
    if np.ptp(values) == 0:
        return Interval(estimate, estimate, estimate)
    bounds = bootstrap(
        (values,),
        statistic,
        n_resamples=RESAMPLES,
        method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval
    return Interval(estimate, float(bounds.low), float(bounds.high))


def share_won(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Return the share of tasks on which `first` is lower; both (tasks,), ties won by nobody."""
    return float(np.mean(first < second - TIE))


def percent(share: float, digits: int = 0) -> str:
    """Write a share as a percentage."""
    return f"{100 * share:.{digits}f} %"
