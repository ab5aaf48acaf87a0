"""Intervals and shares over tasks, against cases that are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from app.evaluation.statistics import TIE, interquartile_mean, interval, share_won

TASKS = np.linspace(0, 100, 50)
ERRORS = st.lists(st.floats(0, 2), min_size=2, max_size=20).map(np.array)
PAIRS = st.lists(st.tuples(st.floats(0, 2), st.floats(0, 2)), min_size=2, max_size=20).map(
    lambda pairs: np.array(pairs).T
)


def test_the_interval_of_a_mean_is_that_of_the_normal_distribution_where_there_are_many() -> None:
    values = np.random.default_rng(1).normal(5, 2, 1000)
    half = 1.96 * values.std() / np.sqrt(len(values))

    found = interval(values)

    assert found.estimate == values.mean()
    assert found.low == pytest.approx(values.mean() - half, abs=0.1 * half)
    assert found.high == pytest.approx(values.mean() + half, abs=0.1 * half)


@given(ERRORS)
@settings(max_examples=20)
def test_an_interval_holds_its_estimate_and_is_always_the_same(errors: NDArray[np.float64]) -> None:
    found = interval(errors)
    assert found.low - 1e-12 <= found.estimate <= found.high + 1e-12
    assert found == interval(errors)


@given(st.floats(-2, 2), st.integers(1, 20))
def test_constant_data_leave_no_doubt(value: float, size: int) -> None:
    estimate, low, high = interval(np.full(size, value))
    assert low == estimate == high == pytest.approx(value)


def test_the_interquartile_mean_is_that_of_the_middle_half() -> None:
    middle = interquartile_mean(np.array([100.0, 2, 3, 5, 6, 0, 1, 4]))
    assert middle == pytest.approx((2 + 3 + 4 + 5) / 4)


def test_the_interquartile_mean_goes_along_the_axis_that_is_named() -> None:
    rows = np.array([[0.0, 1, 2, 50], [10, 12, 14, 90]])
    np.testing.assert_allclose(interquartile_mean(rows), [1.5, 13])
    np.testing.assert_allclose(interquartile_mean(rows.T, axis=0), [1.5, 13])


def test_one_wild_task_does_not_move_the_interquartile_mean_far() -> None:
    wild = np.append(np.linspace(0, 1, 30), 1e6)
    assert interval(wild, interquartile_mean).high < 1


def test_differences_are_paired() -> None:
    """The tasks are far more unlike each other than the methods are."""
    mean, low, high = interval(TASKS + np.tile([0.9, 1.1], 25) - TASKS)
    assert mean == pytest.approx(1.0)
    assert 0.9 < low < 1.0 < high < 1.1


def test_the_same_answers_differ_by_nothing_at_all() -> None:
    assert interval(TASKS - TASKS) == (0.0, 0.0, 0.0)


@given(PAIRS)
@settings(max_examples=20)
def test_the_estimate_of_a_difference_changes_its_sign_with_the_order(
    pair: NDArray[np.float64],
) -> None:
    first, second = pair
    there, back = interval(first - second), interval(second - first)
    assert there.estimate == -back.estimate


def test_shares_won_do_not_count_ties() -> None:
    first = np.array([0.1, 0.3, 0.2, 0.2])
    second = np.array([0.2, 0.2, 0.2, 0.2 + TIE / 2])
    assert share_won(first, second) == 0.25
    assert share_won(second, first) == 0.25


@given(PAIRS)
def test_nobody_wins_a_task_against_himself_and_two_never_win_the_same(
    pair: NDArray[np.float64],
) -> None:
    first, second = pair
    assert share_won(first, first) == 0
    assert share_won(first, second) + share_won(second, first) <= 1
