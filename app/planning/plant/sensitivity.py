"""The exact derivative of the terminal state with respect to the controls.

The plant itself is in system.py; what is done with the derivative is in refinement.py.
"""

import numpy as np

from app.compilation import compiled
from app.planning.plant.system import FloatArray, Parameters, System, step


@compiled
def step_derivatives(
    velocity: float, control: float, next_velocity: float, parameters: Parameters
) -> tuple[float, float]:
    """Return dv+/dv and dv+/du of the step that led from `velocity` to `next_velocity`.

    The four branches of `step` are affine: sliding (1 - b*dt, dt), break-away (1, dt), and stuck
    or stopped (0, 0), where the mass is at rest whatever the control does nearby. In all of them
    p+ = p + dt*v+, so that the two numbers give the derivative of the position as well.
    """
    static_friction, _, damping, _, time_step, threshold = parameters
    if abs(velocity) < threshold:
        return (0.0, 0.0) if abs(control) <= static_friction else (1.0, time_step)
    return (0.0, 0.0) if next_velocity == 0.0 else (1.0 - damping * time_step, time_step)


@compiled
def linearise(
    controls: FloatArray,
    position: float,
    velocity: float,
    parameters: Parameters,
    jacobian: FloatArray,
) -> tuple[float, float]:
    """Return the terminal state of `controls` (H,) and fill `jacobian` (2, H) with its derivative.

    Row 0 is dp_H/du_k, row 1 dv_H/du_k. The adjoint of v+ = A*v + B*u + const., p+ = p + dt*v+ with
    A and B of `step_derivatives`: a change of v_{k+1} moves p_H by q_k and v_H by w_k,

        q_{H-1} = dt,  q_{k-1} = dt + A_k*q_k,    w_{H-1} = 1,  w_{k-1} = A_k*w_k,

    and dp_H/du_k = B_k*q_k, dv_H/du_k = B_k*w_k. No branch is smoothed: between its switches the
    terminal state is affine in the controls, and this is its slope there.
    """
    time_step = parameters[4]
    horizon = controls.size
    for k in range(horizon):
        # The two slopes of the step wait here for the backward pass.
        position, next_velocity = step(position, velocity, controls[k], parameters)
        jacobian[0, k], jacobian[1, k] = step_derivatives(
            velocity, controls[k], next_velocity, parameters
        )
        velocity = next_velocity
    position_slope, velocity_slope = time_step, 1.0
    for k in range(horizon - 1, -1, -1):
        by_velocity, by_control = jacobian[0, k], jacobian[1, k]
        jacobian[0, k] = by_control * position_slope
        jacobian[1, k] = by_control * velocity_slope
        position_slope = time_step + by_velocity * position_slope
        velocity_slope = by_velocity * velocity_slope
    return position, velocity


def terminal_jacobian(
    system: System, initial_state: FloatArray, controls: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the terminal state (2,) that `controls` (H,) lead to, and its derivative (2, H).

    Rows are position (m) and velocity (m/s), columns the controls (m/s^2). Exact wherever the plant
    is differentiable, one-sided on its switches; see `linearise`.
    """
    jacobian = np.empty((2, len(controls)))
    state = linearise(
        np.ascontiguousarray(controls, dtype=np.float64),
        float(initial_state[0]),
        float(initial_state[1]),
        system.parameters,
        jacobian,
    )
    return np.array(state), jacobian
