import pytest

from app.inference.diffusion_times import CLEAN
from app.inference.noise_levels import ModelKind, noise_levels
from training.schedule import alphas_cumprod

STEPS = 100


@pytest.mark.parametrize("kind", ["diffusion", "flow"])
def test_the_last_level_is_without_noise(kind: ModelKind) -> None:
    levels = noise_levels(kind, alphas_cumprod(kind, STEPS).tolist())

    assert len(levels) == STEPS + 1
    assert levels[CLEAN][:2] == (1.0, 0.0)


def test_squared_shares_of_a_diffusion_add_up_to_one() -> None:
    for level in noise_levels("diffusion", alphas_cumprod("diffusion", STEPS).tolist()):
        assert level.signal**2 + level.noise**2 == pytest.approx(1.0)


def test_the_noise_of_a_flow_grows_evenly_and_its_shares_add_up_to_one() -> None:
    levels = noise_levels("flow", alphas_cumprod("flow", STEPS).tolist())

    for t, level in enumerate(levels[:-1]):
        assert level.noise == pytest.approx((t + 0.5) / STEPS)
        assert level.signal + level.noise == pytest.approx(1.0)


@pytest.mark.parametrize("kind", ["diffusion", "flow"])
def test_rates_are_the_directions_in_which_the_shares_change(kind: ModelKind) -> None:
    first, second, third = noise_levels(kind, [0.502, 0.5, 0.498, 0.4])[:3]

    ratio = (third.signal - first.signal) / (third.noise - first.noise)
    assert second.signal_rate / second.noise_rate == pytest.approx(ratio, rel=1e-4)
