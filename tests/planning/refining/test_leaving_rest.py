"""Descent across rests: it arrives where Gauss-Newton alone is blind, both ways, on any plant."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.planning.arrays import FloatArray
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System
from app.planning.problem import Problem
from app.planning.refining.gauss_newton import arrive
from app.planning.refining.leaving_rest import arrive_across_rests
from app.planning.stop import NEVER
from tests.planning.plants import random_system

ITERATIONS = 40


def problem_to(controls: FloatArray, system: System | None = None) -> Problem:
    """A problem from rest that `controls` (H,) solve exactly."""
    system = system or System()
    reached = rollout(system, np.zeros(2), controls[np.newaxis])[0, -1]
    return Problem(np.zeros(2), reached, system, controls.size)


def descents(problem: Problem, controls: FloatArray) -> tuple[float, float]:
    """The errors to which `controls` (H,) descend between rests only, and across them."""
    between, across = controls.copy(), controls.copy()
    error, _ = arrive(between, problem.task, ITERATIONS, NEVER.flag)
    crossing_error, _ = arrive_across_rests(across, problem.task, ITERATIONS, NEVER.flag)
    return error, crossing_error


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("late", [1, 2, 3])
def test_a_mass_that_leaves_too_late_leaves_sooner(direction: float, late: int) -> None:
    solution = direction * np.concatenate([np.zeros(44), np.full(20, 0.9)])
    candidate = direction * np.concatenate([np.zeros(44 + late), np.full(20 - late, 0.9)])

    between, across = descents(problem_to(solution), candidate)

    # All control is in use already, and a step of it makes up to 0.015 m/s.
    assert between > 0.02
    assert across < 1e-9


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_mass_that_stays_at_rest_is_kicked_towards_the_target(direction: float) -> None:
    solution = direction * np.concatenate([np.full(2, 0.9), np.zeros(62)])
    problem = problem_to(solution)

    between, across = descents(problem, np.zeros(64))

    assert between == np.linalg.norm(problem.target_state)
    assert across < 1e-9


def test_a_target_that_moves_is_left_for_with_the_last_step() -> None:
    # From rest at the limit, one step makes 0.05 * (0.9 - 0.6) m/s; 0.8 makes two thirds of it.
    solution = np.concatenate([np.full(10, 0.9), np.full(53, -0.3), [0.8]])

    between, across = descents(
        problem_to(solution), np.concatenate([np.full(10, 0.9), np.full(53, -0.3), [0.0]])
    )

    assert between == pytest.approx(0.01, rel=0.01)
    assert across < 1e-9


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), horizon=st.integers(1, 60))
def test_it_is_never_worse_on_any_plant(seed: int, horizon: int) -> None:
    rng = np.random.default_rng(seed)
    system = random_system(rng)
    problem = Problem(
        rng.choice([0, 1]) * rng.uniform(-1, 1, 2),
        rng.choice([0, 1], 2) * rng.uniform(-1, 1, 2),
        system,
        horizon,
    )
    plant = system.plant
    controls = rng.uniform(plant.lowest_control, plant.highest_control, horizon)
    controls *= rng.random(horizon) < rng.random()
    controls = np.clip(controls, plant.lowest_control, plant.highest_control)
    between, across = controls.copy(), controls.copy()
    error, _ = arrive(between, problem.task, ITERATIONS, NEVER.flag)
    crossing_error, _ = arrive_across_rests(across, problem.task, ITERATIONS, NEVER.flag)

    assert crossing_error <= error
    assert np.all(across >= plant.lowest_control)
    assert np.all(across <= plant.highest_control)
    state = rollout(system, problem.initial_state, across[np.newaxis])[0, -1]
    assert np.linalg.norm(state - problem.target_state) == pytest.approx(crossing_error, abs=1e-12)
    if crossing_error == error:
        np.testing.assert_array_equal(across, between)


def test_a_stop_ends_it() -> None:
    problem = Problem(np.zeros(2), np.array([0.4, 0.2]))
    stopped = np.ones(1, dtype=NEVER.flag.dtype)
    controls = np.zeros(64)
    _, rollouts = arrive_across_rests(controls, problem.task, ITERATIONS, stopped)
    assert rollouts == 1
