"""Plans for many problems at once: each is to the bit the plan that its problem has alone."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.planning.methods import CEM, DatasetPrior, Uniform
from app.planning.methods.base import Method
from app.planning.methods.warm_started import WarmStarted
from app.planning.objectives import OBJECTIVES, Objective
from app.planning.plan import Plan
from app.planning.planner import plan, plan_many
from app.planning.plant.system import ByDirection, System
from app.planning.problem import PlanningError, Problem
from app.planning.recipe import Recipe
from app.planning.refining.refinement import Refinement
from app.planning.stop import Stopped
from tests.planning.fakes import LEARNED, Fixed, every_method, stopped

TARGETS = (0.2, -0.7, 0.0, 3.0, 0.01)
"""Near, far, the start itself, out of reach, nearly there."""
SYSTEM = System(coulomb_friction=ByDirection(0.5, 0.6), bias=0.02)


def problems(horizon: int = 32, system: System = SYSTEM) -> list[Problem]:
    return [
        Problem(np.array([0.0, 0.1 * i]), np.array([target, 0.0]), system, horizon)
        for i, target in enumerate(TARGETS)
    ]


def assert_same(one: Plan, other: Plan) -> None:
    for name in ("controls", "states"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for name in ("terminal_errors", "states", "controls"):
        np.testing.assert_array_equal(
            getattr(one.candidates, name), getattr(other.candidates, name)
        )
    for name in ("terminal_error", "control_energy", "control_smoothness", "stuck_steps"):
        assert getattr(one, name) == getattr(other, name), name
    assert one.candidates.diversity == other.candidates.diversity
    assert (one.refinement, one.cost, one.gap) == (other.refinement, other.cost, other.gap)


def assert_each_as_alone(problems: list[Problem], recipe: Recipe[Method]) -> None:
    together = plan_many(problems, recipe, [np.random.default_rng(i) for i in range(len(problems))])
    for i, (problem, one) in enumerate(zip(problems, together, strict=True)):
        assert_same(one, plan(problem, recipe, np.random.default_rng(i)))


@every_method
def test_each_is_planned_for_as_alone(method: Method) -> None:
    assert_each_as_alone(problems(), Recipe(method, 6))


@pytest.mark.parametrize("objective", OBJECTIVES.values(), ids=lambda objective: objective.name)
def test_each_is_refined_as_alone(objective: Objective) -> None:
    recipe = Recipe(DatasetPrior(), 5, Refinement(), reachability=True)
    assert_each_as_alone(problems(), replace(recipe, objective=objective))


@pytest.mark.parametrize("initial", [DatasetPrior(), LEARNED])
def test_each_is_warm_started_as_alone(initial: Method) -> None:
    assert_each_as_alone(problems(), Recipe(WarmStarted(CEM(iterations=3), initial), 5))


@settings(max_examples=30)
@given(st.integers(1, 9), st.integers(1, 70), st.integers(1, 5))
def test_whatever_their_number_and_size(candidates: int, horizon: int, count: int) -> None:
    assert_each_as_alone(problems(horizon)[:count], Recipe(Uniform(), candidates))


def test_the_times_are_those_of_all_together() -> None:
    plans = plan_many(
        problems(), Recipe(LEARNED, 4), [np.random.default_rng(i) for i in range(len(TARGETS))]
    )
    assert len({one.timing for one in plans}) == 1
    assert sum(one.timing.queue for one in plans) == pytest.approx(2.5)


def test_they_have_one_plant_and_one_horizon() -> None:
    rngs = [np.random.default_rng(i) for i in range(2)]
    for other in (problems(33)[1], problems(system=System())[1]):
        with pytest.raises(ValueError, match="one plant and horizon"):
            plan_many([problems()[0], other], Recipe(Uniform(), 2), rngs)


def test_what_is_not_finite_or_not_wanted_is_not_planned() -> None:
    rngs = [np.random.default_rng(i) for i in range(len(TARGETS))]
    with pytest.raises(PlanningError, match="not finite"):
        plan_many(problems(), Recipe(Fixed(np.full((2, 32), np.nan)), 2), rngs)
    with pytest.raises(Stopped):
        plan_many(problems(), Recipe(Uniform(), 2), rngs, stopped())
