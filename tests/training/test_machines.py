from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.planning.plant.machines import MACHINES
from app.planning.plant.system import System
from training.machines import DRIFT, RandomMachines

HORIZON = 64
MANY = RandomMachines().sample(20_000, HORIZON, np.random.default_rng(0))


@pytest.mark.parametrize("horizon", [HORIZON, 8, 512])
def test_every_machine_is_one_that_the_range_covers(horizon: int) -> None:
    tasks = RandomMachines().sample(200, horizon, np.random.default_rng(0))

    for index in range(200):
        assert RandomMachines().coverage.covers(tasks.problem(index, horizon).system, horizon)


@pytest.mark.parametrize("name", MACHINES)
def test_the_range_covers_the_real_machines(name: str) -> None:
    assert RandomMachines().coverage.covers(MACHINES[name].system, HORIZON)


@pytest.mark.parametrize(
    "outside",
    [
        {"static_friction": 0.82},
        {"static_friction": 0.01, "coulomb_friction": 0.01},
        {"coulomb_friction": 0.2},
        {"viscous_damping": 14.0},
        {"bias": 0.19},
    ],
    ids=["too sticky", "hardly any friction", "Coulomb", "damping", "bias"],
)
def test_the_range_ends_somewhere(outside: dict[str, Any]) -> None:
    assert not RandomMachines().coverage.covers(replace(System(), **outside), HORIZON)


def test_machines_fill_the_range() -> None:
    plant = MANY.columns.plant

    assert np.min(plant.static_forward) < 0.021
    assert np.max(plant.static_forward) > 0.89
    assert 0.45 < np.mean(np.equal(plant.static_forward, plant.static_backward)) < 0.55
    assert np.max(np.divide(plant.static_backward, plant.static_forward)) > 1.9
    assert 0.45 < np.mean(np.equal(plant.bias, 0)) < 0.55
    assert 0.08 < np.mean(np.greater(plant.stribeck_velocity, 0)) < 0.12
    assert np.max(np.multiply(plant.damping_forward, plant.time_step)) * HORIZON > 39


def test_tasks_reach_as_far_and_as_fast_as_configured() -> None:
    reach, speed = MANY.scales(HORIZON)
    _, start, target_position, target = MANY.states.T
    start, target = start / speed, target / speed
    displacement = target_position / reach - DRIFT * (start + target)

    for shares, most, moving in (
        (displacement, 1.1, 1.0),
        (start, 0.75, 0.5),
        (target, 0.75, 0.4),
    ):
        assert 0.97 * most < np.max(np.abs(shares)) < most + 1e-9
        assert abs(np.mean(shares != 0) - moving) < 0.02
        assert abs(np.mean(shares)) < 0.02
    # Half of the nearer ones, of all the others a tenth: 0.3 * 0.33 + 0.7 * 0.1.
    assert np.mean(np.abs(displacement) < 0.11) == pytest.approx(0.3 * 0.33 + 0.07, abs=0.02)
    assert not np.any(MANY.states[:, 0])


def test_position_and_velocity_weigh_about_alike() -> None:
    reach, speed = MANY.scales(HORIZON)

    np.testing.assert_allclose(reach, np.multiply(2, speed))


def test_the_generator_decides_the_machines() -> None:
    first, again, other = (
        RandomMachines().sample(5, HORIZON, np.random.default_rng(seed)) for seed in (1, 1, 2)
    )

    np.testing.assert_array_equal(first.plants, again.plants)
    np.testing.assert_array_equal(first.states, again.states)
    assert not np.array_equal(first.states, other.states)
