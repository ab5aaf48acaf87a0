"""Numbers of a plant or a task, by name: what learned models are told, and what they cover."""

from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import TypeAlias

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.plant.natural_units import in_natural_units, scales
from app.planning.plant.probes import PROBES, probe_misses
from app.planning.plant.system import Plant
from app.planning.plant.task import Task

Value: TypeAlias = float | FloatArray
"""A number, or (N,) where the fields of the plant or the task are (N,)."""
PlantFeature: TypeAlias = Callable[[Plant, int], Value]
"""Of a plant and a horizon H."""
TaskFeature: TypeAlias = Callable[[Task, int], Value]
"""Of a task and a horizon H."""

LEAST = 1e-12
"""m/s^2: no friction is counted as less, where something is divided by it."""


def _natural(field: str) -> PlantFeature:
    """Return the feature that is a field of the plant in its natural units."""
    get = attrgetter(field)
    return lambda plant, _: get(in_natural_units(plant))


def _own(field: str) -> PlantFeature:
    """Return the feature that is a field of the plant."""
    get = attrgetter(field)
    return lambda plant, _: get(plant)


def _ratio(numerator: str, denominator: str) -> PlantFeature:
    """Return the feature that is one field over another; 0 where there is nothing of both."""
    above, below = attrgetter(numerator), attrgetter(denominator)

    def ratio(plant: Plant, _: int) -> Value:
        value: Value = above(plant) / np.maximum(below(plant), LEAST)
        return value

    return ratio


def _position_miss(probe: str) -> TaskFeature:
    """Return by how much of the reach a probe ends beyond the target."""
    return lambda task, horizon: (
        probe_misses(probe, task, horizon)[:, 0] / scales(task.plant, horizon).reach
    )


def _velocity_miss(probe: str) -> TaskFeature:
    """Return by how much of the speed a probe ends faster than the target moves."""
    return lambda task, horizon: (
        probe_misses(probe, task, horizon)[:, 1] / scales(task.plant, horizon).speed
    )


def _log_threshold(plant: Plant, _: int) -> Value:
    threshold: Value = np.log(in_natural_units(plant).velocity_threshold)
    return threshold


def _stribeck_share(plant: Plant, _: int) -> Value:
    speed = in_natural_units(plant).stribeck_velocity
    return speed / (1.0 + speed)


PLANT_FEATURES: dict[str, PlantFeature] = {
    **{field: _own(field) for field in Plant._fields},
    "static_forward_over_limit": _natural("static_forward"),
    "static_backward_over_limit": _natural("static_backward"),
    "static_backward_over_forward": _ratio("static_backward", "static_forward"),
    "coulomb_forward_over_limit": _natural("coulomb_forward"),
    "coulomb_backward_over_limit": _natural("coulomb_backward"),
    "coulomb_over_static_forward": _ratio("coulomb_forward", "static_forward"),
    "coulomb_over_static_backward": _ratio("coulomb_backward", "static_backward"),
    "damping_forward_times_horizon": lambda plant, horizon: (
        plant.damping_forward * plant.time_step * horizon
    ),
    "damping_backward_times_horizon": lambda plant, horizon: (
        plant.damping_backward * plant.time_step * horizon
    ),
    "root_damping_forward": lambda plant, horizon: np.sqrt(
        plant.damping_forward * plant.time_step * horizon
    ),
    "root_damping_backward": lambda plant, horizon: np.sqrt(
        plant.damping_backward * plant.time_step * horizon
    ),
    "bias_over_limit": _natural("bias"),
    "velocity_threshold_over_step": _natural("velocity_threshold"),
    "log_velocity_threshold": _log_threshold,
    "stribeck_over_step": _natural("stribeck_velocity"),
    "stribeck_share": _stribeck_share,
}
"""Fields of `Plant` in its own units; `_over_limit` as a share of what full control makes of the
mass, where the middle of the control range counts as bias; `_over_step` of the velocity that it
adds in a step."""

TASK_FEATURES: dict[str, TaskFeature] = {
    "initial_position": lambda task, _: task.position,
    "initial_velocity": lambda task, _: task.velocity,
    "target_position": lambda task, _: task.target_position,
    "target_velocity": lambda task, _: task.target_velocity,
    "displacement_over_reach": lambda task, horizon: (
        (task.target_position - task.position) / scales(task.plant, horizon).reach
    ),
    "initial_velocity_over_speed": lambda task, horizon: (
        task.velocity / scales(task.plant, horizon).speed
    ),
    "target_velocity_over_speed": lambda task, horizon: (
        task.target_velocity / scales(task.plant, horizon).speed
    ),
    **{f"{probe}_position_miss": _position_miss(probe) for probe in PROBES},
    **{f"{probe}_velocity_miss": _velocity_miss(probe) for probe in PROBES},
}
"""m and m/s, or shares of the plant's scales."""

CHANGES: dict[str, Callable[[Task, int, float], Task]] = {
    "initial_position": lambda task, _, value: task._replace(position=value),
    "initial_velocity": lambda task, _, value: task._replace(velocity=value),
    "target_position": lambda task, _, value: task._replace(target_position=value),
    "target_velocity": lambda task, _, value: task._replace(target_velocity=value),
    "displacement_over_reach": lambda task, horizon, value: task._replace(
        target_position=task.position + value * scales(task.plant, horizon).reach
    ),
    "initial_velocity_over_speed": lambda task, horizon, value: task._replace(
        velocity=value * scales(task.plant, horizon).speed
    ),
    "target_velocity_over_speed": lambda task, horizon, value: task._replace(
        target_velocity=value * scales(task.plant, horizon).speed
    ),
}
"""Of a task and a horizon H, the task whose feature has another value."""


def feature_values(names: Sequence[str], task: Task, horizon: int) -> FloatArray:
    """Return features (N, C) of a task and its plant, by name.

    Args:
        names: C of `TASK_FEATURES` and `PLANT_FEATURES`.
        task: the fields of it and of its plant are floats or (N,).
        horizon: H.
    """
    fields = (*task[:-1], *task.plant)
    (num_tasks,) = np.broadcast_shapes((1,), *(np.shape(field) for field in fields))
    values = np.empty((num_tasks, len(names)))
    for column, name in zip(values.T, names, strict=True):
        column[:] = (
            TASK_FEATURES[name](task, horizon)
            if name in TASK_FEATURES
            else PLANT_FEATURES[name](task.plant, horizon)
        )
    return values
