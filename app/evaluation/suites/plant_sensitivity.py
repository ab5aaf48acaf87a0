"""What a wrong model of the plant costs: nominal plans, carried out on a plant that differs."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd

from app.evaluation import grid
from app.evaluation.answer_log import Answer
from app.evaluation.case import Case, cases_of
from app.evaluation.cells import percent, with_interval
from app.evaluation.entrants import ENTRANTS
from app.evaluation.plots import draw_legend, draw_lines, entrant_lines
from app.evaluation.question import Question
from app.evaluation.section import Picture, Section, Table
from app.evaluation.suite import Answered, Row, Size, Suite
from app.evaluation.tasks import Task, transition_tasks
from app.figures.style import PAGE_INCHES, new_figure
from app.planning.arrays import FloatArray
from app.planning.metrics import terminal_error
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System
from app.wire.requests import PlanRequest

NOMINAL = System()
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
    """Executed errors where f_s, f_c, b or u_max is not what the plan was made for."""

    name = "plant-sensitivity"
    purpose = "Nominal plans on plants whose f_s, f_c, b or u_max differs, K = 32"
    FULL = Size(budgets=(32,), tasks=200)
    QUICK = Size(budgets=(16,), tasks=8)
    trajectories = True

    def tasks(self) -> list[Task]:
        return transition_tasks(self.size.tasks, self.seed)

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

    def section(self, data: pd.DataFrame, answered: Answered) -> Section:
        cases = cases_of(data, ENTRANTS)
        return Section(
            title="Sensitivity to the plant",
            introduction=(
                f"Plans made for the nominal plant with K = {self.size.budgets[0]}, carried out "
                "open loop on a plant that differs in one parameter: static friction f_s, kinetic "
                "(Coulomb) friction f_c, damping b or control limit u_max, each by -20, -10, +10 "
                "and +20 %. The executed error is the distance of the state at the end from the "
                f"target. The tasks are the first {self.size.tasks} random transitions; their mean "
                f"floor is {data.nominal_floor.mean():.3f} m on the nominal plant, which no plan "
                "can go below there. Kinetic friction cannot exceed static friction: where f_s "
                "falls below f_c, f_c falls with it, and where f_c rises above f_s, f_s rises "
                "with it. Where u_max falls, the controls are clipped to it; where it rises "
                "nothing changes, for the plans do not use it."
            ),
            tables=(
                *(_errors(data, parameter) for parameter in PARAMETERS),
                _success(cases),
                _increases(cases),
            ),
            pictures=(_picture(data),),
        )


def changed_plant(parameter: str, change: int) -> System:
    """Return the nominal plant with `parameter` changed by `change` %.

    Kinetic friction stays at or below static friction: the one that did not change gives way.
    """
    value = getattr(NOMINAL, parameter) * (1 + change / 100)
    changed = {parameter: value}
    if parameter == "static_friction":
        changed["coulomb_friction"] = min(NOMINAL.coulomb_friction, value)
    if parameter == "coulomb_friction":
        changed["static_friction"] = max(NOMINAL.static_friction, value)
    return replace(NOMINAL, **changed)


PLANTS = {(UNCHANGED, 0): NOMINAL} | {
    (parameter, change): changed_plant(parameter, change)
    for parameter, change in product(PARAMETERS, CHANGES)
}
"""By the parameter that differs, and by how much (%)."""


def executed_error(plant: System, request: PlanRequest, controls: FloatArray) -> float:
    """Return the terminal error (m) of `controls` (H,) on `plant`, clipped to its limit."""
    clipped = np.clip(controls, -plant.control_limit, plant.control_limit)
    states = rollout(plant, np.array(request.initial_state), clipped[np.newaxis])
    return float(terminal_error(states[0, -1], np.array(request.target_state)))


def _around_nominal(data: pd.DataFrame, parameter: str) -> pd.DataFrame:
    """Return the rows where a parameter differs, and those on the nominal plant: change 0."""
    return data[data.parameter.isin([parameter, UNCHANGED])]


def _errors(data: pd.DataFrame, parameter: str) -> Table:
    return grid.of_cases(
        f"plant-sensitivity-{parameter.replace('_', '-')}",
        f"Executed error (m) where {PARAMETERS[parameter]} differs: mean ± standard deviation.",
        cases_of(_around_nominal(data, parameter), ENTRANTS),
        *(
            grid.spread(f"{change:+d} %" if change else "Nominal", ERROR, 3, change=change)
            for change in ALL_CHANGES
        ),
    )


def _success(cases: list[Case]) -> Table:
    def share(case: Case) -> float:
        return case.share_within(ERROR, SUCCESS)

    def worst(case: Case) -> Case:
        return min((case.at(parameter=name, change=by) for name, by in PLANTS), key=share)

    def described(case: Case) -> str:
        parameter, change = case.where.values()
        return f"{PARAMETERS[parameter]} {change:+d} %" if change else UNCHANGED

    return grid.of_cases(
        "plant-sensitivity-success",
        f"Share of the tasks whose executed error is at most {SUCCESS:g} m: on the nominal plant, "
        "and on the plant where it is lowest (the first of equals).",
        cases,
        grid.within("Nominal", ERROR, SUCCESS, change=0),
        grid.Column("Lowest", lambda case: percent(share(worst(case)))),
        grid.Column("Where", lambda case: described(worst(case))),
    )


def _increases(cases: list[Case]) -> Table:
    def worst(case: Case, parameter: str) -> Case:
        changed = (case.at(parameter=parameter, change=change) for change in CHANGES)
        return max(changed, key=lambda case: case.mean(ERROR))

    def increase_column(parameter: str) -> grid.Column[Case]:
        def increase(case: Case) -> str:
            changed = worst(case, parameter)
            more = changed.less(case.at(change=0), ERROR)
            return f"{with_interval(more, 3, '+')} at {changed.where['change']:+d} %"

        return grid.Column(PARAMETERS[parameter], increase)

    def hurts_most(case: Case) -> str:
        return PARAMETERS[max(PARAMETERS, key=lambda name: worst(case, name).mean(ERROR))]

    return grid.of_cases(
        "plant-sensitivity-increase",
        "Increase of the mean executed error (m) over the nominal plant at each parameter's worst "
        "change, with the 95 % bootstrap interval of the paired differences over the tasks; and "
        "the parameter that hurts most.",
        cases,
        *map(increase_column, PARAMETERS),
        grid.Column("Hurts most", hurts_most),
    )


def _picture(data: pd.DataFrame) -> Picture:
    figure = new_figure(PAGE_INCHES, 4.5)
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, parameter in zip(panels.flat, PARAMETERS, strict=True):
        cases = cases_of(_around_nominal(data, parameter), ENTRANTS, change=ALL_CHANGES)
        draw_lines(axes, entrant_lines(cases, ERROR), ALL_CHANGES, WIDTH)
        axes.set(xticks=ALL_CHANGES, title=parameter.replace("_", " ").capitalize())
    for axes in panels[-1]:
        axes.set_xlabel("change of the plant (%)")
    for axes in panels[:, 0]:
        axes.set_ylabel("mean executed error (m)")
    draw_legend(figure, "outside right upper")
    return Picture(
        "plant-sensitivity",
        "Nominal plans on a plant that differs in one parameter: mean executed error with 95 % "
        "intervals over the tasks; the methods stand side by side about each change.",
        figure,
    )
