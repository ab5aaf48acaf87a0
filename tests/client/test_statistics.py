"""Differences on the same tasks."""

import numpy as np
import pytest

from app.client.statistics import paired_difference

TASKS = np.linspace(0, 100, 50)


def test_differences_are_paired() -> None:
    """The tasks are far more unlike each other than the methods are."""
    mean, low, high = paired_difference(TASKS + np.tile([0.9, 1.1], 25), TASKS)
    assert mean == pytest.approx(1.0)
    assert 0.9 < low < 1.0 < high < 1.1


def test_the_same_answers_differ_by_nothing_at_all() -> None:
    assert paired_difference(TASKS, TASKS) == (0.0, 0.0, 0.0)
