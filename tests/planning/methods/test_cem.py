"""The Cross-Entropy Method: what its Gaussian does, and that its kernel is the loop of them all."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.planning.arrays import FloatArray
from app.planning.methods import CEM
from app.planning.methods.optimiser import Optimiser, score
from app.planning.plan import Plan
from app.planning.planner import plan
from app.planning.plant.system import System
from app.planning.problem import Cost, Problem
from app.planning.recipe import Recipe

TASK = Problem(np.zeros(2), np.array([0.5, 0.0]))


def solve(method: CEM, num_candidates: int, seed: int = 0, problem: Problem = TASK) -> Plan:
    return plan(problem, Recipe(method, num_candidates), np.random.default_rng(seed))


def mean_error(method: CEM, num_candidates: int) -> float:
    return float(np.mean([solve(method, num_candidates, s).terminal_error for s in range(20)]))


def test_it_reaches_half_a_metre_from_rest_to_rest() -> None:
    for seed in range(5):
        assert solve(CEM(), 512, seed).terminal_error < 0.03


def test_candidates_improve_the_plan() -> None:
    assert mean_error(CEM(), 256) < 0.5 * mean_error(CEM(), 32)


@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**32),
    num_candidates=st.integers(1, 16),
    target=st.floats(-1, 1),
    min_std=st.sampled_from([0.0, 1e-3, 0.6]),
)
def test_more_iterations_never_lose_the_best_sequence_of_the_fewer(
    seed: int, num_candidates: int, target: float, min_std: float
) -> None:
    # A floor of 0.6 keeps the last populations as bad as the first: the best comes from any.
    problem = Problem(np.zeros(2), np.array([target, 0.0]), horizon=32)
    errors = [
        solve(CEM(iterations=n, min_std=min_std), num_candidates, seed, problem).terminal_error
        for n in range(1, 12)
    ]

    assert np.all(np.diff(errors) <= 1e-12)


def test_the_best_sequence_of_all_iterations_is_returned_not_that_of_the_last() -> None:
    # The high floor keeps every population at random, so that few iterations bring anything new.
    plans = [solve(CEM(iterations=n, min_std=5.0), 4, seed=1) for n in range(1, 31)]

    kept = [np.array_equal(a.controls, b.controls) for a, b in pairwise(plans)]
    assert sum(kept) > 15


def test_two_candidates_keep_searching_after_the_first_refit() -> None:
    """Two elites at least: one alone would leave no spread to search with."""
    population = solve(CEM(iterations=2, min_std=0.0), 2).candidates.controls

    assert not np.array_equal(population[0], population[1])


def test_no_spread_is_left_without_a_floor_when_one_candidate_is_all_there_is() -> None:
    one, three = (solve(CEM(iterations=n, min_std=0.0), 1) for n in (1, 3))

    np.testing.assert_array_equal(one.controls, three.controls)


def test_the_population_narrows_to_the_floor_of_the_standard_deviation() -> None:
    def spread(min_std: float) -> float:
        population = solve(CEM(iterations=60, min_std=min_std), 64).candidates.controls
        interior = np.all(np.abs(population) < 0.9, axis=0)
        return float(np.median(population[:, interior].std(axis=0)))

    assert spread(0.05) == pytest.approx(0.05, rel=0.5)
    assert spread(1e-3) < 0.02


@pytest.mark.parametrize("initial_std", [0.1, 0.3])
def test_the_first_population_has_the_initial_standard_deviation(initial_std: float) -> None:
    options = CEM(iterations=1, initial_std=initial_std)
    for limit in (0.9, 2.0):
        problem = Problem(np.zeros(2), np.ones(2), System(control_limit=limit))
        population = solve(options, 2000, problem=problem).candidates.controls

        assert population.std() == pytest.approx(initial_std * limit, rel=0.02)
        assert population.mean() == pytest.approx(0.0, abs=0.01)


def test_a_smaller_elite_fraction_narrows_faster() -> None:
    def spread(elite_fraction: float) -> float:
        options = CEM(iterations=20, elite_fraction=elite_fraction)
        return float(solve(options, 64).candidates.controls.std(axis=0).mean())

    assert spread(0.05) < 0.5 * spread(1.0)


def test_the_mirrored_task_is_as_easy() -> None:
    mirrored = Problem(np.zeros(2), np.array([-0.5, 0.0]))

    assert solve(CEM(), 512, problem=mirrored).terminal_error < 0.03


def test_the_cost_is_a_rollout_for_each_candidate_of_each_iteration() -> None:
    assert CEM(iterations=7).cost(16) == Cost(rollouts=112)


@settings(max_examples=50)
@given(
    seed=st.integers(0, 2**32),
    num_candidates=st.integers(1, 24),
    iterations=st.integers(1, 6),
    is_first_given=st.booleans(),
    elite_fraction=st.sampled_from([0.05, 0.2, 1.0]),
)
def test_the_kernel_does_what_the_loop_of_all_optimisers_does(
    seed: int, num_candidates: int, iterations: int, is_first_given: bool, elite_fraction: float
) -> None:
    problem = Problem(np.array([0.1, -0.2]), np.array([0.4, 0.1]), System(control_limit=1.3), 33)
    first: FloatArray | None = None
    if is_first_given:
        first = np.random.default_rng(seed).uniform(-1.3, 1.3, (num_candidates, 33))
    cem = CEM(iterations=iterations, elite_fraction=elite_fraction)
    rngs = np.random.default_rng(seed), np.random.default_rng(seed)

    fused = cem.improve(problem, num_candidates, rngs[0], first).controls
    general = Optimiser.improve(cem, problem, num_candidates, rngs[1], first).controls

    np.testing.assert_allclose(fused, general, rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        score(problem, fused).errors, score(problem, general).errors, rtol=0, atol=1e-9
    )
    # Both took the same draws, no more and no fewer.
    assert rngs[0].bit_generator.state == rngs[1].bit_generator.state
