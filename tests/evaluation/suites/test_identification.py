"""The identification suite: logs that are the same for everybody, compared with what is true."""

from dataclasses import asdict
from typing import Any

import pytest

from app.evaluation.answer_log import Answer
from app.evaluation.logs import draw_machine
from app.evaluation.question import Question
from app.evaluation.suite import Claim, Picture, Table
from app.evaluation.suites.identification import PARAMETERS, RECORDINGS, STANDARD, Identification
from app.planning.plant.system import System
from app.wire.identification import IdentifyRequest
from tests.evaluation.synthetic import section_of

SUITE = Identification(seed=3, quick=True)


def found(question: Question, off_by: float = 0.0) -> Answer:
    """An answer that is the truth, or beside it, in intervals of 0.01; its ensemble is far off."""
    machine = draw_machine(RECORDINGS[STANDARD], 3, int(question.labels["task"]))
    parameters: list[dict[str, Any]] = []
    for name in PARAMETERS:
        value = getattr(machine, name) + off_by
        interval = [value - 0.01, value + 0.01]
        parameters.append(
            {"name": name, "value": value, "interval": interval, "identifiable": True}
        )
    content = {
        "parameters": parameters,
        "delay_steps": 0,
        "position_lag": 0.0,
        "system": asdict(machine),
        "systems": [asdict(System())],
        "timing_ms": {"queue": 1.0, "total": 301.0},
    }
    return Answer(content, 400.0)


def test_it_asks_for_logs_and_again_for_the_same_ones() -> None:
    once, again = list(SUITE.questions()), list(Identification(3, quick=True).questions())
    assert [question.key for question in once] == [question.key for question in again]
    assert len({question.key for question in once}) == len(once) == SUITE.size.tasks
    for question in once:
        assert isinstance(question.request, IdentifyRequest)
        assert len(question.request.controls) == 1000
        # A digest stands for thousands of numbers.
        assert len(question.body["request"]["positions"]) == 64


def test_a_perfect_answer_has_no_errors_and_plans_as_if_it_knew() -> None:
    (row,) = SUITE.rows(question := next(SUITE.questions()), found(question))
    assert all(row[name] == 0.0 for name in PARAMETERS)
    assert row["covered"] == row["told"] == 1.0
    assert row["planned"] == row["knowing"]
    assert row["nominal"] > row["knowing"]
    assert row["robust"] > row["knowing"]  # made for the nominal plant alone
    assert row["seconds"] == pytest.approx(0.3)


def test_errors_and_missed_intervals_are_counted() -> None:
    question = next(SUITE.questions())
    (row,) = SUITE.rows(question, found(question, off_by=0.02))
    assert row["coulomb_friction"] == pytest.approx(0.02)
    assert row["covered"] == 0.0


def test_the_section_says_what_was_claimed_and_what_came_of_it() -> None:
    section = section_of(SUITE, found)
    assert len(section.all(Table)) == 2
    assert len(section.all(Picture)) == 1
    claims = section.all(Claim)
    # 100 % is too many, and with an ensemble that is off robust plans are as well.
    assert [claim.confirmed for claim in claims] == [True, False, True, False]


@pytest.mark.parametrize("entrant", RECORDINGS)
def test_machines_differ_from_the_papers_and_from_each_other(entrant: Any) -> None:
    machines = [draw_machine(RECORDINGS[entrant], 0, number) for number in range(5)]
    assert len({repr(machine) for machine in machines}) == 5
    assert System() not in machines
