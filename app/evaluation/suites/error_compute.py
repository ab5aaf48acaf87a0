"""Figure 3: error against compute time, CEM with more and more iterations beside the others."""

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from app.evaluation import claims, entrants, grid, plots
from app.evaluation.case import Case
from app.evaluation.question import Entrant, Question
from app.evaluation.statistics import TIE
from app.evaluation.suite import Claim, Parts, Picture, Size, Suite
from app.evaluation.tasks import one_task
from app.figures.style import new_figure

TARGET = (0.5, 0.0)
ERROR, TIME = "terminal_error", "compute_ms"
ITERATIONS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 30, 35, 40)
NAMED_ITERATIONS = {1: (-6, 4), 20: (4, 4), 40: (4, -9)}
"""Those whose number stands beside the point, and where from there (pt)."""
OTHERS = (entrants.DIFFUSION, entrants.MPPI, entrants.REFINED_DIFFUSION, entrants.REFINED_PRIOR)
POINTS = (
    *(
        (
            Entrant("CEM", {"method": {"name": "cem", "iterations": number}}, entrants.CEM.look),
            number,
        )
        for number in ITERATIONS
    ),
    *((entrant, 0) for entrant in (entrants.PAPER_DIFFUSION, *OTHERS)),
)
"""What is one point of the figure: an entrant, and CEM's iterations."""


class ErrorCompute(Suite):
    """Figure 3: error against time, CEM with 1 to 40 iterations, 30 runs."""

    name = "error-compute"
    title = "Error and compute time (Figure 3)"
    draw_tasks = staticmethod(one_task(target_state=TARGET))
    FULL = Size(budgets=(32, 512), runs=30)
    QUICK = Size(budgets=(16, 32), runs=2)

    def questions(self) -> Iterator[Question]:
        questions = [
            question
            for k, (entrant, iterations) in product(self.size.budgets, POINTS)
            for question in self.ask(entrant, k, iterations=iterations)
        ]
        # Runs come outermost, so that a machine that slows down slows all points down.
        yield from sorted(questions, key=lambda question: question.labels["run"])

    def report(self, data: pd.DataFrame) -> Parts:
        budgets = self.size.budgets
        points = [Case(data, entrant, {"iterations": number}) for entrant, number in POINTS]
        fronts = [Front([point.at(num_candidates=k) for point in points]) for k in budgets]
        yield (
            f"From rest to {TARGET[0]:g} m, at rest again; {self.size.runs} runs of each point, "
            "all points in turn within a run. CEM's K is the population of each iteration, and "
            "each number of iterations is planned anew; the service runs it compiled from end to "
            "end. The time is the service's own, without waiting."
        )
        for what, measure, digits, part in (
            ("Terminal error (m)", ERROR, 4, ""),
            ("The service's compute time (ms)", TIME, 1, "time"),
        ):
            at_each_k = (
                grid.spread(f"K = {k}", measure, digits, num_candidates=k) for k in budgets
            )
            yield grid.table(
                f"{what}, mean ± standard deviation over the runs.",
                points,
                (
                    grid.METHOD,
                    grid.Column("Iterations", lambda point: str(point.where["iterations"] or "")),
                    *at_each_k,
                ),
                part,
            )
        yield _picture(fronts)
        yield from _claims(*fronts)


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
    def dominant(self) -> str:
        """Name the others that are nearer and faster than Action Diffusion, and than CEM's best."""
        return ", ".join(
            point.entrant.label
            for point in self.others
            if _beats(point, self.learned) and _beats(point, self.best)
        )

    def __str__(self) -> str:
        """Say how Action Diffusion stands to CEM's points: to the best, and to each."""
        time, error = self.learned.mean(TIME), self.learned.mean(ERROR)
        no_slower = [point for point in self.cem if point.mean(TIME) <= time]
        no_worse = [point for point in self.cem if point.mean(ERROR) <= error + TIE]
        neither = [point for point in no_slower if point in no_worse]
        return (
            f"{entrants.PAPER_DIFFUSION.label}: {_shown(self.learned)}; CEM at its best, after "
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
    figure = new_figure(3.4)
    panels = figure.subplots(1, len(fronts), sharey=True)
    for axes, front in zip(panels, fronts, strict=True):
        places = _draw(axes, front.cem, "CEM, 1 to 40 iterations")
        for iterations, beside in NAMED_ITERATIONS.items():
            place = places[ITERATIONS.index(iterations)]
            axes.annotate(str(iterations), place, beside, textcoords="offset points", fontsize=7)
        for point in (front.learned, *front.others):
            _draw(axes, [point], point.entrant.label)
        axes.set(title=front.place, xscale="log", yscale="log", xlabel="compute time (ms)")
    panels[0].set_ylabel("terminal error (m)")
    return plots.with_legend(
        figure,
        "Terminal error against the service's compute time: means over the runs, with a standard "
        "deviation in each direction (but not below the least run); numbers are CEM's iterations. "
        "Errors below a micrometre are drawn as that. Lower and further left is better.",
        columns=3,
    )


def _draw(axes: Axes, points: Sequence[Case], label: str) -> list[tuple[float, float]]:
    """Draw points with their bars, joined by a line; return where they are (ms, m)."""
    times, errors = (
        np.array([plots.spread(point.values(measure).clip(least)) for point in points]).T
        for measure, least in ((TIME, 0.0), (ERROR, plots.LEAST_ERROR))
    )
    look, size = points[0].entrant.look, 3
    if len(points) == 1:
        look, size = look._replace(ls="none"), 5
    axes.errorbar(
        times[0],
        errors[0],
        xerr=abs(times[1:] - times[0]),
        yerr=abs(errors[1:] - errors[0]),
        ms=size,
        elinewidth=0.6,
        label=label,
        **look._asdict(),
    )
    return list(zip(times[0], errors[0], strict=True))


def _claims(low: Front, high: Front) -> Parts:
    leads = {front.place: front.learned.less(front.best, ERROR) for front in (low, high)}
    lead = claims.Lead("CEM at its best", leads, digits=4)
    yield Claim(
        f"For {low.place}, Action Diffusion achieves lower terminal error at a smaller compute "
        "budget than CEM.",
        _beats(low.learned, low.best),
        str(low),
    )
    yield Claim(
        f"For {high.place}, the gap becomes narrower.",
        lead.narrows,
        f"{lead} At {high.place}: {high}",
    )
    yield Claim(
        "Neither of the two is on the front (beyond the paper): another method is nearer and "
        "faster than Action Diffusion, and than CEM at its best.",
        bool(low.dominant and high.dominant),
        f"Nearer and faster than both: {low.dominant or 'none'} at {low.place}; "
        f"{high.dominant or 'none'} at {high.place}.",
    )
