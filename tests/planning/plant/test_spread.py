import numpy as np
import pytest

from app.planning.plant.spread import CERTAIN, FAR, Spread, spread_of
from app.planning.plant.system import ByDirection, System
from app.planning.uncertainty.relative import Relative

SYSTEM = System(coulomb_friction=ByDirection(0.6, 0.5))


def test_plants_that_are_drawn_within_shares_have_these_for_their_spread() -> None:
    relative = Relative(0.1, 0.2, 0.3, control_gain=0.05)
    # Static friction is raised to Coulomb friction where it would fall below it.
    system = System(static_friction=2.0)

    plants = relative.draw(system, 4000, np.random.default_rng(0))

    np.testing.assert_allclose(spread_of(plants, system.plant), (0.1, 0.2, 0.3, 0.05), rtol=0.01)


def test_the_plant_itself_is_certain() -> None:
    assert spread_of(np.array([SYSTEM.plant] * 3), SYSTEM.plant) == CERTAIN


def test_both_directions_count() -> None:
    plant = SYSTEM.plant._replace(coulomb_backward=0.55)

    found = spread_of(np.array([plant]), SYSTEM.plant)

    assert found == pytest.approx(Spread(coulomb_friction=0.1 * np.sqrt(3 / 2)))


def test_something_in_place_of_nothing_is_far_off() -> None:
    found = spread_of(np.array([SYSTEM.plant]), System(viscous_damping=0.0).plant)

    assert found.viscous_damping == FAR
    most = Spread(0.2, 0.2, 0.2, 0.1)
    assert found.within(most).viscous_damping == 0.2
    assert CERTAIN.within(most) == CERTAIN
