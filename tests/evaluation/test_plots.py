"""Panels over K: what their bars show, and over what."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from app.evaluation.case import cases_of
from app.evaluation.entrants import CEM
from app.evaluation.plots import draw_over_budget, spread


def test_a_spread_is_a_standard_deviation_to_either_side() -> None:
    np.testing.assert_allclose(
        spread(np.array([1.0, 2.0, 2.0, 3.0])), (2, 2 - 0.5**0.5, 2 + 0.5**0.5)
    )


def test_a_spread_goes_no_lower_than_the_least_value() -> None:
    assert spread(np.array([1.0, 1.0, 1.0, 9.0])).low == 1


@pytest.mark.parametrize(
    ("tasks", "ends"),
    [((0, 0, 0), (1, 3 + float(np.std([1.0, 2.0, 6.0])))), ((0, 0, 1), (1.5, 6))],
    ids=["runs of a task", "tasks"],
)
def test_bars_are_over_the_runs_of_a_single_task_else_over_the_tasks(
    tasks: tuple[int, ...], ends: tuple[float, float]
) -> None:
    errors = {"task": tasks, "run": range(3), "error": (1.0, 2.0, 6.0)}
    data = pd.DataFrame({"entrant": CEM.label, "num_candidates": 16, **errors})
    axes = Figure().subplots()
    cases = cases_of(data, [CEM], num_candidates=[16])
    draw_over_budget(axes, cases, "error", "error (m)", bars=spread)
    (bars,) = axes.collections
    np.testing.assert_allclose(np.asarray(bars.get_paths()[0].vertices)[:, 1], ends)
