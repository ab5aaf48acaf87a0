"""Learned models side by side: what each proposes, with and without descent, and a plain search."""

from collections.abc import Iterable, Iterator
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from app.evaluation import grid, plots
from app.evaluation.answer_log import Answer
from app.evaluation.case import Case, cases_of, taking_part
from app.evaluation.contests import (
    ERROR,
    MACHINES,
    NUM_CANDIDATES,
    PLANT,
    SEARCH,
    SEARCHES,
    Contest,
)
from app.evaluation.entrants import ANY_MODEL, PAPER_MODEL
from app.evaluation.question import Entrant, Question
from app.evaluation.statistics import percent
from app.evaluation.suite import Parts, Picture, Row, Size, Suite, Table
from app.evaluation.suites.robust import GAIN_SHARE, LONG_HORIZON, shares_of
from app.evaluation.tasks import random_machine_tasks, reachable_tasks, scale_of
from app.figures.style import BLUE, GREEN, ORANGE, PINK, RED, SKY, Look, new_figure
from app.planning.plant.system import System
from app.planning.uncertainty.ensemble import Ensemble
from app.planning.uncertainty.uncertainty import FEW_MOTIONS
from app.wire.requests import PlanRequest

ROBUST_MODEL, LONG_ROBUST_MODEL = "any-machine-robust", "any-machine-robust-h128"


def _model(label: str, name: str, look: Look) -> Entrant:
    return Entrant(label, {"method": "action_diffusion", "model": name}, look)


PAPER = _model("Diffusion, the paper's model", PAPER_MODEL, Look(BLUE, "o", "-"))
ANY = _model("Diffusion, every machine", ANY_MODEL, Look(SKY, "s", "-"))
ROBUST = _model("Diffusion, every machine, robust", ROBUST_MODEL, Look(GREEN, "D", "-"))
LONG_ROBUST = _model(
    f"Diffusion, every machine, robust, {LONG_HORIZON} steps",
    LONG_ROBUST_MODEL,
    Look(GREEN, "D", "--"),
)
DIFFUSION = _model("Diffusion, small budget", "learned-diffusion", Look(ORANGE, "^", "--"))
FLOW = _model("Flow matching, small budget", "learned-flow", Look(RED, "v", "--"))
REGRESSION = _model("Regression, small budget", "learned-regression", Look(PINK, "x", "--"))
MODELS = (PAPER, ANY, ROBUST, DIFFUSION, FLOW, REGRESSION)

OFF_BY = (0.0, 0.1, 0.2)
"""By how much friction may be off; where it may, so may the gain (`GAIN_SHARE`)."""
NUM_PLANTS = 20
"""That each plan is carried out on."""
CONTESTS = (
    Contest(ROBUST, PLANT, 0.1),
    Contest(ROBUST, PLANT, 0.2),
    Contest(LONG_ROBUST, PLANT, 0.1, LONG_HORIZON),
    Contest(ROBUST, MACHINES, 0.1),
)


class LearnedModels(Suite):
    """Learned models side by side, nominal and robust, and plain searches of the same time."""

    name = "learned-models"
    title = "Learned models, and a plain search in the same time"
    draw_tasks = staticmethod(reachable_tasks)
    FULL = Size(budgets=(1, 16, 128), tasks=60, entrants=MODELS)
    QUICK = Size(budgets=(1, 4), tasks=2, entrants=MODELS)
    trajectories = True

    def questions(self) -> Iterator[Question]:
        known = product(OFF_BY, self.size.budgets, (False, True), self.size.entrants)
        for off_by, k, refined, entrant in known:
            yield from self._questions(entrant, k, off_by, refined=refined)
        for contest in CONTESTS:
            for entrant, motions in contest.asked:
                yield from self._questions(
                    entrant.asking(horizon=contest.horizon),
                    NUM_CANDIDATES,
                    contest.off_by,
                    motions=motions,
                    on=contest.on,
                    contest=str(contest),
                )

    def _questions(
        self,
        entrant: Entrant,
        k: int,
        off_by: float,
        *,
        refined: bool = True,
        motions: int = FEW_MOTIONS,
        on: str = PLANT,
        contest: str = "",
    ) -> Iterator[Question]:
        fields: dict[str, Any] = {"refine": refined, "reachability": False}
        if off_by:
            fields["uncertainty"] = {"relative": shares_of(off_by), "num_motions": motions}
        yield from self.ask(
            entrant.asking(**fields),
            k,
            random_machine_tasks if on == MACHINES else None,
            if_covered=entrant != SEARCH,
            off_by=off_by,
            refined=refined,
            motions=motions if off_by and refined else 0,
            on=on,
            contest=contest,
        )

    def rows(self, question: Question, answer: Answer) -> Iterable[Row]:
        """Carry the controls out on plants drawn apart, or on the one that is known: the mean."""
        request, labels = question.request, question.labels
        assert isinstance(request, PlanRequest)
        start, target = np.array(request.initial_state), np.array(request.target_state)
        system = request.system or System()
        assert isinstance(system, System)
        plants = np.array([system.plant], dtype=np.float64)
        if labels["off_by"]:
            rng = np.random.default_rng([self.seed, int(labels["task"])])
            plants = shares_of(float(labels["off_by"])).draw(system, NUM_PLANTS, rng)
        controls = np.array([answer.content["controls"]])
        error = Ensemble.at(plants, start).errors(controls, target).mean()
        scale = scale_of(system).reach if labels["on"] == MACHINES else 1.0
        return [
            {
                **labels,
                ERROR: float(error) / scale,
                "diversity": answer.content["diversity"],
                "evaluations": answer.content["cost"]["network_evaluations"],
                "compute_ms": answer.compute_ms,
            }
        ]

    def report(self, data: pd.DataFrame) -> Parts:
        yield (
            f"{self.size.tasks} random starts, and targets at rest that are within reach on the "
            "nominal plant, for every learned model: the paper's (six network evaluations), that "
            "of every machine, that which knows robust plans as well, and three residual MLPs "
            "that were trained on the same plans with the same budget: a diffusion, conditional "
            "flow matching, and plain regression, which answers with one plan whatever K is. "
            "Where the plant is uncertain, friction and damping are off by so much, the gain by "
            f"{percent(GAIN_SHARE)}; candidates are ranked by an ensemble, and each plan is "
            f"carried out on {NUM_PLANTS} plants drawn apart. Models that know no uncertainty "
            "propose for the nominal plant."
        )
        models_alone = data[data.contest == ""]
        for off_by in OFF_BY:
            chosen = models_alone[models_alone.off_by == off_by]
            models = taking_part(chosen, self.size.entrants)
            yield _table_of_models(chosen, models, self.size.budgets, off_by)
        for number, contest in enumerate(CONTESTS):
            yield from contest.report(data, f"search-{number}")
        shown = data.contest.isin(["", str(CONTESTS[0])])
        yield _picture(data[shown & (data.off_by == OFF_BY[1])], self.size)


def _table_of_models(
    data: pd.DataFrame, models: list[Entrant], budgets: tuple[int, ...], off_by: float
) -> Table:
    known = f"friction off by up to {percent(off_by)}" if off_by else "the plant is known"
    return grid.of_cases(
        f"Mean executed error (m), {known}: as proposed, and after descent; network evaluations, "
        "the service's time, and the diversity of the candidates as proposed (m/s²).",
        cases_of(data, models, num_candidates=budgets),
        grid.mean("As proposed", ERROR, 4, refined=False),
        grid.mean("Evaluations", "evaluations", 0, refined=False),
        grid.median("ms", "compute_ms", 1, refined=False),
        grid.mean("Diversity", "diversity", 3, refined=False),
        grid.mean("Descended", ERROR, 4, refined=True),
        grid.median("ms, descended", "compute_ms", 1, refined=True),
        part=f"{round(100 * off_by)}",
    )


def _picture(data: pd.DataFrame, size: Size) -> Picture:
    """Draw the mean error against the time, a line through the K of each model."""
    figure = new_figure(3.2)
    panels = figure.subplots(1, 2, sharey=True)
    searches = [Case(data, SEARCH, {"motions": motions}) for motions in SEARCHES]
    for axes, refined in zip(panels, (False, True), strict=True):
        for entrant in taking_part(data, size.entrants):
            cases = [
                Case(data, entrant, {"num_candidates": k, "refined": refined}) for k in size.budgets
            ]
            _draw(axes, entrant, cases)
        _draw(axes, SEARCH, searches)
        axes.set(
            title="descended" if refined else "as proposed",
            xlabel="time of the service (ms)",
            xscale="log",
            yscale="log",
        )
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
    panels[0].set_ylabel("mean executed error (m)")
    return plots.with_legend(
        figure,
        f"Friction off by up to {percent(OFF_BY[1])}: mean executed error against the time of a "
        "plan, along the lines by K; of plain searches, which descend always, by their motions.",
        columns=2,
    )


def _draw(axes: Axes, entrant: Entrant, cases: list[Case]) -> None:
    points = [
        (np.median(case.values("compute_ms")), case.mean(ERROR)) for case in cases if len(case.rows)
    ]
    axes.plot(*zip(*points, strict=True), label=entrant.label, **entrant.look._asdict())
