import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.planning.control.switching import (
    braking_distance,
    fill_with_switching,
    least_hop,
    steady_control,
)
from app.planning.plant.friction import STUCK, take_step
from app.planning.plant.rollout import rollout
from app.planning.plant.system import ControlLimits, Plant, System
from app.planning.plant.task import Task
from tests.planning.plants import plants


@pytest.mark.parametrize("velocity", [0.3, -0.3])
def test_without_damping_full_control_brakes_uniformly(velocity: float) -> None:
    plant = System(viscous_damping=0.0, bias=0.1).plant
    braking = 0.9 + 0.6 - 0.1 if velocity > 0 else 0.9 + 0.6 + 0.1

    expected = math.copysign(velocity**2 / (2 * braking), velocity)
    assert braking_distance(velocity, plant) == pytest.approx(expected)


@given(damping=st.floats(1e-6, 15), speed=st.floats(1e-3, 2))
def test_the_braking_distance_is_where_a_fine_rollout_stops(damping: float, speed: float) -> None:
    fine = System(0.7, 0.6, damping, time_step=1e-4, velocity_threshold=1e-6)
    controls = np.full((1, 20_000), -0.9)
    # Once at rest, full control would set off again: the mass is farthest where it stopped.
    farthest = rollout(fine, np.array([0.0, speed]), controls)[0, :, 0].max()

    assert braking_distance(speed, fine.plant) == pytest.approx(farthest, abs=2e-4 * speed)


def test_what_full_control_does_not_stop_has_no_braking_distance() -> None:
    downhill = System(bias=2.0).plant

    assert braking_distance(0.1, downhill) == math.inf
    assert braking_distance(0.0, downhill) == 0.0
    assert braking_distance(-0.1, downhill) < 0.0


def test_the_least_hop_is_a_step_of_full_control_from_rest() -> None:
    plant = System(bias=-0.05).plant
    steps = [take_step(0.0, control, plant).next_velocity for control in (0.9, -0.9)]

    assert least_hop(plant) == pytest.approx(0.05 * min(abs(velocity) for velocity in steps))


@given(plant=plants())
def test_the_steady_control_keeps_a_resting_mass_where_one_does(plant: Plant) -> None:
    control = steady_control(plant)

    assert plant.lowest_control <= control <= plant.highest_control
    holds = [
        take_step(0.0, tried, plant).kind == STUCK
        for tried in np.linspace(plant.lowest_control, plant.highest_control, 2001)
    ]
    if sum(holds) > 2:  # not by a hair, which rounding may cut
        assert take_step(0.0, control, plant).kind == STUCK


def test_the_steady_control_is_none_where_that_surely_holds_and_balances_a_weight() -> None:
    assert steady_control(System(bias=0.5).plant) == 0.0
    assert steady_control(System(bias=0.6, control_gain=2.0).plant) == -0.3
    assert steady_control(System(bias=1.5).plant) == -0.9


@pytest.mark.parametrize(
    "system",
    [
        System(),
        System(0.2, 0.2, 13.0, control_limit=7.0, time_step=0.02),
        System(0.1, 0.05, bias=0.3, control_limit=ControlLimits(-2.0, 1.0)),
        System(stribeck_velocity=0.02),
    ],
)
@pytest.mark.parametrize("start", [(0.0, 0.0), (0.5, 0.3), (-0.1, -0.4)])
def test_switched_controls_rest_near_the_target_in_about_the_least_time(
    system: System, start: tuple[float, float]
) -> None:
    plant = system.plant
    controls = np.empty(1024)
    steps = fill_with_switching(controls, Task(*start, 0.2, 0.0, plant))
    states = rollout(system, np.array(start), controls[np.newaxis])[0]

    assert steps < 200
    assert states[-1, 1] == 0.0
    assert states[-1, 0] == pytest.approx(0.2, abs=8 * least_hop(plant))
    np.testing.assert_array_equal(states[steps:], np.tile(states[-1], (len(states) - steps, 1)))
