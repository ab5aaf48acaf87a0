"""Table 2: everybody gets the same tasks and seeds, and the claims follow the numbers."""

from collections.abc import Mapping

import pytest

from app.evaluation.answer_log import Answer
from app.evaluation.entrants import (
    CEM,
    DATASET_PRIOR,
    ENTRANTS,
    MPPI,
    PAPER_DIFFUSION,
    PAPER_ENTRANTS,
)
from app.evaluation.question import Entrant, Question
from app.evaluation.suite import Claim, Picture, Section, Table
from app.evaluation.suites.multistep_random import MultistepRandom
from app.evaluation.tasks import sequence_tasks
from app.planning.plant.system import System
from tests.evaluation.synthetic import assert_asked_alike, section_of, sequence_answer, split

SUITE = MultistepRandom(seed=3, quick=True)
LOW, HIGH = SUITE.size.budgets

World = Mapping[tuple[Entrant, int], float]
ERRORS: World = {
    (entrant, k): {
        PAPER_DIFFUSION: 0.1,
        CEM: 0.5 if k == LOW else 0.3,
        DATASET_PRIOR: 0.4,
    }.get(entrant, 0.6)
    for entrant in ENTRANTS
    for k in SUITE.size.budgets
}
STUCK: World = {
    (entrant, k): {PAPER_DIFFUSION: 10, CEM: 80}.get(entrant, 50)
    for entrant in ENTRANTS
    for k in SUITE.size.budgets
}
"""A world in which all is as the paper says."""


def section(errors: World = ERRORS, stuck: World = STUCK, compute_ms: float = 1.0) -> Section:
    by_label = {entrant.label: entrant for entrant in ENTRANTS}

    def answer(question: Question) -> Answer:
        labels = question.labels
        asked = by_label[str(labels["entrant"])], int(labels["num_candidates"])
        # Some tasks are harder than others, for everybody.
        error = errors[asked] + 0.01 * int(labels["task"])
        return sequence_answer(error, int(stuck[asked]), compute_ms)

    return section_of(SUITE, answer)


def test_everybody_gets_the_same_tasks_and_seeds_at_every_k() -> None:
    tasks = sequence_tasks(3, SUITE.seed)
    assert_asked_alike(SUITE, tasks, len(ENTRANTS) * len(SUITE.size.budgets))


def test_the_whole_evaluation_is_the_paper_s_in_size_and_begins_with_the_quick_one() -> None:
    whole = list(MultistepRandom(seed=3).questions())
    assert len(whole) == 4 * 30 * 5 * len(ENTRANTS)
    asked = {question.key for question in whole}
    assert len(asked) == len(whole)
    assert asked.issuperset(question.key for question in SUITE.questions())


def test_a_plant_and_more_columns_may_be_given() -> None:
    system = System(static_friction=0.8)
    question, *_ = SUITE.ask(CEM.asking(system=system), 16, static_friction=0.8)
    assert question.plan.system == system
    assert question.labels["static_friction"] == 0.8


def test_a_row_for_each_method_and_k_with_the_paper_s_numbers_beside() -> None:
    errors, plans, statistics, times, *wins = section().all(Table)
    for table in (errors, plans, statistics, times):
        assert len(table.rows) == len(ENTRANTS) * len(SUITE.size.budgets)
        assert {len(row) for row in table.rows} == {len(table.headings)}
    assert errors.rows[0] == (
        PAPER_DIFFUSION.label, "16", "0.110 ± 0.008", "0.20 ± 0.3", "0.110 ± 0.008", "0.17 ± 0.1",
        "0.000", "10.0 ± 0.0", "23.2 ± 18.7",
    )  # fmt: skip
    assert plans.rows[0] == (PAPER_DIFFUSION.label, "16", "0.1100", "1.0")
    assert statistics.rows[1][2:] == ("0.410 [0.400, 0.420]", "+0.300 [+0.300, +0.300]")
    assert times.rows[0][2:] == ("0.001 ± 0.000", "0.68 ± 0.1", "0.3", "0.002 ± 0.000")
    assert [table.part for table in wins] == ["wins-16", "wins-32"]
    assert wins[0].rows[0][1:4] == ("", "100 %", "100 %")


def test_the_same_answers_make_the_same_tables_and_times_stand_apart() -> None:
    (results, times), (again, later) = split(section()), split(section(compute_ms=70))
    assert results == again
    assert times != later


def test_lines_of_all_methods_are_drawn() -> None:
    (picture,) = section().all(Picture)
    for axes in picture.figure.axes:
        assert [line.get_label() for line in axes.containers] == [of.label for of in ENTRANTS]


def test_claims_hold_where_all_is_as_the_paper_says() -> None:
    claims = section().all(Claim)
    assert [claim.confirmed for claim in claims] == [True] * 6
    assert "-0.400 [-0.400, -0.400] m at K = 16" in claims[0].evidence
    assert "0.400 m at K = 16 and 0.200 m at K = 32" in claims[1].evidence


@pytest.mark.parametrize(
    ("number", "changed"),
    [
        (0, {(CEM, LOW): 0.1}),
        (1, {(CEM, HIGH): 0.6}),
        (2, {(DATASET_PRIOR, HIGH): 0.05}),
        (3, {(DATASET_PRIOR, LOW): 0.1}),
        (5, {(MPPI, LOW): 0.05, (MPPI, HIGH): 0.05}),
    ],
)
def test_a_claim_fails_where_errors_are_otherwise(number: int, changed: World) -> None:
    claims = section(errors={**ERRORS, **changed}).all(Claim)
    assert not claims[number].confirmed


def test_a_method_that_is_better_at_one_k_only_is_not_better_than_all() -> None:
    claim = section(errors={**ERRORS, (MPPI, LOW): 0.05}).all(Claim)[5]
    assert claim.confirmed
    assert claim.evidence.endswith("none.")


@pytest.mark.parametrize("k", SUITE.size.budgets)
@pytest.mark.parametrize("other", PAPER_ENTRANTS[1:])
def test_the_claim_on_stuck_steps_fails_where_another_has_fewer(other: Entrant, k: int) -> None:
    claim = section(stuck={**STUCK, (other, k): 9}).all(Claim)[4]
    assert not claim.confirmed
    assert f"{other.label} 9.0" in claim.evidence


def test_a_lead_in_doubt_does_not_count() -> None:
    """Nearer on two sequences of three."""

    def answer(question: Question) -> Answer:
        ahead = question.labels["entrant"] == PAPER_DIFFUSION.label
        error = 0.2 - 0.1 * ahead + 0.3 * (ahead and question.labels["task"] == 0)
        return sequence_answer(error)

    assert not section_of(SUITE, answer).all(Claim)[0].confirmed
