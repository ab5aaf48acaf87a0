"""Random machines: the same tasks for everybody on each, and those out of reach left out."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
import pytest
from matplotlib.container import ErrorbarContainer

from app.evaluation.answer_log import Answer
from app.evaluation.entrants import (
    CEM,
    DATASET_PRIOR,
    DIFFUSION,
    ENTRANTS,
    ICEM,
    PAPER_DIFFUSION,
    REFINED_PRIOR,
)
from app.evaluation.question import Question
from app.evaluation.suite import Claim, Picture, Section, Table
from app.evaluation.suites.random_machines import ARRIVAL, LEARNED, RandomMachines
from app.evaluation.tasks import machine_tasks, scale_of
from app.planning.plant.machines import MACHINES, Machine
from tests.evaluation.synthetic import assert_asked_alike, plan_answer, split

SUITE = RandomMachines(seed=3, quick=True)
TASKS = 8
FLOOR = 0.7
REFINED_GAP = 1e-9
ERRORS = {CEM.label: 0.5, ICEM.label: 0.125, DIFFUSION.label: 0.0625}
SERVO_REACH = scale_of(MACHINES["servo"].system).reach


def section(
    missed: str = "",
    unreachable: dict[str, int] | None = None,
    compute_ms: float = 1.0,
    diffusion_on_servo: float = 1.0,
    covered: Sequence[str] = ("paper",),
) -> Section:
    """Errors are shares of the reach, 0.25 or `ERRORS`, and refined none but on `missed`.

    Models cover the machines in `covered`. The first task is out of reach; of the machines in
    `unreachable` the first so many are.
    """

    def answer(question: Question) -> Answer:
        machine, entrant = str(question.labels["machine"]), question.labels["entrant"]
        gap = ERRORS.get(str(entrant), 0.25) * scale_of(MACHINES[machine].system).reach
        if machine == "servo" and entrant == DIFFUSION.label:
            gap *= diffusion_on_servo
        if question.plan.refine:
            gap = 2 * ARRIVAL if machine == missed else REFINED_GAP
        floor = FLOOR * (int(question.labels["task"]) < (unreachable or {}).get(machine, 1))
        given = plan_answer(gap, compute_ms=compute_ms)
        reachability = {"floor": floor, "reachable": not floor}
        content = {"terminal_error": floor + gap, "reachability": reachability}
        return Answer({**given.content, **content}, given.latency_ms)

    return SUITE.section(
        (question, answer(question))
        for question in SUITE.questions()
        if not question.if_covered or question.labels["machine"] in covered
    )


def cells(table: Table, first: str) -> dict[str, str]:
    (row,) = (row for row in table.rows if row[0] == first)
    return dict(zip(table.headings, row, strict=True))


def by_part(section: Section) -> dict[str, Table]:
    return {table.part: table for table in section.all(Table)}


@pytest.mark.parametrize("machine", MACHINES.values(), ids=list(MACHINES))
def test_everybody_on_a_machine_gets_its_tasks_and_the_same_seeds(machine: Machine) -> None:
    tasks = machine_tasks(machine.system)(TASKS, SUITE.seed)
    number = len(ENTRANTS) - (0 if machine.name == "paper" else 1)
    assert_asked_alike(SUITE, tasks, number, machine=machine.name)
    assert not any(question.trajectories for question in SUITE.questions())


def test_two_hundred_tasks_at_both_k_and_the_quick_evaluation_asks_some_of_them() -> None:
    whole = {question.key: question for question in RandomMachines(seed=3).questions()}
    quick = {question.key for question in SUITE.questions()}
    assert len(whole) == 200 * 2 * (6 * len(ENTRANTS) - 5)
    assert {question.plan.num_candidates for question in whole.values()} == {16, 128}
    assert quick < whole.keys()
    assert quick.isdisjoint(question.key for question in RandomMachines(4, quick=True).questions())


def test_the_paper_s_model_is_asked_for_its_plant_alone_and_others_for_what_they_cover() -> None:
    asked: dict[str, set[tuple[str, bool]]] = defaultdict(set)
    for question in SUITE.questions():
        asked[str(question.labels["entrant"])].add(
            (str(question.labels["machine"]), question.if_covered)
        )
    assert asked.pop(PAPER_DIFFUSION.label) == {("paper", False)}
    for entrant in LEARNED:
        assert asked.pop(entrant.label) == {(machine, True) for machine in MACHINES}
    for machines in asked.values():
        assert machines == {(machine, False) for machine in MACHINES}


@pytest.mark.parametrize(
    ("gap", "arrives"),
    [(-1e-8, True), (0.0, True), (ARRIVAL, True), (float(np.nextafter(ARRIVAL, 1)), False)],
)
def test_a_plan_arrives_by_its_gap_in_the_machine_s_units(gap: float, arrives: bool) -> None:
    question = next(each for each in SUITE.questions() if each.labels["machine"] == "servo")
    (row,) = SUITE.rows(question, plan_answer(gap))
    assert row["arrives"] == arrives
    assert row["relative_gap"] == row["relative_error"] == gap / SERVO_REACH


def test_the_main_table_has_who_arrives_by_machine_and_nothing_where_a_method_has_no_model() -> (
    None
):
    table = by_part(section(missed="emps"))[""]
    assert table.headings == ("Method", "K", *MACHINES)
    assert len(table.rows) == len(ENTRANTS)
    refined = cells(table, REFINED_PRIOR.label)
    assert (refined["paper"], refined["emps"], refined["servo"]) == ("100.0 %", "0.0 %", "100.0 %")
    assert set(cells(table, CEM.label).values()) == {CEM.label, "16", "0.0 %"}
    for entrant in (PAPER_DIFFUSION, *LEARNED):
        paper, *others = (cells(table, entrant.label)[machine] for machine in MACHINES)
        assert paper.endswith("%")
        assert not any(others)


def test_a_model_of_every_machine_takes_part_on_every_machine() -> None:
    found = section(covered=list(MACHINES))
    table = by_part(found)[""]
    assert (
        f"{DIFFUSION.label} takes part where a model covers the machine (paper, emps,"
        in (found.all(str)[0])
    )
    for entrant in LEARNED:
        assert all(cells(table, entrant.label)[machine].endswith("%") for machine in MACHINES)
    assert len(by_part(found)["servo"].rows) == len(ENTRANTS) - 1
    assert "(on none)" in section(covered=()).all(str)[0]


def test_tasks_out_of_reach_are_counted_and_left_out() -> None:
    tables = by_part(section(unreachable={"servo": 3, "emps": 0}))
    counted = tables["machines"]
    assert cells(counted, "paper")["Reachable"] == "7 of 8"
    assert cells(counted, "emps")["Reachable"] == "8 of 8"
    assert cells(counted, "servo") == {
        "Machine": "servo",
        "Horizon (s)": "0.32",
        "Unit": "rad",
        "Reach": "2.578",
        "Speed (1/s)": "8.577",
        "Reachable": "5 of 8",
    }
    assert "the 5 reachable tasks" in tables["servo"].caption
    # With the floor of those out of reach the mean error would be higher.
    assert cells(tables["servo"], CEM.label)["Error"] == "0.5000 ± 0.0000"


def test_a_machine_s_table_has_errors_over_its_reach_and_paired_differences_to_cem() -> None:
    table = by_part(section())["rack-and-pinion"]
    assert "`rack_and_pinion`, a servo press rig" in table.caption
    assert len(table.rows) == len(ENTRANTS) - 1 - len(LEARNED)
    assert cells(table, DATASET_PRIOR.label) == {
        "Method": DATASET_PRIOR.label,
        "K": "16",
        "Error": "0.2500 ± 0.0000",
        "Less CEM (40 it.)": "-0.2500 [-0.2500, -0.2500]",
        "Gap": "2.5e-01",
    }
    assert cells(table, CEM.label)["Less CEM (40 it.)"] == ""
    assert cells(table, REFINED_PRIOR.label)["Gap"] == "5.5e-09"


def test_there_is_no_table_of_no_tasks() -> None:
    tables = by_part(section(unreachable={"servo": TASKS}))
    assert "servo" not in tables
    assert cells(tables["machines"], "servo")["Reachable"] == "0 of 8"
    assert cells(tables[""], CEM.label)["servo"] == ""


def test_the_claim_is_confirmed_if_every_refined_plan_arrives_on_every_machine() -> None:
    (held,) = section().all(Claim)
    assert held.confirmed
    assert "servo 7 of 7, at most 1.0e-09" in held.evidence
    (failed,) = section(missed="servo").all(Claim)
    assert not failed.confirmed
    assert "emps 7 of 7" in failed.evidence
    assert "servo 0 of 7, at most 2.0e-06" in failed.evidence


def test_the_lead_without_refinement_is_over_the_next_method_on_every_machine() -> None:
    _, held = section(covered=list(MACHINES)).all(Claim)
    assert held.confirmed
    assert f"servo -0.0625 [-0.0625, -0.0625] ({ICEM.label})" in held.evidence
    _, failed = section(diffusion_on_servo=3.0, covered=list(MACHINES)).all(Claim)
    assert not failed.confirmed
    assert f"servo +0.0625 [+0.0625, +0.0625] ({ICEM.label})" in failed.evidence


def test_the_same_answers_make_the_same_tables_and_times_stand_apart() -> None:
    (results, times), (again, later) = split(section()), split(section(compute_ms=70))
    assert results == again
    assert times != later
    assert cells(later[0], CEM.label)["servo"] == "70.0"


def test_the_picture_has_a_point_for_each_method_on_each_machine_that_it_plans_for() -> None:
    (axes,) = section().all(Picture)[0].figure.axes
    drawn = {}
    for container in axes.containers:
        assert isinstance(container, ErrorbarContainer)
        drawn[container.get_label()] = np.asarray(container.lines[0].get_ydata())
    assert list(drawn) == [entrant.label for entrant in ENTRANTS]
    np.testing.assert_allclose(drawn[CEM.label], [0.5] * 6)
    # What is lower stands at a millionth.
    np.testing.assert_allclose(drawn[REFINED_PRIOR.label], [1e-6] * 6)
    for entrant in (PAPER_DIFFUSION, *LEARNED):
        assert np.isnan(drawn[entrant.label]).tolist() == [False] + [True] * 5
