"""Figure 3: error against compute time, CEM with more and more iterations beside the others."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import ClassVar, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from numpy.typing import NDArray

from app.evaluation.cells import mean_and_spread, with_interval
from app.evaluation.comparison import column
from app.evaluation.entrants import (
    CEM,
    DIFFUSION,
    MPPI,
    PAPER_DIFFUSION,
    REFINED_DIFFUSION,
    REFINED_PRIOR,
)
from app.evaluation.looks import LOOKS
from app.evaluation.plots import LEAST_ERROR, spread
from app.evaluation.question import Entrant, Question
from app.evaluation.section import Claim, Picture, Section, Table
from app.evaluation.statistics import TIE, paired_difference
from app.evaluation.suite import Answered, Suite
from app.evaluation.suites.sample_budget import run_question
from app.figures.style import PAGE_INCHES, Look, new_figure

TARGET = (0.5, 0.0)
ITERATIONS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 30, 35, 40)
NAMED_ITERATIONS = {1: (-6, 4), 20: (4, 4), 40: (4, -9)}
"""Those whose number stands beside the point, and where from there (pt)."""


class Point(NamedTuple):
    """What is one point of the figure."""

    entrant: Entrant
    iterations: int = 0
    """Of CEM."""


CEM_POINTS = tuple(
    Point(Entrant("CEM", {"method": {"name": "cem", "iterations": number}}), number)
    for number in ITERATIONS
)
PAPER_POINT = Point(PAPER_DIFFUSION)
OTHER_POINTS = tuple(
    Point(entrant) for entrant in (DIFFUSION, MPPI, REFINED_DIFFUSION, REFINED_PRIOR)
)
POINTS = (*CEM_POINTS, PAPER_POINT, *OTHER_POINTS)


class Found(NamedTuple):
    """The means over a point's runs."""

    error: float
    """m."""
    time: float
    """ms."""

    def beats(self, other: "Found") -> bool:
        """Whether it is both nearer to the target and faster."""
        return self.error < other.error - TIE and self.time < other.time

    def __str__(self) -> str:
        return f"{self.error:.4f} m in {self.time:.1f} ms"


@dataclass(frozen=True)
class ErrorCompute(Suite):
    """The paper's error-compute trade-off, with more methods beside CEM and Action Diffusion."""

    name: ClassVar[str] = "error-compute"
    purpose: ClassVar[str] = "Figure 3: error against time, CEM with 1 to 40 iterations, 30 runs"

    @property
    def budgets(self) -> tuple[int, int]:
        """K."""
        return (16, 32) if self.quick else (32, 512)

    @property
    def runs(self) -> int:
        """How many runs of each point."""
        return 2 if self.quick else 30

    def questions(self) -> Iterator[Question]:
        # Runs come outermost, so that a machine that slows down slows all points down.
        for run, k, point in product(range(self.runs), self.budgets, POINTS):
            yield run_question(
                self.seed, run, point.entrant, TARGET, k, iterations=point.iterations
            )

    def section(self, data: pd.DataFrame, answered: Answered) -> Section:
        return Section(
            title="Error and compute time (Figure 3)",
            introduction=(
                f"From rest to {TARGET[0]:g} m, at rest again; {self.runs} runs of each point, all "
                "points in turn within a run. CEM's K is the population of each iteration, and "
                "each number of iterations is planned anew; the service runs it compiled from end "
                "to end. The time is the service's own, without waiting."
            ),
            tables=(
                _table(
                    data, self.budgets, "terminal_error", 4, "error-compute",
                    "Terminal error (m), mean ± standard deviation over the runs.",
                ),
                _table(
                    data, self.budgets, "compute_ms", 1, "error-compute-time",
                    "The service's compute time (ms), mean ± standard deviation over the runs.",
                ),
            ),
            pictures=(_picture(data, self.budgets),),
            claims=_claims(data, self.budgets),
        )  # fmt: skip


def _values(data: pd.DataFrame, point: Point, measure: str, k: int) -> NDArray[np.float64]:
    """Return a measure of a point's runs, (runs,)."""
    return column(data, point.entrant, measure, num_candidates=k, iterations=point.iterations)


def _table(
    data: pd.DataFrame, budgets: tuple[int, int], measure: str, digits: int, name: str, caption: str
) -> Table:
    return Table(
        name,
        caption,
        ("Method", "Iterations", *(f"K = {k}" for k in budgets)),
        [
            (
                point.entrant.label,
                str(point.iterations or ""),
                *(mean_and_spread(_values(data, point, measure, k), digits) for k in budgets),
            )
            for point in POINTS
        ],
    )


def _picture(data: pd.DataFrame, budgets: tuple[int, int]) -> Picture:
    figure = new_figure(PAGE_INCHES, 3.4)
    panels = figure.subplots(1, 2, sharey=True)
    for axes, k in zip(panels, budgets, strict=True):
        places = _draw(axes, data, CEM_POINTS, k, LOOKS[CEM], "CEM, 1 to 40 iterations")
        for point, place in zip(CEM_POINTS, places, strict=True):
            if beside := NAMED_ITERATIONS.get(point.iterations):
                axes.annotate(
                    str(point.iterations), place, beside, textcoords="offset points", fontsize=7
                )
        for point in (PAPER_POINT, *OTHER_POINTS):
            _draw(axes, data, [point], k, LOOKS[point.entrant], point.entrant.label)
        axes.set_title(f"K = {k}")
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("compute time (ms)")
    panels[0].set_ylabel("terminal error (m)")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return Picture(
        "error-compute",
        "Terminal error against the service's compute time: means over the runs, with a standard "
        "deviation in each direction (but not below the least run); numbers are CEM's iterations. "
        "Errors below a micrometre are drawn as that. Lower and further left is better.",
        figure,
    )


def _draw(
    axes: Axes, data: pd.DataFrame, points: Sequence[Point], k: int, style: Look, label: str
) -> list[tuple[float, float]]:
    """Draw points with their bars, joined by a line; return where they are (ms, m)."""
    times = np.array([spread(_values(data, point, "compute_ms", k)) for point in points])
    errors = np.array(
        [
            spread(_values(data, point, "terminal_error", k).clip(min=LEAST_ERROR))
            for point in points
        ]
    )
    joined = len(points) > 1
    axes.errorbar(
        times[:, 0],
        errors[:, 0],
        xerr=abs(times[:, 1:] - times[:, :1]).T,
        yerr=abs(errors[:, 1:] - errors[:, :1]).T,
        color=style.color,
        marker=style.marker,
        ms=3 if joined else 5,
        ls=style.line if joined else "none",
        elinewidth=0.6,
        label=label,
    )
    return list(zip(times[:, 0], errors[:, 0], strict=True))


def _claims(data: pd.DataFrame, budgets: tuple[int, int]) -> tuple[Claim, ...]:
    low, high = budgets
    found = {
        k: {
            point: Found(
                _values(data, point, "terminal_error", k).mean(),
                _values(data, point, "compute_ms", k).mean(),
            )
            for point in POINTS
        }
        for k in budgets
    }
    best = {k: min(CEM_POINTS, key=lambda point: found[k][point].error) for k in budgets}
    lead = {
        k: paired_difference(
            _values(data, PAPER_POINT, "terminal_error", k),
            _values(data, best[k], "terminal_error", k),
        )
        for k in budgets
    }
    dominant = {
        k: [
            point.entrant.label
            for point in OTHER_POINTS
            if found[k][point].beats(found[k][PAPER_POINT])
            and found[k][point].beats(found[k][best[k]])
        ]
        for k in budgets
    }
    return (
        Claim(
            f"For K = {low}, Action Diffusion achieves lower terminal error at a smaller compute "
            "budget than CEM.",
            found[low][PAPER_POINT].beats(found[low][best[low]]),
            _against_cem(found[low], best[low]),
        ),
        Claim(
            f"For K = {high}, the gap becomes narrower.",
            lead[high].estimate > lead[low].estimate,
            "Action Diffusion less CEM at its best: "
            + ", ".join(f"{with_interval(lead[k], 4, '+')} m at K = {k}" for k in budgets)
            + f". At K = {high}: {_against_cem(found[high], best[high])}",
        ),
        Claim(
            "Neither of the two is on the front (beyond the paper): another method is nearer and "
            "faster than Action Diffusion, and than CEM at its best.",
            all(dominant.values()),
            "Nearer and faster than both: "
            + "; ".join(f"{', '.join(names) or 'none'} at K = {k}" for k, names in dominant.items())
            + ".",
        ),
    )


def _against_cem(found: dict[Point, Found], best: Point) -> str:
    """Say how Action Diffusion stands to CEM's points: to the best, and to each."""
    own = found[PAPER_POINT]

    def listed(points: Iterable[Point]) -> str:
        return ", ".join(str(point.iterations) for point in points) or "none"

    no_slower = [point for point in CEM_POINTS if found[point].time <= own.time]
    no_worse = [point for point in CEM_POINTS if found[point].error <= own.error + TIE]
    return (
        f"{PAPER_DIFFUSION.label}: {own}; CEM at its best, after {best.iterations} iterations: "
        f"{found[best]}. Iterations with which CEM is no slower: {listed(no_slower)}; no worse: "
        f"{listed(no_worse)}; neither slower nor worse: "
        f"{listed(point for point in no_slower if point in no_worse)}."
    )
