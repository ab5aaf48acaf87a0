"""Closed loops in an evaluation: everybody gets the same plants, noise and sensors."""

import numpy as np
import pytest

from app.evaluation.answer_log import Answer
from app.evaluation.circumstances import CIRCUMSTANCES, STEPS
from app.evaluation.closed_machines import WITHOUT_SCALE
from app.evaluation.controllers import CLOSED, RECEDING_IDENTIFYING, SWITCHING, tuned
from app.evaluation.question import Question
from app.evaluation.suite import Picture, Section, Table
from app.evaluation.suites.closed_loop import CELLS, OPEN, ClosedLoop
from app.planning.plant.machines import MACHINES
from app.planning.plant.system import ByDirection, System
from app.wire.requests import PlanRequest
from app.wire.simulation import SimulateRequest
from tests.evaluation.synthetic import section_of

SUITE = ClosedLoop(seed=3, quick=True)
TARGET_MISSED = 0.002


def answer(question: Question) -> Answer:
    """A run that rests a little off its target from step 40 on; a plan that does nothing."""
    timing = {"timing_ms": {"queue": 1.0, "total": 1.0 + STEPS * 2e-3}}
    request = question.request
    if isinstance(request, PlanRequest):
        return Answer({"controls": [0.0] * 64, **timing}, 1.0)
    assert isinstance(request, SimulateRequest)
    assert request.target_state
    off = 0.0 if question.labels["entrant"] == RECEDING_IDENTIFYING.label else TARGET_MISSED
    run = {
        "states": [[request.target_state[0] + off, 0.0] for _ in question.kept_steps],
        "settling_step": 40,
        "hunting": False,
        "control_energy": 20.0,
    }
    return Answer({"runs": [run], **timing}, 1.0)


@pytest.fixture(scope="module")
def section() -> Section:
    return section_of(SUITE, answer)


def test_all_controllers_meet_the_same_machines_noise_and_sensors() -> None:
    met: dict[tuple[object, ...], set[str]] = {}
    for question in SUITE.questions():
        request, labels = question.request, question.labels
        if not isinstance(request, SimulateRequest) or "machine" in labels:
            continue
        place = (labels["off_by"], labels["circumstances"], labels["task"], labels["run"])
        machine = request.model_dump_json(exclude={"controller", "steps_left"})
        met.setdefault(place, set()).add(machine)
        assert request.system != request.nominal_system == System()
    assert len(met) == len(CELLS) * SUITE.size.tasks * SUITE.size.runs
    assert all(len(machines) == 1 for machines in met.values())


def test_real_machines_are_controlled_by_a_model_that_knows_less_of_them() -> None:
    asked = [q for q in SUITE.questions() if "machine" in q.labels]

    assert {q.labels["machine"] for q in asked} == set(MACHINES) - {"paper"}
    assert {q.labels["entrant"] for q in asked} == {
        entrant.label for entrant in SUITE.size.entrants if entrant in WITHOUT_SCALE
    }
    for question in asked:
        request, machine = question.request, MACHINES[str(question.labels["machine"])]
        assert isinstance(request, SimulateRequest)
        assert request.system == machine.system
        assert request.nominal_system
        assert not isinstance(request.nominal_system.viscous_damping, ByDirection)
        assert request.delay_steps == machine.delay_steps


def test_open_loops_are_planned_for_the_plants_that_may_be_and_run_on_the_same() -> None:
    plans = [q for q in SUITE.questions() if isinstance(q.request, PlanRequest)]
    nominal, robust = (
        [q for q in plans if q.labels["entrant"] == entrant.label] for entrant in OPEN
    )

    assert len(nominal) == len(robust) == 2 * SUITE.size.tasks
    assert all(q.plan.uncertainty is None for q in nominal)
    assert all(q.plan.uncertainty is not None for q in robust)
    rows = [[row["final_mm"] for row in SUITE.rows(q, answer(q))] for q in (nominal[0], robust[0])]
    assert rows[0] == rows[1]
    assert len(rows[0]) == SUITE.size.runs


@pytest.mark.parametrize("circumstances", CIRCUMSTANCES)
def test_every_controller_has_settings_and_an_observer_that_knows_the_noise(
    circumstances: str,
) -> None:
    given = CIRCUMSTANCES[circumstances]
    for entrant in CLOSED:
        controller, steps_left = tuned(entrant, circumstances)
        assert steps_left is None or 0 < steps_left <= 64
        if controller.observer:
            assert controller.observer.position_noise == given.sensor.position_noise
            assert controller.observer.acceleration_noise >= given.disturbance.acceleration_noise
        else:
            assert given.sensor.measures_velocity


def test_tables_have_what_runs_are_worth(section: Section) -> None:
    tables = section.all(Table)

    assert len(tables) == len(CELLS) + len(MACHINES) - 1
    rows = {row[0]: row[1:] for row in tables[1].rows}
    assert rows[SWITCHING.label] == (
        *("2.00", "100.0 %", "", "2.000", "100.0 %", "2.00", "0.0 %", "20.0", "2.0"),
    )
    assert rows[RECEDING_IDENTIFYING.label][0] == "0.00"
    assert rows[RECEDING_IDENTIFYING.label][2] == "+0.000 [+0.000, +0.000]"
    assert OPEN[0].label in rows
    assert OPEN[0].label not in {row[0] for row in tables[len(CELLS) - 1].rows}
    emps = next(table for table in tables if "`emps`" in table.caption)
    found = {row[0]: row[1:] for row in emps.rows}
    assert found[RECEDING_IDENTIFYING.label][:2] == ("0.00", "100.0 %")
    assert found[SWITCHING.label][4] == "0.40"  # steps of 10 ms


def test_it_says_where_a_law_does_as_well(section: Section) -> None:
    (words,) = (part for part in section.parts if isinstance(part, str) and "best of the" in part)

    assert SWITCHING.label in words
    assert "0 % less energy" in words


def test_the_figure_sets_open_and_closed_loops_side_by_side(section: Section) -> None:
    (picture,) = section.all(Picture)
    panels = picture.figure.axes

    assert len(panels) == 4
    assert all(len(panel.lines) == SUITE.size.runs + 2 for panel in panels)
    shown = np.array(panels[3].lines[0].get_xydata())
    assert len(shown) == STEPS + 1
