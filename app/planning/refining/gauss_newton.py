"""Damped Gauss-Newton on the terminal error, within the control bounds: one candidate, compiled.

It keeps to the motion that the candidate has; trying other motions is the matter of repair.py.
"""

import math

import numpy as np

from app.compilation import compiled
from app.planning.plant.sensitivity import linearise
from app.planning.plant.system import FloatArray, Parameters, terminal_state
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
def terminal_error_of(
    controls: FloatArray,
    position: float,
    velocity: float,
    target: FloatArray,
    parameters: Parameters,
) -> float:
    """Return ||x_H - x*|| of `controls` (H,) by a rollout."""
    p, v = terminal_state(controls, position, velocity, parameters)
    return math.hypot(p - target[0], v - target[1])


@compiled
def arrive(
    controls: FloatArray,
    position: float,
    velocity: float,
    target: FloatArray,
    parameters: Parameters,
    iterations: int,
    stopped: Flag,
) -> tuple[float, int]:
    """Move `controls` (H,) in place until they arrive or stall; return the error and the rollouts.

    Levenberg-Marquardt on the residual r = x_H - x* (Nocedal and Wright, Numerical Optimization,
    Sect. 10.3), the bounds in the subproblem, then halving on the true rollout. The controls change
    only where the true rollout improves, so the error never grows.
    """
    limit = parameters[3]
    horizon = controls.size
    jacobian = np.empty((2, horizon))
    direction = np.empty(horizon)
    trial = np.empty(horizon)
    error = terminal_error_of(controls, position, velocity, target, parameters)
    rollouts = 1
    damping = INITIAL_DAMPING
    for _ in range(iterations):
        if error <= EXACT or stopped[0]:
            break
        p, v = linearise(controls, position, velocity, parameters, jacobian)
        rollouts += 1
        scale = np.sum(jacobian**2)
        if scale == 0.0:
            break
        bounded_step(
            controls, jacobian, p - target[0], v - target[1], damping * scale, limit, direction
        )
        before = error
        fraction = 1.0
        for _ in range(MAX_HALVINGS):
            for k in range(horizon):
                trial[k] = min(limit, max(-limit, controls[k] + fraction * direction[k]))
            trial_error = terminal_error_of(trial, position, velocity, target, parameters)
            rollouts += 1
            if trial_error < error:
                error = trial_error
                controls[:] = trial
                break
            fraction *= 0.5
        if error > (1.0 - STALLED) * before:
            break
        if fraction == 1.0:
            damping = max(DAMPING_FACTOR * damping, MIN_DAMPING)
    return error, rollouts


@compiled
def bounded_step(
    controls: FloatArray,
    jacobian: FloatArray,
    position_residual: float,
    velocity_residual: float,
    damping: float,
    limit: float,
    direction: FloatArray,
) -> None:
    """Fill `direction` (H,) with the damped Gauss-Newton step that keeps to the bounds.

    It is the minimiser d of |r + J d|^2 + damping*|d|^2 with |u + d| <= limit. The optimality
    conditions leave two unknowns, z = (r + J d)/damping:

        d = clip(-J^T z),    damping*z - r - J d = 0.

    The left-hand side is the gradient of a convex piecewise quadratic function of z, the dual,
    which Newton with halving minimises; the free controls (those that the clip leaves alone) give
    its 2x2 Hessian, damping*I + J_free J_free^T. With every control free this is the minimum-norm
    step -J^T (J J^T + damping*I)^-1 r.
    """
    # z: multipliers of the position and the velocity.
    zp, zv = 0.0, 0.0
    tolerance = 1e-14 * (abs(position_residual) + abs(velocity_residual))
    for _ in range(MAX_DUAL_STEPS):
        value = _dual_value(
            controls, jacobian, position_residual, velocity_residual, damping, limit, zp, zv
        )
        gp, gv = damping * zp - position_residual, damping * zv - velocity_residual
        hpp, hpv, hvv = damping, 0.0, damping
        for k in range(controls.size):
            jp, jv = jacobian[0, k], jacobian[1, k]
            unbounded = -(jp * zp + jv * zv)
            direction[k] = min(limit - controls[k], max(-limit - controls[k], unbounded))
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
            trial = _dual_value(
                controls,
                jacobian,
                position_residual,
                velocity_residual,
                damping,
                limit,
                zp - fraction * sp,
                zv - fraction * sv,
            )
            if trial <= value - fraction * decrease:
                break
            fraction *= 0.5
        zp -= fraction * sp
        zv -= fraction * sv


@compiled
def _dual_value(
    controls: FloatArray,
    jacobian: FloatArray,
    position_residual: float,
    velocity_residual: float,
    damping: float,
    limit: float,
    zp: float,
    zv: float,
) -> float:
    """Return the convex function of z whose gradient `bounded_step` makes zero."""
    value = 0.5 * damping * (zp * zp + zv * zv) - position_residual * zp - velocity_residual * zv
    for k in range(controls.size):
        unbounded = -(jacobian[0, k] * zp + jacobian[1, k] * zv)
        d = min(limit - controls[k], max(-limit - controls[k], unbounded))
        value += d * (unbounded - 0.5 * d)
    return value
