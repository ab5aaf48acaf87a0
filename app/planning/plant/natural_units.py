"""A plant in its own units: time in steps, controls and accelerations by what full control makes.

The dynamics know no metres, seconds or volts: two plants that are the same in these units move
alike, and what is known of one is known of the other.
"""

from typing import NamedTuple

import numpy as np

from app.planning.plant.system import Plant


class NaturalUnits(NamedTuple):
    """What one natural unit is in the plant's own, of a float plant or of one of (N,) arrays."""

    middle: float
    """Units of control: halfway between the limits, where natural control is 0."""
    control: float
    """Units of control: half of the way from limit to limit, so that the limits are -1 and 1."""
    velocity: float
    """m/s: what full control adds in a step, friction and bias apart."""
    position: float
    """m."""


def natural_units(plant: Plant) -> NaturalUnits:
    """Return a plant's natural units."""
    middle = 0.5 * (plant.highest_control + plant.lowest_control)
    half = 0.5 * (plant.highest_control - plant.lowest_control)
    velocity = plant.control_gain * half * plant.time_step
    return NaturalUnits(middle, half, velocity, velocity * plant.time_step)


def in_natural_units(plant: Plant) -> Plant:
    """Return the plant with gain 1, limits -1 and 1, and a time step of 1.

    What the middle of the control range makes of the mass becomes a part of the bias. A control
    `w` of the result is `middle + control * w` of `plant`, w in [-1, 1].
    """
    units = natural_units(plant)
    step = plant.time_step
    acceleration = units.velocity / step
    return Plant(
        static_forward=plant.static_forward / acceleration,
        static_backward=plant.static_backward / acceleration,
        coulomb_forward=plant.coulomb_forward / acceleration,
        coulomb_backward=plant.coulomb_backward / acceleration,
        damping_forward=plant.damping_forward * step,
        damping_backward=plant.damping_backward * step,
        breakaway_forward=plant.breakaway_forward / acceleration,
        breakaway_backward=plant.breakaway_backward / acceleration,
        stribeck_velocity=plant.stribeck_velocity / units.velocity,
        bias=(plant.bias + plant.control_gain * units.middle) / acceleration,
        control_gain=1.0,
        lowest_control=-1.0,
        highest_control=1.0,
        time_step=1.0,
        velocity_threshold=plant.velocity_threshold / units.velocity,
    )


SLOWEST = 1e-3
"""Full control accelerates a mass that it hardly moves as if by so much, in natural units."""
LEAST_DAMPING = 1e-9
"""In natural units."""


class Scales(NamedTuple):
    """How far and how fast full control takes a mass, about; in the plant's own units."""

    reach: float
    """m: from rest to rest within the horizon, whichever way it is farther."""
    speed: float
    """m/s: the highest on that way."""


def scales(plant: Plant, horizon: int) -> Scales:
    """Return the scales of a plant and horizon H; of arrays (N,) where the plant's fields are."""
    return scales_of_natural(in_natural_units(plant), natural_units(plant), horizon)


def scales_of_natural(natural: Plant, units: NaturalUnits, horizon: int) -> Scales:
    """Return the same of a plant in natural units, and those units.

    In natural units full control accelerates the mass by a = 1 + bias - f_c, forward, and brakes it
    by 2 - a: without damping it accelerates for the share (2 - a)/2 of the horizon, to the speed
    a H (2 - a)/2, and comes to half of that times H. With damping b the speed nears a/b as
    exp(-b t), and the reach nears all of it times H as the times to get there and to stop fall.
    """
    forward, backward = (
        (push / rate * -np.expm1(-rate * 0.5 * (2.0 - push) * horizon), rate)
        for push, rate in (
            (_full_push(natural.bias - natural.coulomb_forward), _rate(natural.damping_forward)),
            (_full_push(-natural.bias - natural.coulomb_backward), _rate(natural.damping_backward)),
        )
    )
    speed, reach = 0.0, 0.0
    for fastest, rate in (forward, backward):
        speed = np.maximum(speed, fastest)
        reach = np.maximum(reach, fastest * horizon * (1.0 - 0.5 / (1.0 + 0.25 * rate * horizon)))
    return Scales(units.position * reach, units.velocity * speed)


def _full_push(helping: float) -> float:
    """Return what full control makes of the mass beside what helps it."""
    push: float = np.minimum(np.maximum(1.0 + helping, SLOWEST), 2.0 - SLOWEST)
    return push


def _rate(damping: float) -> float:
    """Return a damping of which nothing as good as none is lost, to be divided by."""
    rate: float = np.maximum(damping, LEAST_DAMPING)
    return rate
