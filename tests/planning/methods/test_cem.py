from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.planning.methods import CEM, Uniform
from app.planning.methods.base import Method
from app.planning.plan import Plan
from app.planning.planner import plan
from app.planning.plant.system import System
from app.planning.problem import Cost, Problem

TASK = Problem(np.zeros(2), np.array([0.5, 0.0]))


def solve(method: Method, num_candidates: int, seed: int = 0, problem: Problem = TASK) -> Plan:
    return plan(problem, method, num_candidates, np.random.default_rng(seed))


def mean_error(method: Method, num_candidates: int) -> float:
    return float(np.mean([solve(method, num_candidates, s).terminal_error for s in range(20)]))


def test_it_reaches_half_a_metre_from_rest_to_rest() -> None:
    for seed in range(5):
        assert solve(CEM(), 512, seed).terminal_error < 0.03


def test_iterations_improve_the_plan() -> None:
    one, ten, forty = (mean_error(CEM(iterations=n), 64) for n in (1, 10, 40))

    assert forty < 0.7 * ten
    assert ten < one


def test_candidates_improve_the_plan() -> None:
    assert mean_error(CEM(), 256) < 0.5 * mean_error(CEM(), 32)


def test_it_beats_uniform_shooting_with_the_same_number_of_rollouts() -> None:
    cem, shooting = solve(CEM(iterations=40), 64), solve(Uniform(), 41 * 64)

    assert cem.cost == shooting.cost == Cost(rollouts=41 * 64)
    assert mean_error(CEM(iterations=40), 64) < 0.7 * mean_error(Uniform(), 41 * 64)


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


@pytest.mark.parametrize("num_candidates", [1, 2, 3])
def test_the_smallest_populations_work(num_candidates: int) -> None:
    result = solve(CEM(iterations=10), num_candidates)

    assert result.candidates.controls.shape == (num_candidates, 64)
    assert np.all(np.isfinite(result.candidates.controls))


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


@pytest.mark.parametrize(
    "problem",
    [
        Problem(np.zeros(2), np.array([-0.2, 0.0]), horizon=40),
        Problem(np.zeros(2), np.array([1.0, 0.0]), horizon=100),
        Problem(np.array([0.3, 0.4]), np.array([0.6, 0.0])),
        Problem(
            np.zeros(2),
            np.array([0.5, 0.0]),
            System(static_friction=0.3, coulomb_friction=0.2, control_limit=1.0),
        ),
    ],
    ids=["short", "long", "moving", "slippery"],
)
def test_other_starts_horizons_and_plants_are_solved(problem: Problem) -> None:
    assert solve(CEM(iterations=80), 256, problem=problem).terminal_error < 0.05


def test_the_mirrored_task_is_as_easy() -> None:
    mirrored = Problem(np.zeros(2), np.array([-0.5, 0.0]))

    assert solve(CEM(), 512, problem=mirrored).terminal_error < 0.03


def test_the_cost_is_a_rollout_for_each_candidate_of_each_iteration() -> None:
    assert CEM(iterations=7).cost(16) == Cost(rollouts=112)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"iterations": 0}, "iterations"),
        ({"iterations": 1001}, "iterations"),
        ({"elite_fraction": 0.0}, "elite_fraction"),
        ({"elite_fraction": 1.1}, "elite_fraction"),
        ({"initial_std": 0.0}, "initial_std"),
        ({"initial_std": float("nan")}, "initial_std"),
        ({"min_std": -0.1}, "min_std"),
        ({"min_std": float("inf")}, "min_std"),
    ],
)
def test_impossible_options_are_refused_by_name(options: dict[str, float], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        CEM(**options)  # type: ignore[arg-type]
