"""Plans for a plant that is not known: carried out on plants drawn apart, beside nominal plans."""

from collections.abc import Iterable, Iterator
from itertools import product

import numpy as np
import pandas as pd

from app.evaluation import grid, plots
from app.evaluation.answer_log import Answer
from app.evaluation.case import cases_of
from app.evaluation.entrants import REFINED_PRIOR
from app.evaluation.question import Entrant, Question
from app.evaluation.statistics import percent
from app.evaluation.suite import Parts, Picture, Row, Size, Suite, Table
from app.evaluation.tasks import REST, DrawTasks, Task, reachable_tasks
from app.figures.style import GREEN, RED, Look, new_figure
from app.planning.plant.system import System
from app.planning.problem import DEFAULT_HORIZON
from app.planning.uncertainty.ensemble import Ensemble
from app.planning.uncertainty.relative import Relative
from app.wire.requests import PlanRequest

GAIN_SHARE = 0.05
LONG_HORIZON = 128
SETTINGS = ((0.1, DEFAULT_HORIZON), (0.2, DEFAULT_HORIZON), (0.1, LONG_HORIZON))
"""How far each friction parameter may be off, and the horizon."""
NUM_PLANTS = 20
"""That each plan is carried out on."""
NEAR = 0.4
"""m: smaller displacements leave time to come back."""
SUCCESSES = (0.01, 0.05)
"""Errors that count as success, m."""
DISPLACEMENTS = (0.1, 0.2, 0.4)
"""m, from rest to rest: there the least error of any plan is known to first order."""
AT_THE_BOUND = {"num_systems": 128}
"""More plants: a mean square has no mercy on those that are missed."""
MAX_REPETITIONS = 20
LEAST, LARGEST = 1e-3, 1.0
"""m: the figure's edges."""
ERROR, RATIO = "executed_error", "ratio"

ROBUST = Entrant("Robust", REFINED_PRIOR.fields, Look(GREEN, "o", "-"))
THOROUGH = Entrant("Robust, 4096 motions", REFINED_PRIOR.fields, Look(RED, "D", "-"))
MOTIONS: dict[Entrant, dict[str, int]] = {ROBUST: {}, THOROUGH: {"num_motions": 4096}}


class Robust(Suite):
    """Plans for plants that are off by 10 and 20 %, K = 16."""

    name = "robust"
    title = "Plans for a plant that is not known"
    draw_tasks = staticmethod(reachable_tasks)
    FULL = Size(budgets=(16,), tasks=120, entrants=(REFINED_PRIOR, ROBUST, THOROUGH))
    QUICK = Size(budgets=(16,), tasks=3, entrants=(REFINED_PRIOR, ROBUST))
    trajectories = True

    def questions(self) -> Iterator[Question]:
        (k,) = self.size.budgets
        for (share, horizon), entrant in product(SETTINGS, self.size.entrants):
            asked = _asking(entrant, share, horizon)
            yield from self.ask(asked, k, off_by=share, horizon=horizon, displacement=0.0)
        share = SETTINGS[0][0]
        for displacement, entrant in product(DISPLACEMENTS, self._robust):
            asked = _asking(entrant, share, LONG_HORIZON, **AT_THE_BOUND)
            yield from self.ask(
                asked,
                k,
                _repeated({"initial_state": REST, "target_state": (displacement, 0.0)}),
                off_by=share,
                horizon=LONG_HORIZON,
                displacement=displacement,
            )

    def rows(self, question: Question, answer: Answer) -> Iterable[Row]:
        """Carry the controls out on plants drawn apart, a row each; or compare with the bound."""
        request, labels = question.request, question.labels
        assert isinstance(request, PlanRequest)
        if labels["displacement"]:
            robustness = answer.content["robustness"]
            ratio = robustness["rms_error"] / robustness["first_order_bound"]
            return [{**labels, RATIO: ratio}]
        plants = shares_of(float(labels["off_by"])).draw(
            System(), NUM_PLANTS, np.random.default_rng([self.seed, int(labels["task"])])
        )
        start, target = np.array(request.initial_state), np.array(request.target_state)
        controls = np.array([answer.content["controls"]])
        near = bool(abs(target[0] - start[0]) < NEAR)
        return [
            {**labels, "near": near, "compute_ms": answer.compute_ms, ERROR: float(error)}
            for error in Ensemble.at(plants, start).errors(controls, target)[0]
        ]

    def report(self, data: pd.DataFrame) -> Parts:
        executed = data[data.displacement == 0.0]
        yield (
            f"{self.size.tasks} random starts, and targets at rest that are within reach on the "
            f"nominal plant; each plan is carried out open loop on {NUM_PLANTS} plants, drawn "
            "apart from those that it was made with. Static and Coulomb friction and damping are "
            f"off by up to so much, uniform and independent, the gain by up to "
            f"{percent(GAIN_SHARE)}. Not every plant can reach its target."
        )
        for share, horizon in SETTINGS:
            chosen = executed[(executed.off_by == share) & (executed.horizon == horizon)]
            yield grid.of_cases(
                f"Friction off by up to {percent(share)}, {horizon} steps: executed error (m), its "
                "difference to the nominal plan's with the 95 % bootstrap interval over the "
                "tasks, the share of the plants on which it is at most so much (near: "
                f"displacements below {NEAR:g} m), and the service's time.",
                cases_of(chosen, self.size.entrants),
                grid.mean("Mean", ERROR, 4),
                grid.median("Median", ERROR, 4),
                grid.less("Less nominal", ERROR, REFINED_PRIOR, 4),
                *(grid.within(f"Within {limit:g}", ERROR, limit) for limit in SUCCESSES),
                grid.within(f"Near, within {SUCCESSES[0]:g}", ERROR, SUCCESSES[0], near=True),
                grid.median("Time (ms)", "compute_ms", 1),
                part=f"{round(100 * share)}-{horizon}",
            )
        yield self._at_the_bound(data[data.displacement > 0.0])
        yield self._picture(executed)

    @property
    def _robust(self) -> list[Entrant]:
        return [entrant for entrant in self.size.entrants if entrant in MOTIONS]

    def _at_the_bound(self, data: pd.DataFrame) -> Table:
        cases = cases_of(data, self._robust)
        return grid.of_cases(
            "From rest to rest no plan's r.m.s. error is below a bound, to first order: r.m.s. "
            f"error by that bound with {LONG_HORIZON} steps, the median over "
            f"{data.task.nunique()} draws of {AT_THE_BOUND['num_systems']} plants and the "
            "motions.",
            cases,
            *(
                grid.median(f"D = {displacement:g} m", RATIO, 2, displacement=displacement)
                for displacement in DISPLACEMENTS
            ),
            part="bound",
        )

    def _picture(self, data: pd.DataFrame) -> Picture:
        figure = new_figure(2.8)
        panels = figure.subplots(1, len(SETTINGS), sharey=True)
        for axes, (share, horizon) in zip(panels, SETTINGS, strict=True):
            for case in cases_of(data, self.size.entrants):
                place = case.at(off_by=share, horizon=horizon)
                plots.draw_shares(axes, place, ERROR, LARGEST, "executed error e (m)", LEAST)
        panels[0].set_ylabel("share of plants within e")
        return plots.with_legend(
            figure,
            "Plans carried out on plants that differ: share of all tasks and plants on which the "
            "error is at most e.",
            columns=len(self.size.entrants),
        )


def shares_of(friction_share: float) -> Relative:
    """Return how far the parameters may be off."""
    return Relative(friction_share, friction_share, friction_share, control_gain=GAIN_SHARE)


def _asking(entrant: Entrant, share: float, horizon: int, **fields: int) -> Entrant:
    """Return an entrant for a horizon, and a robust one for how far the parameters may be off."""
    asking = entrant.asking(horizon=horizon)
    if entrant not in MOTIONS:
        return asking
    uncertainty = {"relative": shares_of(share), **MOTIONS[entrant], **fields}
    return asking.asking(uncertainty=uncertainty)


def _repeated(task: Task) -> DrawTasks:
    """Draw always the same task; the seeds of its requests differ."""
    return lambda num_tasks, _: [task] * min(num_tasks, MAX_REPETITIONS)
