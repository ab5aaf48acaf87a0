"""Panels that several suites draw."""

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from numpy.typing import ArrayLike, NDArray

from app.evaluation.comparison import Unit, per_unit
from app.evaluation.looks import LOOKS
from app.evaluation.question import Entrant
from app.evaluation.statistics import Interval, interval
from app.figures.style import Look

LEAST_ERROR = 1e-6
"""Logarithmic axes show smaller errors as this (m): below lies rounding."""
DODGE = 0.12
"""How far to either side figures spread the entrants about each K, in octaves."""


def spread(values: NDArray[np.float64]) -> Interval:
    """Return the mean of `values` (units,) and one standard deviation to either side.

    The lower end is not below the least value, so that it is positive where all values are.
    """
    mean, deviation = float(values.mean()), float(values.std())
    return Interval(mean, max(mean - deviation, float(values.min())), mean + deviation)


def draw_over_budget(
    axes: Axes,
    data: pd.DataFrame,
    entrants: Sequence[Entrant],
    budgets: Sequence[int],
    measure: str,
    label: str,
    scale: Literal["linear", "log"] = "linear",
    unit: Unit = "task",
    bars: Callable[[NDArray[np.float64]], Interval] = interval,
) -> None:
    """Draw the mean of a measure over K, a line an entrant, with 95 % intervals over the tasks.

    Args:
        axes: takes the lines.
        data: of a suite.
        entrants: who is drawn.
        budgets: K.
        measure: column of `data`.
        label: of the measure, with its unit.
        scale: of the measure's axis.
        unit: column of what the bars are over.
        bars: mean, lower and upper end of the bar from a value for each unit, (units,).
    """
    for entrant, shift in zip(entrants, np.linspace(-DODGE, DODGE, len(entrants)), strict=True):
        found = [bars(per_unit(data, entrant, measure, unit, num_candidates=k)) for k in budgets]
        positions = np.array(budgets) * 2**shift
        draw_intervals(axes, LOOKS[entrant], entrant.label, positions, found)
    axes.set_xscale("log", base=2)
    axes.set_xticks(budgets, labels=[str(k) for k in budgets])
    axes.set_xlabel("candidates K")
    axes.set_ylabel(label)
    axes.set_yscale(scale)
    if scale == "linear":
        axes.set_ylim(bottom=0)


def draw_intervals(
    axes: Axes, look: Look, label: str, positions: ArrayLike, found: Sequence[Interval]
) -> None:
    """Draw a line of estimates `found` with their intervals, at `positions` (N,) along x."""
    middle, low, high = np.array(found).T
    axes.errorbar(
        positions,
        middle,
        yerr=np.array([middle - low, high - middle]).clip(min=0),
        color=look.color,
        marker=look.marker,
        ls=look.line,
        elinewidth=0.7,
        label=label,
    )
