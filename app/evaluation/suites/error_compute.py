"""Figure 3: error against compute time, CEM with more and more iterations beside the others."""

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from app.evaluation import grid
from app.evaluation.case import Case
from app.evaluation.claims import Lead
from app.evaluation.entrants import (
    CEM,
    DIFFUSION,
    MPPI,
    PAPER_DIFFUSION,
    REFINED_DIFFUSION,
    REFINED_PRIOR,
)
from app.evaluation.plots import LEAST_ERROR, LOOKS, draw_legend, spread
from app.evaluation.question import Entrant, Question
from app.evaluation.section import Claim, Picture, Section
from app.evaluation.statistics import TIE
from app.evaluation.suite import Answered, Size, Suite
from app.evaluation.tasks import REST, Task
from app.figures.style import PAGE_INCHES, Look, new_figure

TARGET = (0.5, 0.0)
ERROR, TIME = "terminal_error", "compute_ms"
ITERATIONS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 30, 35, 40)
NAMED_ITERATIONS = {1: (-6, 4), 20: (4, 4), 40: (4, -9)}
"""Those whose number stands beside the point, and where from there (pt)."""
OTHERS = (DIFFUSION, MPPI, REFINED_DIFFUSION, REFINED_PRIOR)
POINTS = (
    *((Entrant("CEM", {"method": {"name": "cem", "iterations": n}}), n) for n in ITERATIONS),
    *((entrant, 0) for entrant in (PAPER_DIFFUSION, *OTHERS)),
)
"""What is one point of the figure: an entrant, and CEM's iterations."""


class ErrorCompute(Suite):
    """The paper's error-compute trade-off, with more methods beside CEM and Action Diffusion."""

    name = "error-compute"
    purpose = "Figure 3: error against time, CEM with 1 to 40 iterations, 30 runs"
    FULL = Size(budgets=(32, 512), runs=30)
    QUICK = Size(budgets=(16, 32), runs=2)

    def tasks(self) -> list[Task]:
        return [{"initial_state": REST, "target_state": TARGET}]

    def questions(self) -> Iterator[Question]:
        questions = [
            question
            for k, (entrant, iterations) in product(self.size.budgets, POINTS)
            for question in self.ask(entrant, k, iterations=iterations)
        ]
        # Runs come outermost, so that a machine that slows down slows all points down.
        yield from sorted(questions, key=lambda question: question.labels["run"])

    def section(self, data: pd.DataFrame, answered: Answered) -> Section:
        budgets = self.size.budgets
        points = [Case(data, entrant, {"iterations": number}) for entrant, number in POINTS]
        fronts = [Front([point.at(num_candidates=k) for point in points]) for k in budgets]
        return Section(
            title="Error and compute time (Figure 3)",
            introduction=(
                f"From rest to {TARGET[0]:g} m, at rest again; {self.size.runs} runs of each "
                "point, all points in turn within a run. CEM's K is the population of each "
                "iteration, and each number of iterations is planned anew; the service runs it "
                "compiled from end to end. The time is the service's own, without waiting."
            ),
            tables=(
                grid.table(
                    self.name,
                    "Terminal error (m), mean ± standard deviation over the runs.",
                    points,
                    _columns(ERROR, budgets, digits=4),
                ),
                grid.table(
                    f"{self.name}-time",
                    "The service's compute time (ms), mean ± standard deviation over the runs.",
                    points,
                    _columns(TIME, budgets, digits=1),
                ),
            ),
            pictures=(_picture(fronts),),
            claims=_claims(*fronts),
        )


def _columns(measure: str, budgets: Sequence[int], digits: int) -> tuple[grid.Column[Case], ...]:
    return (
        grid.METHOD,
        grid.Column("Iterations", lambda point: str(point.where["iterations"] or "")),
        *(grid.spread(f"K = {k}", measure, digits, num_candidates=k) for k in budgets),
    )


class Front:
    """The points of one K, and how they stand to each other.

    Args:
        points: in the order of `POINTS`.
    """

    def __init__(self, points: Sequence[Case]) -> None:
        self.cem = points[: len(ITERATIONS)]
        self.learned, *self.others = points[len(ITERATIONS) :]
        self.best = min(self.cem, key=lambda point: point.mean(ERROR))
        self.place = f"K = {self.best.where['num_candidates']}"

    @property
    def dominant(self) -> list[str]:
        """Name the others that are nearer and faster than Action Diffusion, and than CEM's best."""
        return [
            point.entrant.label
            for point in self.others
            if _beats(point, self.learned) and _beats(point, self.best)
        ]

    def __str__(self) -> str:
        """Say how Action Diffusion stands to CEM's points: to the best, and to each."""
        time, error = self.learned.mean(TIME), self.learned.mean(ERROR)
        no_slower = [point for point in self.cem if point.mean(TIME) <= time]
        no_worse = [point for point in self.cem if point.mean(ERROR) <= error + TIE]
        neither = [point for point in no_slower if point in no_worse]
        return (
            f"{PAPER_DIFFUSION.label}: {_shown(self.learned)}; CEM at its best, after "
            f"{self.best.where['iterations']} iterations: {_shown(self.best)}. Iterations with "
            f"which CEM is no slower: {_iterations(no_slower)}; no worse: {_iterations(no_worse)}; "
            f"neither slower nor worse: {_iterations(neither)}."
        )


def _beats(point: Case, other: Case) -> bool:
    """Whether a point is both nearer to the target and faster."""
    return point.mean(ERROR) < other.mean(ERROR) - TIE and point.mean(TIME) < other.mean(TIME)


def _shown(point: Case) -> str:
    return f"{point.mean(ERROR):.4f} m in {point.mean(TIME):.1f} ms"


def _iterations(points: Sequence[Case]) -> str:
    return ", ".join(str(point.where["iterations"]) for point in points) or "none"


def _picture(fronts: list[Front]) -> Picture:
    figure = new_figure(PAGE_INCHES, 3.4)
    panels = figure.subplots(1, len(fronts), sharey=True)
    for axes, front in zip(panels, fronts, strict=True):
        places = _draw(axes, front.cem, LOOKS[CEM], "CEM, 1 to 40 iterations")
        for iterations, beside in NAMED_ITERATIONS.items():
            place = places[ITERATIONS.index(iterations)]
            axes.annotate(str(iterations), place, beside, textcoords="offset points", fontsize=7)
        for point in (front.learned, *front.others):
            _draw(axes, [point], LOOKS[point.entrant], point.entrant.label)
        axes.set(title=front.place, xscale="log", yscale="log", xlabel="compute time (ms)")
    panels[0].set_ylabel("terminal error (m)")
    draw_legend(figure, "outside upper center", columns=3)
    return Picture(
        "error-compute",
        "Terminal error against the service's compute time: means over the runs, with a standard "
        "deviation in each direction (but not below the least run); numbers are CEM's iterations. "
        "Errors below a micrometre are drawn as that. Lower and further left is better.",
        figure,
    )


def _draw(axes: Axes, points: Sequence[Case], look: Look, label: str) -> list[tuple[float, float]]:
    """Draw points with their bars, joined by a line; return where they are (ms, m)."""
    times = np.array([spread(point.values(TIME)) for point in points])
    errors = np.array([spread(point.values(ERROR).clip(min=LEAST_ERROR)) for point in points])
    joined = len(points) > 1
    axes.errorbar(
        times[:, 0],
        errors[:, 0],
        xerr=abs(times[:, 1:] - times[:, :1]).T,
        yerr=abs(errors[:, 1:] - errors[:, :1]).T,
        color=look.color,
        marker=look.marker,
        ms=3 if joined else 5,
        ls=look.line if joined else "none",
        elinewidth=0.6,
        label=label,
    )
    return list(zip(times[:, 0], errors[:, 0], strict=True))


def _claims(low: Front, high: Front) -> tuple[Claim, ...]:
    leads = {front.place: front.learned.less(front.best, ERROR, "run") for front in (low, high)}
    lead = Lead("CEM at its best", leads, digits=4)
    return (
        Claim(
            f"For {low.place}, Action Diffusion achieves lower terminal error at a smaller compute "
            "budget than CEM.",
            _beats(low.learned, low.best),
            str(low),
        ),
        Claim(
            f"For {high.place}, the gap becomes narrower.",
            lead.narrows,
            f"{lead} At {high.place}: {high}",
        ),
        Claim(
            "Neither of the two is on the front (beyond the paper): another method is nearer and "
            "faster than Action Diffusion, and than CEM at its best.",
            bool(low.dominant and high.dominant),
            "Nearer and faster than both: "
            + "; ".join(
                f"{', '.join(front.dominant) or 'none'} at {front.place}" for front in (low, high)
            )
            + ".",
        ),
    )
