"""Learned models side by side, nominal and robust, and plain searches beside the robust one."""

from collections.abc import Collection

import pytest

from app.evaluation.answer_log import Answer
from app.evaluation.contests import SEARCH, SEARCHES
from app.evaluation.question import Question
from app.evaluation.suite import Claim, Picture, Section, Table
from app.evaluation.suites.learned_models import (
    CONTESTS,
    MODELS,
    OFF_BY,
    REGRESSION,
    LearnedModels,
)
from app.evaluation.suites.robust import LONG_HORIZON
from app.planning.problem import DEFAULT_HORIZON
from app.planning.uncertainty.uncertainty import FEW_MOTIONS
from app.wire.requests import PlanRequest

SUITE = LearnedModels(seed=3, quick=True)
ROBUST = {contest.model.label for contest in CONTESTS}


def horizon_of(question: Question) -> int:
    assert isinstance(question.request, PlanRequest)
    return question.request.horizon or DEFAULT_HORIZON


def section(control: float = 0.0, without: Collection[str] = ()) -> Section:
    """Nothing moves but where a robust model plans; a search takes a millisecond a motion."""

    def answer(question: Question) -> Answer:
        labels = question.labels
        is_search = labels["entrant"] == SEARCH.label
        content = {
            "controls": [control if labels["entrant"] in ROBUST else 0.0] * horizon_of(question),
            "diversity": 0.25,
            "cost": {"network_evaluations": 0 if is_search else 3},
            "timing_ms": {
                "queue": 1.0,
                "total": 1.0 + (int(labels["motions"]) if is_search else 300),
            },
        }
        return Answer(content, 1.0)

    return SUITE.section(
        (question, answer(question))
        for question in SUITE.questions()
        if question.labels["entrant"] not in without
    )


def test_models_are_asked_by_name_and_left_out_where_there_is_none() -> None:
    for question in SUITE.questions():
        is_search = question.labels["entrant"] == SEARCH.label
        assert question.if_covered == (not is_search)
        assert (question.plan.model is None) == is_search


def test_uncertainty_is_asked_for_as_the_labels_say() -> None:
    for question in SUITE.questions():
        request, labels = question.request, question.labels
        assert isinstance(request, PlanRequest)
        assert bool(request.uncertainty) == bool(labels["off_by"])
        assert (request.refine is not None) == labels["refined"]
        if request.uncertainty and labels["refined"]:
            assert request.uncertainty.num_motions == labels["motions"]
            assert request.uncertainty.relative is not None
            assert request.uncertainty.relative.coulomb_friction == labels["off_by"]


def test_each_level_has_a_row_for_each_model_and_k() -> None:
    tables = section().all(Table)[: len(OFF_BY)]

    assert [table.part for table in tables] == ["0", "10", "20"]
    for table in tables:
        assert len(table.rows) == len(MODELS) * len(SUITE.size.budgets)
        cells = dict(zip(table.headings, table.rows[0], strict=True))
        assert cells["Diversity"] == "0.250"
        assert cells["ms"] == "300.0"


def test_plain_searches_stand_beside_the_model_in_each_setting() -> None:
    searches = section().all(Table)[len(OFF_BY) :]

    for table, contest in zip(searches, CONTESTS, strict=True):
        assert str(contest) in table.caption
        assert table.rows[0][:2] == (contest.model.label, str(FEW_MOTIONS))
        assert [row[1] for row in table.rows[1:]] == [str(motions) for motions in SEARCHES]


@pytest.mark.parametrize("control", [0.0, 0.9])
def test_the_verdict_is_against_the_largest_search_that_takes_no_longer(control: float) -> None:
    for claim in section(control).all(Claim):
        assert "the search of 256 motions 256.0" in claim.evidence
        assert not claim.confirmed or control


def test_contests_are_asked_for_their_own_horizon() -> None:
    for question in SUITE.questions():
        steps = LONG_HORIZON if "128 steps" in str(question.labels["contest"]) else DEFAULT_HORIZON
        assert horizon_of(question) == steps


def test_a_store_without_the_robust_model_gives_no_verdict() -> None:
    without = section(without=ROBUST)

    assert without.all(Claim) == []
    assert REGRESSION.label in {row[0] for row in without.all(Table)[0].rows}


def test_the_figure_has_a_line_for_each_model_and_one_for_the_search() -> None:
    (picture,) = section().all(Picture)

    assert [len(axes.lines) for axes in picture.figure.axes] == [len(MODELS) + 1] * 2
