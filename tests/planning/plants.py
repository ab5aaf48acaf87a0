"""Random plants, for tests that hold for all of them."""

import numpy as np
from hypothesis import strategies as st

from app.planning.plant.system import Plant, System


@st.composite
def systems(draw: st.DrawFn) -> System:
    """Draw a system."""
    static_friction = draw(st.floats(0, 2))
    return System(
        static_friction=static_friction,
        coulomb_friction=static_friction * draw(st.floats(0, 1)),
        viscous_damping=draw(st.floats(0, 5)),
        time_step=draw(st.floats(1e-3, 0.15)),
        velocity_threshold=draw(st.floats(1e-6, 0.05)),
    )


@st.composite
def plants(draw: st.DrawFn) -> Plant:
    """Draw a plant whose control limits differ by direction; no control is always admissible."""
    return draw(systems()).plant._replace(
        lowest_control=-draw(st.floats(0, 4)), highest_control=draw(st.floats(0, 4))
    )


def mirrored(plant: Plant) -> Plant:
    """Return the plant whose motions are the mirror images of those of `plant`."""
    return plant._replace(
        lowest_control=-plant.highest_control, highest_control=-plant.lowest_control
    )


def random_system(rng: np.random.Generator) -> System:
    """Draw a system whose controls need not suffice to break away."""
    coulomb = rng.uniform(0, 1)
    return System(
        static_friction=coulomb + rng.uniform(0, 0.3),
        coulomb_friction=coulomb,
        viscous_damping=rng.uniform(0, 0.5),
        control_limit=rng.uniform(0.2, 3),
        time_step=rng.uniform(0.01, 0.1),
        velocity_threshold=10 ** rng.uniform(-5, -2),
    )
