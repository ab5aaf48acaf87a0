import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TypeAlias

import pytest
import torch
from torch import Tensor

from app.inference.diffusion_times import CLEAN, diffusion_times
from app.inference.manifest import Prediction
from app.inference.noise_levels import ModelKind, noise_levels
from app.inference.solvers import SOLVERS, Steps, ddim, dpm_solver
from training.schedule import straight_alphas_cumprod

T = 200
ALPHAS = [math.cos((t + 2) / 205 * math.pi / 2) ** 2 for t in range(T)]
"""Signal shares of a cosine-like schedule."""
MEAN, STD = 0.3, 0.2
UNBOUNDED = 1e12

Solver: TypeAlias = Callable[..., Steps]
Predictor: TypeAlias = Callable[[Tensor, int], Tensor]
"""Of u_t (K, H) and t; (K, H)."""
KINDS: tuple[Prediction, ...] = ("noise", "clean", "velocity")
every_kind = pytest.mark.parametrize("predicts", KINDS)
every_solver = pytest.mark.parametrize("solve", [ddim, dpm_solver])


def run(
    solve: Solver,
    predict: Predictor,
    noise: Tensor,
    times: Sequence[int],
    alphas: Sequence[float] = ALPHAS,
    predicts: Prediction = "noise",
    kind: ModelKind = "diffusion",
    **bound: float,
) -> Tensor:
    """Give a solver all the predictions that it asks for; return its controls."""
    steps = solve(noise, times, noise_levels(kind, alphas), predicts, **bound)
    asked = next(steps)
    while True:
        try:
            asked = steps.send(predict(*asked))
        except StopIteration as done:
            controls: Tensor = done.value
            return controls


def even_times(num_timesteps: int, steps: int) -> list[int]:
    return diffusion_times(num_timesteps, steps, 1.0, 0.0)


def optimal_denoiser(
    mean: float, std: float, alphas: Sequence[float] = ALPHAS, predicts: Prediction = "noise"
) -> Predictor:
    """The best prediction where all data are independently N(mean, std^2)."""

    def predict(u: Tensor, t: int) -> Tensor:
        signal, level = math.sqrt(alphas[t]), math.sqrt(1 - alphas[t])
        surprise = (u - signal * mean) / (signal**2 * std**2 + level**2)
        noise, clean = level * surprise, mean + signal * std**2 * surprise
        return {"noise": noise, "clean": clean, "velocity": signal * noise - level * clean}[
            predicts
        ]

    return predict


def spread(times: list[int], std: float) -> float:
    """What DDIM makes of a unit of initial spread: every step is linear in u - sqrt(alpha) mean.

    A step takes the clean part from alpha to the next alpha, and the noise likewise.
    """
    factor = 1.0
    for t, next_t in pairwise(times):
        alpha, next_alpha = ALPHAS[t], 1.0 if next_t == CLEAN else ALPHAS[next_t]
        clean = math.sqrt(alpha * next_alpha) * std**2
        noise = math.sqrt((1 - alpha) * (1 - next_alpha))
        factor *= (clean + noise) / (alpha * std**2 + 1 - alpha)
    return factor


def sample(
    noise: Tensor, steps: int, predicts: Prediction = "noise", solve: Solver = ddim
) -> Tensor:
    predict, times = optimal_denoiser(MEAN, STD, ALPHAS, predicts), even_times(T, steps)
    return run(solve, predict, noise, times, predicts=predicts, bound=UNBOUNDED)


@every_kind
@pytest.mark.parametrize("steps", range(1, T + 1))
def test_ddim_on_gaussian_data_follows_the_closed_form(steps: int, predicts: Prediction) -> None:
    offsets = torch.linspace(-3, 3, 16, dtype=torch.float64).reshape(2, 8)
    noise = math.sqrt(ALPHAS[-1]) * MEAN + offsets

    controls = sample(noise, steps, predicts)

    assert controls.shape == noise.shape
    expected = MEAN + spread(even_times(T, steps), STD) * offsets
    torch.testing.assert_close(controls, expected, rtol=1e-9, atol=1e-9)


def test_ddim_recovers_the_spread_of_the_data_as_steps_grow() -> None:
    noise = torch.tensor([[0.0], [1.0]], dtype=torch.float64)

    def spread_with(steps: int) -> float:
        low, high = sample(noise, steps)
        return float(high - low)

    misses = [abs(spread_with(steps) - STD) for steps in (1, 5, 20, 50, 200)]
    assert misses == sorted(misses, reverse=True)
    assert misses[-1] < 0.02 * STD


@every_solver
@pytest.mark.parametrize("steps", [1, 2, 3, 10, 50, 199, 200])
def test_controls_stay_finite_and_within_the_bound(solve: Solver, steps: int) -> None:
    noise = 3 * torch.randn(4, 64, generator=torch.Generator().manual_seed(0))

    controls = run(
        solve,
        lambda u, t: torch.sin(7 * u + t),
        noise,
        even_times(T, steps),
        bound=0.5,
    )

    assert torch.all(torch.isfinite(controls))
    assert controls.abs().max() <= 0.5
    assert controls.dtype == noise.dtype


@every_solver
def test_controls_keep_within_one_unless_told_otherwise(solve: Solver) -> None:
    noise = torch.linspace(-3, 3, 8).reshape(1, 8)

    controls = run(solve, lambda u, _: -u, noise, even_times(T, 5))

    assert controls.abs().max() == 1.0


@every_solver
def test_the_last_step_ends_at_the_clean_sequence_without_noise(solve: Solver) -> None:
    """With true noise predictions the sequence that was noised comes back."""
    clean = torch.linspace(-0.9, 0.9, 12, dtype=torch.float64).reshape(2, 6)
    epsilon = torch.randn(2, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    noise = math.sqrt(ALPHAS[-1]) * clean + math.sqrt(1 - ALPHAS[-1]) * epsilon

    for steps in (1, 2, 7, 200):
        controls = run(solve, lambda _u, _t: epsilon, noise, even_times(T, steps))
        torch.testing.assert_close(controls, clean, rtol=0, atol=1e-9)


@every_solver
@pytest.mark.parametrize("steps", [1, 3, 50, T])
def test_whatever_is_predicted_the_controls_are_the_same(solve: Solver, steps: int) -> None:
    noise = torch.randn(4, 8, dtype=torch.float64, generator=torch.Generator().manual_seed(3))

    by_noise, *others = (sample(noise, steps, predicts, solve) for predicts in KINDS)

    assert float(by_noise.std()) > 1e-3
    for controls in others:
        torch.testing.assert_close(controls, by_noise, rtol=1e-9, atol=1e-9)


@every_solver
@pytest.mark.parametrize("predicts", ["clean", "velocity"])
def test_times_may_begin_where_no_signal_is_left(solve: Solver, predicts: Prediction) -> None:
    """A wrong prediction there is not amplified, as an error in the noise would be."""
    alphas = [0.99, 0.5, 1e-9]
    noise = torch.randn(4, 8, generator=torch.Generator().manual_seed(4))

    def controls(error: float) -> Tensor:
        exact = optimal_denoiser(MEAN, STD, alphas, predicts)
        wrong: Predictor = lambda u, t: exact(u, t) + error * (t == 2)  # noqa: E731
        return run(solve, wrong, noise, [2, 1, 0, CLEAN], alphas, predicts, bound=UNBOUNDED)

    assert torch.all(torch.isfinite(controls(0.0)))
    assert float((controls(0.01) - controls(0.0)).abs().max()) < 0.02


@every_solver
@every_kind
def test_what_is_predicted_is_left_alone(solve: Solver, predicts: Prediction) -> None:
    given: list[Tensor] = []

    def predict(u: Tensor, _: int) -> Tensor:
        given.append(2 * torch.ones_like(u))
        return given[-1]

    run(solve, predict, torch.ones(2, 4), even_times(T, 3), predicts=predicts)

    assert all(bool((prediction == 2).all()) for prediction in given)


def test_the_noise_is_derived_anew_from_the_clamped_sequence() -> None:
    """With the clean sequence clamped, the noise must be what separates u from the clamped one."""
    times, bound = [150, 60, CLEAN], 0.5
    u = torch.tensor([[1.3, 0.1]], dtype=torch.float64)
    seen: list[Tensor] = []

    def predict_noise(u: Tensor, _: int) -> Tensor:
        seen.append(u)
        return torch.tensor([[-2.0, 0.1]], dtype=torch.float64)

    run(ddim, predict_noise, u, times, bound=bound)

    alpha, next_alpha = ALPHAS[150], ALPHAS[60]
    clamped = 0.5
    noise = (1.3 - math.sqrt(alpha) * clamped) / math.sqrt(1 - alpha)
    expected = math.sqrt(next_alpha) * clamped + math.sqrt(1 - next_alpha) * noise
    assert float(seen[1][0, 0]) == pytest.approx(expected, rel=1e-12)
    # The second control was never beyond the bound: it takes the predicted noise as it is.
    free = (0.1 - math.sqrt(1 - alpha) * 0.1) / math.sqrt(alpha)
    assert abs(free) < bound
    expected = math.sqrt(next_alpha) * free + math.sqrt(1 - next_alpha) * 0.1
    assert float(seen[1][0, 1]) == pytest.approx(expected, rel=1e-12)


@every_solver
def test_each_time_is_predicted_at_once_and_the_noise_left_alone(solve: Solver) -> None:
    times = even_times(T, 9)
    noise = torch.ones(1, 4)
    asked: list[int] = []

    def predict_noise(u: Tensor, t: int) -> Tensor:
        asked.append(t)
        return u

    run(solve, predict_noise, noise, times)

    assert asked == times[:-1]
    assert torch.all(noise == 1)


def schedule(steps: int) -> list[float]:
    """Signal shares of `steps` + 1 levels whose log ratios are evenly spaced from 3 to -3."""
    return [1 / (1 + math.exp(-2 * (3 - 6 * i / steps))) for i in range(steps + 1)]


def miss(solve: Solver, steps: int) -> float:
    """How far a sampling of Gaussian data ends from the solution of the differential equation.

    That solution keeps u - sqrt(alpha) mean in proportion to the spread of the noisy data. It is
    followed over `steps` steps; the step to the clean sequence then is the same for all of them.
    """
    alphas = schedule(steps)
    noise = torch.tensor([[0.0], [1.0]], dtype=torch.float64) + math.sqrt(alphas[-1]) * MEAN
    low, high = run(
        solve,
        optimal_denoiser(MEAN, STD, alphas),
        noise,
        [*range(steps, -1, -1), CLEAN],
        alphas,
        bound=UNBOUNDED,
    )
    assert float(low) == pytest.approx(MEAN, abs=1e-12)
    first, last = (alphas[i] * STD**2 + 1 - alphas[i] for i in (-1, 0))
    exact = math.sqrt(last / first) * math.sqrt(alphas[0]) * STD**2 / last
    return abs(float(high - low) - exact)


@pytest.mark.parametrize(("solve", "order"), [(ddim, 1), (dpm_solver, 2)])
def test_the_error_falls_with_the_order_of_the_solver(solve: Solver, order: int) -> None:
    misses = [miss(solve, steps) for steps in (40, 80, 160, 320)]

    for coarse, fine in pairwise(misses):
        assert math.log2(coarse / fine) == pytest.approx(order, abs=0.15)


def test_dpm_solver_is_linear_in_the_offsets_and_recovers_the_spread_of_the_data() -> None:
    offsets = torch.linspace(-3, 3, 16, dtype=torch.float64).reshape(2, 8)
    noise = math.sqrt(ALPHAS[-1]) * MEAN + offsets

    def factor(steps: int) -> float:
        controls = sample(noise, steps, solve=dpm_solver)
        factor = float((controls[0, 0] - MEAN) / offsets[0, 0])
        torch.testing.assert_close(controls, MEAN + factor * offsets, rtol=1e-9, atol=1e-9)
        return factor

    misses = [abs(factor(steps) - STD) for steps in (10, 20, 50, 100, 200)]
    assert misses == sorted(misses, reverse=True)
    assert misses[-1] < 0.002 * STD


@pytest.mark.parametrize(
    ("times", "same"),
    [([150, CLEAN], True), ([150, 60, CLEAN], True), ([190, 150, 60, CLEAN], False)],
    ids=["one step", "two", "three"],
)
def test_up_to_two_steps_dpm_solver_is_ddim(times: list[int], same: bool) -> None:
    noise = torch.randn(4, 16, generator=torch.Generator().manual_seed(2))

    first, second = (
        run(solve, lambda u, t: torch.sin(u + t), noise, times) for solve in (ddim, dpm_solver)
    )

    assert torch.equal(first, second) == same


def test_dpm_solver_steps_to_a_clean_sequence_extrapolated_in_the_log_ratio() -> None:
    """The formula of Lu et al. 2022, Algorithm 2, with clean sequences that are given."""
    times, cleans = [150, 100, 40, CLEAN], {150: 0.6, 100: 0.2, 40: 0.1}
    seen: list[float] = []

    def predict_noise(u: Tensor, t: int) -> Tensor:
        seen.append(float(u))
        return (u - math.sqrt(ALPHAS[t]) * cleans[t]) / math.sqrt(1 - ALPHAS[t])

    result = run(
        dpm_solver, predict_noise, torch.tensor([[0.7]], dtype=torch.float64), times, ALPHAS
    )

    signal = {t: math.sqrt(ALPHAS[t]) for t in cleans}
    sigma = {t: math.sqrt(1 - ALPHAS[t]) for t in cleans}
    log_ratio = {t: math.log(signal[t] / sigma[t]) for t in cleans}
    h, previous_h = log_ratio[40] - log_ratio[100], log_ratio[100] - log_ratio[150]
    r = previous_h / h
    extrapolated = (1 + 1 / (2 * r)) * cleans[100] - 1 / (2 * r) * cleans[150]
    expected = sigma[40] / sigma[100] * seen[1] - signal[40] * math.expm1(-h) * extrapolated
    assert seen[2] == pytest.approx(expected, rel=1e-12)
    assert float(result) == pytest.approx(cleans[40], rel=1e-12)


FLOW_STEPS = 64
FLOW_ALPHAS = straight_alphas_cumprod(FLOW_STEPS).tolist()
FLOW_LEVELS = noise_levels("flow", FLOW_ALPHAS)


def flow_velocity(u: Tensor, t: int) -> Tensor:
    """The exact velocity of the flow from N(MEAN, STD^2) to the noise, E[eps - clean | u]."""
    signal, noise = FLOW_LEVELS[t][:2]
    variance = signal**2 * STD**2 + noise**2
    return -MEAN + (noise - signal * STD**2) / variance * (u - signal * MEAN)


def flowed(solve: Solver, offsets: Tensor, steps: int) -> Tensor:
    """What a solver makes of the mean of the noise and these offsets."""
    start = FLOW_LEVELS[-2].signal * MEAN + offsets
    times = even_times(FLOW_STEPS, steps)
    return run(solve, flow_velocity, start, times, FLOW_ALPHAS, "velocity", "flow", bound=UNBOUNDED)


def test_ddim_on_a_flow_is_eulers_method() -> None:
    offsets = torch.linspace(-2, 2, 8, dtype=torch.float64).reshape(1, 8)
    times = even_times(FLOW_STEPS, 7)

    u = FLOW_LEVELS[-2].signal * MEAN + offsets
    for t, next_t in pairwise(times):
        u = u + (FLOW_LEVELS[next_t].noise - FLOW_LEVELS[t].noise) * flow_velocity(u, t)

    torch.testing.assert_close(flowed(ddim, offsets, 7), u, rtol=1e-10, atol=1e-10)


@every_solver
def test_a_flow_with_the_exact_velocity_of_a_gaussian_arrives_at_it(solve: Solver) -> None:
    """The flow keeps u less its mean in proportion to its standard deviation."""
    offsets = torch.linspace(-2, 2, 16, dtype=torch.float64).reshape(2, 8)
    first = FLOW_LEVELS[-2]
    exact = MEAN + STD / math.hypot(first.signal * STD, first.noise) * offsets

    coarse, fine = (float((flowed(solve, offsets, n) - exact).abs().max()) for n in (8, 64))

    assert fine < 0.1 * STD
    assert fine < coarse / 2


def test_solvers_are_offered_under_their_names() -> None:
    assert {"ddim": ddim, "dpm_solver": dpm_solver} == SOLVERS
