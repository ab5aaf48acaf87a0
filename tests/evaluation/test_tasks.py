"""The tasks: by the seed alone, and over the training range."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.evaluation.tasks import (
    TARGETS_PER_SEQUENCE,
    machine_tasks,
    random_machine_tasks,
    request_seed,
    scale_of,
    sequence_tasks,
    transition_tasks,
)
from app.planning.plant.system import ControlLimits, System
from app.wire.requests import MAX_SEED
from training.machines import RandomMachines

SEEDS = st.integers(0, 2**32)
SIZES = st.integers(0, 20)
LOPSIDED = System(
    static_friction=0.0,
    coulomb_friction=0.0,
    viscous_damping=0.0,
    bias=0.1,
    control_gain=2.0,
    control_limit=ControlLimits(-0.2, 0.6),
    time_step=0.1,
)
"""Without friction: its accelerations, -0.3 to 1.3 m/s^2, take it wherever it gets."""


@given(SEEDS, SIZES, SIZES)
def test_more_tasks_begin_with_the_same_ones(seed: int, few: int, more: int) -> None:
    assert sequence_tasks(few + more, seed)[:few] == sequence_tasks(few, seed)
    assert transition_tasks(few + more, seed)[:few] == transition_tasks(few, seed)
    draw = machine_tasks(LOPSIDED)
    assert draw(few + more, seed)[:few] == draw(few, seed)


def test_another_seed_draws_other_tasks() -> None:
    assert sequence_tasks(9, seed=0) != sequence_tasks(9, seed=1)
    assert transition_tasks(9, seed=0) != transition_tasks(9, seed=1)
    assert machine_tasks(LOPSIDED)(9, 0) != machine_tasks(LOPSIDED)(9, 1)


def test_sequences_are_rest_positions_within_a_metre() -> None:
    sequences = np.array([task["targets"] for task in sequence_tasks(400, seed=0)])
    assert sequences.shape == (400, TARGETS_PER_SEQUENCE, 2)
    assert 0.99 < np.abs(sequences[:, :, 0]).max() <= 1
    assert not sequences[:, :, 1].any()


def test_transitions_cover_the_training_range_and_every_other_target_moves() -> None:
    transitions = np.array([list(task.values()) for task in transition_tasks(400, seed=0)])
    starts, targets = transitions[:, 0], transitions[:, 1]
    for states in (starts, targets):
        assert np.abs(states).max(axis=0) == pytest.approx([1, 0.5], abs=0.02)
        assert (np.abs(states).max(axis=0) <= [1, 0.5]).all()
    assert not targets[::2, 1].any()
    assert targets[1::2, 1].all()


def test_a_machine_s_scale_is_half_of_what_full_control_both_ways_spans() -> None:
    steps, time_step, acceleration = 64, 0.1, (1.3 + 0.3) / 2
    reach, speed = scale_of(LOPSIDED)
    assert speed == pytest.approx(acceleration * time_step * steps)
    assert reach == pytest.approx(acceleration * time_step**2 * steps * (steps + 1) / 2)


def test_tasks_of_a_machine_are_in_proportion_to_its_scale() -> None:
    tasks = machine_tasks(LOPSIDED)(800, 0)
    assert all(task["system"] == LOPSIDED for task in tasks)
    states = np.array([(task["initial_state"], task["target_state"]) for task in tasks])
    starts, targets = (states / scale_of(LOPSIDED)).transpose(1, 0, 2)
    assert not starts[:, 0].any()
    assert np.abs(targets[:, 0]).max() == pytest.approx(0.5, abs=0.01)
    for velocities in (starts[:, 1], targets[:, 1]):
        assert np.abs(velocities).max() == pytest.approx(0.3, abs=0.01)


def test_half_of_a_machine_s_starts_move_and_a_quarter_of_its_targets_of_both_kinds_alike() -> None:
    tasks = machine_tasks(LOPSIDED)(200, 0)
    moving = [(task["initial_state"][1] != 0, task["target_state"][1] != 0) for task in tasks]
    counts = {kind: moving.count(kind) for kind in set(moving)}
    assert counts == {
        (False, False): 75,
        (True, False): 75,
        (False, True): 25,
        (True, True): 25,
    }


def test_all_machines_have_the_same_tasks_in_proportion() -> None:
    ours, paper = (
        np.array([(task["initial_state"], task["target_state"]) for task in draw(20, 0)])
        / scale_of(system)
        for system in (LOPSIDED, System())
        for draw in [machine_tasks(system)]
    )
    np.testing.assert_allclose(ours, paper)


@given(SEEDS, st.integers(0, 500), st.integers(0, 50))
def test_seeds_of_requests_are_taken_by_the_service(seed: int, task: int, run: int) -> None:
    assert 0 <= request_seed(seed, task, run) <= MAX_SEED


def test_no_two_runs_of_any_task_have_the_same_seed() -> None:
    seeds = {request_seed(0, task, run) for task in range(100) for run in range(5)}
    assert len(seeds) == 500


def test_random_machines_are_all_that_a_model_of_every_machine_covers() -> None:
    systems = [task["system"] for task in random_machine_tasks(300, 1)]

    assert all(RandomMachines().coverage.covers(system, 64) for system in systems)
    assert 0.4 < np.mean([system.plant.bias != 0 for system in systems]) < 0.6
    assert 0.05 < np.mean([system.stribeck_velocity is not None for system in systems]) < 0.16
    shares = [
        system.plant.static_forward / (system.plant.control_gain * system.plant.highest_control)
        for system in systems
    ]
    assert min(shares) < 0.05
    assert max(shares) > 0.85
    first, again = random_machine_tasks(3, 1), random_machine_tasks(5, 1)
    assert first == again[:3]
    assert random_machine_tasks(3, 2) != first
