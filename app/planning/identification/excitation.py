"""Controls that a machine is identified well from: ramps from rest, and dwells at three speeds."""

import numpy as np

from app.planning.arrays import FloatArray
from app.planning.plant.friction import acceleration, breakaway_controls, friction_of, weakening
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


def excitation(system: System) -> FloatArray:
    """Return controls (N,) within the limits of a machine that is known roughly.

    In each direction a slow ramp from rest until it surely moves, and dwells at three speeds, each
    from rest and back to it; twice. Forward and backward take it about as far.
    """
    parts = []
    for _ in range(REPETITIONS):
        for direction in (1.0, -1.0):
            parts.append(_ramp(system, direction))
            parts.append(_rest(system))
        for share in SPEEDS:
            for direction in (1.0, -1.0):
                parts.append(_dwell(system, direction, share))
                parts.append(_rest(system))
    controls = np.concatenate(parts)
    plant = system.plant
    return np.clip(controls, plant.lowest_control, plant.highest_control)


def _steps(system: System, seconds: float) -> int:
    return max(LEAST_STEPS, round(seconds / system.time_step))


def _rest(system: System) -> FloatArray:
    """Leave the machine to its friction until it has come to rest."""
    plant = system.plant
    neutral = float(
        np.clip(-plant.bias / plant.control_gain, plant.lowest_control, plant.highest_control)
    )
    least = min(friction_of(way, plant).coulomb for way in (1.0, -1.0))
    damping = min(friction_of(way, plant).damping for way in (1.0, -1.0))
    # Friction alone, or damping where that is stronger.
    fastest = _fastest(system)
    seconds = min(fastest / max(least, 1e-9), 3.0 / max(damping, 1e-9), 5.0 * PUSH_SECONDS)
    return np.full(_steps(system, seconds + REST_SECONDS), neutral)


def _ramp(system: System, direction: float) -> FloatArray:
    plant = system.plant
    least = breakaway_controls(plant)
    neutral = -plant.bias / plant.control_gain
    threshold = (least.high if direction > 0.0 else least.low) - neutral
    steps = _steps(system, RAMP_SECONDS)
    return neutral + threshold * np.linspace(RAMP_FROM, RAMP_TO, steps)


def _dwell(system: System, direction: float, share: float) -> FloatArray:
    """Push to a share of the fastest speed, then with what friction takes there."""
    plant = system.plant
    friction = friction_of(direction, plant)
    speed = share * _fastest(system)
    drag = friction.coulomb + weakening(speed, friction, plant) + friction.damping * speed
    holding = (direction * drag - plant.bias) / plant.control_gain
    push = plant.highest_control if direction > 0.0 else plant.lowest_control
    pushing = np.full(_steps(system, share * PUSH_SECONDS), push)
    return np.concatenate([pushing, np.full(_steps(system, DWELL_SECONDS), holding)])


def _fastest(system: System) -> float:
    """Return the speed that full control reaches in a push, whichever way that is lower, m/s."""
    plant = system.plant
    speeds = []
    for direction, control in ((1.0, plant.highest_control), (-1.0, plant.lowest_control)):
        friction = friction_of(direction, plant)
        net = max(direction * acceleration(control, plant) - friction.coulomb, 0.0)
        if friction.damping > 0.0:
            net *= -np.expm1(-friction.damping * PUSH_SECONDS) / friction.damping
        else:
            net *= PUSH_SECONDS
        speeds.append(net)
    return float(min(speeds))
