"""Cases: which rows are an entrant's, what is read off them, and how two are compared."""

import numpy as np
import pandas as pd

from app.evaluation.case import Case, cases_of
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


AT_16 = Case(DATA, CEM, {"num_candidates": 16})


def test_rows_are_those_of_the_entrant_and_of_all_that_is_asked_for() -> None:
    assert list(Case(DATA, CEM, {}).values("error")) == [0.4, 0.1, 0.6, 0.3, 0.7]
    assert list(AT_16.at(task=1).values("error")) == [0.4, 0.6]
    assert Case(DATA, MPPI, {}).rows.empty


def test_measures_keep_the_order_of_the_rows() -> None:
    errors = AT_16.values("error")
    assert errors.dtype == np.float64
    assert errors.tolist() == [0.4, 0.1, 0.6, 0.3]


def test_runs_are_averaged_in_the_order_of_the_tasks() -> None:
    np.testing.assert_allclose(AT_16.per_unit("error"), [0.2, 0.5])


def test_the_runs_of_a_single_task_stand_for_themselves() -> None:
    runs = DATA[DATA.task == 0].assign(run=[1, 0, 0, 0])
    case = Case(runs, CEM, {"num_candidates": 16})
    assert (AT_16.unit, case.unit) == ("task", "run")
    np.testing.assert_allclose(case.per_unit("error"), [0.3, 0.1])


def test_a_share_counts_what_is_just_at_the_limit() -> None:
    assert AT_16.share_within("error", 0.4) == 0.75


def test_another_entrant_s_case_is_at_the_same_place() -> None:
    assert AT_16.with_entrant(UNIFORM).mean("error") == 0.9
    assert AT_16.with_entrant(UNIFORM).place == AT_16.place == "K = 16"


def test_cases_are_compared_task_by_task() -> None:
    better = AT_16.rows.assign(entrant=MPPI.label, error=AT_16.rows.error - 0.1)
    cem = Case(pd.concat([DATA, better]), CEM, {"num_candidates": 16})
    np.testing.assert_allclose(cem.less(cem.with_entrant(MPPI), "error"), [0.1] * 3)
    assert cem.less(MPPI, "error") == cem.less(cem.with_entrant(MPPI), "error")


def test_all_cases_come_with_the_entrants_innermost() -> None:
    cases = cases_of(DATA, [CEM, UNIFORM], num_candidates=[16, 32])
    assert [(case.place, case.entrant) for case in cases] == [
        ("K = 16", CEM),
        ("K = 16", UNIFORM),
        ("K = 32", CEM),
        ("K = 32", UNIFORM),
    ]
