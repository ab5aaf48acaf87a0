"""Grids: a row for each case, a cell for each column, and the tables that several suites make."""

import pandas as pd

from app.evaluation import grid
from app.evaluation.case import cases_of
from app.evaluation.entrants import CEM, MPPI, PAPER_DIFFUSION, UNIFORM

DATA = pd.DataFrame(
    [
        (entrant.label, 16, task, error, task % 2 == 0)
        for entrant, errors in {
            CEM: (0.1, 0.1, 0.1, 0.1),
            MPPI: (0.2, 0.2, 0.2, 0.1),
            UNIFORM: (0.0, 0.3, 0.3, 0.3),
            PAPER_DIFFUSION: (0.05, 0.05, 0.05, 0.05),
        }.items()
        for task, error in enumerate(errors)
    ],
    columns=["entrant", "num_candidates", "task", "error", "even"],
)
CASES = cases_of(DATA, [CEM, MPPI, UNIFORM], num_candidates=[16])


def test_a_table_of_cases_begins_with_the_method_and_what_varies() -> None:
    table = grid.of_cases(
        "Errors.",
        CASES,
        grid.spread("Spread", "error", 2),
        grid.mean("Mean", "error", 3),
        grid.median("Median", "error", 1),
        grid.within("Within 0.1 m", "error", 0.1),
        grid.share("Even", "even", 1),
    )
    assert table.headings == (
        "Method", "K", "Spread", "Mean", "Median", "Within 0.1 m", "Even",
    )  # fmt: skip
    assert table.rows[1] == (
        MPPI.label, "16", "0.18 ± 0.04", "0.175", "0.2", "25 %", "50.0 %",
    )  # fmt: skip


def test_a_column_may_show_another_place_than_the_row_s() -> None:
    whole = cases_of(DATA, [UNIFORM])
    table = grid.of_cases("One.", whole, grid.mean("Task 0", "error", 1, task=0))
    assert table.rows == [(UNIFORM.label, "0.0")]


def test_statistics_are_paired_with_the_paper_s_sampler_which_is_compared_with_nothing() -> None:
    cases = cases_of(DATA, [PAPER_DIFFUSION, CEM], num_candidates=[16])
    table = grid.statistics(cases, "error")
    assert table.part == "statistics"
    assert [row[2:] for row in table.rows] == [
        ("0.050 [0.050, 0.050]", ""),
        ("0.100 [0.100, 0.100]", "+0.050 [+0.050, +0.050]"),
    ]


def test_a_table_of_wins_has_the_row_s_method_win_and_leaves_the_diagonal_empty() -> None:
    (table,) = grid.wins(CASES, "error", "Error")

    assert table.part == "wins-16"
    assert table.caption.startswith("Error, K = 16: share of the tasks")
    assert table.headings == ("Method", CEM.label, MPPI.label, UNIFORM.label)
    assert table.rows == [
        (CEM.label, "", "75 %", "75 %"),
        (MPPI.label, "0 %", "", "75 %"),
        (UNIFORM.label, "25 %", "25 %", ""),
    ]
