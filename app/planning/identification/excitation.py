"""Controls that a machine is identified well from: ramps from rest, and dwells at three speeds."""

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.plant.friction import acceleration, breakaway_controls, friction_of, weakening
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System

RAMP_SECONDS = 2.0
RAMP_FROM, RAMP_TO = 0.6, 1.3
"""Of the control that is thought to break the machine away: it may need less, or more."""
PUSH_SECONDS = 0.4
"""Of full control: what it reaches is the fastest speed."""
SPEEDS = (0.25, 0.5, 1.0)
"""Of the fastest."""
DWELL_SECONDS = 0.6
REST_SECONDS = 0.4
LEAST_STEPS = 3
"""Of each part."""
REPETITIONS = 2
SHORTER = 0.9
"""Where it goes too far, all parts are tried so much shorter, again and again."""
SHORTEST = 0.1
"""Of their usual length: in less nothing is told from anything."""


class StrokeTooShort(ValueError):
    """No controls of this kind stay within a stroke; the message says what they take at least."""


def excitation(system: System, stroke: float | None = None) -> FloatArray:
    """Return controls (N,) within the limits of a machine that is known roughly.

    In each direction a slow ramp from rest until it surely moves, and dwells at three speeds, each
    from rest and back to it; twice. Forward and backward take it about as far.

    Args:
        system: about the machine.
        stroke: m, that such a machine is to stay within, by shorter parts; None for no limit.

    Raises:
        StrokeTooShort: it does not, however short they are.
    """
    length = 1.0
    while True:
        controls = _of_length(system, length)
        lowest, highest = travel(system, controls)
        if stroke is None or highest - lowest <= stroke:
            return controls
        length *= SHORTER
        if length < SHORTEST:
            raise StrokeTooShort(
                f"the shortest controls that tell anything take {highest - lowest:.2g} m"
            )


def travel(system: System, controls: FloatArray) -> tuple[float, float]:
    """Return the lowest and the highest position, m, that controls (N,) from rest at 0 lead to."""
    positions = rollout(system, np.zeros(2), controls[np.newaxis])[0, :, 0]
    return float(positions.min()), float(positions.max())


def _of_length(system: System, length: float) -> FloatArray:
    """Return the controls (N,), whose pushes and dwells last so much of their usual time, and whose
    ramps go so far beyond break-away."""
    parts = []
    for _ in range(REPETITIONS):
        for direction in (1.0, -1.0):
            parts.append(_ramp(system, direction, length))
            parts.append(_rest(system, length))
        for share in SPEEDS:
            for direction in (1.0, -1.0):
                parts.append(_dwell(system, direction, share, length))
                parts.append(_rest(system, length))
    controls = np.concatenate(parts)
    plant = system.plant
    return np.clip(controls, plant.lowest_control, plant.highest_control)


def _steps(system: System, seconds: float) -> int:
    return max(LEAST_STEPS, round(seconds / system.time_step))


def _rest(system: System, length: float) -> FloatArray:
    """Leave the machine to its friction until it has come to rest."""
    plant = system.plant
    neutral = float(
        np.clip(-plant.bias / plant.control_gain, plant.lowest_control, plant.highest_control)
    )
    least = min(friction_of(way, plant).coulomb for way in (1.0, -1.0))
    damping = min(friction_of(way, plant).damping for way in (1.0, -1.0))
    # Friction alone, or damping where that is stronger.
    fastest = _fastest(system, length)
    seconds = min(fastest / max(least, 1e-9), 3.0 / max(damping, 1e-9), 5.0 * PUSH_SECONDS)
    return np.full(_steps(system, seconds + REST_SECONDS), neutral)


def _ramp(system: System, direction: float, length: float) -> FloatArray:
    plant = system.plant
    least = breakaway_controls(plant)
    neutral = -plant.bias / plant.control_gain
    threshold = (least.high if direction > 0.0 else least.low) - neutral
    # As steep as the whole one, and so as near to break-away when it comes: it ends earlier.
    highest = 1.0 + length * (RAMP_TO - 1.0)
    steps = _steps(system, RAMP_SECONDS * (highest - RAMP_FROM) / (RAMP_TO - RAMP_FROM))
    return neutral + threshold * np.linspace(RAMP_FROM, highest, steps)


def _dwell(system: System, direction: float, share: float, length: float) -> FloatArray:
    """Push to a share of the fastest speed, then with what friction takes there."""
    plant = system.plant
    friction = friction_of(direction, plant)
    speed = share * _fastest(system, length)
    drag = friction.coulomb + weakening(speed, friction, plant) + friction.damping * speed
    holding = (direction * drag - plant.bias) / plant.control_gain
    push = plant.highest_control if direction > 0.0 else plant.lowest_control
    pushing = np.full(_steps(system, share * length * PUSH_SECONDS), push)
    return np.concatenate([pushing, np.full(_steps(system, length * DWELL_SECONDS), holding)])


def _fastest(system: System, length: float) -> float:
    """Return the speed that full control reaches in a push, whichever way that is lower, m/s."""
    plant, seconds = system.plant, length * PUSH_SECONDS
    speeds = []
    for direction, control in ((1.0, plant.highest_control), (-1.0, plant.lowest_control)):
        friction = friction_of(direction, plant)
        net = max(direction * acceleration(control, plant) - friction.coulomb, 0.0)
        if friction.damping > 0.0:
            net *= -np.expm1(-friction.damping * seconds) / friction.damping
        else:
            net *= seconds
        speeds.append(net)
    return float(min(speeds))
