"""Refinement: what it must never do, and how often it arrives."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.planning.arrays import FloatArray
from app.planning.metrics import control_energy, control_smoothness, terminal_error
from app.planning.objectives import (
    CONTROL_ENERGY,
    CONTROL_SMOOTHNESS,
    OBJECTIVES,
    TOLERANCE,
    Objective,
)
from app.planning.plant.friction import resting_controls
from app.planning.plant.rollout import rollout
from app.planning.plant.system import System
from app.planning.prior import ControlPrior
from app.planning.problem import Problem
from app.planning.refining.refinement import Refined, Refinement, refine
from tests.planning.plants import random_system

ROUNDING = 2e-12
LOWERS_NOTHING = Objective("terminal_error", CONTROL_ENERGY.measure)
"""Every candidate is to arrive, and no more."""


def errors_of(problem: Problem, controls: FloatArray) -> FloatArray:
    states = rollout(problem.system, problem.initial_state, controls)
    return terminal_error(states[:, -1], problem.target_state)


def random_problems(
    num_problems: int, seed: int, target_speed: float = 0.0
) -> Iterator[tuple[Problem, np.random.Generator]]:
    """Starts in the training range, targets at rest or moving; each with a generator of its own."""
    rng = np.random.default_rng(seed)
    for draws in rng.spawn(num_problems):
        start = np.array([draws.uniform(-1, 1), draws.uniform(-0.5, 0.5)])
        target = np.array([draws.uniform(-1, 1), draws.uniform(-1, 1) * target_speed])
        yield Problem(start, target), draws


def check(problem: Problem, controls: FloatArray, refined: Refined) -> None:
    """What holds of every refinement."""
    plant = problem.system.plant
    assert refined.controls.shape == controls.shape
    assert np.all(refined.controls >= plant.lowest_control)
    assert np.all(refined.controls <= plant.highest_control)
    assert np.all(refined.errors <= refined.errors_before + ROUNDING)
    before = errors_of(problem, np.clip(controls, plant.lowest_control, plant.highest_control))
    np.testing.assert_allclose(refined.errors_before, before, rtol=ROUNDING, atol=ROUNDING)
    after = errors_of(problem, refined.controls)
    np.testing.assert_allclose(refined.errors, after, rtol=ROUNDING, atol=ROUNDING)


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    horizon=st.integers(1, 80),
    num_candidates=st.integers(1, 4),
    kind=st.sampled_from(["prior", "stuck", "saturated", "outside", "zero"]),
    repair=st.booleans(),
    objective=st.sampled_from(list(OBJECTIVES.values())),
    num_refined=st.none() | st.integers(1, 5),
)
def test_never_worse_and_never_out_of_bounds(
    seed: int,
    horizon: int,
    num_candidates: int,
    kind: str,
    repair: bool,
    objective: Objective,
    num_refined: int | None,
) -> None:
    rng = np.random.default_rng(seed)
    system = random_system(rng)
    start = rng.choice([0, 1]) * rng.uniform(-1, 1, 2)
    problem = Problem(start, rng.choice([0, 1], 2) * rng.uniform(-1, 1, 2), system, horizon)
    plant, shape = system.plant, (num_candidates, horizon)
    lowest, highest = plant.lowest_control, plant.highest_control
    controls = {
        "prior": ControlPrior().sample(num_candidates, horizon, plant, rng),
        "stuck": np.full(shape, min(highest, 0.9 * resting_controls(plant).high)),
        "saturated": rng.choice([lowest, highest], shape),
        "outside": rng.uniform(3 * lowest, 3 * highest, shape),
        "zero": np.zeros(shape),
    }[kind]
    given_controls = controls.copy()
    options = Refinement(iterations=10, num_refined=num_refined, repair=repair)
    refined = refine(problem, controls, options, objective)
    np.testing.assert_array_equal(controls, given_controls)
    check(problem, controls, refined)
    improved = refined.errors < refined.errors_before - ROUNDING
    assert np.count_nonzero(improved) <= (num_refined or num_candidates)


def test_an_exact_plan_is_left_alone() -> None:
    rng = np.random.default_rng(1)
    controls = ControlPrior().sample(1, 64, System().plant, rng)
    reached = rollout(System(), np.zeros(2), controls)[0, -1]
    refined = refine(Problem(np.zeros(2), reached), controls, Refinement())
    np.testing.assert_array_equal(refined.controls, controls)
    assert not refined.replaced.any()


def test_a_candidate_that_leaves_the_wrong_way_is_replaced() -> None:
    problem = Problem(np.zeros(2), np.array([0.4, 0.0]))
    controls = np.full((1, 64), -0.9)
    assert refine(problem, controls, Refinement(repair=False)).errors[0] > 0.1
    repaired = refine(problem, controls, Refinement())
    assert repaired.errors[0] < 1e-9
    assert repaired.replaced[0]


def test_the_same_call_gives_the_same_plan() -> None:
    for problem, rng in random_problems(20, seed=3, target_speed=0.5):
        controls = ControlPrior().sample(4, problem.horizon, problem.system.plant, rng)
        first = refine(problem, controls, Refinement())
        second = refine(problem, controls, Refinement())
        np.testing.assert_array_equal(first.controls, second.controls)


@pytest.mark.parametrize(
    ("num_candidates", "target_speed", "fraction"),
    # Of these targets about 0.88 at rest and 0.7 moving are reachable.
    [(16, 0.0, 0.85), (1, 0.0, 0.85), (16, 0.5, 0.66), (1, 0.5, 0.66)],
)
def test_what_can_be_reached_is_reached(
    num_candidates: int, target_speed: float, fraction: float
) -> None:
    arrived = []
    for problem, rng in random_problems(300, seed=5, target_speed=target_speed):
        controls = ControlPrior().sample(num_candidates, problem.horizon, problem.system.plant, rng)
        refined = refine(problem, controls, Refinement())
        check(problem, controls, refined)
        arrived.append(refined.errors.min() < 1e-6)
    assert np.mean(arrived) >= fraction


@pytest.mark.parametrize(
    ("objective", "measure"),
    [(CONTROL_ENERGY, control_energy), (CONTROL_SMOOTHNESS, control_smoothness)],
    ids=["control_energy", "control_smoothness"],
)
@pytest.mark.parametrize("target_speed", [0.0, 0.5])
def test_the_objective_falls_and_the_plan_still_arrives(
    objective: Objective, measure: Callable[[FloatArray], FloatArray], target_speed: float
) -> None:
    before: list[float] = []
    after: list[float] = []
    for problem, rng in random_problems(60, seed=9, target_speed=target_speed):
        controls = ControlPrior().sample(2, problem.horizon, problem.system.plant, rng)
        exact = refine(problem, controls, Refinement(), LOWERS_NOTHING)
        least = refine(problem, controls, Refinement(), objective)
        check(problem, controls, least)
        np.testing.assert_allclose(least.errors, exact.errors, atol=ROUNDING)
        equal = exact.errors <= exact.errors.min() + TOLERANCE
        before.extend(measure(exact.controls[equal]))
        after.extend(measure(least.controls[equal]))
    assert np.all(np.array(after) <= before)
    assert np.mean(after) < 0.9 * np.mean(before)


@pytest.mark.parametrize("options", [{"iterations": 0}, {"num_refined": 0}])
def test_options_out_of_range_are_refused(options: dict[str, int]) -> None:
    with pytest.raises(ValueError, match="must be at least 1"):
        Refinement(**options)  # type: ignore[arg-type]
