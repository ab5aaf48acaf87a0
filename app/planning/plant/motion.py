"""The motion of a plan: which branch of `step` each step takes, and what keeps it there.

As long as every step keeps its branch, the plan is affine in its controls; null_space.py uses that.
"""

import math
from typing import NamedTuple

import numpy as np

from app.compilation import compiled
from app.planning.plant.sensitivity import step_derivatives
from app.planning.plant.system import FloatArray, Parameters, step

STRICT = 1e-9
"""A bound that itself belongs to the next branch is approached no closer than this share of it."""


class Motion(NamedTuple):
    """One entry a step, all of shape (H,). v' is the velocity before friction stops the mass."""

    by_velocity: FloatArray
    """dv_{k+1}/dv_k."""
    by_control: FloatArray
    """dv_{k+1}/du_k."""
    free_velocity: FloatArray
    """v'_{k+1}, m/s, in the direction of the motion."""
    side: FloatArray
    """Direction of the motion: +-1, or 0 for a stuck step."""
    velocity_low: FloatArray
    """Bounds of `free_velocity`, m/s."""
    velocity_high: FloatArray
    control_low: FloatArray
    """Bounds of the controls, m/s^2: u_max, and static friction for a mass at rest."""
    control_high: FloatArray


@compiled
def motion_of(
    controls: FloatArray, position: float, velocity: float, parameters: Parameters
) -> Motion:
    """Return the motion that `controls` (H,) lead to."""
    static_friction, coulomb_friction, damping, limit, time_step, threshold = parameters
    horizon = controls.size
    by_velocity, by_control = np.empty(horizon), np.empty(horizon)
    free_velocity, side = np.zeros(horizon), np.zeros(horizon)
    velocity_low, velocity_high = np.full(horizon, -np.inf), np.full(horizon, np.inf)
    control_low, control_high = np.full(horizon, -limit), np.full(horizon, limit)
    for k in range(horizon):
        control = controls[k]
        position, next_velocity = step(position, velocity, control, parameters)
        by_velocity[k], by_control[k] = step_derivatives(
            velocity, control, next_velocity, parameters
        )
        if abs(velocity) < threshold:
            breakaway = static_friction * (1.0 + STRICT)
            if abs(control) <= static_friction:
                control_low[k] = max(-limit, -static_friction)
                control_high[k] = min(limit, static_friction)
            elif control > 0.0:
                control_low[k] = min(control, breakaway)
                side[k] = 1.0
            else:
                control_high[k] = max(control, -breakaway)
                side[k] = -1.0
            free_velocity[k] = side[k] * next_velocity
        else:
            side[k] = math.copysign(1.0, velocity)
            drift = control - side[k] * coulomb_friction - damping * velocity
            free_velocity[k] = side[k] * (velocity + time_step * drift)
        if side[k] != 0.0:
            if by_control[k] == 0.0:
                velocity_high[k] = 0.0
            elif k == horizon - 1:
                velocity_low[k] = 0.0
            elif abs(next_velocity) < threshold:
                velocity_low[k], velocity_high[k] = 0.0, threshold * (1.0 - STRICT)
            else:
                velocity_low[k] = threshold * (1.0 + STRICT)
        velocity = next_velocity
    return Motion(
        by_velocity,
        by_control,
        free_velocity,
        side,
        velocity_low,
        velocity_high,
        control_low,
        control_high,
    )


@compiled
def free_velocity_row(
    motion: Motion, at: int, time_step: float, damping: float, row: FloatArray
) -> None:
    """Fill `row` (H,) with the derivative of `motion.free_velocity[at]` by the controls."""
    row[:] = 0.0
    row[at] = motion.side[at] * time_step
    slope = motion.side[at]
    # A stopping step still has a free velocity, which the velocity before it moves.
    slope *= motion.by_velocity[at] if motion.by_control[at] > 0.0 else 1.0 - damping * time_step
    for k in range(at - 1, -1, -1):
        row[k] = slope * motion.by_control[k]
        slope *= motion.by_velocity[k]
        if slope == 0.0:
            break


@compiled
def free_velocity_rates(
    motion: Motion, direction: FloatArray, time_step: float, damping: float, rates: FloatArray
) -> None:
    """Fill `rates` (H,) with how fast `motion.free_velocity` changes along `direction` (H,)."""
    velocity_rate = 0.0
    for k in range(direction.size):
        slope = motion.by_velocity[k] if motion.by_control[k] > 0.0 else 1.0 - damping * time_step
        rates[k] = motion.side[k] * (slope * velocity_rate + time_step * direction[k])
        velocity_rate = motion.by_velocity[k] * velocity_rate + motion.by_control[k] * direction[k]
