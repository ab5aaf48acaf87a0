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
"""Share of the control range, beyond the control that would just stop the mass."""
MAX_HALVINGS = 64
ROUNDING = 2.0**-53
"""Relative, of a double."""
TINY = 1e-300


class Friction(NamedTuple):
    """What opposes motion in one direction."""

    static: float
    """f_s, m/s^2."""
    coulomb: float
    """f_c, m/s^2."""
    damping: float
    """b, 1/s."""
    breakaway: float
    """What opposes the first step from rest, m/s^2."""


@compiled
def friction_of(direction: float, plant: Plant) -> Friction:
    """Return what opposes motion in a `direction`, forward (> 0) or backward."""
    if direction > 0.0:
        return Friction(
            plant.static_forward,
            plant.coulomb_forward,
            plant.damping_forward,
            plant.breakaway_forward,
        )
    return Friction(
        plant.static_backward,
        plant.coulomb_backward,
        plant.damping_backward,
        plant.breakaway_backward,
    )


@compiled
def weakening(speed: float, friction: Friction, plant: Plant) -> float:
    """Return by how much dry friction still exceeds Coulomb friction at a `speed`, m/s^2.

    Stribeck's effect, (f_s - f_c) exp(-(speed/v_s)^2); none where the plant has no v_s.
    """
    if plant.stribeck_velocity == 0.0:
        return 0.0
    ratio = speed / plant.stribeck_velocity
    return (friction.static - friction.coulomb) * math.exp(-ratio * ratio)


@compiled
def acceleration(control: float, plant: Plant) -> float:
    """Return what a control and the bias make of a mass without friction, m/s^2."""
    return plant.control_gain * control + plant.bias


class Step(NamedTuple):
    """What one step does to the velocity. The position follows: p' = p + dt * `next_velocity`."""

    kind: int
    direction: float
    """Of the motion: +1 or -1, 0 for a stuck step."""
    free_velocity: float
    """Next velocity before friction stops the mass, m/s."""
    next_velocity: float
    """m/s."""
    free_by_velocity: float
    """Derivative of `free_velocity` by the velocity."""
    by_velocity: float
    """Derivative of `next_velocity` by the velocity; without Stribeck's effect a constant."""
    by_control: float
    """Derivative of `next_velocity` by the control."""


@compiled
def take_step(velocity: float, control: float, plant: Plant) -> Step:
    """Return what a step does to a mass with `velocity` (m/s) under `control` (units of control).

    Paper Eq. 6, semi-implicit Euler with the post-friction velocity, for a friction that may differ
    by direction. With a = gain*u + bias, a mass at rest, |v| < eps_v, stays exactly at rest while
    -f_s <= a <= f_s, each side with the friction of its direction. A sliding step whose velocity
    would change sign ends at rest: friction stops a mass, it does not reverse it. What depends on
    the velocity, damping and Stribeck's effect, is at rest that of v = 0.
    """
    time_step = plant.time_step
    accelerated = acceleration(control, plant)
    if abs(velocity) < plant.velocity_threshold:
        if -plant.static_backward <= accelerated <= plant.static_forward:
            return Step(STUCK, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        direction = math.copysign(1.0, accelerated)
        drag = plant.breakaway_forward if accelerated > 0.0 else -plant.breakaway_backward
        free = velocity + time_step * (accelerated - drag)
        by_control = time_step * plant.control_gain
        return Step(BREAKING_AWAY, direction, free, free, 1.0, 1.0, by_control)
    direction = math.copysign(1.0, velocity)
    # Of both directions, and then of one: a rollout waits for nothing but each step's velocity.
    forward = accelerated - plant.coulomb_forward - plant.damping_forward * velocity
    backward = accelerated + plant.coulomb_backward - plant.damping_backward * velocity
    slid = forward if velocity > 0.0 else backward
    damping = plant.damping_forward if velocity > 0.0 else plant.damping_backward
    retained = 1.0 - damping * time_step
    if plant.stribeck_velocity > 0.0:
        excess = weakening(abs(velocity), friction_of(direction, plant), plant)
        slid -= direction * excess
        retained += time_step * excess * 2.0 * abs(velocity) / plant.stribeck_velocity**2
    free = velocity + time_step * slid
    if free * direction <= 0.0:
        return Step(STOPPING, direction, free, 0.0, retained, 0.0, 0.0)
    by_control = time_step * plant.control_gain
    return Step(SLIDING, direction, free, free, retained, retained, by_control)


@compiled
def counts_as_stuck(velocity: float, control: float, plant: Plant) -> bool:
    """Return whether the paper counts a step as stuck (Sect. 4.5): at rest, below static friction.

    An acceleration of f_s exactly, which does not move the mass either, it does not count.
    """
    within = -plant.static_backward < acceleration(control, plant) < plant.static_forward
    return abs(velocity) < plant.velocity_threshold and within


class Controls(NamedTuple):
    """A range of controls, both ends included; empty if `low` > `high`."""

    low: float
    high: float


@compiled
def resting_controls(plant: Plant) -> Controls:
    """Return all controls that leave a mass at rest, admissible or not, to within rounding."""
    low = (-plant.static_backward - plant.bias) / plant.control_gain
    by = _rounding(plant.static_backward, plant)
    while acceleration(low, plant) < -plant.static_backward:
        low, by = low + by, 2.0 * by
    high = (plant.static_forward - plant.bias) / plant.control_gain
    by = _rounding(plant.static_forward, plant)
    while acceleration(high, plant) > plant.static_forward:
        high, by = high - by, 2.0 * by
    return Controls(low, high)


@compiled
def breakaway_controls(plant: Plant) -> Controls:
    """Return the least controls that break a mass at rest away, backward and forward."""
    resting = resting_controls(plant)
    low, by = math.nextafter(resting.low, -math.inf), _rounding(plant.static_backward, plant)
    while acceleration(low, plant) >= -plant.static_backward:
        low, by = low - by, 2.0 * by
    high, by = math.nextafter(resting.high, math.inf), _rounding(plant.static_forward, plant)
    while acceleration(high, plant) <= plant.static_forward:
        high, by = high + by, 2.0 * by
    return Controls(low, high)


@compiled
def _rounding(static_friction: float, plant: Plant) -> float:
    """Return what rounding does to the control of a static friction, if anything."""
    return max(TINY, ROUNDING * max(static_friction, abs(plant.bias)) / plant.control_gain)


@compiled
def can_rest(plant: Plant) -> bool:
    """Return whether an admissible control leaves a mass at rest."""
    highest = acceleration(plant.highest_control, plant)
    lowest = acceleration(plant.lowest_control, plant)
    return highest >= -plant.static_backward and lowest <= plant.static_forward


@compiled
def holding_control(plant: Plant) -> float:
    """Return the admissible control nearest to none that leaves a mass at rest, where one does.

    Where none does, the admissible one nearest to none.
    """
    control = 0.0
    if can_rest(plant):
        resting = resting_controls(plant)
        control = min(resting.high, max(resting.low, control))
    return min(plant.highest_control, max(plant.lowest_control, control))


class Regime(NamedTuple):
    """What all controls together make of a velocity v: w = `kept`(v) + s, low <= s <= high."""

    retained: float
    """The share of its velocity that the mass keeps, friction and control apart; with Stribeck's
    effect `kept_velocity` says what it keeps."""
    low: float
    """m/s."""
    high: float
    """m/s."""


@compiled
def breaking_away(direction: float, plant: Plant) -> Regime:
    """Return where a mass at rest can get to in one `direction`; empty (low > high) if nowhere.

    Its slow end belongs to the control that just does not break away, if that is admissible.
    """
    friction = friction_of(direction, plant)
    pull, push = _accelerations(direction, plant)
    slow = plant.time_step * (max(friction.static, pull) - friction.breakaway)
    fast = plant.time_step * (push - friction.breakaway)
    if push <= friction.static:
        return Regime(1.0, math.inf, -math.inf)
    return Regime(1.0, slow, fast) if direction > 0.0 else Regime(1.0, -fast, -slow)


@compiled
def sliding(direction: float, plant: Plant) -> Regime:
    """Return where a mass that slides in `direction` can get to, were it not stopped at rest."""
    friction = friction_of(direction, plant)
    retained = 1.0 - friction.damping * plant.time_step
    pull, push = _accelerations(direction, plant)
    slow = plant.time_step * (pull - friction.coulomb)
    fast = plant.time_step * (push - friction.coulomb)
    return Regime(retained, slow, fast) if direction > 0.0 else Regime(retained, -fast, -slow)


@compiled
def _accelerations(direction: float, plant: Plant) -> tuple[float, float]:
    """Return the least and the greatest acceleration along a `direction`, m/s^2."""
    lowest = acceleration(plant.lowest_control, plant)
    highest = acceleration(plant.highest_control, plant)
    return (lowest, highest) if direction > 0.0 else (-highest, -lowest)


@compiled
def kept_velocity(velocity: float, direction: float, plant: Plant) -> float:
    """Return what of a `velocity` (m/s) in a direction the next step keeps, as `Regime` has it.

    It grows with the velocity: damping takes less than all of it in a step, and dry friction only
    falls.
    """
    friction = friction_of(direction, plant)
    excess = weakening(abs(velocity), friction, plant)
    retained = 1.0 - friction.damping * plant.time_step
    return retained * velocity - plant.time_step * direction * excess


@compiled
def velocity_that_keeps(kept: float, direction: float, plant: Plant) -> float:
    """Return the velocity of which `kept_velocity` is `kept`, m/s, by bisection."""
    friction = friction_of(direction, plant)
    retained = 1.0 - friction.damping * plant.time_step
    lost = plant.time_step * (friction.breakaway - friction.coulomb)
    if lost == 0.0 or math.isinf(kept):
        return kept / retained
    low, high = kept / retained, (kept + direction * lost) / retained
    # It grows with velocities in its direction only: none is on the other side of rest.
    if direction > 0.0:
        low, high = max(low, 0.0), max(high, 0.0)
    else:
        low, high = min(high, 0.0), min(low, 0.0)
    for _ in range(MAX_HALVINGS):
        middle = 0.5 * (low + high)
        if kept_velocity(middle, direction, plant) < kept:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@compiled
def control_towards(next_velocity: float, velocity: float, plant: Plant) -> float:
    """Return the admissible control after which a mass with `velocity` is nearest to another one.

    The inverse of `take_step`. A mass at rest that is to stay so it holds with the least control;
    where a sliding mass is to stop, it stops it for certain.
    """
    change = (next_velocity - velocity) / plant.time_step
    if abs(velocity) < plant.velocity_threshold:
        if next_velocity == 0.0:
            return holding_control(plant)
        direction = math.copysign(1.0, change)
        change += direction * friction_of(direction, plant).breakaway
        control = (change - plant.bias) / plant.control_gain
        least = breakaway_controls(plant)
        control = max(control, least.high) if direction > 0.0 else min(control, least.low)
    else:
        direction = math.copysign(1.0, velocity)
        friction = friction_of(direction, plant)
        change += direction * (friction.coulomb + weakening(abs(velocity), friction, plant))
        change += friction.damping * velocity
        control = (change - plant.bias) / plant.control_gain
        if next_velocity == 0.0:
            # No push is needed to stop, and rounding must not leave it creeping.
            margin = STOPPING_MARGIN * (plant.highest_control - plant.lowest_control)
            control = direction * min(0.0, direction * control - margin)
    return min(plant.highest_control, max(plant.lowest_control, control))


@compiled
def is_symmetric(plant: Plant) -> bool:
    """Return whether the mirror image of each motion is a motion of the same plant."""
    forward, backward = friction_of(1.0, plant), friction_of(-1.0, plant)
    return forward == backward and (
        acceleration(plant.lowest_control, plant) == -acceleration(plant.highest_control, plant)
    )
