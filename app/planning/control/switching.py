"""Full control either way, switched where it just stops the mass at the target: a law, and a plan.

It is time-optimal in continuous time. In steps it ends near the target, where Gauss-Newton
(refining/gauss_newton.py) goes on from.
"""

import math

from app.compilation import compiled
from app.planning.arrays import FloatArray
from app.planning.plant.friction import acceleration, can_rest, friction_of, holding_control
from app.planning.plant.rollout import step
from app.planning.plant.system import Plant
from app.planning.plant.task import Task

SLIGHT = 1e-3
"""Below this loss of velocity by damping its logarithm is a series."""
HOPS = 8.0
"""A mass at rest so many times the least hop away has come near the target."""
SURELY = 0.8
"""Of static friction: what a mass at rest is held with, its parameters being uncertain."""


@compiled
def braking_distance(velocity: float, plant: Plant) -> float:
    """Return the way (m, with the sign of `velocity`) in which full control stops a mass.

    With v' = -(d + b*v), it is v/b - d/b^2*ln(1 + b*v/d); without damping v^2/(2*d). Infinite where
    full control does not stop it.
    """
    direction = math.copysign(1.0, velocity)
    friction = friction_of(direction, plant)
    against = plant.lowest_control if direction > 0.0 else plant.highest_control
    braking = friction.coulomb - direction * acceleration(against, plant)
    speed = abs(velocity)
    if braking <= 0.0:
        return math.copysign(math.inf, velocity) if speed > 0.0 else 0.0
    lost = friction.damping * speed / braking
    if lost < SLIGHT:
        return direction * speed * speed / braking * (0.5 - lost / 3.0)
    return direction * speed * speed / braking * (lost - math.log1p(lost)) / (lost * lost)


@compiled
def least_hop(plant: Plant) -> float:
    """Return how far a step of full control moves a mass from rest, the lesser of both ways; m."""
    forward = acceleration(plant.highest_control, plant) - plant.breakaway_forward
    backward = -acceleration(plant.lowest_control, plant) - plant.breakaway_backward
    return plant.time_step**2 * max(0.0, min(forward, backward))


@compiled
def steady_control(plant: Plant) -> float:
    """Return the control that keeps a mass at rest: none, where none surely does.

    Otherwise what is nearest to balancing the bias.
    """
    if -SURELY * plant.static_backward <= plant.bias <= SURELY * plant.static_forward:
        control = 0.0
    elif can_rest(plant):
        control = -plant.bias / plant.control_gain
    else:
        control = holding_control(plant)
    return min(plant.highest_control, max(plant.lowest_control, control))


@compiled
def fill_with_switching(controls: FloatArray, task: Task) -> int:
    """Fill `controls` (H,) with full control, switched in time to stop at the target; then hold.

    Returns the steps until the mass rests near the target; H where it does not come to that.
    """
    plant = task.plant
    near = HOPS * least_hop(plant)
    position, velocity = task.position, task.velocity
    for k in range(controls.size):
        ahead = task.target_position - position - braking_distance(velocity, plant)
        controls[k] = plant.highest_control if ahead > 0.0 else plant.lowest_control
        position, velocity = step(position, velocity, controls[k], plant)
        if velocity == 0.0 and abs(task.target_position - position) < near:
            for j in range(k + 1, controls.size):
                controls[j] = steady_control(plant)
            return k + 1
    return int(controls.size)
