"""One step of a controller: what was measured in, a control and a new memory out. Pure.

Whole runs are in simulation.py; both stand on the kernel in stepping.py.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, TypeAlias

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.control.base import Controller
from app.planning.control.belief import believed
from app.planning.control.estimate import Estimate, estimate_of, system_of
from app.planning.control.memory import (
    PLAN_AGE,
    PLAN_LENGTH,
    POSITION,
    TARGET,
    VELOCITY,
    Memory,
)
from app.planning.control.receding_horizon import ARRIVES
from app.planning.control.settings import RECEDING_HORIZON, Settings
from app.planning.control.stepping import Machine, Record, run
from app.planning.methods.base import Method
from app.planning.planner import plan
from app.planning.plant.rollout import rollout_on
from app.planning.plant.system import Plant, System
from app.planning.problem import Problem
from app.planning.recipe import Recipe
from app.planning.stop import NEVER, Stop
from app.planning.uncertainty.ensemble import NO_PLANTS, Ensemble

Status: TypeAlias = Literal["moving", "holding", "arrived", "unreachable"]
STATUSES: tuple[Status, ...] = ("moving", "holding", "arrived", "unreachable")
"""In the order of the kernel's numbers: on its way; at rest for this step, short of the target; at
rest in the dead band; no plan that was found gets there (in time, with a deadline)."""

NOTHING = np.zeros(2)
"""No disturbance and no noise, of one step."""


@dataclass(frozen=True, slots=True)
class Measurement:
    """What a sensor says now."""

    position: float
    """m."""
    velocity: float | None = None
    """m/s; none where it is not measured."""


@dataclass(frozen=True, slots=True)
class Goal:
    """Where the mass is to rest, and by when."""

    target_position: float
    """m."""
    steps_left: int | None = None
    """Until it has to be there, counted from the control that is asked for: 0 or less once it
    should be. None: as early as possible."""


@dataclass(frozen=True, slots=True)
class Fallback:
    """How to plan where no plan of the receding horizon's own arrives: by any method."""

    recipe: Recipe[Method]
    rng: np.random.Generator


@dataclass(frozen=True, slots=True)
class ControlStep:
    """What a step gives."""

    control: float
    """Units of control: to be sent now."""
    plan: FloatArray
    """(N,), this control and those that are to follow it; N = 1 of a law that plans nothing."""
    predicted_error: float | None
    """Terminal error of a plan that was made in this step, m; None if none was."""
    status: Status
    memory: Memory
    """For the next step; `carry.write_carry` makes JSON of it."""
    model: System
    """What was believed of the plant before anything was learned."""
    plant: Plant
    """What the plan is for: the model with what was learned, cautiously."""
    pending: FloatArray
    """(D,), controls that act before this one."""

    @property
    def predicted_states(self) -> FloatArray:
        """States (N+1, 2) of the plan on the plant as it is believed, from the one on in which it
        acts: after the pending controls, m and m/s."""
        start = _where_it_acts(self.memory, self.plant, self.pending)
        return np.asarray(rollout_on(self.plant, start, self.plan[np.newaxis])[0])

    @property
    def estimate(self) -> Estimate:
        """What is believed of state and plant."""
        return estimate_of(self.memory, self.model)


@lru_cache(maxsize=1024)
def _prepared(controller: Controller, model: System) -> tuple[Plant, Settings]:
    """Return model and controller as the kernels take them: for many steps the same."""
    plant = model.plant
    return plant, controller.settings(plant)


def control_step(
    controller: Controller,
    model: System,
    measurement: Measurement,
    goal: Goal,
    memory: Memory | None = None,
    *,
    pending_controls: Sequence[float] = (),
    ensemble: Ensemble | None = None,
    fallback: Fallback | None = None,
    stop: Stop = NEVER,
) -> ControlStep:
    """Do one step of a controller; nothing that is passed in is changed.

    Args:
        controller: with its options.
        model: what is believed of the plant.
        measurement: of the state now.
        goal: where the mass is to rest.
        memory: of the step before; None begins.
        pending_controls: on their way to the actuator, oldest first, each for a time step: the
            control of this step acts after them. Always as many, as the delay is.
        ensemble: plants that may be the true one, wherever they are: the receding horizon plans
            for all of them. None: for the model with what was learned.
        fallback: another way to plan; none: the receding horizon's own plans have to do.
        stop: ends it early.

    Raises:
        ValueError: no velocity is measured, and no observer is there to estimate it.
        PlanningError: the fallback's method proposed controls that are not finite.
        Stopped: `stop` said so.
    """
    velocity = measurement.velocity
    if velocity is None and controller.observer is None:
        raise ValueError("velocity is not measured: the controller needs an observer")
    nominal, settings = _prepared(controller, model)
    measured = (measurement.position, math.nan if velocity is None else velocity)
    pending = np.asarray(pending_controls, dtype=np.float64)
    plants = NO_PLANTS if ensemble is None else ensemble.plants
    before = memory or Memory.empty()
    after = before.copy()
    record = _take(measured, pending, goal, nominal, settings, after, plants, stop)
    plant = believed(nominal, after, 1.0, settings.rest_velocity)
    if fallback and record.errors[0] > ARRIVES:
        horizon = int(after.registers[PLAN_LENGTH])
        problem = Problem(
            _where_it_acts(after, plant, pending),
            np.array([goal.target_position, 0.0]),
            system_of(plant),
            horizon,
        )
        offered = plan(problem, fallback.recipe, fallback.rng, stop)
        if offered.terminal_error < record.errors[0]:
            after = before.copy()
            after.plan[:horizon] = offered.controls
            after.registers[PLAN_AGE], after.registers[PLAN_LENGTH] = 0.0, float(horizon)
            after.registers[TARGET] = goal.target_position
            record = _take(measured, pending, goal, nominal, settings, after, plants, stop)
            record.errors[0] = offered.terminal_error
    stop.check()
    control, error = float(record.controls[0]), float(record.errors[0])
    age, length = int(after.registers[PLAN_AGE]), int(after.registers[PLAN_LENGTH])
    follows = after.plan[age:length] if settings.kind == RECEDING_HORIZON else after.plan[:0]
    return ControlStep(
        control=control,
        plan=np.concatenate([[control], follows]),
        predicted_error=None if math.isnan(error) else error,
        status=STATUSES[record.statuses[0]],
        memory=after,
        model=model,
        plant=plant,
        pending=pending,
    )


def _take(
    measured: tuple[float, float],
    pending: FloatArray,
    goal: Goal,
    model: Plant,
    settings: Settings,
    memory: Memory,
    plants: FloatArray,
    stop: Stop,
) -> Record:
    """Do one step of a run, whose measurement is given; the memory is changed."""
    record = Record.begun(measured, 1)
    steps_left = -1 if goal.steps_left is None else max(0, goal.steps_left)
    run(
        pending,
        True,
        goal.target_position,
        steps_left,
        model,
        settings,
        memory,
        plants,
        Machine(model, NOTHING[:1], NOTHING, NOTHING, 0.0, 0.0),
        record,
        stop.flag,
    )
    return record


def _where_it_acts(memory: Memory, plant: Plant, pending: FloatArray) -> FloatArray:
    """Return the state (2,) after the pending controls, as it is believed."""
    start = memory.mean[[POSITION, VELOCITY]]
    return np.asarray(rollout_on(plant, start, pending[np.newaxis])[0, -1])
