"""Random plants, for tests that hold for all of them."""

from dataclasses import replace

import numpy as np
from hypothesis import strategies as st

from app.planning.plant.system import ByDirection, ControlLimits, Plant, System


@st.composite
def by_direction(draw: st.DrawFn, low: float, high: float) -> ByDirection:
    """Draw a friction, mostly another one backward."""
    frictions = st.floats(low, high)
    return ByDirection(draw(frictions), draw(frictions))


@st.composite
def systems(draw: st.DrawFn) -> System:
    """Draw a system whose friction is the same both ways, as the paper's."""
    static_friction = draw(st.floats(0, 2))
    return System(
        static_friction=static_friction,
        coulomb_friction=static_friction * draw(st.floats(0, 1)),
        viscous_damping=draw(st.floats(0, 5)),
        time_step=draw(st.floats(1e-3, 0.15)),
        velocity_threshold=draw(st.floats(1e-6, 0.05)),
    )


@st.composite
def machines(draw: st.DrawFn, may_weaken: bool = True) -> System:
    """Draw a system with all that a real machine has; it need neither rest nor move.

    `may_weaken` says whether some have Stribeck's effect.
    """
    static = draw(by_direction(0, 2))
    shares = draw(by_direction(0, 1))
    lower = draw(st.floats(-4, 3))
    stribeck = st.none() | st.floats(1e-3, 1) if may_weaken else st.none()
    return System(
        static_friction=static,
        coulomb_friction=ByDirection(
            static.forward * shares.forward, static.backward * shares.backward
        ),
        viscous_damping=draw(by_direction(0, 5)),
        stribeck_velocity=draw(stribeck),
        bias=draw(st.just(0.0) | st.floats(-2, 2)),
        control_gain=draw(st.just(1.0) | st.floats(0.1, 10)),
        control_limit=ControlLimits(lower, lower + draw(st.floats(1e-3, 6))),
        time_step=draw(st.floats(1e-3, 0.15)),
        velocity_threshold=draw(st.floats(1e-6, 0.05)),
    )


@st.composite
def plants(draw: st.DrawFn) -> Plant:
    """Draw a plant as the kernels take it."""
    return draw(systems() | machines()).plant


def mirrored(system: System) -> System:
    """Return the system whose motions are the mirror images of those of `system`."""
    return replace(
        system,
        static_friction=_swapped(system.static_friction),
        coulomb_friction=_swapped(system.coulomb_friction),
        viscous_damping=_swapped(system.viscous_damping),
        bias=-system.bias,
        control_limit=(
            ControlLimits(-system.control_limit.upper, -system.control_limit.lower)
            if isinstance(system.control_limit, ControlLimits)
            else system.control_limit
        ),
    )


def _swapped(friction: float | ByDirection) -> float | ByDirection:
    if isinstance(friction, ByDirection):
        return ByDirection(friction.backward, friction.forward)
    return friction


def random_system(rng: np.random.Generator) -> System:
    """Draw a system whose controls need not suffice to break away; every other one is lopsided."""
    coulomb = rng.uniform(0, 1)
    system = System(
        static_friction=coulomb + rng.uniform(0, 0.3),
        coulomb_friction=coulomb,
        viscous_damping=rng.uniform(0, 0.5),
        control_limit=rng.uniform(0.2, 3),
        time_step=rng.uniform(0.01, 0.1),
        velocity_threshold=10 ** rng.uniform(-5, -2),
    )
    return lopsided(system, rng) if rng.random() < 0.5 else system


def lopsided(system: System, rng: np.random.Generator) -> System:
    """Return a system with other friction backward, a bias, a gain and another lower limit."""
    plant = system.plant
    back = rng.uniform(0.3, 1.0, 3)
    gain = rng.choice([1.0, rng.uniform(0.2, 5)])
    return replace(
        system,
        static_friction=ByDirection(plant.static_forward, max(back[:2]) * plant.static_forward),
        coulomb_friction=ByDirection(plant.coulomb_forward, back[0] * plant.coulomb_forward),
        viscous_damping=ByDirection(plant.damping_forward, back[2] * plant.damping_forward),
        bias=rng.choice([0.0, rng.uniform(-0.5, 0.5)]),
        control_gain=gain,
        control_limit=ControlLimits(
            -rng.uniform(0.7, 1.0) * plant.highest_control / gain, plant.highest_control / gain
        ),
    )
