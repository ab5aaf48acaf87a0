"""Learned models side by side: what each proposes, with and without descent, and a plain search."""

from collections.abc import Iterable, Iterator
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from app.evaluation import grid, plots
from app.evaluation.answer_log import Answer
from app.evaluation.case import Case, cases_of, taking_part
from app.evaluation.entrants import ANY_MODEL, DATASET_PRIOR, PAPER_MODEL
from app.evaluation.question import Entrant, Question
from app.evaluation.statistics import percent
from app.evaluation.suite import Claim, Parts, Picture, Row, Size, Suite, Table
from app.evaluation.suites.robust import GAIN_SHARE, shares_of
from app.evaluation.tasks import DrawTasks, random_machine_tasks, reachable_tasks, scale_of
from app.figures.style import BLACK, BLUE, GREEN, ORANGE, PINK, RED, SKY, Look, new_figure
from app.planning.plant.system import System
from app.planning.uncertainty.ensemble import Ensemble
from app.planning.uncertainty.uncertainty import FEW_MOTIONS
from app.wire.requests import PlanRequest

ROBUST_MODEL = "any-machine-robust"


def _model(label: str, name: str, look: Look) -> Entrant:
    return Entrant(label, {"method": "action_diffusion", "model": name}, look)


PAPER = _model("Diffusion, the paper's model", PAPER_MODEL, Look(BLUE, "o", "-"))
ANY = _model("Diffusion, every machine", ANY_MODEL, Look(SKY, "s", "-"))
ROBUST = _model("Diffusion, every machine, robust", ROBUST_MODEL, Look(GREEN, "D", "-"))
DIFFUSION = _model("Diffusion, small budget", "learned-diffusion", Look(ORANGE, "^", "--"))
FLOW = _model("Flow matching, small budget", "learned-flow", Look(RED, "v", "--"))
REGRESSION = _model("Regression, small budget", "learned-regression", Look(PINK, "x", "--"))
SEARCH = Entrant("Plain search", DATASET_PRIOR.fields, Look(BLACK, "*", "-"))
"""From motions that are drawn: what the network has to beat in the same time."""
MODELS = (PAPER, ANY, ROBUST, DIFFUSION, FLOW, REGRESSION)

OFF_BY = (0.0, 0.1, 0.2)
"""By how much friction may be off; where it may, so may the gain (`GAIN_SHARE`)."""
SEARCHES = (64, 128, 256, 512, 1024)
"""Motions of plain searches, among which the one that takes as long is read off."""
K_OF_SEARCHES = 16
NUM_PLANTS = 20
"""That each plan is carried out on."""
ERROR = "executed_error"
PLANT, MACHINES = "plant", "machines"
"""What the tasks are on: the paper's plant, or each on a random machine."""


class LearnedModels(Suite):
    """Learned models side by side, nominal and robust, and plain searches of the same time."""

    name = "learned-models"
    title = "Learned models, and a plain search in the same time"
    draw_tasks = staticmethod(reachable_tasks)
    FULL = Size(budgets=(1, 16, 128), tasks=60, entrants=MODELS)
    QUICK = Size(budgets=(1, 4), tasks=2, entrants=MODELS)
    trajectories = True

    def questions(self) -> Iterator[Question]:
        for off_by, k, refined in product(OFF_BY, self.size.budgets, (False, True)):
            for entrant in self.size.entrants:
                yield from self._questions(entrant, k, off_by, refined, FEW_MOTIONS)
        for off_by, motions in product(OFF_BY[1:], SEARCHES):
            yield from self._questions(SEARCH, K_OF_SEARCHES, off_by, True, motions)
        for entrant, motions in ((ROBUST, FEW_MOTIONS), *((SEARCH, each) for each in SEARCHES)):
            yield from self._questions(
                entrant, K_OF_SEARCHES, OFF_BY[1], True, motions, random_machine_tasks
            )

    def _questions(
        self,
        entrant: Entrant,
        k: int,
        off_by: float,
        refined: bool,
        motions: int,
        draw_tasks: DrawTasks | None = None,
    ) -> Iterator[Question]:
        fields: dict[str, Any] = {"refine": refined, "reachability": False}
        uncertainty = {"relative": shares_of(off_by), "num_motions": motions}
        if off_by:
            fields["uncertainty"] = uncertainty
        yield from self.ask(
            entrant.asking(**fields),
            k,
            draw_tasks,
            if_covered=entrant != SEARCH,
            off_by=off_by,
            refined=refined,
            motions=motions if off_by and refined else 0,
            on=MACHINES if draw_tasks else PLANT,
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
        on_plant = data[data.on == PLANT]
        for off_by in OFF_BY:
            chosen = on_plant[on_plant.off_by == off_by]
            models = taking_part(chosen, self.size.entrants)
            yield _table_of_models(chosen, models, self.size.budgets, off_by)
        yield from _searches(data, self.size.budgets)
        yield _picture(on_plant[on_plant.off_by == OFF_BY[1]], self.size)


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


def _searches(data: pd.DataFrame, budgets: tuple[int, ...]) -> Parts:
    """Compare the robust model's refined plans with plain searches, on the plant and on machines.

    Last comes the verdict, by the fastest search that takes no less time.
    """
    where = [
        (f"friction off by up to {percent(off_by)}, m", PLANT, off_by) for off_by in OFF_BY[1:]
    ]
    where.append(
        ("random machines, friction off by up to 10 %, shares of the reach", MACHINES, 0.1)
    )
    for number, (what, on, off_by) in enumerate(where):
        at = data[(data.on == on) & (data.off_by == off_by) & data.refined]
        rivals = [
            Case(at, SEARCH, {"motions": motions, "num_candidates": K_OF_SEARCHES})
            for motions in SEARCHES
        ]
        k = K_OF_SEARCHES if K_OF_SEARCHES in budgets or on == MACHINES else budgets[-1]
        learned = Case(at, ROBUST, {"motions": FEW_MOTIONS, "num_candidates": k})
        cases = ([learned] if len(learned.rows) else []) + rivals

        def less(case: Case, learned: Case = learned) -> str:
            if case is learned or not len(learned.rows):
                return ""
            return learned.less(case, ERROR).shown(4, "+")

        yield grid.table(
            f"Refined robust plans and plain searches, {what}: mean executed error, what the "
            "model's is more than it with the 95 % bootstrap interval over the tasks, and the "
            "service's time.",
            cases,
            (
                grid.METHOD,
                grid.Column("Motions", lambda case: str(case.where["motions"])),
                grid.mean("Mean", ERROR, 4),
                grid.Column("Model less search", less),
                grid.median("ms", "compute_ms", 1),
            ),
            part=f"search-{number}",
        )
        if len(learned.rows):
            yield _verdict(what, learned, rivals)


def _verdict(what: str, learned: Case, rivals: list[Case]) -> Claim:
    took = float(np.median(learned.values("compute_ms")))
    times = [float(np.median(rival.values("compute_ms"))) for rival in rivals]
    within = [rival for rival, ms in zip(rivals, times, strict=True) if ms <= took]
    rival = within[-1] if within else rivals[0]
    difference = learned.less(rival, ERROR)
    return Claim(
        "A learned robust plan is nearer than that of a plain search in the same time (beyond the "
        f"paper), {what}.",
        difference.high < 0,
        f"The model takes {took:.1f} ms, the search of {rival.where['motions']} motions "
        f"{times[rivals.index(rival)]:.1f}; its error less the search's is "
        f"{difference.shown(4, '+')}.",
    )


def _picture(data: pd.DataFrame, size: Size) -> Picture:
    """Draw the mean error against the time, a line through the K of each model."""
    figure = new_figure(3.2)
    panels = figure.subplots(1, 2, sharey=True)
    searches = [Case(data, SEARCH, {"motions": motions, "refined": True}) for motions in SEARCHES]
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
