import math
from itertools import pairwise

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from app.inference.samplers import (
    CLEAN,
    SAMPLERS,
    InvalidStepCount,
    NoisePredictor,
    ddim,
    guided,
    sampling_times,
)

T = 200
ALPHAS = [math.cos((t + 2) / 205 * math.pi / 2) ** 2 for t in range(T)]
"""Signal shares of a cosine-like schedule."""
MEAN, STD = 0.3, 0.2
UNBOUNDED = 1e12


def optimal_denoiser(mean: float, std: float) -> NoisePredictor:
    """The best noise prediction where all data are independently N(mean, std^2)."""

    def predict_noise(u: Tensor, t: int) -> Tensor:
        alpha = ALPHAS[t]
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
    return ddim(optimal_denoiser(MEAN, STD), noise, sampling_times(T, steps), ALPHAS, bound)


@pytest.mark.parametrize("steps", range(1, T + 1))
def test_ddim_on_gaussian_data_follows_the_closed_form(steps: int) -> None:
    offsets = torch.linspace(-3, 3, 16, dtype=torch.float64).reshape(2, 8)
    noise = math.sqrt(ALPHAS[-1]) * MEAN + offsets

    controls = sample(noise, steps)

    assert controls.shape == noise.shape
    expected = MEAN + spread(sampling_times(T, steps), STD) * offsets
    torch.testing.assert_close(controls, expected, rtol=1e-9, atol=1e-9)


def test_ddim_recovers_the_spread_of_the_data_as_steps_grow() -> None:
    noise = torch.tensor([[0.0], [1.0]], dtype=torch.float64)

    def spread_with(steps: int) -> float:
        low, high = sample(noise, steps)
        return float(high - low)

    misses = [abs(spread_with(steps) - STD) for steps in (1, 5, 20, 50, 200)]
    assert misses == sorted(misses, reverse=True)
    assert misses[-1] < 0.02 * STD


@pytest.mark.parametrize("steps", [1, 2, 3, 10, 50, 199, 200])
def test_ddim_stays_finite_and_within_the_bound(steps: int) -> None:
    noise = 3 * torch.randn(4, 64, generator=torch.Generator().manual_seed(0))

    controls = ddim(
        lambda u, t: torch.sin(7 * u + t), noise, sampling_times(T, steps), ALPHAS, bound=0.5
    )

    assert torch.all(torch.isfinite(controls))
    assert controls.abs().max() <= 0.5
    assert controls.dtype == noise.dtype


def test_ddim_keeps_within_one_unless_told_otherwise() -> None:
    noise = torch.linspace(-3, 3, 8).reshape(1, 8)

    controls = ddim(lambda u, _: -u, noise, sampling_times(T, 5), ALPHAS)

    assert controls.abs().max() == 1.0


def test_the_last_step_ends_at_the_clean_sequence_without_noise() -> None:
    """With true noise predictions the sequence that was noised comes back."""
    clean = torch.linspace(-0.9, 0.9, 12, dtype=torch.float64).reshape(2, 6)
    epsilon = torch.randn(2, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    noise = math.sqrt(ALPHAS[-1]) * clean + math.sqrt(1 - ALPHAS[-1]) * epsilon

    for steps in (1, 2, 7, 200):
        controls = ddim(lambda _u, _t: epsilon, noise, sampling_times(T, steps), ALPHAS)
        torch.testing.assert_close(controls, clean, rtol=0, atol=1e-9)


def test_the_noise_is_derived_anew_from_the_clamped_sequence() -> None:
    """With the clean sequence clamped, the noise must be what separates u from the clamped one."""
    times, bound = [150, 60, CLEAN], 0.5
    u = torch.tensor([[1.3, 0.1]], dtype=torch.float64)
    seen: list[Tensor] = []

    def predict_noise(u: Tensor, _: int) -> Tensor:
        seen.append(u)
        return torch.tensor([[-2.0, 0.1]], dtype=torch.float64)

    ddim(predict_noise, u, times, ALPHAS, bound)

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


def test_ddim_predicts_once_at_each_time_and_leaves_the_noise_alone() -> None:
    times = sampling_times(T, 9)
    noise = torch.ones(1, 4)
    asked: list[int] = []

    def predict_noise(u: Tensor, t: int) -> Tensor:
        asked.append(t)
        return u

    ddim(predict_noise, noise, times, ALPHAS)

    assert asked == times[:-1]
    assert torch.all(noise == 1)


def test_ddim_is_offered_under_its_name() -> None:
    assert SAMPLERS["ddim"] is ddim


@pytest.mark.parametrize("num_timesteps", [1, 2, 50, 200])
def test_times_fall_strictly_from_the_noisiest_to_clean_for_every_step_count(
    num_timesteps: int,
) -> None:
    for steps in range(1, num_timesteps + 1):
        times = sampling_times(num_timesteps, steps)

        assert len(times) == steps + 1
        assert times[0] == num_timesteps - 1
        assert times[-1] == CLEAN
        assert all(t > next_t for t, next_t in pairwise(times))


@given(st.integers(2, 2000).flatmap(lambda n: st.tuples(st.just(n), st.integers(2, n))))
def test_times_are_evenly_spaced_down_to_the_first(counts: tuple[int, int]) -> None:
    num_timesteps, steps = counts
    times = sampling_times(num_timesteps, steps)[:-1]

    assert times[-1] == 0
    gaps = [t - next_t for t, next_t in pairwise(times)]
    assert min(gaps) >= 1
    assert all(abs(gap - (num_timesteps - 1) / (steps - 1)) <= 1 for gap in gaps)


@pytest.mark.parametrize("steps", [0, -1, T + 1])
def test_a_step_count_that_the_model_does_not_have_is_refused(steps: int) -> None:
    with pytest.raises(InvalidStepCount, match="from 1 to 200"):
        sampling_times(T, steps)


class FakeNetwork:
    """Answers 1 for rows with their condition and 10 for rows without, and counts."""

    def __init__(self) -> None:
        self.calls: list[tuple[Tensor, Tensor, Tensor, Tensor]] = []

    def __call__(self, u: Tensor, t: Tensor, condition: Tensor, keep: Tensor) -> Tensor:
        self.calls.append((u, t, condition, keep))
        return torch.where(keep, 1.0, 10.0)[:, None, None] * u


CONDITION = torch.tensor([0.1, 0.2, 0.3, 0.4])
NOISE = torch.arange(15, dtype=torch.float32).reshape(3, 5)


def test_guidance_of_one_is_one_conditional_prediction() -> None:
    network = FakeNetwork()

    prediction = guided(network, CONDITION, 1.0)(NOISE, 17)

    ((u, t, condition, keep),) = network.calls
    assert u.shape == (3, 1, 5)
    assert t.tolist() == [17] * 3
    assert t.dtype == torch.int64
    assert torch.equal(condition, CONDITION.repeat(3, 1))
    assert keep.tolist() == [True] * 3
    torch.testing.assert_close(prediction, NOISE)


def test_guidance_of_nought_is_one_unconditional_prediction() -> None:
    network = FakeNetwork()

    prediction = guided(network, CONDITION, 0.0)(NOISE, 17)

    ((u, _, _, keep),) = network.calls
    assert u.shape == (3, 1, 5)
    assert keep.tolist() == [False] * 3
    torch.testing.assert_close(prediction, 10 * NOISE)


@pytest.mark.parametrize("scale", [0.5, 2.0, 7.5])
def test_guidance_weighs_both_predictions_from_one_batch(scale: float) -> None:
    network = FakeNetwork()

    prediction = guided(network, CONDITION, scale)(NOISE, 17)

    ((u, t, condition, keep),) = network.calls
    assert u.shape == (6, 1, 5)
    assert t.tolist() == [17] * 6
    assert keep.dtype == torch.bool
    assert sorted(keep.tolist()) == [False] * 3 + [True] * 3
    assert torch.equal(condition[keep], CONDITION.repeat(3, 1))
    torch.testing.assert_close(u[keep].squeeze(1), NOISE)
    torch.testing.assert_close(u[~keep].squeeze(1), NOISE)
    # eps_uncond + s (eps_cond - eps_uncond)
    torch.testing.assert_close(prediction, 10 * NOISE + scale * (1 - 10) * NOISE)


@pytest.mark.parametrize(("scale", "rows"), [(0.0, 3), (1.0, 3), (2.0, 6)])
def test_a_guided_sampling_makes_one_call_a_step(scale: float, rows: int) -> None:
    network = FakeNetwork()

    ddim(guided(network, CONDITION, scale), NOISE, sampling_times(T, 12), ALPHAS)

    assert [len(u) for u, *_ in network.calls] == [rows] * 12
