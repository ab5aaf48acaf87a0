import math

import numpy as np
import pytest

from training.schedule import cosine_alphas_cumprod


@pytest.mark.parametrize("num_timesteps", [2, 20, 200, 1000])
def test_the_signal_falls_strictly_within_nought_and_one(num_timesteps: int) -> None:
    alphas = cosine_alphas_cumprod(num_timesteps)

    assert alphas.shape == (num_timesteps,)
    assert np.all(np.diff(alphas) < 0)
    assert alphas[0] < 1
    assert alphas[-1] > 0


def test_it_is_the_squared_cosine_of_nichol_and_dhariwal() -> None:
    alphas = cosine_alphas_cumprod(200)

    def f(fraction: float) -> float:
        return math.cos((fraction + 0.008) / 1.008 * math.pi / 2) ** 2

    for t in (0, 1, 49, 99, 150, 198):
        assert alphas[t] == pytest.approx(f((t + 1) / 200) / f(0), rel=1e-9)


@pytest.mark.parametrize("num_timesteps", [2, 20, 200, 1000])
def test_no_step_takes_more_than_the_cap_and_the_last_takes_just_that(
    num_timesteps: int,
) -> None:
    alphas = cosine_alphas_cumprod(num_timesteps)
    betas = 1 - alphas / np.concatenate([[1.0], alphas[:-1]])

    assert np.all(betas > 0)
    assert np.all(betas <= 0.999 + 1e-12)
    # Without the cap the last step would take everything, and sampling divide by nought.
    assert betas[-1] == pytest.approx(0.999)


def test_it_begins_almost_clean_and_ends_almost_in_noise() -> None:
    alphas = cosine_alphas_cumprod(200)

    assert alphas[0] > 0.999
    assert alphas[-1] < 1e-6
