"""Figure 2: everybody gets the same runs, and the claims follow the numbers."""

from collections.abc import Mapping
from functools import cache

import numpy as np
import pytest

from app.evaluation.answer_log import Answer
from app.evaluation.entrants import (
    DATASET_PRIOR,
    ENTRANTS,
    PAPER_DIFFUSION,
    REFINED_PRIOR,
    UNIFORM,
)
from app.evaluation.question import Entrant, Question
from app.evaluation.suite import Claim, Picture, Section, Table
from app.evaluation.suites.sample_budget import SampleBudget
from tests.evaluation.synthetic import assert_asked_alike, plan_answer, section_of, split

SUITE = SampleBudget(seed=3, quick=True)
LOW, HIGH = SUITE.size.budgets

World = Mapping[tuple[Entrant, int], float]
ERRORS: World = {
    (entrant, k): {
        PAPER_DIFFUSION: 0.001,
        DATASET_PRIOR: 0.08,
        UNIFORM: 0.19,
        REFINED_PRIOR: 1e-16,
    }.get(entrant, 0.1)
    for entrant in ENTRANTS
    for k in SUITE.size.budgets
}
ENERGIES: World = {
    (entrant, k): 10 if entrant == UNIFORM else 25
    for entrant in ENTRANTS
    for k in SUITE.size.budgets
}
"""A world in which all is as the paper says."""


def section(errors: World = ERRORS, energies: World = ENERGIES, compute_ms: float = 1.0) -> Section:
    by_label = {entrant.label: entrant for entrant in ENTRANTS}

    def answer(question: Question) -> Answer:
        labels = question.labels
        asked = by_label[str(labels["entrant"])], int(labels["num_candidates"])
        luck = 1 + 0.1 * int(labels["run"])
        return plan_answer(errors[asked] * luck, energies[asked], compute_ms=compute_ms)

    return section_of(SUITE, answer)


@cache
def section_as_in_the_paper() -> Section:
    return section()


def test_everybody_gets_the_same_runs_at_every_k() -> None:
    task = {"initial_state": (0.0, 0.0), "target_state": (0.2, 0.0), "include": []}
    assert_asked_alike(SUITE, [task], len(ENTRANTS) * len(SUITE.size.budgets))


def test_the_whole_evaluation_is_the_paper_s_in_size_and_begins_with_the_quick_one() -> None:
    whole = list(SampleBudget(seed=3).questions())
    assert len(whole) == 4 * 30 * len(ENTRANTS)
    asked = {question.key for question in whole}
    assert len(asked) == len(whole)
    assert asked.issuperset(question.key for question in SUITE.questions())


def test_a_row_for_each_method_and_k() -> None:
    measures, statistics, times, *wins = section_as_in_the_paper().all(Table)
    for table in (measures, statistics, times):
        assert len(table.rows) == len(ENTRANTS) * len(SUITE.size.budgets)
        assert {len(row) for row in table.rows} == {len(table.headings)}
    assert measures.rows[0] == (
        PAPER_DIFFUSION.label, "16", "0.0011 ± 0.0001", "100 %", "25.0 ± 0.0", "0.0 ± 0.0", "1",
    )  # fmt: skip
    assert measures.rows[1][2:4] == ("0.0880 ± 0.0065", "0 %")
    assert statistics.rows[1][2:] == ("0.0880 [0.0800, 0.0960]", "+0.0869 [+0.0790, +0.0948]")
    assert times.rows[0][2:] == ("1.0 ± 0.0", "2.0 ± 0.0")
    assert [table.part for table in wins] == ["wins-16", "wins-32"]
    assert wins[0].caption.startswith("Terminal error, K = 16: share of the runs")
    assert wins[0].rows[0][1:3] == ("", "100 %")


def test_the_same_answers_make_the_same_tables_and_times_stand_apart() -> None:
    (results, times), (again, later) = split(section()), split(section(compute_ms=70))
    assert results == again
    assert times != later


def test_all_methods_are_drawn_and_tiny_errors_as_a_micrometre() -> None:
    (picture,) = section_as_in_the_paper().all(Picture)
    for axes in picture.figure.axes:
        assert [line.get_label() for line in axes.containers] == [of.label for of in ENTRANTS]
    errors = picture.figure.axes[0]
    drawn = np.concatenate([np.asarray(line.get_ydata()) for line in errors.lines])
    np.testing.assert_allclose(drawn.min(), 1e-6)
    bars = np.concatenate([path.vertices for bar in errors.collections for path in bar.get_paths()])
    assert bars[:, 1].min() >= 1e-6


def test_claims_hold_where_all_is_as_the_paper_says() -> None:
    claims = section_as_in_the_paper().all(Claim)
    assert [claim.confirmed for claim in claims] == [True] * 4
    assert "0.0011 [0.0010, 0.0012] m at K = 16 (100 % within 0.01 m)" in claims[0].evidence
    assert "K = 16: Uniform, 0.2090 m, 0.0011 m" in claims[3].evidence


@pytest.mark.parametrize(
    ("number", "changed"),
    [
        (0, {(PAPER_DIFFUSION, LOW): 0.02}),
        (1, {(DATASET_PRIOR, HIGH): 0.001}),
        (2, {(UNIFORM, HIGH): 0.005}),
    ],
)
def test_a_claim_fails_where_errors_are_otherwise(number: int, changed: World) -> None:
    assert not section(errors={**ERRORS, **changed}).all(Claim)[number].confirmed


def test_low_energy_is_sufficient_where_the_nearest_method_spends_least() -> None:
    claim = section(energies={**ENERGIES, (PAPER_DIFFUSION, HIGH): 5}).all(Claim)[3]
    assert not claim.confirmed
    assert f"K = 32: {PAPER_DIFFUSION.label}, 0.0011 m, 0.0011 m" in claim.evidence
