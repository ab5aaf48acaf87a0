"""Waiting comes after the motion: the same motion, no more stuck steps than there have to be."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.planning.arrays import FloatArray
from app.planning.methods import DatasetPrior
from app.planning.metrics import stuck_steps, terminal_error
from app.planning.objectives import STUCK_STEPS, TERMINAL_ERROR, Objective
from app.planning.plan import Plan
from app.planning.planner import plan
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System
from app.planning.problem import Problem
from app.planning.recipe import Recipe
from app.planning.refining.refinement import Refinement, refine
from app.planning.refining.waiting import wait_at_the_end
from tests.planning.plants import random_system

REST = np.zeros(2)
COARSE = System(time_step=0.2)
"""A plant that gets somewhere in a few steps."""


def stuck_and_errors(problem: Problem, controls: FloatArray) -> tuple[list[int], FloatArray]:
    states = rollout(problem.system, problem.initial_state, controls)
    stuck = stuck_steps(states, controls, float(problem.target_state[0]), problem.system)
    return stuck.tolist(), terminal_error(states[:, -1], problem.target_state)


def refined_plan(problem: Problem, objective: Objective, seed: int) -> Plan:
    recipe = Recipe(DatasetPrior(), 16, Refinement(), objective)
    return plan(problem, recipe, np.random.default_rng(seed))


def test_pauses_go_to_the_end_and_the_motion_stays() -> None:
    push, brake, pause = 0.9, -0.9, 0.5
    # A control of f_s exactly moves nothing, though the paper does not call it stuck.
    held = -COARSE.plant.static_forward
    controls = np.array([[pause, pause, push, brake, held, pause, -pause, push, brake, pause]])
    reached = rollout(COARSE, REST, controls)[0, -1]
    assert reached[0] > 0.02
    problem = Problem(REST, reached, COARSE, 10)
    assert stuck_and_errors(problem, controls)[0] == [4]

    moved, errors = wait_at_the_end(problem, controls)

    np.testing.assert_array_equal(moved[0, :4], [push, brake, push, brake])
    np.testing.assert_array_equal(moved[0, 4:], 0.0)
    np.testing.assert_array_equal(rollout(COARSE, REST, moved)[0, -1], reached)
    assert errors == [0.0]
    assert stuck_and_errors(problem, moved)[0] == [0]


def test_what_is_passed_in_motion_is_not_reached_sooner() -> None:
    controls = np.array([[0.0, 0.0, 0.9, 0.9]])
    problem = Problem(REST, rollout(COARSE, REST, controls)[0, -1], COARSE, 4)

    moved, errors = wait_at_the_end(problem, controls)

    np.testing.assert_array_equal(moved, controls)
    assert errors == [0.0]


@given(seed=st.integers(0, 2**32 - 1), num_candidates=st.integers(1, 4), horizon=st.integers(1, 40))
def test_no_error_and_no_count_ever_grows(seed: int, num_candidates: int, horizon: int) -> None:
    rng = np.random.default_rng(seed)
    system = random_system(rng)
    target = rng.choice([0, 1], 2) * rng.uniform(-1, 1, 2)
    problem = Problem(rng.choice([0, 1], 2) * rng.uniform(-1, 1, 2), target, system, horizon)
    plant, shape = system.plant, (num_candidates, horizon)
    controls = rng.uniform(plant.lowest_control, plant.highest_control, shape)
    controls *= rng.choice([0, 1], controls.shape)
    before, errors_before = stuck_and_errors(problem, controls)

    moved, errors = wait_at_the_end(problem, controls)

    after, errors_after = stuck_and_errors(problem, moved)
    np.testing.assert_array_equal(errors, errors_after)
    assert np.all(errors <= errors_before)
    assert np.all(np.array(after) <= before)


@pytest.mark.parametrize("num_targets", [12])
def test_the_count_is_the_least_of_all_plans_that_end_alike(num_targets: int) -> None:
    # Brute force: every sequence of these levels, and for its end the least count of them all.
    horizon = 7
    lattice = np.array(list(product((-0.9, 0.0, 0.8, 0.9), repeat=horizon)))
    states = rollout(COARSE, REST, lattice)
    at_rest = np.flatnonzero((states[:, -1, 1] == 0.0) & (np.abs(states[:, -1, 0]) > 0.02))
    rng = np.random.default_rng(2)
    lowered = 0
    for chosen in rng.choice(at_rest, num_targets, replace=False):
        problem = Problem(REST, states[chosen, -1], COARSE, horizon)
        stuck, errors = stuck_and_errors(problem, lattice)
        alike = np.flatnonzero(errors < 1e-12)
        least = min(stuck[i] for i in alike)
        worst = max(alike, key=lambda i: stuck[i])
        lowered += stuck[worst] > least

        refined = refine(problem, lattice[worst : worst + 1], Refinement(), STUCK_STEPS)

        assert refined.errors[0] < 1e-12
        assert stuck_and_errors(problem, refined.controls)[0] == [least]
    assert lowered > num_targets / 2


def test_a_plan_refined_for_it_arrives_without_a_stuck_step() -> None:
    # From rest to rest nothing has to wait before it has arrived: the least is none.
    targets = [(position, 0.0) for position in (-0.9, -0.4, 0.1, 0.2, 0.6)]
    problems = [Problem(REST, np.array(target), horizon=100) for target in targets]
    before = [refined_plan(problem, TERMINAL_ERROR, seed=1) for problem in problems]
    after = [refined_plan(problem, STUCK_STEPS, seed=1) for problem in problems]
    assert max(made.terminal_error for made in after) < 1e-9
    assert sum(made.stuck_steps for made in before) > 20
    assert [made.stuck_steps for made in after] == [0] * len(problems)
