"""A mass that does not move is not pushed, and what moves moves as before."""

import numpy as np

from app.planning.plant.system import System
from app.planning.uncertainty.ensemble import Ensemble
from app.planning.uncertainty.rests import without_idle_pushes

PLANT = System().plant
"""Static friction 0.7 m/s^2, Coulomb friction 0.6, at most 0.9."""


def ensemble(*static_frictions: float) -> Ensemble:
    return Ensemble.of([System(static) for static in static_frictions], np.zeros(2))


def test_what_moves_no_plant_is_taken_out() -> None:
    controls = np.array([0.5, 0.9, -0.9, 0.3, 0.65, 0.65])

    eased = without_idle_pushes(controls, ensemble(0.7, 0.75), PLANT)

    np.testing.assert_array_equal(eased, [0.0, 0.9, -0.9, 0.0, 0.0, 0.0])
    # Another plant, with less static friction than any that was thought of, stays where it was.
    (path,) = ensemble(0.62).trajectories(eased)
    assert path[-1, 1] == 0.0
    assert ensemble(0.62).trajectories(controls)[0, -1, 1] > 0.0


def test_a_push_that_moves_one_of_them_stays() -> None:
    controls = np.array([0.72, 0.72, -0.9])

    np.testing.assert_array_equal(
        without_idle_pushes(controls, ensemble(0.7, 0.75), PLANT), controls
    )


def test_on_a_slope_what_holds_the_mass_stays() -> None:
    pulled = System(0.7, 0.6, bias=-0.8)
    controls = np.full(4, 0.5)
    on_slope = Ensemble.of([pulled], np.zeros(2))

    eased = without_idle_pushes(controls, on_slope, pulled.plant)

    assert (eased < 0.5).all()
    np.testing.assert_array_equal(on_slope.trajectories(eased)[0, :, 0], np.zeros(5))
