import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, TypeAlias

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from app.inference.solvers import (
    CLEAN,
    SOLVERS,
    Steps,
    ddim,
    dpm_solver,
    even_times,
    middle_times,
)
from app.planning.methods.base import InvalidStepCount

T = 200
ALPHAS = [math.cos((t + 2) / 205 * math.pi / 2) ** 2 for t in range(T)]
"""Signal shares of a cosine-like schedule."""
MEAN, STD = 0.3, 0.2
UNBOUNDED = 1e12

Solver: TypeAlias = Callable[..., Steps]
NoisePredictor: TypeAlias = Callable[[Tensor, int], Tensor]
"""eps(u_t (K, H), t): the predicted noise (K, H)."""
every_solver = pytest.mark.parametrize("solve", [ddim, dpm_solver])


def run(solve: Solver, predict_noise: NoisePredictor, *args: Any, **options: Any) -> Tensor:
    """Give a solver all the predictions that it asks for; return its controls."""
    steps = solve(*args, **options)
    asked = next(steps)
    while True:
        try:
            asked = steps.send(predict_noise(*asked))
        except StopIteration as done:
            controls: Tensor = done.value
            return controls


def optimal_denoiser(mean: float, std: float, alphas: Sequence[float] = ALPHAS) -> NoisePredictor:
    """The best noise prediction where all data are independently N(mean, std^2)."""

    def predict_noise(u: Tensor, t: int) -> Tensor:
        alpha = alphas[t]
        return math.sqrt(1 - alpha) * (u - math.sqrt(alpha) * mean) / (alpha * std**2 + 1 - alpha)

    return predict_noise


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


def sample(noise: Tensor, steps: int, bound: float = UNBOUNDED) -> Tensor:
    return run(ddim, optimal_denoiser(MEAN, STD), noise, even_times(T, steps), ALPHAS, bound)


@pytest.mark.parametrize("steps", range(1, T + 1))
def test_ddim_on_gaussian_data_follows_the_closed_form(steps: int) -> None:
    offsets = torch.linspace(-3, 3, 16, dtype=torch.float64).reshape(2, 8)
    noise = math.sqrt(ALPHAS[-1]) * MEAN + offsets

    controls = sample(noise, steps)

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
        ALPHAS,
        bound=0.5,
    )

    assert torch.all(torch.isfinite(controls))
    assert controls.abs().max() <= 0.5
    assert controls.dtype == noise.dtype


@every_solver
def test_controls_keep_within_one_unless_told_otherwise(solve: Solver) -> None:
    noise = torch.linspace(-3, 3, 8).reshape(1, 8)

    controls = run(solve, lambda u, _: -u, noise, even_times(T, 5), ALPHAS)

    assert controls.abs().max() == 1.0


@every_solver
def test_the_last_step_ends_at_the_clean_sequence_without_noise(solve: Solver) -> None:
    """With true noise predictions the sequence that was noised comes back."""
    clean = torch.linspace(-0.9, 0.9, 12, dtype=torch.float64).reshape(2, 6)
    epsilon = torch.randn(2, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    noise = math.sqrt(ALPHAS[-1]) * clean + math.sqrt(1 - ALPHAS[-1]) * epsilon

    for steps in (1, 2, 7, 200):
        controls = run(solve, lambda _u, _t: epsilon, noise, even_times(T, steps), ALPHAS)
        torch.testing.assert_close(controls, clean, rtol=0, atol=1e-9)


def test_the_noise_is_derived_anew_from_the_clamped_sequence() -> None:
    """With the clean sequence clamped, the noise must be what separates u from the clamped one."""
    times, bound = [150, 60, CLEAN], 0.5
    u = torch.tensor([[1.3, 0.1]], dtype=torch.float64)
    seen: list[Tensor] = []

    def predict_noise(u: Tensor, _: int) -> Tensor:
        seen.append(u)
        return torch.tensor([[-2.0, 0.1]], dtype=torch.float64)

    run(ddim, predict_noise, u, times, ALPHAS, bound)

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

    run(solve, predict_noise, noise, times, ALPHAS)

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
        UNBOUNDED,
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
        predict_noise = optimal_denoiser(MEAN, STD)
        controls = run(dpm_solver, predict_noise, noise, even_times(T, steps), ALPHAS, UNBOUNDED)
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
        run(solve, lambda u, t: torch.sin(u + t), noise, times, ALPHAS)
        for solve in (ddim, dpm_solver)
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


def test_solvers_are_offered_under_their_names_with_their_times() -> None:
    assert {name: tuple(solver) for name, solver in SOLVERS.items()} == {
        "ddim": (even_times, ddim),
        "dpm_solver": (middle_times, dpm_solver),
    }


@pytest.mark.parametrize("num_timesteps", [1, 2, 50, 200])
def test_times_fall_strictly_from_the_noisiest_to_clean_for_every_step_count(
    num_timesteps: int,
) -> None:
    for steps in range(1, num_timesteps + 1):
        times = even_times(num_timesteps, steps)

        assert len(times) == steps + 1
        assert times[0] == num_timesteps - 1
        assert times[-1] == CLEAN
        assert all(t > next_t for t, next_t in pairwise(times))


@given(st.integers(2, 2000).flatmap(lambda n: st.tuples(st.just(n), st.integers(2, n))))
def test_times_are_evenly_spaced_down_to_the_first(counts: tuple[int, int]) -> None:
    num_timesteps, steps = counts
    times = even_times(num_timesteps, steps)[:-1]

    assert times[-1] == 0
    gaps = [t - next_t for t, next_t in pairwise(times)]
    assert min(gaps) >= 1
    assert all(abs(gap - (num_timesteps - 1) / (steps - 1)) <= 1 for gap in gaps)


@pytest.mark.parametrize("steps", [0, -1, T + 1])
def test_a_step_count_that_the_model_does_not_have_is_refused(steps: int) -> None:
    with pytest.raises(InvalidStepCount, match="from 1 to 200"):
        even_times(T, steps)


def test_middle_times_are_evenly_spaced_from_seven_to_two_and_a_half_tenths() -> None:
    assert middle_times(200, 1) == [140, CLEAN]
    assert middle_times(200, 2) == [140, 50, CLEAN]
    assert middle_times(200, 4) == [140, 110, 80, 50, CLEAN]
    assert middle_times(1000, 3) == [700, 475, 250, CLEAN]


@pytest.mark.parametrize(
    ("num_timesteps", "available"), [(1, 1), (2, 2), (3, 2), (4, 3), (20, 10), (50, 24), (200, 91)]
)
def test_middle_times_fall_strictly_for_every_step_count_and_others_are_refused(
    num_timesteps: int, available: int
) -> None:
    for steps in range(1, available + 1):
        times = middle_times(num_timesteps, steps)

        assert len(times) == steps + 1
        assert times[-1] == CLEAN
        assert num_timesteps > times[0] >= times[-2] >= 0
        assert all(t > next_t for t, next_t in pairwise(times))
    for steps in (-1, 0, available + 1):
        with pytest.raises(InvalidStepCount, match=f"from 1 to {available}, "):
            middle_times(num_timesteps, steps)
