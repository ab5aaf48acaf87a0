"""Panels that several suites draw."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Literal, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from app.evaluation.case import Case
from app.evaluation.question import Entrant
from app.evaluation.statistics import Interval, interval
from app.evaluation.suite import Picture

Bars: TypeAlias = Callable[[NDArray[np.float64]], Interval]
"""Mean, lower and upper end of a bar from a value for each task or run, (units,)."""
Lines: TypeAlias = Mapping[Entrant, Sequence[Interval]]
"""Estimates with their intervals, one at each position along x."""

LEAST_ERROR = 1e-6
"""Logarithmic axes show smaller errors as this (m): below lies rounding."""
OCTAVES = 0.24
"""Width over which figures spread the lines about each K."""


def spread(values: NDArray[np.float64]) -> Interval:
    """Return the mean of `values` (units,) and one standard deviation to either side.

    The lower end is not below the least value, so that it is positive where all values are.
    """
    mean, deviation = float(values.mean()), float(values.std())
    return Interval(mean, max(mean - deviation, float(values.min())), mean + deviation)


def entrant_lines(cases: Iterable[Case], measure: str, bars: Bars = interval) -> Lines:
    """Return a line of a measure for each entrant, through its cases in their order."""
    lines: dict[Entrant, list[Interval]] = {}
    for case in cases:
        lines.setdefault(case.entrant, []).append(bars(case.per_unit(measure)))
    return lines


def draw_lines(
    axes: Axes,
    lines: Lines,
    positions: ArrayLike,
    width: float,
    shifted: Callable[[ArrayLike, float], ArrayLike] = np.add,
) -> None:
    """Draw lines side by side.

    Args:
        axes: takes the lines.
        lines: what is drawn.
        positions: along x, (N,).
        width: over which the lines are spread about each position.
        shifted: positions from their middle and a shift.
    """
    shifts = np.linspace(-width / 2, width / 2, len(lines))
    for (entrant, intervals), shift in zip(lines.items(), shifts, strict=True):
        middle, low, high = np.array(intervals).T
        axes.errorbar(
            shifted(positions, shift),
            middle,
            yerr=np.array([middle - low, high - middle]).clip(min=0),
            elinewidth=0.7,
            label=entrant.label,
            **entrant.look._asdict(),
        )


def draw_over_budget(
    axes: Axes,
    cases: Sequence[Case],
    measure: str,
    label: str,
    scale: Literal["linear", "log"] = "linear",
    bars: Bars = interval,
) -> None:
    """Draw a measure over K, a line an entrant.

    Args:
        axes: takes the lines.
        cases: what is drawn.
        measure: column of the data.
        label: of the measure, with its unit.
        scale: of the measure's axis.
        bars: what they show.
    """
    budgets = list(dict.fromkeys(case.where["num_candidates"] for case in cases))
    lines = entrant_lines(cases, measure, bars)
    draw_lines(axes, lines, budgets, OCTAVES, lambda k, octaves: np.multiply(k, 2**octaves))
    axes.set_xscale("log", base=2)
    axes.set_xticks(budgets, labels=[str(k) for k in budgets])
    axes.set(xlabel="candidates K", ylabel=label, yscale=scale)
    if scale == "linear":
        axes.set_ylim(bottom=0)


def with_legend(figure: Figure, caption: str, columns: int = 1) -> Picture:
    """Name the lines of the first panel in a column beside all panels, or in more above them."""
    handles, labels = figure.axes[0].get_legend_handles_labels()
    if columns == 1:
        figure.legend(handles, labels, loc="outside right upper")
    else:
        figure.legend(handles, labels, loc="outside upper center", ncols=columns)
    return Picture(caption, figure)


def draw_shares(
    axes: Axes,
    case: Case,
    measure: str,
    largest: float,
    xlabel: str,
    least: float = LEAST_ERROR,
) -> None:
    """Draw the share of a case's rows whose measure is at most e, over `least` to `largest`."""
    values = np.sort(case.values(measure)).clip(least)
    axes.stairs(
        np.arange(1, len(values) + 1) / len(values),
        [*values, max(values[-1], largest)],
        baseline=None,
        color=case.entrant.look.color,
        ls=case.entrant.look.ls,
        label=case.entrant.label,
    )
    axes.set(
        title=case.place,
        xlabel=xlabel,
        xscale="log",
        xlim=(least, largest),
        xticks=np.geomspace(least, largest, 4),
        ylim=(0, 1.02),
    )
