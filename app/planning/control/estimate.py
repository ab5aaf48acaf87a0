"""What a controller believes after a step: where the mass is, and which plant it moves."""

import math
from dataclasses import dataclass

from app.planning.control.belief import believed
from app.planning.control.memory import (
    BACKWARD,
    BIAS,
    COULOMB,
    DAMPING,
    FORWARD,
    GAIN,
    LEAST,
    MOST,
    POSITION,
    VELOCITY,
    Memory,
)
from app.planning.plant.system import ByDirection, ControlLimits, Plant, System


@dataclass(frozen=True, slots=True)
class Estimate:
    """State and plant as an observer has them, with standard deviations by the filter itself."""

    position: float
    """m."""
    velocity: float
    """m/s."""
    position_std: float
    """m; 0 without an observer."""
    velocity_std: float
    """m/s; 0 without an observer."""
    system: System
    """The model with what was learned: static friction in the middle of what it can be."""
    gain_std: float
    """Relative."""
    coulomb_std: float
    """Relative."""
    damping_std: float
    """Relative."""
    bias_std: float
    """m/s^2."""
    static_forward: tuple[float, float]
    """At least and at most, m/s^2."""
    static_backward: tuple[float, float]


def estimate_of(memory: Memory, model: System) -> Estimate:
    """Return what is believed by a controller with that memory, of a machine with that model."""
    stds = [math.sqrt(max(0.0, variance)) for variance in memory.covariance.diagonal()]
    plant = believed(model.plant, memory, 0.5, model.plant.velocity_threshold)
    forward, backward = memory.statics[FORWARD], memory.statics[BACKWARD]
    return Estimate(
        position=float(memory.mean[POSITION]),
        velocity=float(memory.mean[VELOCITY]),
        position_std=stds[POSITION],
        velocity_std=stds[VELOCITY],
        system=system_of(plant),
        gain_std=stds[GAIN],
        coulomb_std=stds[COULOMB],
        damping_std=stds[DAMPING],
        bias_std=stds[BIAS],
        static_forward=(float(forward[LEAST]), float(forward[MOST])),
        static_backward=(float(backward[LEAST]), float(backward[MOST])),
    )


def system_of(plant: Plant) -> System:
    """Return the system with that plant."""
    return System(
        static_friction=_friction(plant.static_forward, plant.static_backward),
        coulomb_friction=_friction(plant.coulomb_forward, plant.coulomb_backward),
        viscous_damping=_friction(plant.damping_forward, plant.damping_backward),
        stribeck_velocity=plant.stribeck_velocity or None,
        bias=plant.bias,
        control_gain=plant.control_gain,
        control_limit=(
            plant.highest_control
            if plant.lowest_control == -plant.highest_control
            else ControlLimits(plant.lowest_control, plant.highest_control)
        ),
        time_step=plant.time_step,
        velocity_threshold=plant.velocity_threshold,
    )


def _friction(forward: float, backward: float) -> float | ByDirection:
    return forward if forward == backward else ByDirection(forward, backward)
