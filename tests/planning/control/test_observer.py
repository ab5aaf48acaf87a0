"""What a controller is told of its sensor and its model."""

import pytest

from app.planning.control import RecedingHorizon
from app.planning.control.memory import POSITION, VELOCITY
from app.planning.control.observer import Identification, Observer
from app.planning.control.simulation import Sensor
from app.planning.control.step import Goal, Measurement, control_step
from app.planning.plant.system import System
from tests.planning.control.controllers import EXACT, run

LEARNS = RecedingHorizon(observer=EXACT)


def test_an_encoder_of_coarse_steps_is_a_noise_of_its_own() -> None:
    assert Observer(0.0, position_step=1.2e-3).position_std == pytest.approx(1.2e-3 / 12**0.5)
    looking = Observer(0.0, position_step=2e-3)
    runs = run(
        RecedingHorizon(observer=looking),
        sensor=Sensor(position_step=2e-3, measures_velocity=False),
    )

    assert runs.final_errors[0] < 4e-3
    assert not runs.hunting[0]


def test_shares_are_what_is_believed_at_first() -> None:
    known = Observer(identification=Identification(0.0, 0.0, 0.0, 0.0, 0.0))
    estimate = control_step(
        RecedingHorizon(observer=known), System(), Measurement(0.0, 0.0), Goal(0.3)
    ).estimate

    assert estimate.system == System()
    assert (estimate.gain_std, estimate.coulomb_std, estimate.bias_std) == (0.0, 0.0, 0.0)
    assert estimate.static_forward == (0.7, 0.7)
    unsure = control_step(LEARNS, System(), Measurement(0.0, 0.0), Goal(0.3)).estimate
    assert unsure.static_backward == pytest.approx((0.56, 0.84))
    assert unsure.coulomb_std == pytest.approx(0.2 / 3**0.5)
    assert (unsure.position, unsure.velocity) == (0.0, 0.0)
    assert POSITION == 0
    assert VELOCITY == 1
