"""Random machines with a task each: gaps as shares of what is within each machine's reach."""

import numpy as np
import pytest

from app.evaluation.answer_log import Answer
from app.evaluation.entrants import DIFFUSION, MPPI
from app.evaluation.question import Question
from app.evaluation.suite import Claim, Picture, Section, Table
from app.evaluation.suites.any_machine import ENTRANTS, AnyMachine
from app.evaluation.tasks import Task, random_machine_tasks, scale_of
from app.planning.plant.system import System
from tests.evaluation.synthetic import assert_asked_alike, plan_answer

SUITE = AnyMachine(seed=3, quick=True)


def section(median: float = 0.001, worst: float = 0.01, covered: bool = True) -> Section:
    """The learned model's gap over the reach is `median`, `worst` on the last two; MPPI's 0.25."""

    def answer(question: Question) -> Answer:
        system = question.plan.system
        assert isinstance(system, System)
        share = 0.25
        if question.labels["entrant"] == DIFFUSION.label:
            share = worst if int(question.labels["task"]) >= 6 else median
        return plan_answer(share * scale_of(system).reach, compute_ms=2.0)

    return SUITE.section(
        (question, answer(question))
        for question in SUITE.questions()
        if covered or not question.if_covered
    )


def test_everybody_is_asked_for_the_same_machines_and_tasks() -> None:
    assert_asked_alike(SUITE, random_machine_tasks(8, 3), len(ENTRANTS) * 2)
    assert {q.if_covered for q in SUITE.questions() if q.labels["entrant"] == MPPI.label} == {False}


def test_gaps_are_shares_of_the_reach() -> None:
    main, *_ = section().all(Table)

    rows = {tuple(row[:2]): row[2:] for row in main.rows}
    assert rows[DIFFUSION.label, "4"][:4] == ("0.10", "1.00", "1.00", "0.33")
    assert rows[MPPI.label, "1"][:4] == ("25.00", "25.00", "25.00", "25.00")
    assert rows[MPPI.label, "1"][4] == "2.0"


@pytest.mark.parametrize(
    ("median", "worst", "holds"),
    [(0.005, 0.02, True), (0.006, 0.02, False), (0.001, 0.021, False)],
)
def test_the_claim_is_of_the_median_and_of_nine_in_ten(
    median: float, worst: float, holds: bool
) -> None:
    (claim,) = section(median, worst).all(Claim)

    assert claim.confirmed is holds
    assert "K = 4" in claim.statement


def test_a_service_without_a_model_for_them_has_the_other_methods_alone() -> None:
    without = section(covered=False)

    assert without.all(Claim) == []
    assert {row[0] for row in without.all(Table)[0].rows} == {e.label for e in ENTRANTS[1:]}


def test_the_figure_has_a_panel_for_each_k_and_a_line_for_each_method() -> None:
    (picture,) = section().all(Picture)

    panels = picture.figure.axes
    assert [panel.get_title() for panel in panels] == ["K = 1", "K = 4"]
    assert all(len(panel.patches) == len(ENTRANTS) for panel in panels)


def test_machines_are_told_apart_by_what_static_friction_takes() -> None:
    _, by_class = section().all(Table)
    classes = [system_class(task) for task in random_machine_tasks(8, 3)]

    row = dict(zip(by_class.headings, by_class.rows[0], strict=True))
    for low, heading in ((0.0, "0% to 30%"), (0.3, "30% to 60%"), (0.6, "60% to 100%")):
        assert (row[heading] != "") == (low in classes)


def system_class(task: Task) -> float:
    plant = task["system"].plant
    friction = max(plant.static_forward, plant.static_backward)
    share = friction / (plant.control_gain * plant.highest_control)
    return (0.0, 0.3, 0.6)[int(np.searchsorted([0.3, 0.6], share, side="right"))]
