"""Rollouts: the states that controls lead to."""

import numpy as np

from app.compilation import compiled
from app.planning.arrays import BoolArray, FloatArray
from app.planning.plant.friction import counts_as_stuck, take_step
from app.planning.plant.system import Plant, System


@compiled
def step(position: float, velocity: float, control: float, plant: Plant) -> tuple[float, float]:
    """Advance one time step; return the new position (m) and velocity (m/s)."""
    velocity = take_step(velocity, control, plant).next_velocity
    return position + plant.time_step * velocity, velocity


@compiled
def terminal_state(
    controls: FloatArray, position: float, velocity: float, plant: Plant
) -> tuple[float, float]:
    """Return the state that `controls` (H,) lead to."""
    for control in controls:
        position, velocity = step(position, velocity, control, plant)
    return position, velocity


@compiled
def _rollout(controls: FloatArray, initial_states: FloatArray, plant: Plant) -> FloatArray:
    num_candidates, horizon = controls.shape
    states = np.empty((num_candidates, horizon + 1, 2))
    for candidate in range(num_candidates):
        p, v = initial_states[candidate, 0], initial_states[candidate, 1]
        states[candidate, 0, 0], states[candidate, 0, 1] = p, v
        for k in range(horizon):
            p, v = step(p, v, controls[candidate, k], plant)
            states[candidate, k + 1, 0], states[candidate, k + 1, 1] = p, v
    return states


def rollout(system: System, initial_states: FloatArray, controls: FloatArray) -> FloatArray:
    """Roll `controls` (K, H) out from one state (2,) or one each (K, 2).

    Returns:
        States (K, H+1, 2), the initial ones first.
    """
    return rollout_on(system.plant, initial_states, controls)


def rollout_on(plant: Plant, initial_states: FloatArray, controls: FloatArray) -> FloatArray:
    """Do what `rollout` does, on a plant as the kernels take it."""
    # A copy: for an array that must not be written the kernel would be compiled once more.
    starts = np.array(
        np.broadcast_to(initial_states, (len(controls), 2)), dtype=np.float64, order="C"
    )
    return _rollout(np.ascontiguousarray(controls, dtype=np.float64), starts, plant)


def rollout_many(plant: Plant, initial_states: FloatArray, controls: FloatArray) -> FloatArray:
    """Roll `controls` (N, K, H) out, K sequences from each of the states (N, 2).

    Returns:
        States (N, K, H+1, 2), the initial ones first.
    """
    num_problems, num_candidates, horizon = controls.shape
    starts = np.repeat(initial_states, num_candidates, axis=0)
    states = rollout_on(plant, starts, controls.reshape(-1, horizon))
    return states.reshape(num_problems, num_candidates, horizon + 1, 2)


@compiled
def are_stuck(velocities: FloatArray, controls: FloatArray, plant: Plant) -> BoolArray:
    """Return which steps from `velocities` (N,) under `controls` (N,) count as stuck, (N,)."""
    stuck = np.empty(controls.size, dtype=np.bool_)
    for i in range(controls.size):
        stuck[i] = counts_as_stuck(velocities[i], controls[i], plant)
    return stuck
