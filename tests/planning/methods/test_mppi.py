import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.planning.arrays import FloatArray
from app.planning.methods import MPPI, Uniform, mppi
from app.planning.methods.base import Method, Scored, score
from app.planning.methods.mppi import moving_average, path_integral_weights
from app.planning.plan import Plan
from app.planning.planner import plan
from app.planning.plant.system import System
from app.planning.problem import Cost, Problem

TASK = Problem(np.zeros(2), np.array([0.5, 0.0]))
QUICK = MPPI(iterations=10)


def solve(method: Method, num_candidates: int, seed: int = 0, problem: Problem = TASK) -> Plan:
    return plan(problem, method, num_candidates, np.random.default_rng(seed))


def mean_error(method: Method, num_candidates: int) -> float:
    return float(np.mean([solve(method, num_candidates, s).terminal_error for s in range(10)]))


@pytest.fixture
def rolled_out(monkeypatch: pytest.MonkeyPatch) -> list[FloatArray]:
    """Every population that MPPI rolls out, in order."""
    populations: list[FloatArray] = []

    def recording(problem: Problem, controls: FloatArray) -> Scored:
        populations.append(controls.copy())
        return score(problem, controls)

    monkeypatch.setattr(mppi, "score", recording)
    return populations


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


@pytest.mark.parametrize("num_candidates", [1, 7, 64])
def test_the_cost_is_what_it_rolls_out(num_candidates: int, rolled_out: list[FloatArray]) -> None:
    QUICK.propose(TASK, num_candidates, np.random.default_rng(0), None)

    assert sum(map(len, rolled_out)) == 10 * num_candidates + 1
    assert QUICK.cost(num_candidates) == Cost(rollouts=10 * num_candidates + 1)


def test_the_best_of_everything_rolled_out_is_returned(rolled_out: list[FloatArray]) -> None:
    proposal = QUICK.propose(TASK, 16, np.random.default_rng(0), None)

    everything = score(TASK, np.concatenate(rolled_out))
    np.testing.assert_array_equal(proposal.controls, everything.best(16).controls)


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

    proposal = method.propose(problem, num_candidates, np.random.default_rng(seed), None)

    assert proposal.controls.shape == (num_candidates, 33)
    assert np.all(np.abs(proposal.controls) <= 1.3)
    assert np.all(np.diff(score(problem, proposal.controls).errors) >= 0)


def test_coloured_noise_breaks_away_where_white_noise_does_not() -> None:
    assert mean_error(QUICK, 64) < 0.5 * mean_error(MPPI(iterations=10, noise_exponent=0.0), 64)


def test_iterations_and_candidates_improve_the_plan() -> None:
    assert mean_error(MPPI(), 32) < mean_error(QUICK, 32) < mean_error(MPPI(iterations=1), 32)
    assert mean_error(QUICK, 128) < mean_error(QUICK, 8)


def test_it_beats_uniform_shooting_with_the_same_number_of_rollouts() -> None:
    assert mean_error(MPPI(), 64) < 0.2 * mean_error(Uniform(), 41 * 64 + 1)


def test_the_same_seed_gives_the_same_plan_and_another_one_another() -> None:
    one, same, other = (solve(QUICK, 32, seed).controls for seed in (1, 1, 2))

    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one, other)


@pytest.mark.parametrize("horizon", [1, 2, 5])
def test_one_candidate_and_the_shortest_horizons_work(horizon: int) -> None:
    problem = Problem(np.zeros(2), np.array([0.001, 0.0]), horizon=horizon)
    candidates = solve(MPPI(iterations=3, smoothing_window=7), 1, problem=problem).candidates

    assert candidates.controls.shape == (1, horizon)


@pytest.mark.parametrize(
    "problem",
    [
        Problem(np.zeros(2), np.array([-0.2, 0.0]), horizon=40),
        Problem(np.zeros(2), np.array([1.0, 0.0]), horizon=99),
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
    assert solve(MPPI(), 128, problem=problem).terminal_error < 0.03


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"iterations": 0}, "iterations"),
        ({"noise_std": 0.0}, "noise_std"),
        ({"noise_std": float("nan")}, "noise_std"),
        ({"noise_exponent": -1.0}, "noise_exponent"),
        ({"temperature": 0.0}, "temperature"),
        ({"temperature": float("inf")}, "temperature"),
        ({"smoothing_window": 0}, "smoothing_window"),
        ({"smoothing_window": 4}, "smoothing_window must be odd"),
    ],
)
def test_impossible_options_are_refused_by_name(options: dict[str, float], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        MPPI(**options)  # type: ignore[arg-type]


def test_it_reaches_half_a_metre_from_rest_to_rest() -> None:
    for seed in range(5):
        assert solve(MPPI(), 128, seed).terminal_error < 0.01
