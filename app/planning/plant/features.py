"""Numbers of a plant or a task, by name: what learned models are told, and what they cover."""

from collections.abc import Callable, Sequence
from functools import cached_property
from operator import attrgetter
from typing import TypeAlias

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.plant.natural_units import (
    Scales,
    in_natural_units,
    natural_units,
    scales_of_natural,
)
from app.planning.plant.probes import PROBES, probe_misses
from app.planning.plant.spread import CERTAIN, Spread
from app.planning.plant.system import Plant
from app.planning.plant.task import Task

Value: TypeAlias = float | FloatArray
"""A number, or (N,) where the fields of the plant or the task are (N,)."""

LEAST = 1e-12
"""m/s^2: no friction is counted as less, where something is divided by it."""


class PlantFacts:
    """What the features of a plant are made of, each worked out once.

    Args:
        plant: its fields are floats or (N,).
        horizon: H.
    """

    def __init__(self, plant: Plant, horizon: int) -> None:
        self.plant, self.horizon = plant, horizon

    @cached_property
    def natural(self) -> Plant:
        """The plant in its natural units."""
        return in_natural_units(self.plant)

    @cached_property
    def scales(self) -> Scales:
        """Reach and speed, in its own units."""
        return scales_of_natural(self.natural, natural_units(self.plant), self.horizon)


class TaskFacts(PlantFacts):
    """What the features of a task and its plant are made of.

    Args:
        task: its fields, and its plant's, are floats or (N,).
        horizon: H.
    """

    def __init__(self, task: Task, horizon: int) -> None:
        super().__init__(task.plant, horizon)
        self.task = task

    @cached_property
    def misses(self) -> FloatArray:
        """By how much each probe misses the target, as shares of reach and speed, (N, 5, 2)."""
        scales = np.column_stack([np.atleast_1d(scale) for scale in self.scales])
        misses: FloatArray = probe_misses(self.task, self.horizon) / scales[:, np.newaxis]
        return misses


PlantFeature: TypeAlias = Callable[[PlantFacts], Value]
TaskFeature: TypeAlias = Callable[[TaskFacts], Value]


def _natural(field: str) -> PlantFeature:
    """Return the feature that is a field of the plant in its natural units."""
    get = attrgetter(field)
    return lambda facts: get(facts.natural)


def _own(field: str) -> PlantFeature:
    """Return the feature that is a field of the plant."""
    get = attrgetter(field)
    return lambda facts: get(facts.plant)


def _ratio(numerator: str, denominator: str) -> PlantFeature:
    """Return the feature that is one field over another; 0 where there is nothing of both."""
    above, below = attrgetter(numerator), attrgetter(denominator)

    def ratio(facts: PlantFacts) -> Value:
        value: Value = above(facts.plant) / np.maximum(below(facts.plant), LEAST)
        return value

    return ratio


def _damping(way: str) -> PlantFeature:
    """Return the share of its velocity that damping would take in H steps at its first rate."""
    get = attrgetter(f"damping_{way}")
    return lambda facts: get(facts.natural) * facts.horizon


def _root_damping(way: str) -> PlantFeature:
    """Return the square root of the same: most machines have little."""
    damping = _damping(way)
    return lambda facts: np.sqrt(damping(facts))


def _log_threshold(facts: PlantFacts) -> Value:
    threshold: Value = np.log(facts.natural.velocity_threshold)
    return threshold


def _stribeck_share(facts: PlantFacts) -> Value:
    speed = facts.natural.stribeck_velocity
    return speed / (1.0 + speed)


def _miss(probe: int, of: int) -> TaskFeature:
    """Return by how much of the reach (0) or speed (1) a probe ends beyond the target."""
    return lambda facts: facts.misses[:, probe, of]


PLANT_FEATURES: dict[str, PlantFeature] = {
    **{field: _own(field) for field in Plant._fields},
    "static_forward_over_limit": _natural("static_forward"),
    "static_backward_over_limit": _natural("static_backward"),
    "static_backward_over_forward": _ratio("static_backward", "static_forward"),
    "coulomb_forward_over_limit": _natural("coulomb_forward"),
    "coulomb_backward_over_limit": _natural("coulomb_backward"),
    "coulomb_over_static_forward": _ratio("coulomb_forward", "static_forward"),
    "coulomb_over_static_backward": _ratio("coulomb_backward", "static_backward"),
    "damping_forward_times_horizon": _damping("forward"),
    "damping_backward_times_horizon": _damping("backward"),
    "root_damping_forward": _root_damping("forward"),
    "root_damping_backward": _root_damping("backward"),
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
    "initial_position": lambda facts: facts.task.position,
    "initial_velocity": lambda facts: facts.task.velocity,
    "target_position": lambda facts: facts.task.target_position,
    "target_velocity": lambda facts: facts.task.target_velocity,
    "displacement_over_reach": lambda facts: (
        (facts.task.target_position - facts.task.position) / facts.scales.reach
    ),
    "initial_velocity_over_speed": lambda facts: facts.task.velocity / facts.scales.speed,
    "target_velocity_over_speed": lambda facts: facts.task.target_velocity / facts.scales.speed,
    **{
        f"{probe}_{of}_miss": _miss(i, j)
        for i, probe in enumerate(PROBES)
        for j, of in enumerate(("position", "velocity"))
    },
}
"""m and m/s, or shares of the plant's scales."""

SPREAD_FEATURES: dict[str, Callable[[Spread], Value]] = {
    f"{parameter}_spread": attrgetter(parameter) for parameter in Spread._fields
}
"""By what share a parameter may be off."""

CHANGES: dict[str, Callable[[TaskFacts, float], Task]] = {
    "initial_position": lambda facts, value: facts.task._replace(position=value),
    "initial_velocity": lambda facts, value: facts.task._replace(velocity=value),
    "target_position": lambda facts, value: facts.task._replace(target_position=value),
    "target_velocity": lambda facts, value: facts.task._replace(target_velocity=value),
    "displacement_over_reach": lambda facts, value: facts.task._replace(
        target_position=facts.task.position + value * facts.scales.reach
    ),
    "initial_velocity_over_speed": lambda facts, value: facts.task._replace(
        velocity=value * facts.scales.speed
    ),
    "target_velocity_over_speed": lambda facts, value: facts.task._replace(
        target_velocity=value * facts.scales.speed
    ),
}
"""The task whose feature has another value."""


def feature_values(
    names: Sequence[str], task: Task, horizon: int, spread: Spread = CERTAIN
) -> FloatArray:
    """Return features (N, C) of a task, its plant and how well that is known, by name.

    Args:
        names: C of `TASK_FEATURES`, `PLANT_FEATURES` and `SPREAD_FEATURES`.
        task: the fields of it and of its plant are floats or (N,).
        horizon: H.
        spread: by how much the plant may be off; its fields are the same.
    """
    facts = TaskFacts(task, horizon)

    def value(name: str) -> Value:
        if name in SPREAD_FEATURES:
            return SPREAD_FEATURES[name](spread)
        return TASK_FEATURES[name](facts) if name in TASK_FEATURES else PLANT_FEATURES[name](facts)

    fields = (np.shape(field) for field in (*task[:-1], *task.plant, *spread))
    values = np.empty((*np.broadcast_shapes((1,), *fields), len(names)))
    for column, name in zip(values.T, names, strict=True):
        column[:] = value(name)
    return values
