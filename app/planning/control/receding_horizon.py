"""Receding horizon: plan to the target, do a step of it, measure, plan again from there."""

from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

import numpy as np
from annotated_types import Ge, Le

from app.compilation import compiled
from app.planning.arrays import copy_into
from app.planning.control.base import Law
from app.planning.control.memory import MAX_PLAN, PLAN_AGE, PLAN_LENGTH, Memory
from app.planning.control.settings import RECEDING_HORIZON, Settings
from app.planning.control.switching import fill_with_switching, steady_control
from app.planning.plant.system import Plant
from app.planning.plant.task import Task
from app.planning.refining.gauss_newton import arrive, terminal_error_of
from app.planning.refining.null_space import descend
from app.planning.stop import Flag
from app.planning.uncertainty.descent import descend_risk
from app.planning.uncertainty.ensemble import Scenarios

ObjectiveName: TypeAlias = Literal["terminal_error", "control_energy"]
ARRIVES = 2e-4
"""m and m/s: a plan that ends this near to the target is good enough for the next step."""
MORE = 2
"""A plan from switches may take so many times the iterations of one that is followed."""
SPARE_STEPS = 2
"""Beyond what switching takes: its end is rounded to whole steps."""
DESCENTS = 3
"""Quadratic programs of the least energy, in a step."""


@dataclass(frozen=True, slots=True)
class RecedingHorizon(Law):
    """Plans anew from every state: arrives at a deadline, or as early as it can."""

    name: Literal["receding_horizon"] = "receding_horizon"
    replan_every: Annotated[int, Ge(1), Le(MAX_PLAN)] = 1
    """Steps of a plan that are carried out before the next one is made."""
    least_horizon: Annotated[int, Ge(1), Le(MAX_PLAN)] = 10
    """Steps of the shortest plan: past a deadline, and close to the target."""
    margin: Annotated[float, Ge(0.5), Le(10)] = 1.0
    """Without a deadline a plan takes so many times the steps of the time-optimal motion."""
    iterations: Annotated[int, Ge(1), Le(100)] = 5
    """Gauss-Newton steps from the plan before; twice as many from switches of full control."""
    objective: ObjectiveName = "terminal_error"
    """What to want among plans that arrive: the least energy takes the time that there is."""

    def settings(self, model: Plant) -> Settings:
        return self._watching(model)._replace(
            kind=RECEDING_HORIZON,
            replan_every=self.replan_every,
            least_horizon=self.least_horizon,
            margin=self.margin,
            iterations=self.iterations,
            saves_energy=self.objective == "control_energy",
        )


@compiled
def make_plan(
    task: Task,
    steps_left: int,
    settings: Settings,
    memory: Memory,
    ensemble: Scenarios,
    stopped: Flag,
) -> float:
    """Plan from the task's start, into `memory`; return the terminal error, m.

    For an ensemble that is the error before the plan was made robust: how near one comes at all.

    The plan that is there, from the control that is due on, is descended first. Where it does not
    arrive, full control that is switched in time is descended as well.

    Args:
        task: start, target and the plant that is believed.
        steps_left: until the deadline; negative without one.
        settings: of the controller.
        ensemble: the task on the plants over which the mean squared error is descended; none of
            them: only the task's plant.
        memory: with the plan before; a plan that is new has age 0.
        stopped: ends it early.
    """
    switched = np.empty(MAX_PLAN)
    least = MAX_PLAN + 1
    horizon = steps_left
    if steps_left <= 0:
        least = fill_with_switching(switched, task)
        horizon = int(np.ceil(settings.margin * least)) + SPARE_STEPS
    horizon = min(max(horizon, settings.least_horizon), MAX_PLAN)
    age, length = int(memory.registers[PLAN_AGE]), int(memory.registers[PLAN_LENGTH])
    steady = steady_control(task.plant)
    warm = np.empty(horizon)
    for k in range(horizon):
        warm[k] = memory.plan[age + k] if age + k < length else steady
    other = switched[:horizon]
    if least == MAX_PLAN:
        # It is far: full control is what every plan begins with.
        error = terminal_error_of(other, task)
        copy_into(warm, other)
    else:
        error = arrive(warm, task, settings.iterations, stopped)[0]
    if error > ARRIVES and least != MAX_PLAN:
        if least > MAX_PLAN:
            fill_with_switching(other, task)
        other_error = arrive(other, task, MORE * settings.iterations, stopped)[0]
        if other_error < error:
            error = other_error
            copy_into(warm, other)
    num_plants = len(ensemble.plants)
    if num_plants > 0:
        descend_risk(warm, ensemble, float(num_plants), True, settings.iterations, stopped)
    elif settings.saves_energy:
        error = descend(warm, task, False, DESCENTS, stopped)[0]
    copy_into(memory.plan[:horizon], warm)
    memory.registers[PLAN_AGE] = 0.0
    memory.registers[PLAN_LENGTH] = float(horizon)
    return error
