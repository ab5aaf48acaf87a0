"""The exact derivative of the terminal state with respect to the controls.

What is done with it is in `refining`.
"""

from app.compilation import compiled
from app.planning.arrays import FloatArray
from app.planning.plant.friction import take_step
from app.planning.plant.task import Task


@compiled
def linearise(controls: FloatArray, task: Task, jacobian: FloatArray) -> tuple[float, float]:
    """Return the terminal state of `controls` (H,) and fill `jacobian` (2, H) with its derivative.

    Row 0 is dp_H/du_k, row 1 dv_H/du_k. The adjoint of v+ = A*v + B*u + const., p+ = p + dt*v+ with
    A and B of `Step`: a change of v_{k+1} moves p_H by q_k and v_H by w_k,

        q_{H-1} = dt,  q_{k-1} = dt + A_k*q_k,    w_{H-1} = 1,  w_{k-1} = A_k*w_k,

    and dp_H/du_k = B_k*q_k, dv_H/du_k = B_k*w_k. No kind of step is smoothed: between its switches
    the terminal state is affine in the controls, and this is its slope there; on them it is
    one-sided.
    """
    time_step = task.plant.time_step
    horizon = controls.size
    position, velocity = task.position, task.velocity
    for k in range(horizon):
        step = take_step(velocity, controls[k], task.plant)
        velocity = step.next_velocity
        position += time_step * velocity
        # The two slopes of the step wait here for the backward pass.
        jacobian[0, k], jacobian[1, k] = step.by_velocity, step.by_control
    position_slope, velocity_slope = time_step, 1.0
    for k in range(horizon - 1, -1, -1):
        by_velocity, by_control = jacobian[0, k], jacobian[1, k]
        jacobian[0, k] = by_control * position_slope
        jacobian[1, k] = by_control * velocity_slope
        position_slope = time_step + by_velocity * position_slope
        velocity_slope = by_velocity * velocity_slope
    return position, velocity
