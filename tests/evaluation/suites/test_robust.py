"""Robust plans beside nominal ones: carried out on the same plants, which nobody planned with."""

import numpy as np
import pytest

from app.evaluation.answer_log import Answer
from app.evaluation.entrants import REFINED_PRIOR
from app.evaluation.question import Question
from app.evaluation.suite import Picture, Section, Table
from app.evaluation.suites.robust import DISPLACEMENTS, NUM_PLANTS, ROBUST, SETTINGS, Robust
from app.evaluation.tasks import reachable_tasks
from app.wire.requests import PlanRequest
from tests.evaluation.synthetic import section_of

SUITE = Robust(seed=3, quick=True)
TASKS = SUITE.size.tasks


def answer(question: Question, controls: float = 0.0) -> Answer:
    """Nothing moves."""
    content = {
        "controls": [controls] * int(question.labels["horizon"]),
        "robustness": {"rms_error": 0.03, "first_order_bound": 0.02},
        "timing_ms": {"queue": 1.0, "total": 6.0},
    }
    return Answer(content, 1.0)


@pytest.fixture(scope="module")
def section() -> Section:
    return section_of(SUITE, answer)


def test_everybody_gets_the_same_reachable_tasks_and_seeds_in_every_setting() -> None:
    tasks = reachable_tasks(TASKS, 3)
    seeds: dict[int, set[int | None]] = {}
    asked = 0
    for question in SUITE.questions():
        labels, request = question.labels, question.request
        assert isinstance(request, PlanRequest)
        if labels["displacement"]:
            continue
        task = int(labels["task"])
        assert request.initial_state == tasks[task]["initial_state"]
        assert request.target_state == tasks[task]["target_state"]
        assert request.horizon == labels["horizon"]
        seeds.setdefault(task, set()).add(request.seed)
        relative = request.uncertainty and request.uncertainty.relative
        assert (relative is None) == (labels["entrant"] == REFINED_PRIOR.label)
        if relative:
            assert relative.static_friction == relative.coulomb_friction == labels["off_by"]
            assert relative.control_gain == 0.05
        asked += 1
    assert asked == TASKS * len(SETTINGS) * 2
    assert all(len(of_task) == 1 for of_task in seeds.values())


def test_a_plan_is_carried_out_on_plants_that_are_the_same_for_everybody() -> None:
    plans = [question for question in SUITE.questions() if not question.labels["displacement"]]
    nominal, robust = plans[0], plans[TASKS]
    assert [q.labels["entrant"] for q in (nominal, robust)] == [REFINED_PRIOR.label, ROBUST.label]
    one, other = (
        [row["executed_error"] for row in SUITE.rows(question, answer(question, 0.9))]
        for question in (nominal, robust)
    )
    assert one == other
    assert len(set(one)) == NUM_PLANTS


def test_errors_and_the_shares_within_are_told_for_each_setting(section: Section) -> None:
    *settings, bound = section.all(Table)
    assert [table.part for table in settings] == ["10-64", "20-64", "10-128"]
    for table in settings:
        (row,) = (row for row in table.rows if row[0] == ROBUST.label)
        cells = dict(zip(table.headings, row, strict=True))
        assert cells["Less nominal"].startswith("+0.0000")
        assert cells["Time (ms)"] == "5.0"
    assert [row[0] for row in bound.rows] == [ROBUST.label]
    assert bound.rows[0][1:] == ("1.50",) * len(DISPLACEMENTS)
    (picture,) = section.all(Picture)
    assert len(picture.figure.axes) == len(SETTINGS)


def test_tasks_are_at_rest_at_the_end_and_within_reach() -> None:
    tasks = reachable_tasks(20, 0)
    assert tasks[:5] == reachable_tasks(5, 0)
    assert all(task["target_state"][1] == 0.0 for task in tasks)
    assert np.std([task["initial_state"][1] for task in tasks]) > 0.1
