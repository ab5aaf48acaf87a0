"""iCEM: its coloured noise, its kept elites and its populations that shrink."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.planning.arrays import FloatArray
from app.planning.methods import CEM, ICEM, Uniform
from app.planning.methods.base import Method
from app.planning.methods.icem import coloured_noise
from app.planning.methods.optimiser import score
from app.planning.plan import Plan
from app.planning.planner import plan
from app.planning.plant.system import System
from app.planning.problem import Cost, Problem
from app.planning.recipe import Recipe

TASK = Problem(np.zeros(2), np.array([0.5, 0.0]))
QUICK = ICEM(iterations=10)


def solve(method: Method, num_candidates: int, seed: int = 0, problem: Problem = TASK) -> Plan:
    return plan(problem, Recipe(method, num_candidates), np.random.default_rng(seed))


def mean_error(method: Method, num_candidates: int) -> float:
    return float(np.mean([solve(method, num_candidates, s).terminal_error for s in range(10)]))


@pytest.mark.parametrize("horizon", [1, 2, 7, 64, 65])
@pytest.mark.parametrize("exponent", [0.0, 1.0, 3.5, 10.0])
def test_the_noise_has_mean_zero_and_variance_one_at_every_step(
    horizon: int, exponent: float
) -> None:
    noise = coloured_noise(np.random.default_rng(0), 4000, horizon, exponent)

    assert noise.shape == (4000, horizon)
    np.testing.assert_allclose(noise.mean(axis=0), 0.0, atol=0.08)
    np.testing.assert_allclose(noise.var(axis=0), 1.0, atol=0.12)


@pytest.mark.parametrize("exponent", [0.0, 0.25, 1.0, 2.0, 3.5])
def test_the_spectrum_of_the_noise_falls_with_the_exponent(exponent: float) -> None:
    noise = coloured_noise(np.random.default_rng(0), 2000, 256, exponent)

    # The lowest (constant) and the highest (real) component have laws of their own.
    power = (np.abs(np.fft.rfft(noise)) ** 2).mean(axis=0)[1:-1]
    slope, _ = np.polyfit(np.log(np.arange(1, power.size + 1)), np.log(power), 1)
    assert slope == pytest.approx(-exponent, abs=0.03)


def test_an_exponent_of_zero_leaves_the_draws_as_they_are() -> None:
    np.testing.assert_allclose(
        coloured_noise(np.random.default_rng(5), 3, 33, 0.0),
        np.random.default_rng(5).standard_normal((3, 33)),
        atol=1e-12,
    )


def test_coloured_noise_breaks_away_where_white_noise_does_not() -> None:
    assert mean_error(QUICK, 64) < 0.5 * mean_error(ICEM(iterations=10, noise_exponent=0.0), 64)


def test_it_beats_uniform_shooting_and_plain_cem_with_fewer_rollouts() -> None:
    assert ICEM().cost(64).rollouts < CEM(iterations=40).cost(64).rollouts
    assert mean_error(ICEM(), 64) < 0.5 * mean_error(CEM(iterations=40), 64)
    assert mean_error(ICEM(), 64) < 0.2 * mean_error(Uniform(), 41 * 64)


@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**32),
    num_candidates=st.integers(1, 16),
    iterations=st.integers(1, 8),
    target=st.floats(-1, 1),
    kept_elite_fraction=st.sampled_from([0.0, 0.3, 1.0]),
)
def test_candidates_keep_to_the_limits_and_come_best_first(
    seed: int, num_candidates: int, iterations: int, target: float, kept_elite_fraction: float
) -> None:
    problem = Problem(np.zeros(2), np.array([target, 0.0]), System(control_limit=1.3), horizon=33)
    method = ICEM(iterations=iterations, kept_elite_fraction=kept_elite_fraction, initial_std=3.0)

    proposal = method.propose(problem, num_candidates, np.random.default_rng(seed))

    assert proposal.controls.shape == (num_candidates, 33)
    assert np.all(np.abs(proposal.controls) <= 1.3)
    errors = solve(method, num_candidates, seed, problem).candidates.terminal_errors
    assert np.all(np.diff(errors) >= 0)


@pytest.mark.parametrize("momentum", [0.0, 0.1, 0.9])
def test_the_refit_is_to_the_elites_with_momentum_and_the_last_iteration_tries_the_mean(
    momentum: float, rolled_out: list[FloatArray]
) -> None:
    initial = np.random.default_rng(0).uniform(-0.5, 0.5, (4000, 64))
    method = ICEM(
        iterations=2, momentum=momentum, elite_fraction=0.1, population_decay=1.0, noise_exponent=1
    )
    method.improve(TASK, 4000, np.random.default_rng(0), initial)

    elites = score(TASK, initial).best(400).controls
    mean = (1 - momentum) * elites.mean(axis=0) + momentum * initial.mean(axis=0)
    std = (1 - momentum) * elites.std(axis=0) + momentum * initial.std(axis=0)
    _, second = rolled_out
    np.testing.assert_allclose(second[0], mean)
    np.testing.assert_allclose(second.mean(axis=0), mean, atol=0.03)
    np.testing.assert_allclose(second.std(axis=0), std, rtol=0.1)


def test_kept_elites_compete_again_without_being_rolled_out_again(
    rolled_out: list[FloatArray],
) -> None:
    """What all were kept of can only be refitted to the best of everything seen."""
    ICEM(iterations=6, momentum=0.0, kept_elite_fraction=1.0, elite_fraction=0.25).propose(
        TASK, 16, np.random.default_rng(0)
    )

    *before, last = rolled_out
    best = score(TASK, np.concatenate(before)).best(4).controls
    np.testing.assert_allclose(last[0], best.mean(axis=0))


@pytest.mark.parametrize("limit", [0.9, 2.0])
def test_the_first_population_has_the_initial_standard_deviation(limit: float) -> None:
    problem = Problem(np.zeros(2), np.ones(2), System(control_limit=limit))
    population = solve(ICEM(iterations=1, initial_std=0.2), 2000, problem=problem).candidates

    assert population.controls.std() == pytest.approx(0.2 * limit, rel=0.03)
    assert population.controls.mean() == pytest.approx(0.0, abs=0.02)


def test_the_populations_shrink_to_two_for_each_elite() -> None:
    # 100, 50, 25, 12 -> 20, 20
    method = ICEM(iterations=5, population_decay=2.0, elite_fraction=0.1)
    assert method.cost(100) == Cost(rollouts=100 + 50 + 25 + 20 + 20)

    assert ICEM(iterations=5, population_decay=1.0).cost(100) == Cost(rollouts=500)
    assert ICEM(iterations=5).cost(1) == Cost(rollouts=5)


def test_it_reaches_half_a_metre_from_rest_to_rest() -> None:
    for seed in range(5):
        assert solve(ICEM(), 128, seed).terminal_error < 0.01
