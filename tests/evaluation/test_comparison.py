"""Picking measures out of a suite's data, and who wins."""

import numpy as np
import pandas as pd

from app.evaluation.comparison import column, per_unit, rows_of, wins
from app.evaluation.entrants import CEM, MPPI, UNIFORM

DATA = pd.DataFrame(
    [
        (CEM.label, 16, 1, 0.4),
        (CEM.label, 16, 0, 0.1),
        (CEM.label, 16, 1, 0.6),
        (CEM.label, 16, 0, 0.3),
        (CEM.label, 32, 0, 0.7),
        (UNIFORM.label, 16, 0, 0.9),
    ],
    columns=["entrant", "num_candidates", "task", "error"],
)


def test_rows_are_those_of_the_entrant_and_of_all_that_is_asked_for() -> None:
    assert list(rows_of(DATA, CEM).error) == [0.4, 0.1, 0.6, 0.3, 0.7]
    assert list(rows_of(DATA, CEM, num_candidates=16, task=1).error) == [0.4, 0.6]
    assert rows_of(DATA, MPPI).empty


def test_a_column_keeps_the_order_of_the_rows() -> None:
    found = column(DATA, CEM, "error", num_candidates=16)
    assert found.dtype == np.float64
    assert found.tolist() == [0.4, 0.1, 0.6, 0.3]


def test_runs_are_averaged_in_the_order_of_the_tasks() -> None:
    np.testing.assert_allclose(per_unit(DATA, CEM, "error", num_candidates=16), [0.2, 0.5])


def test_a_table_of_wins_has_the_row_s_method_win_and_leaves_the_diagonal_empty() -> None:
    errors = {
        CEM: np.array([0.1, 0.1, 0.1, 0.1]),
        MPPI: np.array([0.2, 0.2, 0.2, 0.1]),
        UNIFORM: np.array([0.0, 0.3, 0.3, 0.3]),
    }

    table = wins(errors, "wins", "Error")

    assert table.name == "wins"
    assert table.caption.startswith("Error: share of the tasks")
    assert list(table.headings) == ["Method", CEM.label, MPPI.label, UNIFORM.label]
    assert [list(row) for row in table.rows] == [
        [CEM.label, "", "75 %", "75 %"],
        [MPPI.label, "0 %", "", "75 %"],
        [UNIFORM.label, "25 %", "25 %", ""],
    ]
