import numpy as np
import pytest

from app.planning.metrics import (
    control_energy,
    control_smoothness,
    diversity,
    stuck_steps,
    terminal_error,
)
from app.planning.plant.system import System

SYSTEM = System()


def test_terminal_error_is_the_distance_in_position_and_velocity() -> None:
    states = np.array([[0.3, 0.4], [1.0, 0.0], [-2.0, 1.0]])

    np.testing.assert_allclose(terminal_error(states, np.zeros(2)), [0.5, 1.0, np.sqrt(5)])
    np.testing.assert_allclose(
        terminal_error(states, np.array([1.0, 1.0])), [np.sqrt(0.85), 1.0, 3.0]
    )
    assert terminal_error(states[0], np.array([0.3, 0.0])) == pytest.approx(0.4)


def test_energy_is_the_sum_of_squares() -> None:
    assert control_energy(np.array([1.0, -2.0, 0.5])) == pytest.approx(5.25)
    np.testing.assert_allclose(control_energy(np.array([[1.0, 1.0], [0.0, -3.0]])), [2.0, 9.0])


def test_smoothness_is_the_sum_of_squared_differences() -> None:
    assert control_smoothness(np.array([1.0, -2.0, 0.5])) == pytest.approx(9.0 + 6.25)
    np.testing.assert_allclose(
        control_smoothness(np.array([[1.0, 1.0, 1.0], [0.0, -3.0, 0.0]])), [0.0, 18.0]
    )
    assert control_smoothness(np.array([0.7])) == 0.0


def test_diversity_is_the_spread_of_the_candidates() -> None:
    assert diversity(np.array([[1.0, -2.0, 0.5]])) == 0.0
    assert diversity(np.array([[1.0, 0.0], [3.0, 0.0]])) == pytest.approx(np.sqrt(0.5))
    rng = np.random.default_rng(0)
    assert diversity(0.3 * rng.standard_normal((4000, 64))) == pytest.approx(0.3, rel=0.01)


def stuck(position: float, velocity: float, control: float, target: float = 0.0) -> int:
    states = np.array([[position, velocity], [position, velocity]])
    return int(stuck_steps(states, np.array([control]), target, SYSTEM))


def test_a_mass_at_rest_below_the_threshold_and_off_the_target_is_stuck() -> None:
    assert stuck(0.5, 0.0, 0.3) == 1
    assert stuck(-0.5, -0.0009, -0.69) == 1


def test_a_mass_that_moves_is_not_stuck() -> None:
    assert stuck(0.5, 0.2, 0.0) == 0
    assert stuck(0.5, -0.2, 0.0) == 0


def test_a_mass_that_is_pushed_hard_enough_is_not_stuck() -> None:
    assert stuck(0.5, 0.0, 0.9) == 0
    assert stuck(0.5, 0.0, -0.9) == 0


def test_a_mass_that_has_arrived_is_not_stuck() -> None:
    assert stuck(0.405, 0.0, 0.0, target=0.4) == 0
    assert stuck(0.395, 0.0, 0.0, target=0.4) == 0


def test_each_inequality_of_stuck_is_strict() -> None:
    assert stuck(0.5, 1e-3, 0.0) == 0
    assert stuck(0.5, 0.0, 0.7) == 0
    assert stuck(0.01, 0.0, 0.0) == 0
    assert stuck(np.nextafter(0.01, 1), np.nextafter(1e-3, 0), np.nextafter(0.7, 0)) == 1


def test_stuck_uses_the_thresholds_of_the_plant() -> None:
    states, controls = np.array([[0.5, 0.002], [0.5, 0.002]]), np.array([0.5])

    assert stuck_steps(states, controls, 0.0, System(velocity_threshold=0.01)) == 1
    weaker = System(velocity_threshold=0.01, static_friction=0.4, coulomb_friction=0.3)
    assert stuck_steps(states, controls, 0.0, weaker) == 0


def test_stuck_counts_every_state_that_a_control_follows() -> None:
    rest = np.zeros((4, 2))

    # The fourth state has no control of its own.
    assert stuck_steps(rest, np.array([0.0, 0.9, 0.1]), 0.5, SYSTEM) == 2


def test_a_stack_of_plans_is_measured_plan_by_plan() -> None:
    states = np.zeros((2, 4, 2))
    states[1, 1] = [0.1, 0.5]

    counts = stuck_steps(states, np.zeros((2, 3)), 0.5, SYSTEM)

    assert counts.tolist() == [3, 2]
