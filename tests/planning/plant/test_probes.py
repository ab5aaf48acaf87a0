from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings

from app.planning.plant.features import feature_values
from app.planning.plant.natural_units import scales
from app.planning.plant.probes import PROBES, probe_controls, probe_misses
from app.planning.plant.rollout import rollout
from app.planning.plant.system import ControlLimits, Plant, System
from app.planning.plant.task import Task
from tests.planning.plants import machines

HORIZON = 64


def test_a_probe_pushes_as_hard_as_the_machine_can() -> None:
    for probe in PROBES:
        controls = probe_controls(probe, HORIZON)
        assert controls.shape == (HORIZON,)
        assert set(np.abs(controls)) <= {0.0, 1.0}
    assert probe_controls("forth_and_back", HORIZON).sum() == 0
    np.testing.assert_array_equal(
        probe_controls("forth_and_back", HORIZON), -probe_controls("back_and_forth", HORIZON)
    )


def test_full_control_ends_where_constant_acceleration_leads() -> None:
    """Without damping: v = a n dt and p = a dt^2 n(n + 1)/2."""
    system = System(viscous_damping=0.0, control_gain=2.0, control_limit=3.0)
    task = Task(1.0, 0.0, 5.0, 0.5, system.plant)

    position, velocity = probe_misses(task, HORIZON)[0, PROBES.index("forward")]

    acceleration = 6.0 - 0.6
    assert velocity == pytest.approx(acceleration * HORIZON * 0.05 - 0.5)
    travelled = acceleration * 0.05**2 * HORIZON * (HORIZON + 1) / 2
    assert position == pytest.approx(1.0 + travelled - 5.0)


def test_without_control_a_mass_at_rest_stays() -> None:
    task = Task(0.2, 0.0, 0.7, 0.1, System().plant)

    np.testing.assert_allclose(
        probe_misses(task, HORIZON)[:, PROBES.index("coasting")], [[-0.5, -0.1]]
    )


@settings(max_examples=20, deadline=None)
@given(machines())
def test_misses_are_those_of_rollouts_for_one_task_and_for_many(system: System) -> None:
    plant = system.plant
    half = 0.5 * (plant.highest_control - plant.lowest_control)
    middle = 0.5 * (plant.highest_control + plant.lowest_control)
    starts = np.array([[0.0, 0.0], [0.3, -0.2]])
    fields: Any = (np.full(2, field) for field in plant)
    columns: Any = (*starts.T, np.array([0.1, -0.4]), np.array([0.0, 0.2]), Plant(*fields))
    misses = probe_misses(Task(*columns), HORIZON)

    for i, probe in enumerate(PROBES):
        controls = np.tile(middle + half * probe_controls(probe, HORIZON), (2, 1))
        ends = rollout(system, starts, controls)[:, -1]
        np.testing.assert_array_equal(misses[:, i], ends - [[0.1, 0.0], [-0.4, 0.2]])
    one = Task(0.3, -0.2, -0.4, 0.2, plant)
    np.testing.assert_array_equal(probe_misses(one, HORIZON), misses[1:])


def test_features_are_shares_of_reach_and_speed() -> None:
    task = Task(0.0, 0.1, 0.4, 0.0, System(control_limit=ControlLimits(-0.8, 0.9)).plant)
    reach, speed = scales(task.plant, HORIZON)
    names = [f"{probe}_{of}_miss" for probe in PROBES for of in ("position", "velocity")]

    (values,) = feature_values(names, task, HORIZON).reshape(1, len(PROBES), 2)

    np.testing.assert_allclose(values * [reach, speed], probe_misses(task, HORIZON)[0])
