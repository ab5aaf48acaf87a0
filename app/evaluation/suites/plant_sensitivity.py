"""What a wrong model of the plant costs: nominal plans, carried out on a plant that differs."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import ClassVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from app.evaluation.answer_log import Answer
from app.evaluation.cells import mean_and_spread, percent, with_interval
from app.evaluation.comparison import column
from app.evaluation.entrants import ENTRANTS
from app.evaluation.looks import LOOKS
from app.evaluation.plots import draw_intervals
from app.evaluation.question import Entrant, Question
from app.evaluation.section import Picture, Section, Table
from app.evaluation.statistics import interval, paired_difference
from app.evaluation.suite import Answered, Row, Suite
from app.evaluation.suites.random_targets import transition_questions
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
UNCHANGED = "nominal"
"""Stands for the parameter on the nominal plant."""
SUCCESS = 0.05
"""Executed errors up to this count as success, m."""
DODGE = 4.0
"""Width over which a figure spreads the entrants about each change, %."""


@dataclass(frozen=True)
class PlantSensitivity(Suite):
    """Executed errors where f_s, f_c, b or u_max is not what the plan was made for."""

    name: ClassVar[str] = "plant-sensitivity"
    purpose: ClassVar[str] = "Nominal plans on plants whose f_s, f_c, b or u_max differs, K = 32"

    @property
    def num_candidates(self) -> int:
        """K."""
        return 16 if self.quick else 32

    @property
    def num_tasks(self) -> int:
        """How many transitions."""
        return 8 if self.quick else 200

    def questions(self) -> Iterator[Question]:
        for entrant in ENTRANTS:
            yield from transition_questions(
                self.seed, self.num_tasks, entrant, self.num_candidates, trajectories=True
            )

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
        return Section(
            title="Sensitivity to the plant",
            introduction=(
                f"Plans made for the nominal plant with K = {self.num_candidates}, carried out "
                "open loop on a plant that differs in one parameter: static friction f_s, kinetic "
                "(Coulomb) friction f_c, damping b or control limit u_max, each by -20, -10, +10 "
                "and +20 %. The executed error is the distance of the state at the end from the "
                f"target. The tasks are the first {self.num_tasks} random transitions; their mean "
                f"floor is {data.nominal_floor.mean():.3f} m on the nominal plant, which no plan "
                "can go below there. Kinetic friction cannot exceed static friction: where f_s "
                "falls below f_c, f_c falls with it, and where f_c rises above f_s, f_s rises "
                "with it. Where u_max falls, the controls are clipped to it; where it rises "
                "nothing changes, for the plans do not use it."
            ),
            tables=(
                *(_errors(data, parameter) for parameter in PARAMETERS),
                _success(data),
                _increases(data),
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


def _executed(
    data: pd.DataFrame, entrant: Entrant, parameter: str, change: int
) -> NDArray[np.float64]:
    """Return executed errors, (tasks,); no change is the nominal plant, whatever the parameter."""
    of_plant = data[data.parameter == (parameter if change else UNCHANGED)]
    return column(of_plant, entrant, "executed_error", change=change)


def _errors(data: pd.DataFrame, parameter: str) -> Table:
    changes = sorted((*CHANGES, 0))
    return Table(
        f"plant-sensitivity-{parameter.replace('_', '-')}",
        f"Executed error (m) where {PARAMETERS[parameter]} differs: mean ± standard deviation.",
        ("Method", *(f"{change:+d} %" if change else "Nominal" for change in changes)),
        [
            [
                entrant.label,
                *(
                    mean_and_spread(_executed(data, entrant, parameter, change), 3)
                    for change in changes
                ),
            ]
            for entrant in ENTRANTS
        ],
    )


def _success(data: pd.DataFrame) -> Table:
    rows = []
    for entrant in ENTRANTS:
        shares = {
            plant: float(np.mean(_executed(data, entrant, *plant) <= SUCCESS)) for plant in PLANTS
        }
        worst = min(shares, key=lambda plant: shares[plant])
        rows.append(
            (
                entrant.label,
                percent(shares[UNCHANGED, 0]),
                percent(shares[worst]),
                _described(*worst),
            )
        )
    return Table(
        "plant-sensitivity-success",
        f"Share of the tasks whose executed error is at most {SUCCESS:g} m: on the nominal plant, "
        "and on the plant where it is lowest (the first of equals).",
        ("Method", "Nominal", "Lowest", "Where"),
        rows,
    )


def _increases(data: pd.DataFrame) -> Table:
    rows = []
    for entrant in ENTRANTS:
        nominal = _executed(data, entrant, UNCHANGED, 0)
        found = {
            plant: paired_difference(_executed(data, entrant, *plant), nominal) for plant in PLANTS
        }
        worst = {
            parameter: max(
                ((parameter, change) for change in CHANGES),
                key=lambda plant: found[plant].estimate,
            )
            for parameter in PARAMETERS
        }
        rows.append(
            (
                entrant.label,
                *(
                    f"{with_interval(found[plant], 3, '+')} at {plant[1]:+d} %"
                    for plant in worst.values()
                ),
                PARAMETERS[max(worst, key=lambda parameter: found[worst[parameter]].estimate)],
            )
        )
    return Table(
        "plant-sensitivity-increase",
        "Increase of the mean executed error (m) over the nominal plant at each parameter's worst "
        "change, with the 95 % bootstrap interval of the paired differences over the tasks; and "
        "the parameter that hurts most.",
        ("Method", *PARAMETERS.values(), "Hurts most"),
        rows,
    )


def _described(parameter: str, change: int) -> str:
    return f"{PARAMETERS[parameter]} {change:+d} %" if change else "nominal"


def _picture(data: pd.DataFrame) -> Picture:
    figure = new_figure(PAGE_INCHES, 4.5)
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    changes = sorted((*CHANGES, 0))
    shifts = np.linspace(-DODGE / 2, DODGE / 2, len(ENTRANTS))
    for axes, parameter in zip(panels.flat, PARAMETERS, strict=True):
        for entrant, shift in zip(ENTRANTS, shifts, strict=True):
            found = [interval(_executed(data, entrant, parameter, change)) for change in changes]
            draw_intervals(axes, LOOKS[entrant], entrant.label, np.add(changes, shift), found)
        axes.set_xticks(changes)
        axes.set_title(parameter.replace("_", " ").capitalize())
    for axes in panels[-1]:
        axes.set_xlabel("change of the plant (%)")
    for axes in panels[:, 0]:
        axes.set_ylabel("mean executed error (m)")
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside right upper")
    return Picture(
        "plant-sensitivity",
        "Nominal plans on a plant that differs in one parameter: mean executed error with 95 % "
        "intervals over the tasks; the methods stand side by side about each change.",
        figure,
    )
