"""Risks: one number for the errors over an ensemble."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.planning.uncertainty.risk import MEAN, Risk, tail_weights

ERRORS = np.array([0.4, 0.1, 0.3, 0.2])


@pytest.mark.parametrize(
    ("risk", "value"),
    [
        (MEAN, 0.25),
        (Risk("worst"), 0.4),
        (Risk("cvar", 0.5), 0.35),
        (Risk("cvar", 0.0), 0.25),
        # One plant and a half of the next.
        (Risk("cvar", 0.625), (0.4 + 0.5 * 0.3) / 1.5),
        # Less than one plant is one.
        (Risk("cvar", 0.99), 0.4),
        (Risk("cvar", 1.0), 0.4),
    ],
)
def test_it_is_the_mean_of_the_greatest_errors(risk: Risk, value: float) -> None:
    np.testing.assert_allclose(risk.of(np.array([ERRORS, 2 * ERRORS])), [value, 2 * value])


@given(st.lists(st.floats(0, 10), min_size=1, max_size=40), st.floats(0, 0.999))
def test_the_weights_of_the_kernel_make_the_same_number(errors: list[float], level: float) -> None:
    for risk in (MEAN, Risk("worst"), Risk("cvar", level)):
        weights = np.empty(len(errors))
        counted = risk.num_counted(len(errors))
        value = tail_weights(np.array(errors), counted, weights)
        assert value == pytest.approx(risk.of(np.array(errors)), abs=1e-12)
        assert weights.sum() == pytest.approx(counted)
        assert (weights @ errors) / counted == pytest.approx(value, abs=1e-12)


@given(st.integers(1, 40), st.integers(0, 2**32))
def test_it_is_to_the_last_bit_the_same_alone_and_among_others(num_plants: int, seed: int) -> None:
    errors = np.random.default_rng(seed).random((5, num_plants))
    for risk in (MEAN, Risk("worst"), Risk("cvar", 0.7)):
        assert risk.of(errors).tolist() == [float(risk.of(alone)) for alone in errors]
