"""Figure 3: all points in turn within a run, and claims on who is nearer and faster."""

from functools import cache

import numpy as np
import pytest

from app.evaluation.answer_log import Answer
from app.evaluation.entrants import DIFFUSION, PAPER_DIFFUSION, REFINED_PRIOR
from app.evaluation.question import Question
from app.evaluation.suite import Claim, Picture, Section, Table
from app.evaluation.suites.error_compute import ITERATIONS, POINTS, ErrorCompute
from tests.evaluation.synthetic import assert_asked_alike, plan_answer, section_of, split

SUITE = ErrorCompute(seed=3, quick=True)
LOW, HIGH = SUITE.size.budgets

Point = tuple[float, float]
"""Error (m) and time (ms)."""
CEM_AT_BEST = {("CEM", LOW): (0.3, 40.0), ("CEM", HIGH): (0.02, 400.0)}
OTHERS = {
    (PAPER_DIFFUSION.label, LOW): (0.01, 12.5),
    (PAPER_DIFFUSION.label, HIGH): (0.001, 50.0),
    (REFINED_PRIOR.label, LOW): (1e-16, 1.0),
    (REFINED_PRIOR.label, HIGH): (1e-16, 2.0),
}
WORLD: dict[tuple[str, int], Point] = CEM_AT_BEST | OTHERS
"""A world in which all is as the paper says; CEM's error and time go with its iterations."""


def section(world: dict[tuple[str, int], Point] = WORLD, slower: float = 1) -> Section:
    def answer(question: Question) -> Answer:
        labels = question.labels
        error, time = world.get(
            (str(labels["entrant"]), int(labels["num_candidates"])), (0.5, 1000.0)
        )
        if labels["iterations"]:
            done = int(labels["iterations"]) / ITERATIONS[-1]
            error, time = error / done, time * done
        return plan_answer(error * (1 + 0.1 * int(labels["run"])), compute_ms=slower * time)

    return section_of(SUITE, answer)


@cache
def section_as_in_the_paper() -> Section:
    return section()


def test_every_point_gets_the_same_runs_and_the_runs_come_outermost() -> None:
    task = {"initial_state": (0.0, 0.0), "target_state": (0.5, 0.0)}
    assert_asked_alike(SUITE, [task], len(POINTS) * len(SUITE.size.budgets))
    runs = [question.labels["run"] for question in SUITE.questions()]
    assert runs == sorted(runs)


def test_cem_has_the_iterations_that_the_labels_say() -> None:
    for question in SUITE.questions():
        done = getattr(question.plan.method, "iterations", 40)
        assert done == (question.labels["iterations"] or 40)


def test_the_whole_evaluation_is_the_paper_s_in_size() -> None:
    whole = {question.key for question in ErrorCompute(seed=3).questions()}
    assert len(whole) == 2 * 30 * (15 + 5)


def test_a_row_for_each_point() -> None:
    errors, times = section_as_in_the_paper().all(Table)
    for table in (errors, times):
        assert len(table.rows) == len(POINTS)
        assert list(table.headings) == ["Method", "Iterations", "K = 16", "K = 32"]
    assert errors.rows[14] == ("CEM", "40", "0.3150 ± 0.0150", "0.0210 ± 0.0010")
    assert times.rows[14] == ("CEM", "40", "40.0 ± 0.0", "400.0 ± 0.0")
    assert errors.rows[15] == (PAPER_DIFFUSION.label, "", "0.0105 ± 0.0005", "0.0011 ± 0.0001")


def test_the_same_answers_make_the_same_tables_and_times_stand_apart() -> None:
    (results, times), (again, later) = split(section()), split(section(slower=70))
    assert results == again
    assert times != later


def test_all_points_are_drawn_and_tiny_errors_as_a_micrometre() -> None:
    (picture,) = section_as_in_the_paper().all(Picture)
    assert [axes.get_title() for axes in picture.figure.axes] == ["K = 16", "K = 32"]
    for axes in picture.figure.axes:
        drawn = np.concatenate([np.asarray(line.get_xydata()) for line in axes.lines])
        assert len(drawn) == len(POINTS)
        np.testing.assert_allclose(drawn[:, 1].min(), 1e-6)
        assert [text.get_text() for text in axes.texts] == ["1", "20", "40"]


def test_claims_hold_where_all_is_as_the_paper_says() -> None:
    claims = section_as_in_the_paper().all(Claim)
    assert [claim.confirmed for claim in claims] == [True] * 3
    assert claims[0].evidence == (
        "Action Diffusion (paper): 0.0105 m in 12.5 ms; CEM at its best, after 40 iterations: "
        "0.3150 m in 40.0 ms. Iterations with which CEM is no slower: 1, 2, 3, 4, 5, 6, 8, 10, 12; "
        "no worse: none; neither slower nor worse: none."
    )
    assert claims[2].evidence == (
        f"Nearer and faster than both: {REFINED_PRIOR.label} at K = 16; {REFINED_PRIOR.label} at "
        "K = 32."
    )


@pytest.mark.parametrize(
    ("number", "changed"),
    [
        (0, {(PAPER_DIFFUSION.label, LOW): (0.01, 45.0)}),
        (0, {(PAPER_DIFFUSION.label, LOW): (0.35, 12.5)}),
        (1, {("CEM", HIGH): (0.4, 400.0)}),
        (2, {(REFINED_PRIOR.label, HIGH): (1e-16, 60.0)}),
        (2, {(REFINED_PRIOR.label, LOW): (0.02, 1.0)}),
    ],
)
def test_a_claim_fails_where_the_points_lie_otherwise(
    number: int, changed: dict[tuple[str, int], Point]
) -> None:
    assert not section(WORLD | changed).all(Claim)[number].confirmed


def test_cem_s_points_that_are_as_good_are_named() -> None:
    claim = section(WORLD | {("CEM", LOW): (0.005, 10.0)}).all(Claim)[0]
    assert not claim.confirmed
    assert claim.evidence.endswith(
        "no worse: 20, 25, 30, 35, 40; neither slower nor worse: 20, 25, 30, 35, 40."
    )


def test_any_other_method_may_dominate() -> None:
    slow = {(REFINED_PRIOR.label, k): (1e-16, 9e3) for k in SUITE.size.budgets}
    fast = {(DIFFUSION.label, k): (1e-4, 5.0) for k in SUITE.size.budgets}
    claim = section(WORLD | slow | fast).all(Claim)[2]
    assert claim.confirmed
    assert f"{DIFFUSION.label} at K = 16; {DIFFUSION.label} at K = 32." in claim.evidence
