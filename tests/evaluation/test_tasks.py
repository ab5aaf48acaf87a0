"""The tasks: by the seed alone, and over the training range."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.evaluation.tasks import (
    TARGETS_PER_SEQUENCE,
    request_seed,
    sequence_tasks,
    transition_tasks,
)
from app.wire.requests import MAX_SEED

SEEDS = st.integers(0, 2**32)
SIZES = st.integers(0, 20)


@given(SEEDS, SIZES, SIZES)
def test_more_tasks_begin_with_the_same_ones(seed: int, few: int, more: int) -> None:
    assert sequence_tasks(few + more, seed)[:few] == sequence_tasks(few, seed)
    assert transition_tasks(few + more, seed)[:few] == transition_tasks(few, seed)


def test_another_seed_draws_other_tasks() -> None:
    assert sequence_tasks(9, seed=0) != sequence_tasks(9, seed=1)
    assert transition_tasks(9, seed=0) != transition_tasks(9, seed=1)


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


@given(SEEDS, st.integers(0, 500), st.integers(0, 50))
def test_seeds_of_requests_are_taken_by_the_service(seed: int, task: int, run: int) -> None:
    assert 0 <= request_seed(seed, task, run) <= MAX_SEED


def test_no_two_runs_of_any_task_have_the_same_seed() -> None:
    seeds = {request_seed(0, task, run) for task in range(100) for run in range(5)}
    assert len(seeds) == 500
