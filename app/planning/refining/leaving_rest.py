"""Descent across rests: when one candidate leaves rest, which no derivative tells. Compiled.

The descent of the motion between rests is in gauss_newton.py.
"""

import numpy as np

from app.compilation import compiled
from app.planning.arrays import FloatArray, copy_into
from app.planning.plant.rollout import step
from app.planning.plant.task import Task
from app.planning.refining.gauss_newton import EXACT, STALLED, arrive
from app.planning.stop import Flag

MAX_KICKS = 8
"""Of one candidate; with the paper's plant none needs more than four."""


@compiled
def arrive_across_rests(
    controls: FloatArray, task: Task, iterations: int, stopped: Flag
) -> tuple[float, int]:
    """Move `controls` (H,) in place until they arrive or stall; return the error and the rollouts.

    A control that leaves the mass at rest has no derivative, so Gauss-Newton (`arrive`) cannot see
    that the mass had better leave sooner, and stalls a step's worth of velocity short. There one
    such control is set to its limit (`_find_kicks`), and the descent goes on from it if that brings
    it nearer; then the next one, up to `MAX_KICKS`, while fewer rollouts are spent than one and a
    half times `iterations`. The error never grows.
    """
    error, rollouts = arrive(controls, task, iterations, stopped)
    trial, kicks = np.empty(controls.size), np.empty(controls.size)
    for _ in range(MAX_KICKS):
        if error <= EXACT or stopped[0] or 2 * rollouts >= 3 * iterations:
            break
        _find_kicks(controls, task, kicks)
        rollouts += 1
        for k in range(controls.size - 1, -1, -1):
            if kicks[k] == 0.0:
                continue
            copy_into(trial, controls)
            trial[k] = kicks[k]
            trial_error, spent = arrive(trial, task, iterations, stopped)
            rollouts += spent
            if trial_error < (1.0 - STALLED) * error:
                error = trial_error
                copy_into(controls, trial)
                break
        else:
            break
    return error, rollouts


@compiled
def _find_kicks(controls: FloatArray, task: Task, kicks: FloatArray) -> None:
    """Fill `kicks` (H,) with the control by which to leave rest in each step, 0 for the others.

    They are the limits of control. The mass may leave each rest one step sooner, the way that it
    leaves it; and its last rest, where it stays to the end, towards the target: at once, or, if the
    target moves, in the last step with its velocity.
    """
    plant = task.plant
    position, velocity = task.position, task.velocity
    rested = False
    first_of_rest = 0
    for k in range(controls.size):
        kicks[k] = 0.0
        at_rest = abs(velocity) < plant.velocity_threshold
        position, velocity = step(position, velocity, controls[k], plant)
        rests = at_rest and velocity == 0.0
        if rested and not rests:
            kicks[k - 1] = _limit_towards(velocity, task)
        if rests and not rested:
            first_of_rest = k
        rested = rests
    if rested:
        kicks[first_of_rest] = _limit_towards(task.target_position - position, task)
        if task.target_velocity != 0.0:
            kicks[-1] = _limit_towards(task.target_velocity, task)


@compiled
def _limit_towards(direction: float, task: Task) -> float:
    """Return the control limit that pushes the most in the direction of the sign."""
    return task.plant.highest_control if direction > 0.0 else task.plant.lowest_control
