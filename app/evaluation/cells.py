"""Cells of tables: numbers as the paper prints them, and with intervals."""

import numpy as np
from numpy.typing import ArrayLike

from app.evaluation.statistics import Interval


def mean_and_spread(values: ArrayLike, digits: int) -> str:
    """Write mean ± standard deviation, as the paper does."""
    array = np.asarray(values, dtype=np.float64)
    return f"{array.mean():.{digits}f} ± {array.std():.{digits}f}"


def with_interval(interval: Interval, digits: int, sign: str = "") -> str:
    """Write an estimate and its interval; `sign` "+" shows the signs of differences."""
    # Rounded before it is written, and 0 added: -0.0004 is "0.000" and not "-0.000".
    estimate, low, high = (f"{round(value, digits) + 0.0:{sign}.{digits}f}" for value in interval)
    return f"{estimate} [{low}, {high}]"


def percent(share: float, digits: int = 0) -> str:
    """Write a share as a percentage."""
    return f"{share:.{digits}%}".replace("%", " %")
