"""Figure 1: one question with its candidates, their shares and the shape of the selected plan."""

from functools import cache

import numpy as np
import pytest

from app.evaluation.answer_log import Answer
from app.evaluation.question import Question
from app.evaluation.suite import Claim, Picture, Section, Table
from app.evaluation.suites.single_target import SingleTarget
from app.evaluation.tasks import request_seed
from app.wire.answers import CandidatesReport
from app.wire.requests import PlanRequest
from tests.evaluation.fakes import answer_to
from tests.evaluation.synthetic import section_of

SUITE = SingleTarget(seed=3, quick=True)
ERRORS = (0.005, 0.04, 0.09, 0.2)
CONTROLS = (0.9, 0.8, -0.2, 0.1)


def section(errors: tuple[float, ...] = ERRORS, controls: tuple[float, ...] = CONTROLS) -> Section:
    def answer(question: Question) -> Answer:
        assert isinstance(question.request, PlanRequest)
        candidates = CandidatesReport(
            controls=[list(controls)] * len(errors), terminal_errors=list(errors)
        )
        plan = answer_to(question.request).model_copy(
            update={"controls": list(controls), "states": None, "candidates": candidates}
        )
        return Answer(plan.model_dump(mode="json", exclude_none=True), latency_ms=1.0)

    return section_of(SUITE, answer)


@cache
def section_as_in_the_paper() -> Section:
    return section()


@pytest.mark.parametrize(("quick", "num_candidates"), [(True, 32), (False, 512)])
def test_one_plan_is_asked_for_with_its_candidates_but_not_their_states(
    quick: bool, num_candidates: int
) -> None:
    (question,) = SingleTarget(seed=3, quick=quick).questions()
    request = question.request
    assert isinstance(request, PlanRequest)
    assert question.trajectories
    assert request.include == ["candidates"]
    assert request.num_candidates == num_candidates
    assert request.seed == request_seed(3, 0, 0)
    assert (request.initial_state, request.target_state) == ((0.0, 0.0), (0.2, 0.0))


def test_the_table_counts_candidates_by_their_distance() -> None:
    (table,) = section_as_in_the_paper().all(Table)
    assert table.rows == [("4", "25 %", "50 %", "75 %", "0.065", "0.0050")]
    assert {len(row) for row in table.rows} == {len(table.headings)}


def test_candidates_and_plan_are_drawn_over_time() -> None:
    (picture,) = section_as_in_the_paper().all(Picture)
    controls, position, velocity = picture.figure.axes
    assert len(controls.lines) == len(ERRORS) + 1
    np.testing.assert_array_equal(controls.lines[-1].get_ydata(), [*CONTROLS, CONTROLS[-1]])
    labels = [axes.get_ylabel() for axes in (controls, position, velocity)]
    assert labels == ["control (m/s²)", "position (m)", "velocity (m/s)"]


def test_claims_hold_where_all_is_as_the_paper_says() -> None:
    concentration, crossing = section_as_in_the_paper().all(Claim)
    assert concentration.confirmed
    assert "25 % within 0.01 m, 50 % within 0.05 m, 75 % within 0.1 m" in concentration.evidence
    assert crossing.confirmed
    assert crossing.evidence == (
        "The first 2 of 4 controls exceed 0.7 m/s²; 2 of the others are no stronger than that, "
        "and the least of all is -0.20 m/s²."
    )


def test_candidates_of_which_half_end_further_away_are_not_many() -> None:
    assert not section(errors=(0.005, 0.09, 0.11, 0.2)).all(Claim)[0].confirmed


@pytest.mark.parametrize("controls", [(0.7, 0.9, -0.2, 0.1), (0.9, 0.9, 0.9, 0.9)])
def test_a_plan_that_starts_weak_or_never_lets_go_is_no_threshold_crossing(
    controls: tuple[float, ...],
) -> None:
    assert not section(controls=controls).all(Claim)[1].confirmed
