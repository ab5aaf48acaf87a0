"""A plan that nobody wants any more ends soon, whatever it is doing; the others never notice.

That every method obeys is in methods/test_contract.py.
"""

import threading

import numpy as np
import pytest

from app.planning.methods import CEM, DatasetPrior, WarmStarted
from app.planning.objectives import CONTROL_ENERGY, CONTROL_SMOOTHNESS, OBJECTIVES, Objective
from app.planning.planner import plan, plan_multistep
from app.planning.prior import ControlPrior
from app.planning.problem import Problem
from app.planning.reachable.reachability import reachability
from app.planning.recipe import Recipe
from app.planning.refining.refinement import Refinement, refine
from app.planning.stop import NEVER, Stop, Stopped
from tests.planning.fakes import Fixed, Unwanted, assert_stops, stopped

PROBLEM = Problem(np.zeros(2), np.array([0.5, 0.0]))
UNDER_WAY_S = 0.05
TARGETS = [np.array([0.4, 0.0]), np.array([-0.4, 0.0]), np.array([0.2, 0.0])]
every_objective = pytest.mark.parametrize(
    "objective", OBJECTIVES.values(), ids=lambda objective: objective.name
)


def test_the_first_reason_stands_and_is_the_one_raised() -> None:
    stop, first = Stop(), Unwanted()
    stop.check()
    assert not stop.flag[0]

    stop.set(first)
    stop.set(Stopped())

    assert stop.flag[0]
    for _ in range(2):
        with pytest.raises(Unwanted) as raised:
            stop.check()
        assert raised.value is first


@every_objective
def test_a_stop_that_nobody_sets_changes_nothing(objective: Objective) -> None:
    recipe = Recipe(DatasetPrior(), 6, Refinement(), objective, reachability=True)
    usual, stoppable = (
        plan_multistep(PROBLEM, TARGETS, recipe, np.random.default_rng(0), stop)
        for stop in (NEVER, Stop())
    )

    np.testing.assert_array_equal(stoppable.controls, usual.controls)
    assert stoppable.cost == usual.cost
    assert stoppable.mean_end_floor == usual.mean_end_floor


@pytest.mark.parametrize("objective", [CONTROL_ENERGY, CONTROL_SMOOTHNESS])
def test_a_stop_from_another_thread_ends_a_refinement_that_runs(objective: Objective) -> None:
    problem = Problem(np.array([0.0, 0.5]), np.array([5.0, 0.3]), horizon=1024)
    controls = ControlPrior().sample(2000, 1024, problem.system.plant, np.random.default_rng(0))
    proposed = threading.Event()
    method = Fixed(controls, proposed.set)
    recipe = Recipe(method, len(controls), Refinement(iterations=1000), objective)

    assert_stops(
        lambda stop: plan(problem, recipe, np.random.default_rng(0), stop),
        lambda: proposed.is_set() and not threading.Event().wait(UNDER_WAY_S),
    )


@every_objective
@pytest.mark.parametrize("repair", [False, True])
def test_a_refinement_that_is_not_wanted_raises(objective: Objective, repair: bool) -> None:
    controls = ControlPrior().sample(8, 64, PROBLEM.system.plant, np.random.default_rng(0))

    with pytest.raises(Unwanted):
        refine(PROBLEM, controls, Refinement(repair=repair), objective, stopped())


def test_a_floor_that_nobody_wants_is_not_computed() -> None:
    with pytest.raises(Unwanted):
        reachability(Problem(np.array([0.1, 0.2]), np.array([1e3, 0.5]), horizon=1024), stopped())


@pytest.mark.parametrize("with_floor", [False, True])
def test_a_plan_is_stopped_after_its_proposal_too(with_floor: bool) -> None:
    stop = Stop()
    method = Fixed(np.zeros((4, 64)), lambda: stop.set(Unwanted()))
    recipe = Recipe(method, 4, reachability=with_floor)

    with pytest.raises(Unwanted):
        plan(PROBLEM, recipe, np.random.default_rng(0), stop)


def test_a_multistep_plan_is_stopped_between_its_targets() -> None:
    stop = Stop()

    def second_time() -> None:
        if len(method.problems) == 2:
            stop.set(Unwanted())

    method = Fixed(np.zeros((4, 64)), second_time)

    with pytest.raises(Unwanted):
        plan_multistep(PROBLEM, TARGETS, Recipe(method, 4), np.random.default_rng(0), stop)

    assert len(method.problems) == 2


def test_a_stop_in_the_initial_method_keeps_the_optimiser_from_running() -> None:
    stop = Stop()
    rng = np.random.default_rng(0)
    before = rng.bit_generator.state
    initial = Fixed(np.zeros((4, 64)), lambda: stop.set(Unwanted()))

    with pytest.raises(Unwanted):
        plan(PROBLEM, Recipe(WarmStarted(CEM(), initial), 4), rng, stop)

    assert rng.bit_generator.state == before
