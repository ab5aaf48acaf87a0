"""Panels over K: what their bars show, and over what."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from app.evaluation.case import cases_of
from app.evaluation.entrants import CEM
from app.evaluation.plots import draw_over_budget, spread

DATA = pd.DataFrame(
    [(CEM.label, 16, 0, 0, 1.0), (CEM.label, 16, 0, 1, 2.0), (CEM.label, 16, 0, 2, 6.0)],
    columns=["entrant", "num_candidates", "task", "run", "error"],
)


def test_a_spread_is_a_standard_deviation_to_either_side() -> None:
    np.testing.assert_allclose(
        spread(np.array([1.0, 2.0, 2.0, 3.0])), (2, 2 - 0.5**0.5, 2 + 0.5**0.5)
    )


def test_a_spread_goes_no_lower_than_the_least_value() -> None:
    assert spread(np.array([1.0, 1.0, 1.0, 9.0])).low == 1


def test_bars_are_over_the_units_that_the_caller_names() -> None:
    axes = Figure().subplots()
    cases = cases_of(DATA, [CEM], num_candidates=[16])
    draw_over_budget(axes, cases, "error", "error (m)", unit="run", bars=spread)
    draw_over_budget(axes, cases, "error", "error (m)", bars=spread)
    over_runs, over_tasks = (
        np.asarray(bars.get_paths()[0].vertices)[:, 1] for bars in axes.collections
    )
    np.testing.assert_allclose(over_runs, [1, 3 + float(np.std([1.0, 2.0, 6.0]))])
    np.testing.assert_allclose(over_tasks, [3, 3])
