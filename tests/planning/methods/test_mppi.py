"""MPPI: its weights, its nominal sequence and the smoothing of its updates."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.planning.arrays import FloatArray
from app.planning.methods import MPPI, Uniform
from app.planning.methods.base import Method
from app.planning.methods.mppi import moving_average, path_integral_weights
from app.planning.methods.optimiser import score
from app.planning.plan import Plan
from app.planning.planner import plan
from app.planning.plant.system import System
from app.planning.problem import Problem
from app.planning.recipe import Recipe

TASK = Problem(np.zeros(2), np.array([0.5, 0.0]))
QUICK = MPPI(iterations=10)


def solve(method: Method, num_candidates: int, seed: int = 0, problem: Problem = TASK) -> Plan:
    return plan(problem, Recipe(method, num_candidates), np.random.default_rng(seed))


def mean_error(method: Method, num_candidates: int) -> float:
    return float(np.mean([solve(method, num_candidates, s).terminal_error for s in range(10)]))


def test_the_weights_are_a_softmax() -> None:
    weights = path_integral_weights(np.array([0.3, 0.1, 0.2]), 0.1)

    assert weights.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(weights / weights[1], np.exp([-2.0, 0.0, -1.0]))


def test_a_tiny_temperature_takes_the_best_sample_and_a_huge_one_the_plain_mean() -> None:
    errors = np.array([0.3, 0.1, 0.2, 1e6])

    np.testing.assert_array_equal(path_integral_weights(errors, 1e-9), [0, 1, 0, 0])
    np.testing.assert_allclose(path_integral_weights(errors[:3], 1e6), 1 / 3, rtol=1e-6)


@pytest.mark.parametrize(("temperature", "tiny"), [(1e-9, True), (1e6, False)])
def test_the_nominal_sequence_moves_to_the_weighted_mean(
    temperature: float, tiny: bool, rolled_out: list[FloatArray]
) -> None:
    samples = np.random.default_rng(0).uniform(-0.9, 0.9, (8, 64))
    MPPI(iterations=1, temperature=temperature).improve(TASK, 8, np.random.default_rng(0), samples)

    expected = score(TASK, samples).best(1).controls[0] if tiny else samples.mean(axis=0)
    np.testing.assert_allclose(rolled_out[-1], expected[None], atol=1e-6)


def test_the_samples_scatter_around_the_nominal_sequence(rolled_out: list[FloatArray]) -> None:
    centre = np.full((2000, 64), 0.3)
    MPPI(iterations=2, noise_std=0.1).improve(TASK, 2000, np.random.default_rng(0), centre)

    _, second, _ = (controls for controls in rolled_out if len(controls))
    np.testing.assert_allclose(second.mean(axis=0), 0.3, atol=0.01)
    np.testing.assert_allclose(second.std(axis=0), 0.09, rtol=0.1)


def test_the_update_is_smoothed_over_time_on_request(rolled_out: list[FloatArray]) -> None:
    samples = np.random.default_rng(0).uniform(-0.9, 0.9, (8, 64))
    MPPI(iterations=1, smoothing_window=3, temperature=1e-9).improve(
        TASK, 8, np.random.default_rng(0), samples
    )

    before = samples.mean(axis=0)
    update = score(TASK, samples).best(1).controls[0] - before
    expected = np.clip(before + moving_average(update, 3), -0.9, 0.9)
    np.testing.assert_allclose(rolled_out[-1][0], expected)


def test_the_moving_average_keeps_constants_and_spreads_a_spike() -> None:
    np.testing.assert_array_equal(moving_average(np.arange(5.0), 1), np.arange(5.0))
    np.testing.assert_allclose(moving_average(np.full(4, 2.0), 9), 2.0)
    np.testing.assert_allclose(
        moving_average(np.array([0, 0, 3.0, 0, 0, 3.0]), 3), [0, 1, 1, 1, 1, 2]
    )


@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**32),
    num_candidates=st.integers(1, 16),
    target=st.floats(-1, 1),
    temperature=st.sampled_from([1e-9, 1e-3, 1e6]),
    window=st.sampled_from([1, 5, 101]),
)
def test_candidates_keep_to_the_limits_and_come_best_first(
    seed: int, num_candidates: int, target: float, temperature: float, window: int
) -> None:
    problem = Problem(np.zeros(2), np.array([target, 0.0]), System(control_limit=1.3), horizon=33)
    method = MPPI(iterations=4, noise_std=2.0, temperature=temperature, smoothing_window=window)

    proposal = method.propose(problem, num_candidates, np.random.default_rng(seed))

    assert proposal.controls.shape == (num_candidates, 33)
    assert np.all(np.abs(proposal.controls) <= 1.3)
    assert np.all(np.diff(score(problem, proposal.controls).errors) >= 0)


def test_coloured_noise_breaks_away_where_white_noise_does_not() -> None:
    assert mean_error(QUICK, 64) < 0.5 * mean_error(MPPI(iterations=10, noise_exponent=0.0), 64)


def test_it_beats_uniform_shooting_with_the_same_number_of_rollouts() -> None:
    assert mean_error(MPPI(), 64) < 0.2 * mean_error(Uniform(), 41 * 64 + 1)


@pytest.mark.parametrize("horizon", [1, 2, 5])
def test_one_candidate_and_the_shortest_horizons_work(horizon: int) -> None:
    problem = Problem(np.zeros(2), np.array([0.001, 0.0]), horizon=horizon)
    candidates = solve(MPPI(iterations=3, smoothing_window=7), 1, problem=problem).candidates

    assert candidates.controls.shape == (1, horizon)


def test_an_even_smoothing_window_is_refused() -> None:
    with pytest.raises(ValueError, match="smoothing_window must be odd"):
        MPPI(smoothing_window=4)


def test_it_reaches_half_a_metre_from_rest_to_rest() -> None:
    for seed in range(5):
        assert solve(MPPI(), 128, seed).terminal_error < 0.01
