"""Plans on other plants than theirs: the executed errors are those of the physics."""

import numpy as np
import pandas as pd
import pytest

from app.evaluation.answer_log import Answer
from app.evaluation.entrants import CEM, DATASET_PRIOR
from app.evaluation.question import Entrant, Question
from app.evaluation.suite import Picture, Section, Table
from app.evaluation.suites.plant_sensitivity import (
    CHANGES,
    NOMINAL,
    PARAMETERS,
    PLANTS,
    ROBUST,
    TESTED,
    PlantSensitivity,
    changed_plant,
)
from app.evaluation.suites.random_targets import RandomTargets
from app.planning.arrays import FloatArray
from app.planning.methods import ActionDiffusion
from app.planning.planner import plan
from app.planning.problem import Problem
from app.planning.recipe import Recipe
from app.planning.refining.refinement import Refinement
from app.wire.requests import PlanRequest
from tests.evaluation.synthetic import assert_asked_alike

SUITE = PlantSensitivity(seed=3, quick=True)
DT = NOMINAL.time_step
Plant = tuple[str, int]


def executed(
    controls: FloatArray, start: tuple[float, float], target: tuple[float, float]
) -> dict[Plant, float]:
    """The executed error of a plan on each plant."""
    request = PlanRequest(initial_state=start, target_state=target)
    answer = Answer({"controls": list(controls), "reachability": {"floor": 0.0}}, 1.0)
    rows = SUITE.rows(Question({}, request, trajectories=True), answer)
    return {(row["parameter"], row["change"]): row["executed_error"] for row in rows}


def section(errors: dict[tuple[Entrant, Plant], float]) -> Section:
    """All executed errors that are not given are 0.01 m, the first task's is 0.03 m more."""
    rows = [
        {
            "entrant": entrant.label,
            "task": task,
            "parameter": plant[0],
            "change": plant[1],
            "executed_error": errors.get((entrant, plant), 0.01) + 0.03 * (task == 0),
            "nominal_floor": 0.005,
        }
        for entrant in TESTED
        for task in range(SUITE.size.tasks)
        for plant in PLANTS
    ]
    data = pd.DataFrame(rows)
    return Section(SUITE.name, SUITE.title, list(SUITE.report(data)), data)


def test_everybody_gets_the_first_random_transitions_with_the_same_seeds() -> None:
    elsewhere = RandomTargets(seed=3, quick=True)
    tasks = elsewhere.draw_tasks(elsewhere.size.tasks, elsewhere.seed)[: SUITE.size.tasks]
    nominal = [{**task, "include": [], "system": None} for task in tasks]
    assert_asked_alike(SUITE, nominal, len(TESTED))
    assert all(question.trajectories for question in SUITE.questions())


def test_two_hundred_tasks_at_k_32() -> None:
    questions = list(PlantSensitivity(seed=3).questions())
    assert len({question.key for question in questions}) == 200 * len(TESTED)
    assert {question.plan.num_candidates for question in questions} == {32}


def test_kinetic_friction_never_exceeds_static_friction() -> None:
    lower = changed_plant("static_friction", -20)
    assert lower.static_friction == lower.coulomb_friction == pytest.approx(0.56)
    higher = changed_plant("coulomb_friction", 20)
    assert higher.static_friction == higher.coulomb_friction == pytest.approx(0.72)


def test_elsewhere_one_parameter_alone_differs() -> None:
    coupled = {("nominal", 0), ("static_friction", -20), ("coulomb_friction", 20)}
    assert len(PLANTS) == 1 + len(PARAMETERS) * len(CHANGES)
    for (parameter, change), plant in PLANTS.items():
        if (parameter, change) not in coupled:
            values = {name: getattr(plant, name) / getattr(NOMINAL, name) for name in PARAMETERS}
            assert values == pytest.approx(
                dict.fromkeys(PARAMETERS, 1.0) | {parameter: 1 + change / 100}
            )


@pytest.mark.parametrize("refinement", [None, Refinement()])
@pytest.mark.parametrize("entrant", [DATASET_PRIOR, CEM])
def test_on_the_nominal_plant_the_executed_error_is_the_planned_one(
    entrant: Entrant, refinement: Refinement | None
) -> None:
    start, target = (0.1, -0.3), (0.4, 0.2)
    method = PlanRequest(initial_state=start, target_state=target, **entrant.fields).method
    problem = Problem(np.array(start), np.array(target))
    assert not isinstance(method, ActionDiffusion)
    planned = plan(problem, Recipe(method, 16, refinement), np.random.default_rng(0))
    assert executed(planned.controls, start, target)["nominal", 0] == planned.terminal_error


def test_a_plan_below_the_true_static_friction_moves_nothing() -> None:
    errors = executed(np.full(10, 0.75), (0.0, 0.0), (0.3, 0.0))
    assert errors["static_friction", 10] == errors["static_friction", 20] == pytest.approx(0.3)
    assert errors["nominal", 0] != pytest.approx(0.3)
    assert errors["static_friction", -10] == errors["nominal", 0]


def test_one_step_from_rest_is_pushed_by_no_more_than_the_true_limit() -> None:
    errors = executed(np.array([0.9]), (0.0, 0.0), (0.0, 0.0))
    velocities = {
        ("control_limit", -10): DT * (0.81 - 0.6),
        ("control_limit", 10): DT * (0.9 - 0.6),
        ("control_limit", 20): DT * (0.9 - 0.6),
        ("nominal", 0): DT * (0.9 - 0.6),
        ("control_limit", -20): DT * (0.72 - 0.6),
    }
    for plant, velocity in velocities.items():
        assert errors[plant] == pytest.approx(np.hypot(DT * velocity, velocity))


def test_one_step_of_sliding_feels_the_true_friction_and_damping() -> None:
    errors = executed(np.array([0.0]), (0.0, 0.5), (0.0, 0.0))
    for change in CHANGES:
        more = 1 + change / 100
        for plant, deceleration in {
            ("coulomb_friction", change): 0.6 * more + 0.05 * 0.5,
            ("viscous_damping", change): 0.6 + 0.05 * more * 0.5,
        }.items():
            velocity = 0.5 - DT * deceleration
            assert errors[plant] == pytest.approx(np.hypot(DT * velocity, velocity))


def test_tables_of_each_parameter_have_the_means_over_the_changes() -> None:
    errors = {(CEM, ("static_friction", -10)): 0.2, (CEM, ("coulomb_friction", 20)): 0.4}
    static, coulomb, damping, _, _, _ = section(errors).all(Table)
    assert static.part == "static-friction"
    assert static.headings == ("Method", "-20 %", "-10 %", "Nominal", "+10 %", "+20 %")
    small = "0.014 ± 0.010"
    rows = {row[0]: row[1:] for row in static.rows}
    assert rows[CEM.label] == (small, "0.204 ± 0.010", small, small, small)
    assert rows[DATASET_PRIOR.label] == (small,) * 5
    assert {row[0]: row[5] for row in coulomb.rows}[CEM.label] == "0.404 ± 0.010"
    assert all(row[1:] == (small,) * 5 for row in damping.rows)


def test_the_worst_plant_and_the_parameter_that_hurts_most_are_named() -> None:
    errors = {
        (CEM, ("static_friction", -10)): 0.04,
        (CEM, ("coulomb_friction", 20)): 0.4,
        (DATASET_PRIOR, ("viscous_damping", 10)): 0.03,
    }
    *_, success, increase = section(errors).all(Table)
    shares = {row[0]: row[1:] for row in success.rows}
    assert shares[CEM.label] == ("100 %", "0 %", "f_c +20 %")
    assert shares[DATASET_PRIOR.label] == ("100 %", "88 %", "b +10 %")
    hurt = {row[0]: row[1:] for row in increase.rows}
    assert hurt[CEM.label][:2] == (
        "+0.030 [+0.030, +0.030] at -10 %",
        "+0.390 [+0.390, +0.390] at +20 %",
    )
    assert hurt[CEM.label][-1] == "f_c"
    assert hurt[DATASET_PRIOR.label][-1] == "b"


@pytest.fixture(scope="module")
def plain() -> Section:
    return section({})


def test_the_same_errors_make_the_same_tables(plain: Section) -> None:
    assert section({}).all(Table) == plain.all(Table)


def test_the_introduction_says_how_near_any_plan_could_come(plain: Section) -> None:
    assert "mean floor is 0.005 m" in plain.all(str)[0]


def test_a_panel_for_each_parameter_has_a_line_of_each_method(plain: Section) -> None:
    (picture,) = plain.all(Picture)
    panels = picture.figure.axes
    assert [axes.get_title() for axes in panels] == [
        "Static friction",
        "Coulomb friction",
        "Viscous damping",
        "Control limit",
    ]
    for axes in panels:
        assert [line.get_label() for line in axes.containers] == [of.label for of in TESTED]


def test_robust_plans_stand_beside_the_nominal_ones() -> None:
    (asked,) = {
        str(question.plan.uncertainty)
        for question in SUITE.questions()
        if question.labels["entrant"] == ROBUST.label
    }
    assert "control_gain=0.1" in asked
