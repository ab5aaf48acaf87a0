"""What a wrong model of the plant costs: plans carried out on a plant that differs."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd

from app.evaluation import grid, plots
from app.evaluation.answer_log import Answer
from app.evaluation.case import Case, cases_of
from app.evaluation.entrants import ENTRANTS, REFINED_PRIOR
from app.evaluation.question import Entrant, Question
from app.evaluation.statistics import percent
from app.evaluation.suite import Parts, Picture, Row, Size, Suite
from app.evaluation.tasks import transition_tasks
from app.figures.style import BLACK, Look, new_figure
from app.planning.arrays import FloatArray
from app.planning.metrics import terminal_error
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System
from app.planning.uncertainty.relative import Relative
from app.wire.requests import PlanRequest

NOMINAL = System()
EXPECTED_SHARE = 0.1
"""How far the robust plans take friction, damping and gain to be off at most."""
EXPECTED = Relative(EXPECTED_SHARE, EXPECTED_SHARE, EXPECTED_SHARE, control_gain=EXPECTED_SHARE)
ROBUST = Entrant(
    "Dataset Prior, robust",
    REFINED_PRIOR.fields | {"uncertainty": {"relative": EXPECTED}},
    Look(BLACK, "h", "-"),
)
"""Made for the plants of 10 % and those between, and carried out where 20 % is off as well."""
TESTED = (*ENTRANTS, ROBUST)
PARAMETERS = {
    "static_friction": "f_s",
    "coulomb_friction": "f_c",
    "viscous_damping": "b",
    "control_limit": "u_max",
}
"""What differs, and its symbol."""
CHANGES = (-20, -10, 10, 20)
"""By how much, %."""
ALL_CHANGES = sorted((*CHANGES, 0))
UNCHANGED = "nominal"
"""Stands for the parameter on the nominal plant."""
SUCCESS = 0.05
"""Executed errors up to this count as success, m."""
ERROR = "executed_error"
WIDTH = 4.0
"""Over which a figure spreads the entrants about each change, %."""


class PlantSensitivity(Suite):
    """Nominal and robust plans on plants whose f_s, f_c, b or u_max differs, K = 32."""

    name = "plant-sensitivity"
    title = "Sensitivity to the plant"
    draw_tasks = staticmethod(transition_tasks)
    FULL = Size(budgets=(32,), tasks=200, entrants=TESTED)
    QUICK = Size(budgets=(16,), tasks=8, entrants=TESTED)
    trajectories = True

    def rows(self, question: Question, answer: Answer) -> Iterable[Row]:
        """Carry the answered controls out on every plant: a row each, the nominal one first."""
        assert isinstance(question.request, PlanRequest)
        controls = np.array(answer.content["controls"])
        floor = answer.content["reachability"]["floor"]
        return [
            {
                **question.labels,
                "parameter": parameter,
                "change": change,
                "executed_error": executed_error(plant, question.request, controls),
                "nominal_floor": floor,
            }
            for (parameter, change), plant in PLANTS.items()
        ]

    def report(self, data: pd.DataFrame) -> Parts:
        yield (
            f"Plans made for the nominal plant with K = {self.size.budgets[0]}, carried out open "
            "loop on a plant that differs in one parameter: static friction f_s, kinetic (Coulomb) "
            "friction f_c, damping b or control limit u_max, each by -20, -10, +10 and +20 %. The "
            "executed error is the distance of the state at the end from the target. The tasks are "
            f"the first {self.size.tasks} random transitions; their mean floor is "
            f"{data.nominal_floor.mean():.3f} m on the nominal plant, which no plan can go below "
            "there. Kinetic friction cannot exceed static friction: where f_s falls below f_c, f_c "
            "falls with it, and where f_c rises above f_s, f_s rises with it. Where u_max falls, "
            "the controls are clipped to it; where it rises nothing changes, for the plans do not "
            f"use it. {ROBUST.label}, is made for friction, damping and gain that are off by up to "
            f"{percent(EXPECTED_SHARE)} at once."
        )
        # The rows where a parameter differs, and those on the nominal plant: change 0.
        around_nominal = {
            parameter: data[data.parameter.isin([parameter, UNCHANGED])] for parameter in PARAMETERS
        }
        for parameter, rows in around_nominal.items():
            yield grid.of_cases(
                f"Executed error (m) where {PARAMETERS[parameter]} differs: mean ± standard "
                "deviation.",
                cases_of(rows, TESTED),
                *(
                    grid.spread(f"{change:+d} %" if change else "Nominal", ERROR, 3, change=change)
                    for change in ALL_CHANGES
                ),
                part=parameter.replace("_", "-"),
            )
        cases = cases_of(data, TESTED)
        yield grid.table(
            f"Share of the tasks whose executed error is at most {SUCCESS:g} m: on the nominal "
            "plant, and on the plant where it is lowest (the first of equals).",
            [
                min(
                    (case.at(parameter=parameter, change=change) for parameter, change in PLANTS),
                    key=lambda case: case.share_within(ERROR, SUCCESS),
                )
                for case in cases
            ],
            (
                grid.METHOD,
                grid.within("Nominal", ERROR, SUCCESS, parameter=UNCHANGED, change=0),
                grid.within("Lowest", ERROR, SUCCESS),
                grid.Column("Where", _plant),
            ),
            part="success",
        )
        yield grid.of_cases(
            "Increase of the mean executed error (m) over the nominal plant at each parameter's "
            "worst change, with the 95 % bootstrap interval of the paired differences over the "
            "tasks; and the parameter that hurts most.",
            cases,
            *map(_increase, PARAMETERS),
            grid.Column("Hurts most", _hurts_most),
            part="increase",
        )
        yield _picture(around_nominal)


def changed_plant(parameter: str, change: int) -> System:
    """Return the nominal plant with `parameter` changed by `change` %.

    Kinetic friction stays at or below static friction: the one that did not change gives way.
    """
    value = getattr(NOMINAL, parameter) * (1 + change / 100)
    changed = {parameter: value}
    if parameter == "static_friction":
        changed["coulomb_friction"] = min(NOMINAL.plant.coulomb_forward, value)
    if parameter == "coulomb_friction":
        changed["static_friction"] = max(NOMINAL.plant.static_forward, value)
    return replace(NOMINAL, **changed)


PLANTS = {(UNCHANGED, 0): NOMINAL} | {
    place: changed_plant(*place) for place in product(PARAMETERS, CHANGES)
}
"""By the parameter that differs, and by how much (%)."""


def executed_error(plant: System, request: PlanRequest, controls: FloatArray) -> float:
    """Return the terminal error (m) of `controls` (H,) on `plant`, clipped to its limit."""
    limits = plant.plant
    clipped = np.clip(controls, limits.lowest_control, limits.highest_control)
    states = rollout(plant, np.array(request.initial_state), clipped[np.newaxis])
    return float(terminal_error(states[0, -1], np.array(request.target_state)))


def _plant(case: Case) -> str:
    parameter, change = case.where.values()
    return f"{PARAMETERS[parameter]} {change:+d} %" if change else UNCHANGED


def _worst(case: Case, parameter: str) -> Case:
    changed = (case.at(parameter=parameter, change=change) for change in CHANGES)
    return max(changed, key=lambda case: case.mean(ERROR))


def _hurts_most(case: Case) -> str:
    return PARAMETERS[max(PARAMETERS, key=lambda name: _worst(case, name).mean(ERROR))]


def _increase(parameter: str) -> grid.Column[Case]:
    def increase(case: Case) -> str:
        changed = _worst(case, parameter)
        more = changed.less(case.at(change=0), ERROR)
        return f"{more.shown(3, '+')} at {changed.where['change']:+d} %"

    return grid.Column(PARAMETERS[parameter], increase)


def _picture(around_nominal: dict[str, pd.DataFrame]) -> Picture:
    figure = new_figure(4.5)
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, (parameter, data) in zip(panels.flat, around_nominal.items(), strict=True):
        lines = plots.entrant_lines(cases_of(data, TESTED, change=ALL_CHANGES), ERROR)
        plots.draw_lines(axes, lines, ALL_CHANGES, WIDTH)
        axes.set(xticks=ALL_CHANGES, title=parameter.replace("_", " ").capitalize())
    for axes in panels[-1]:
        axes.set_xlabel("change of the plant (%)")
    for axes in panels[:, 0]:
        axes.set_ylabel("mean executed error (m)")
    return plots.with_legend(
        figure,
        "Plans on a plant that differs in one parameter: mean executed error with 95 % "
        "intervals over the tasks; the methods stand side by side about each change.",
    )
