import numpy as np
import pytest

from app.planning.plant.natural_units import scales
from app.planning.plant.rollout import rollout
from training.machines import RandomMachines
from training.tasks import Tasks, system_of

HORIZON = 64
TASKS = RandomMachines(stribeck_share=0.5).sample(100, HORIZON, np.random.default_rng(0))


def test_a_problem_is_a_row() -> None:
    for index in range(100):
        problem = TASKS.problem(index, HORIZON)
        np.testing.assert_allclose(problem.system.plant, TASKS.plants[index], rtol=1e-12)
        np.testing.assert_array_equal(
            [*problem.initial_state, *problem.target_state], TASKS.states[index]
        )
        assert problem.horizon == HORIZON


def test_columns_are_the_fields_of_a_task() -> None:
    task = TASKS.columns

    np.testing.assert_array_equal(task.target_velocity, TASKS.states[:, 3])
    for index in (0, 7):
        plant = TASKS.problem(index, HORIZON).system.plant
        reach, speed = scales(plant, HORIZON)
        assert np.asarray(TASKS.scales(HORIZON).reach)[index] == pytest.approx(reach)
        assert np.asarray(TASKS.scales(HORIZON).speed)[index] == pytest.approx(speed)


def test_a_mirror_image_moves_the_other_way_on_the_mirrored_machine() -> None:
    controls = np.random.default_rng(1).uniform(-1, 1, (1, HORIZON))
    mirrored = TASKS.mirrored()

    for index in range(100):
        problem, image = TASKS.problem(index, HORIZON), mirrored.problem(index, HORIZON)
        end = rollout(problem.system, problem.initial_state, controls)[0, -1]
        other_end = rollout(image.system, image.initial_state, -controls)[0, -1]
        np.testing.assert_allclose(other_end, -end, atol=1e-12)
    np.testing.assert_array_equal(mirrored.mirrored().plants, TASKS.plants)
    np.testing.assert_array_equal(mirrored.states, -TASKS.states)


def test_rows_targets_and_those_that_follow() -> None:
    both = TASKS.followed_by(TASKS.mirrored())

    assert len(both) == 200
    np.testing.assert_array_equal(both.rows(slice(100, 200)).plants, TASKS.mirrored().plants)
    moved = TASKS.with_targets(np.ones((100, 2)))
    np.testing.assert_array_equal(moved.states[:, 2:], 1.0)
    np.testing.assert_array_equal(moved.states[:, :2], TASKS.states[:, :2])
    assert isinstance(moved, Tasks)


def test_a_system_without_stribecks_effect_has_none() -> None:
    without = TASKS.problem(int(np.argmin(TASKS.plants[:, 8])), HORIZON).system.plant

    assert without.stribeck_velocity == 0.0
    assert system_of(without).stribeck_velocity is None
