"""The friction law, written once: what a step does with one control, and with all of them.

Rollouts, sensitivities, motions, stuck steps and the reachable set follow from it; none of them
knows a friction coefficient.
"""

import math
from typing import NamedTuple

from app.compilation import compiled
from app.planning.plant.system import Plant

STUCK, BREAKING_AWAY, SLIDING, STOPPING = range(4)
"""The kinds of a step."""
STOPPING_MARGIN = 1e-9
"""m/s^2, beyond the control that would just stop the mass."""


class Step(NamedTuple):
    """What one step does to the velocity. The position follows: p' = p + dt * `next_velocity`."""

    kind: int
    direction: float
    """Of the motion: +1 or -1, 0 for a stuck step."""
    free_velocity: float
    """Next velocity before friction stops the mass, m/s."""
    next_velocity: float
    """m/s."""
    by_velocity: float
    """Derivative of the next velocity by the velocity: each kind of step is affine."""
    by_control: float
    """Derivative of the next velocity by the control."""


@compiled
def take_step(velocity: float, control: float, plant: Plant) -> Step:
    """Return what a step does to a mass with `velocity` (m/s) under `control` (m/s^2).

    Paper Eq. 6, semi-implicit Euler with the post-friction velocity. A mass at rest,
    |v| < eps_v, stays exactly at rest unless |u| > f_s. A sliding step whose velocity would
    change sign ends at rest: friction stops a mass, it does not reverse it.
    """
    time_step = plant.time_step
    if abs(velocity) < plant.velocity_threshold:
        if abs(control) <= plant.static_friction:
            return Step(STUCK, 0.0, 0.0, 0.0, 0.0, 0.0)
        direction = math.copysign(1.0, control)
        free = velocity + time_step * (control - direction * plant.coulomb_friction)
        return Step(BREAKING_AWAY, direction, free, free, 1.0, time_step)
    direction = math.copysign(1.0, velocity)
    drag = direction * plant.coulomb_friction
    free = velocity + time_step * (control - drag - plant.viscous_damping * velocity)
    if free * direction <= 0.0:
        return Step(STOPPING, direction, free, 0.0, 0.0, 0.0)
    return Step(SLIDING, direction, free, free, sliding_retains(plant), time_step)


@compiled
def sliding_retains(plant: Plant) -> float:
    """Return the share of its velocity that a sliding mass keeps, friction and control apart."""
    return 1.0 - plant.viscous_damping * plant.time_step


@compiled
def counts_as_stuck(velocity: float, control: float, plant: Plant) -> bool:
    """Return whether the paper counts a step as stuck (Sect. 4.5): at rest, with |u| below f_s.

    A control of f_s exactly, which does not move the mass either, it does not count.
    """
    return abs(velocity) < plant.velocity_threshold and abs(control) < plant.static_friction


class Regime(NamedTuple):
    """What all controls together make of a velocity v: w = `retained` * v + s, low <= s <= high."""

    retained: float
    low: float
    """m/s."""
    high: float
    """m/s."""


@compiled
def breaking_away(direction: float, plant: Plant) -> Regime:
    """Return where a mass at rest can get to in one `direction`; empty (low > high) if nowhere.

    Its slow end belongs to the control that just does not break away.
    """
    push = plant.highest_control if direction > 0.0 else -plant.lowest_control
    slow = plant.time_step * (plant.static_friction - plant.coulomb_friction)
    fast = plant.time_step * (push - plant.coulomb_friction)
    if push <= plant.static_friction:
        return Regime(1.0, math.inf, -math.inf)
    return Regime(1.0, slow, fast) if direction > 0.0 else Regime(1.0, -fast, -slow)


@compiled
def sliding(direction: float, plant: Plant) -> Regime:
    """Return where a mass that slides in `direction` can get to, were it not stopped at rest."""
    push, pull = plant.highest_control, -plant.lowest_control
    if direction < 0.0:
        push, pull = pull, push
    fast = plant.time_step * (push - plant.coulomb_friction)
    brake = plant.time_step * (pull + plant.coulomb_friction)
    if direction > 0.0:
        return Regime(sliding_retains(plant), -brake, fast)
    return Regime(sliding_retains(plant), -fast, brake)


@compiled
def control_towards(next_velocity: float, velocity: float, plant: Plant) -> float:
    """Return the admissible control after which a mass with `velocity` is nearest to another one.

    The inverse of `take_step`. At rest it is the least control that leaves the mass at rest; where
    a sliding mass is to stop, one that stops it for certain.
    """
    change = (next_velocity - velocity) / plant.time_step
    if abs(velocity) < plant.velocity_threshold:
        if next_velocity == 0.0:
            return 0.0
        direction = math.copysign(1.0, change)
        beyond = math.nextafter(plant.static_friction, math.inf)
        control = direction * max(beyond, direction * change + plant.coulomb_friction)
    else:
        direction = math.copysign(1.0, velocity)
        control = change + direction * plant.coulomb_friction + plant.viscous_damping * velocity
        if next_velocity == 0.0:
            # No push is needed to stop, and rounding must not leave it creeping.
            control = direction * min(0.0, direction * control - STOPPING_MARGIN)
    return min(plant.highest_control, max(plant.lowest_control, control))


@compiled
def is_symmetric(plant: Plant) -> bool:
    """Return whether the mirror image of each motion is a motion of the same plant."""
    return plant.lowest_control == -plant.highest_control
