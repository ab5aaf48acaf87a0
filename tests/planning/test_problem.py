"""States and problems: what is none is refused."""

import math

import numpy as np
import pytest

from app.planning.plant.rollout import rollout
from app.planning.plant.system import ByDirection, System
from app.planning.problem import Problem, as_state, state_after


@pytest.mark.parametrize(
    "state", [[0.0], [0.0, 0.0, 0.0], [[0.0, 0.0]], [math.nan, 0.0], [0.0, math.inf]]
)
def test_what_is_not_two_finite_numbers_is_no_state(state: list[float]) -> None:
    with pytest.raises(ValueError, match="two finite numbers"):
        as_state(state)
    with pytest.raises(ValueError, match="two finite numbers"):
        Problem(np.zeros(2), np.array(state))


def test_a_horizon_of_no_steps_is_refused() -> None:
    with pytest.raises(ValueError, match="horizon"):
        Problem(np.zeros(2), np.zeros(2), horizon=0)


def test_controls_lead_to_the_state_that_their_rollout_ends_in() -> None:
    system = System(
        coulomb_friction=ByDirection(0.2, 0.6), bias=0.1, control_gain=2.0, control_limit=5.0
    )
    start, controls = np.array([0.1, -0.2]), [5.0, -3.0, 0.0, 2.5]
    states = rollout(system, start, np.array([controls]))
    np.testing.assert_array_equal(state_after(controls, start, system), states[0, -1])


def test_no_controls_lead_nowhere() -> None:
    np.testing.assert_array_equal(state_after([], np.array([0.1, -0.2]), System()), [0.1, -0.2])
