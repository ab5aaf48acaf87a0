"""Damped Gauss-Newton on the terminal error, within the control bounds: one candidate, compiled.

It keeps to the motion that the candidate has; another one is the matter of reachable/trace.py.
"""

import math
from typing import NamedTuple

import numpy as np

from app.compilation import compiled
from app.planning.arrays import FloatArray, copy_into
from app.planning.plant.rollout import terminal_state
from app.planning.plant.sensitivity import linearise
from app.planning.plant.task import Task
from app.planning.stop import Flag

EXACT = 1e-12
"""A terminal error below this is rounding: nothing is left to improve."""
MAX_DUAL_STEPS = 30
MAX_HALVINGS = 8
INITIAL_DAMPING = 1e-3
DAMPING_FACTOR = 1e-2
"""The damping falls by this much with every full step, so that the last steps are undamped."""
MIN_DAMPING = 1e-10
MIN_DUAL_FRACTION = 1e-6
STALLED = 1e-4
"""A step that lowers the error by a smaller share than this is the last one."""


@compiled
def distance(position: float, velocity: float, task: Task) -> float:
    """Return how far a state is from the target, ||x - x*||."""
    return math.hypot(position - task.target_position, velocity - task.target_velocity)


@compiled
def terminal_error_of(controls: FloatArray, task: Task) -> float:
    """Return ||x_H - x*|| of `controls` (H,) by a rollout."""
    position, velocity = terminal_state(controls, task.position, task.velocity, task.plant)
    return distance(position, velocity, task)


@compiled
def arrive(controls: FloatArray, task: Task, iterations: int, stopped: Flag) -> tuple[float, int]:
    """Move `controls` (H,) in place until they arrive or stall; return the error and the rollouts.

    Levenberg-Marquardt on the residual r = x_H - x* (Nocedal and Wright, Numerical Optimization,
    Sect. 10.3), the bounds in the subproblem, then halving on the true rollout. The controls change
    only where the true rollout improves, so the error never grows.
    """
    lowest, highest = task.plant.lowest_control, task.plant.highest_control
    horizon = controls.size
    jacobian = np.empty((2, horizon))
    direction = np.empty(horizon)
    trial = np.empty(horizon)
    error = terminal_error_of(controls, task)
    rollouts = 1
    damping = INITIAL_DAMPING
    for _ in range(iterations):
        if error <= EXACT or stopped[0]:
            break
        p, v = linearise(controls, task, jacobian)
        rollouts += 1
        scale = np.sum(jacobian**2)
        if scale == 0.0:
            break
        subproblem = Subproblem(
            controls,
            jacobian,
            p - task.target_position,
            v - task.target_velocity,
            damping * scale,
            lowest,
            highest,
        )
        bounded_step(subproblem, direction)
        before = error
        fraction = 1.0
        for _ in range(MAX_HALVINGS):
            for k in range(horizon):
                trial[k] = min(highest, max(lowest, controls[k] + fraction * direction[k]))
            trial_error = terminal_error_of(trial, task)
            rollouts += 1
            if trial_error < error:
                error = trial_error
                copy_into(controls, trial)
                break
            fraction *= 0.5
        if error > (1.0 - STALLED) * before:
            break
        if fraction == 1.0:
            damping = max(DAMPING_FACTOR * damping, MIN_DAMPING)
    return error, rollouts


class Subproblem(NamedTuple):
    """Minimise |r + J d|^2 + damping*|d|^2 over d, with lowest <= u + d <= highest."""

    controls: FloatArray
    """u, (H,)."""
    jacobian: FloatArray
    """J, (2, H)."""
    position_residual: float
    """r."""
    velocity_residual: float
    damping: float
    lowest: float
    highest: float


@compiled
def bounded_step(subproblem: Subproblem, direction: FloatArray) -> None:
    """Fill `direction` (H,) with the minimiser d of a subproblem.

    The optimality conditions leave two unknowns, z = (r + J d)/damping:

        d = clip(-J^T z),    damping*z - r - J d = 0.

    The left-hand side is the gradient of a convex piecewise quadratic function of z, the dual,
    which Newton with halving minimises; the free controls (those that the clip leaves alone) give
    its 2x2 Hessian, damping*I + J_free J_free^T. With every control free this is the minimum-norm
    step -J^T (J J^T + damping*I)^-1 r.
    """
    controls, jacobian, damping = subproblem.controls, subproblem.jacobian, subproblem.damping
    rp, rv = subproblem.position_residual, subproblem.velocity_residual
    # z: multipliers of the position and the velocity.
    zp, zv = 0.0, 0.0
    tolerance = 1e-14 * (abs(rp) + abs(rv))
    for _ in range(MAX_DUAL_STEPS):
        value = _dual_value(subproblem, zp, zv)
        gp, gv = damping * zp - rp, damping * zv - rv
        hpp, hpv, hvv = damping, 0.0, damping
        for k in range(controls.size):
            jp, jv = jacobian[0, k], jacobian[1, k]
            unbounded = -(jp * zp + jv * zv)
            nearest = max(subproblem.lowest - controls[k], unbounded)
            direction[k] = min(subproblem.highest - controls[k], nearest)
            gp -= jp * direction[k]
            gv -= jv * direction[k]
            if direction[k] == unbounded:
                hpp += jp * jp
                hpv += jp * jv
                hvv += jv * jv
        if abs(gp) + abs(gv) <= tolerance:
            break
        determinant = hpp * hvv - hpv * hpv
        sp = (hvv * gp - hpv * gv) / determinant
        sv = (hpp * gv - hpv * gp) / determinant
        decrease = 0.1 * (gp * sp + gv * sv)
        fraction = 1.0
        while fraction > MIN_DUAL_FRACTION:
            trial = _dual_value(subproblem, zp - fraction * sp, zv - fraction * sv)
            if trial <= value - fraction * decrease:
                break
            fraction *= 0.5
        zp -= fraction * sp
        zv -= fraction * sv


@compiled
def _dual_value(subproblem: Subproblem, zp: float, zv: float) -> float:
    """Return the convex function of z whose gradient `bounded_step` makes zero."""
    controls, jacobian = subproblem.controls, subproblem.jacobian
    value = 0.5 * subproblem.damping * (zp * zp + zv * zv)
    value = value - subproblem.position_residual * zp - subproblem.velocity_residual * zv
    for k in range(controls.size):
        unbounded = -(jacobian[0, k] * zp + jacobian[1, k] * zv)
        nearest = max(subproblem.lowest - controls[k], unbounded)
        d = min(subproblem.highest - controls[k], nearest)
        value += d * (unbounded - 0.5 * d)
    return value
