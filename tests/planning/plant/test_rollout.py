"""Rollouts: their shape, and what they take. What a step does is in test_friction.py."""

import numpy as np

from app.planning.plant.rollout import rollout
from app.planning.plant.system import System


def test_a_rollout_begins_with_the_initial_state_and_has_one_state_more_than_controls() -> None:
    start = np.array([0.3, -0.2])

    states = rollout(System(), start, np.zeros((5, 7)))

    assert states.shape == (5, 8, 2)
    assert states.dtype == np.float64
    assert np.all(states[:, 0] == start)


def test_one_start_for_all_rows_equals_that_start_row_by_row() -> None:
    rng = np.random.default_rng(0)
    controls = rng.uniform(-0.9, 0.9, (6, 64))
    start = np.array([0.3, -0.2])

    together = rollout(System(), start, controls)

    np.testing.assert_array_equal(together, rollout(System(), np.tile(start, (6, 1)), controls))
    for row in range(6):
        np.testing.assert_array_equal(
            together[row], rollout(System(), start, controls[row : row + 1])[0]
        )


def test_each_row_starts_from_its_own_state() -> None:
    rng = np.random.default_rng(1)
    controls = rng.uniform(-0.9, 0.9, (6, 64))
    starts = rng.uniform(-1, 1, (6, 2))

    states = rollout(System(), starts, controls)

    for row in range(6):
        np.testing.assert_array_equal(
            states[row], rollout(System(), starts[row], controls[row : row + 1])[0]
        )


def test_a_rollout_takes_strided_and_single_precision_controls() -> None:
    controls = np.random.default_rng(2).uniform(-0.9, 0.9, (64, 6)).astype(np.float32)

    np.testing.assert_array_equal(
        rollout(System(), np.zeros(2), controls.T),  # type: ignore[arg-type]
        rollout(System(), np.zeros(2), np.array(controls.T, dtype=np.float64)),
    )
