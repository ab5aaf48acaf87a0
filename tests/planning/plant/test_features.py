"""Features: by name, for one or for many, and the same for plants that move alike."""

from typing import Any

import numpy as np
import pytest

from app.planning.plant.features import PLANT_FEATURES, TASK_FEATURES, feature_values
from app.planning.plant.machines import MACHINES
from app.planning.plant.system import Plant, System
from app.planning.plant.task import Task

PAPER = System().plant
OWN_UNITS = ("initial_position", "initial_velocity", "target_position", "target_velocity")
WITHOUT_UNIT = [
    name for name in (*TASK_FEATURES, *PLANT_FEATURES) if name not in (*OWN_UNITS, *Plant._fields)
]


def values(task: Task, *names: str, horizon: int = 64) -> list[float]:
    (row,) = feature_values(names, task, horizon).tolist()
    found: list[float] = row
    return found


def task(plant: Plant = PAPER) -> Task:
    return Task(0.1, 0.2, 0.4, -0.1, plant)


def test_states_and_parameters_are_features_in_their_own_units() -> None:
    assert values(task(), *OWN_UNITS) == [0.1, 0.2, 0.4, -0.1]
    assert values(task(), *Plant._fields) == list(PAPER)


def test_shares_of_what_full_control_makes_of_the_mass() -> None:
    plant = MACHINES["servo"].system.plant
    full = 24.65 * 14.4
    shares = {
        "static_forward_over_limit": 8.15 / full,
        "coulomb_backward_over_limit": 3.32 / full,
        "bias_over_limit": -29.0 / full,
        "velocity_threshold_over_step": 0.01 / (full * 0.005),
        "log_velocity_threshold": np.log(0.01 / (full * 0.005)),
        "damping_forward_times_horizon": 41.0 * 0.005 * 64,
        "root_damping_backward": np.sqrt(41.0 * 0.005 * 64),
        "coulomb_over_static_forward": 3.32 / 8.15,
        "static_backward_over_forward": 1.0,
        "stribeck_over_step": 0.0,
        "stribeck_share": 0.0,
    }
    assert values(task(plant), *shares) == pytest.approx(list(shares.values()))


@pytest.mark.parametrize("name", WITHOUT_UNIT)
def test_what_has_no_unit_is_the_same_in_any(name: str) -> None:
    """Metres are counted in thirds, seconds in halves and controls in fifths."""
    position, time, control = 3.0, 2.0, 5.0
    velocity, acceleration = position / time, position / time**2
    plant = MACHINES["rack_and_pinion"].system.plant._replace(bias=0.3, lowest_control=-4.0)
    converted = plant._replace(
        **{
            field: value * acceleration
            for field, value in plant._asdict().items()
            if field.startswith(("static", "coulomb", "breakaway", "bias"))
        },
        damping_forward=plant.damping_forward / time,
        damping_backward=plant.damping_backward / time,
        stribeck_velocity=plant.stribeck_velocity * velocity,
        velocity_threshold=plant.velocity_threshold * velocity,
        control_gain=plant.control_gain * acceleration / control,
        lowest_control=plant.lowest_control * control,
        highest_control=plant.highest_control * control,
        time_step=plant.time_step * time,
    )
    own = Task(0.02, 0.1, 0.1, 0.05, plant)
    other = Task(0.02 * position, 0.1 * velocity, 0.1 * position, 0.05 * velocity, converted)

    assert values(other, name) == pytest.approx(values(own, name), rel=1e-9)
    assert values(own, name) != [0.0]


def test_many_are_worked_out_at_once_and_each_as_it_is_alone() -> None:
    names = (*PLANT_FEATURES, *TASK_FEATURES)
    plants = [machine.system.plant for machine in MACHINES.values()]
    positions: Any = np.linspace(0, 1, len(plants))
    many = Task(positions, 0.2, 0.4, -0.1, Plant(*np.array(plants).T))

    found = feature_values(names, many, 32)

    assert found.shape == (len(plants), len(names))
    assert found.dtype == np.float64
    for row, position, plant in zip(found, positions, plants, strict=True):
        alone = Task(float(position), 0.2, 0.4, -0.1, plant)
        np.testing.assert_allclose(row, values(alone, *names, horizon=32), rtol=1e-12)


def test_there_are_as_many_rows_as_tasks_even_if_no_feature_differs() -> None:
    positions: Any = np.zeros(5)
    many = Task(positions, 0.0, 1.0, 0.0, PAPER)

    np.testing.assert_array_equal(
        feature_values(("target_position", "bias"), many, 64), [[1.0, 0.0]] * 5
    )


@pytest.mark.parametrize("name", [*PLANT_FEATURES, *TASK_FEATURES])
def test_every_feature_is_finite_without_friction_and_with_too_much(name: str) -> None:
    for friction in (0.0, 1e6):
        plant = System(friction, friction, 0.0).plant
        assert np.isfinite(values(Task(0.0, 0.0, 1.0, 1.0, plant), name)).all()
