"""One step of a controller, and many on a machine: the kernel behind both.

What is asked of it in Python is in step.py (one step) and simulation.py (whole runs).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from app.compilation import compiled
from app.planning.arrays import FloatArray, IntArray
from app.planning.control.belief import believed
from app.planning.control.feedback import feedback_control, switching_control
from app.planning.control.kalman import observe
from app.planning.control.memory import (
    ACTING,
    HELD,
    INTEGRAL,
    PLAN_AGE,
    PLAN_ERROR,
    PLAN_LENGTH,
    POSITION,
    STEPS,
    TARGET,
    VELOCITY,
    Memory,
)
from app.planning.control.receding_horizon import ARRIVES, make_plan
from app.planning.control.settings import FEEDBACK, RECEDING_HORIZON, SEQUENCE, SWITCHING, Settings
from app.planning.control.switching import steady_control
from app.planning.plant.friction import STOPPING, STUCK, control_towards, take_step
from app.planning.plant.rollout import step
from app.planning.plant.system import Plant
from app.planning.plant.task import Task
from app.planning.stop import Flag
from app.planning.uncertainty.ensemble import Scenarios, scenario

MOVING, HOLDING, ARRIVED, UNREACHABLE = range(4)
"""What a step says of itself."""
CERTAIN = 3.0
"""Standard deviations of the estimated position."""


class Machine(NamedTuple):
    """What a run is made on: the true plant with what disturbs it, and its sensor's noise."""

    plant: Plant
    accelerations: FloatArray
    """(T,), m/s^2, of disturbances."""
    position_noise: FloatArray
    """(T + 1,), m."""
    velocity_noise: FloatArray
    """(T + 1,), m/s; NaN where velocities are not measured."""
    position_step: float
    """m: the resolution of the encoder, 0 for none."""
    position_lag: float
    """s: positions are measured as they were so long before."""


class Record(NamedTuple):
    """What a run of T steps fills."""

    states: FloatArray
    """(T + 1, 2), true ones."""
    measurements: FloatArray
    """(T + 1, 2), velocity NaN where it is not measured."""
    estimates: FloatArray
    """(T, 2)."""
    controls: FloatArray
    """(T,), as the controller asked for them."""
    statuses: IntArray
    """(T,)."""
    errors: FloatArray
    """(T,), terminal errors of plans, m; NaN where none was made."""

    @classmethod
    def begun(cls, state: ArrayLike, num_steps: int) -> "Record":
        """Return the record of a run that begins in a `state` (2,)."""
        states = np.empty((num_steps + 1, 2))
        states[0] = state
        return cls(
            states,
            np.empty((num_steps + 1, 2)),
            np.empty((num_steps, 2)),
            np.empty(num_steps),
            np.empty(num_steps, dtype=np.int64),
            np.empty(num_steps),
        )


@compiled
def _is_held(task: Task, settings: Settings, memory: Memory) -> bool:
    """Return whether a mass is to be held where it is; never by a control sequence.

    It is once it rests in the dead band, and then until it moves, or is outside of it for certain:
    an estimate at the edge would have it leave and come back without end.
    """
    if settings.kind == SEQUENCE:
        return False
    band = settings.dead_band
    if memory.registers[HELD] > 0.0 and memory.registers[TARGET] == task.target_position:
        band += CERTAIN * math.sqrt(max(0.0, memory.covariance[POSITION, POSITION]))
    is_near = abs(task.target_position - task.position) < band
    return is_near and abs(task.velocity) < settings.rest_velocity


@compiled
def _choose(
    task: Task, steps_left: int, is_held: bool, settings: Settings, memory: Memory
) -> tuple[float, int]:
    """Return the control of a state, and the status; a plan that is due has been made."""
    plant, registers = task.plant, memory.registers
    registers[HELD] = 1.0 if is_held else 0.0
    if is_held:
        registers[PLAN_LENGTH], registers[PLAN_AGE], registers[INTEGRAL] = 0.0, 0.0, 0.0
        registers[TARGET] = task.target_position
        return steady_control(plant), ARRIVED
    error = task.target_position - task.position
    control = steady_control(plant)
    if settings.kind == FEEDBACK:
        control = feedback_control(error, task.velocity, plant, settings, memory)
    elif settings.kind == SWITCHING:
        control = switching_control(error, task.velocity, plant, settings)
    elif registers[PLAN_AGE] < registers[PLAN_LENGTH]:
        control = memory.plan[int(registers[PLAN_AGE])]
        registers[PLAN_AGE] += 1.0
    control = min(plant.highest_control, max(plant.lowest_control, control))
    kind = take_step(task.velocity, control, plant).kind
    if kind == STOPPING and settings.position_lag > 0.0:
        # What moves between samples would not stop for the rest of a step, but turn round.
        control = control_towards(0.0, task.velocity, plant)
    is_stuck = kind == STUCK
    if settings.kind == RECEDING_HORIZON and steps_left <= 0:
        # Nothing is to be waited for: a plan that begins with rest would be made for ever.
        while is_stuck and registers[PLAN_AGE] < registers[PLAN_LENGTH]:
            control = memory.plan[int(registers[PLAN_AGE])]
            registers[PLAN_AGE] += 1.0
            is_stuck = take_step(task.velocity, control, plant).kind == STUCK
    status = HOLDING if is_stuck else MOVING
    if settings.kind == RECEDING_HORIZON:
        if is_stuck:
            # What does not move the mass can as well be nothing.
            control = steady_control(plant)
        misses = registers[PLAN_ERROR] > max(settings.dead_band, ARRIVES)
        if misses and (is_stuck or steps_left > 0):
            status = UNREACHABLE
    return control, status


@compiled
def _plan_is_due(task: Task, is_held: bool, settings: Settings, memory: Memory) -> bool:
    if settings.kind != RECEDING_HORIZON or is_held:
        return False
    registers = memory.registers
    if registers[TARGET] != task.target_position:
        return True
    return bool(registers[PLAN_AGE] >= min(settings.replan_every, registers[PLAN_LENGTH]))


@compiled
def run(
    pending: FloatArray,
    knows_delay: bool,
    target: float,
    deadline: int,
    model: Plant,
    settings: Settings,
    memory: Memory,
    plants: FloatArray,
    machine: Machine,
    record: Record,
    stopped: Flag,
) -> None:
    """Control a machine for as many steps as `record` has room for.

    Args:
        pending: (D,), on their way to the actuator, the oldest first.
        knows_delay: whether the controller is told of them.
        target: m; at rest.
        deadline: steps until the mass has to be there; negative without one.
        model: what the controller believes of the plant.
        settings: of the controller.
        memory: of the controller; changed.
        plants: (S, parameters), for which plans are made; for the model alone if there are none.
        machine: the true one.
        record: what is filled; its first state is the true one.
        stopped: ends it early.
    """
    queue = pending.copy()
    known = queue if knows_delay else queue[:0]
    num_steps = record.controls.size
    _measure(0, machine, record)
    for k in range(num_steps):
        if stopped[0]:
            break
        steps_left = max(0, deadline - k) if deadline >= 0 else -1
        observe(record.measurements[k, 0], record.measurements[k, 1], memory, model, settings)
        plant = believed(model, memory, 1.0, settings.rest_velocity)
        position, velocity = memory.mean[POSITION], memory.mean[VELOCITY]
        record.estimates[k, 0], record.estimates[k, 1] = position, velocity
        for control in known:
            position, velocity = step(position, velocity, control, plant)
        task = Task(position, velocity, target, 0.0, plant)
        record.errors[k] = math.nan
        is_held = _is_held(task, settings, memory)
        if _plan_is_due(task, is_held, settings, memory):
            ensemble = _on_each(plants, memory, known, target)
            error = make_plan(task, steps_left, settings, memory, ensemble, stopped)
            record.errors[k] = memory.registers[PLAN_ERROR] = error
            memory.registers[TARGET] = target
        control, record.statuses[k] = _choose(task, steps_left, is_held, settings, memory)
        record.controls[k] = control
        memory.registers[ACTING] = known[0] if known.size > 0 else control
        memory.registers[STEPS] += 1.0
        acting = control
        if queue.size > 0:
            acting = queue[0]
            for i in range(queue.size - 1):
                queue[i] = queue[i + 1]
            queue[queue.size - 1] = control
        truth = machine.plant
        disturbed = acting + machine.accelerations[k] / truth.control_gain
        position, velocity = step(record.states[k, 0], record.states[k, 1], disturbed, truth)
        record.states[k + 1, 0], record.states[k + 1, 1] = position, velocity
        _measure(k + 1, machine, record)


@compiled
def _on_each(plants: FloatArray, memory: Memory, pending: FloatArray, target: float) -> Scenarios:
    """Return the task of each plant: from where it is after the pending controls."""
    scenarios = Scenarios(plants, np.empty((len(plants), 2)), target, 0.0)
    for s in range(len(plants)):
        position, velocity = memory.mean[POSITION], memory.mean[VELOCITY]
        plant = scenario(scenarios, s).plant
        for control in pending:
            position, velocity = step(position, velocity, control, plant)
        scenarios.states[s, 0], scenarios.states[s, 1] = position, velocity
    return scenarios


@compiled
def _measure(k: int, machine: Machine, record: Record) -> None:
    """Measure the state at step `k`."""
    position = record.states[k, 0] + machine.position_noise[k]
    if machine.position_lag > 0.0:  # a single step, of what was measured, may know no velocity
        position -= machine.position_lag * record.states[k, 1]
    if machine.position_step > 0.0:
        position = machine.position_step * math.floor(position / machine.position_step + 0.5)
    record.measurements[k, 0] = position
    record.measurements[k, 1] = record.states[k, 1] + machine.velocity_noise[k]
