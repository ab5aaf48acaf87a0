"""The motion of a plan: the kind of each of its steps, and what keeps it so.

As long as every step keeps its kind, the plan is affine in its controls, Stribeck's effect apart;
null_space.py uses that.
"""

from typing import NamedTuple

import numpy as np

from app.compilation import compiled
from app.planning.arrays import FloatArray
from app.planning.plant.friction import (
    BREAKING_AWAY,
    STOPPING,
    STUCK,
    breakaway_controls,
    resting_controls,
    take_step,
)
from app.planning.plant.system import Plant
from app.planning.plant.task import Task

STRICT = 1e-9
"""A bound that belongs to the next kind of step is approached no closer than this share of it."""


class Motion(NamedTuple):
    """One entry a step, all of shape (H,). v' is the velocity before friction stops the mass."""

    by_velocity: FloatArray
    """dv_{k+1}/dv_k."""
    by_control: FloatArray
    """dv_{k+1}/du_k."""
    free_by_velocity: FloatArray
    """dv'_{k+1}/dv_k: a stopping step has it, too."""
    free_velocity: FloatArray
    """v'_{k+1}, m/s, in the direction of the motion."""
    direction: FloatArray
    """Of the motion: +-1, or 0 for a stuck step."""
    lowest_velocity: FloatArray
    """Bounds of `free_velocity`, m/s."""
    highest_velocity: FloatArray
    lowest_control: FloatArray
    """Bounds of the controls: the plant's, and static friction for a mass at rest."""
    highest_control: FloatArray


@compiled
def motion_of(controls: FloatArray, task: Task) -> Motion:
    """Return the motion that `controls` (H,) lead to."""
    plant = task.plant
    threshold = plant.velocity_threshold
    resting, breakaway = resting_controls(plant), breakaway_controls(plant)
    margin = STRICT * 0.5 * (resting.high - resting.low)
    horizon = controls.size
    motion = Motion(
        by_velocity=np.empty(horizon),
        by_control=np.empty(horizon),
        free_by_velocity=np.empty(horizon),
        free_velocity=np.empty(horizon),
        direction=np.empty(horizon),
        lowest_velocity=np.full(horizon, -np.inf),
        highest_velocity=np.full(horizon, np.inf),
        lowest_control=np.full(horizon, plant.lowest_control),
        highest_control=np.full(horizon, plant.highest_control),
    )
    velocity = task.velocity
    for k in range(horizon):
        step = take_step(velocity, controls[k], plant)
        motion.by_velocity[k], motion.by_control[k] = step.by_velocity, step.by_control
        motion.free_by_velocity[k] = step.free_by_velocity
        motion.free_velocity[k] = step.direction * step.free_velocity
        motion.direction[k] = step.direction
        if step.kind == STUCK:
            motion.lowest_control[k] = max(plant.lowest_control, resting.low)
            motion.highest_control[k] = min(plant.highest_control, resting.high)
        elif step.kind == BREAKING_AWAY and step.direction > 0.0:
            motion.lowest_control[k] = min(controls[k], breakaway.high + margin)
        elif step.kind == BREAKING_AWAY:
            motion.highest_control[k] = max(controls[k], breakaway.low - margin)
        if step.kind == STOPPING:
            motion.highest_velocity[k] = 0.0
        elif step.kind != STUCK and k == horizon - 1:
            motion.lowest_velocity[k] = 0.0
        elif step.kind != STUCK and abs(step.next_velocity) < threshold:
            motion.lowest_velocity[k] = 0.0
            motion.highest_velocity[k] = threshold * (1.0 - STRICT)
        elif step.kind != STUCK:
            motion.lowest_velocity[k] = threshold * (1.0 + STRICT)
        velocity = step.next_velocity
    return motion


@compiled
def free_velocity_row(motion: Motion, at: int, plant: Plant, row: FloatArray) -> None:
    """Fill `row` (H,) with the derivative of `motion.free_velocity[at]` by the controls."""
    row[:] = 0.0
    row[at] = motion.direction[at] * plant.time_step * plant.control_gain
    slope = motion.direction[at] * motion.free_by_velocity[at]
    for k in range(at - 1, -1, -1):
        row[k] = slope * motion.by_control[k]
        slope *= motion.by_velocity[k]
        if slope == 0.0:
            break


@compiled
def free_velocity_rates(
    motion: Motion, direction: FloatArray, plant: Plant, rates: FloatArray
) -> None:
    """Fill `rates` (H,) with how fast `motion.free_velocity` changes along `direction` (H,)."""
    velocity_rate = 0.0
    by_control = plant.time_step * plant.control_gain
    for k in range(direction.size):
        free_rate = motion.free_by_velocity[k] * velocity_rate + by_control * direction[k]
        rates[k] = motion.direction[k] * free_rate
        velocity_rate = motion.by_velocity[k] * velocity_rate + motion.by_control[k] * direction[k]
