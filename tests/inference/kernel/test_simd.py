"""Kernels in sixteen lanes against NumPy."""

from typing import TypeAlias

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from app.compilation import compiled
from app.inference.kernel.simd import (
    LANES,
    floor,
    load,
    maximum,
    minimum,
    multiply_add,
    power_of_two,
    silu,
    spread,
    spread_from,
    store,
)

Floats: TypeAlias = NDArray[np.float32]

finite = st.floats(allow_nan=False, allow_infinity=False, width=32)
lanes = arrays(np.float32, LANES, elements=finite)
moderate_lanes = arrays(np.float32, LANES, elements=st.floats(-1000, 1000, width=32))


@compiled
def move(x: Floats, start: int, out: Floats, out_start: int) -> None:
    store(out, out_start, load(x, start))


@compiled
def fill(x: Floats, index: int, scalar: np.float32, out: Floats) -> None:
    store(out, 0, spread_from(x, index))
    store(out, LANES, spread(scalar))


@compiled
def calculate(x: Floats, y: Floats, out: Floats) -> None:
    a, b = load(x, 0), load(y, 0)
    store(out, 0, a + b)
    store(out, LANES, a - b)
    store(out, 2 * LANES, a * b)
    store(out, 3 * LANES, a / b)
    store(out, 4 * LANES, minimum(a, b))
    store(out, 5 * LANES, maximum(a, b))
    store(out, 6 * LANES, floor(a))


@compiled
def multiply_and_add(x: Floats, y: Floats, z: Floats, out: Floats) -> None:
    store(out, 0, multiply_add(load(x, 0), load(y, 0), load(z, 0)))


@compiled
def powers_of_two(x: Floats, out: Floats) -> None:
    for i in range(0, x.size, LANES):
        store(out, i, power_of_two(load(x, i)))


@compiled
def silus(x: Floats, out: Floats) -> None:
    for i in range(0, x.size, LANES):
        store(out, i, silu(load(x, i)))


def silu_of(x: Floats) -> Floats:
    out = np.empty_like(x)
    silus(x, out)
    return out


@given(st.integers(0, 20), st.integers(0, 20))
def test_sixteen_numbers_are_moved_from_anywhere_to_anywhere(start: int, out_start: int) -> None:
    x = np.arange(1, 41, dtype=np.float32)
    out = np.zeros(40, np.float32)

    move(x, start, out, out_start)

    expected = np.zeros(40, np.float32)
    expected[out_start : out_start + LANES] = x[start : start + LANES]
    np.testing.assert_array_equal(out, expected)


@given(lanes, st.integers(0, LANES - 1), finite)
def test_a_number_is_spread_over_all_lanes(x: Floats, index: int, scalar: float) -> None:
    out = np.empty(2 * LANES, np.float32)

    fill(x, index, np.float32(scalar), out)

    np.testing.assert_array_equal(out, np.repeat([x[index], np.float32(scalar)], LANES))


@given(lanes, lanes)
def test_operators_are_those_of_numpy_to_the_last_bit(x: Floats, y: Floats) -> None:
    out = np.empty((7, LANES), np.float32)

    calculate(x, y, out.ravel())

    with np.errstate(all="ignore"):
        expected = [x + y, x - y, x * y, x / y, np.minimum(x, y), np.maximum(x, y), np.floor(x)]
    np.testing.assert_array_equal(out, expected)


@given(moderate_lanes, moderate_lanes, moderate_lanes)
def test_multiply_add_multiplies_and_adds(x: Floats, y: Floats, z: Floats) -> None:
    out = np.empty(LANES, np.float32)

    multiply_and_add(x, y, z, out)

    # Products of float32 are exact in float64.
    expected = x.astype(np.float64) * y + z
    np.testing.assert_allclose(out, expected, rtol=2**-23, atol=2**-126)


def test_multiply_add_rounds_once() -> None:
    x = np.full(LANES, 1 + 2**-12, np.float32)
    out = np.empty(LANES, np.float32)

    multiply_and_add(x, x, np.full(LANES, -1, np.float32), out)

    # The last summand is lost where the product is rounded first.
    np.testing.assert_array_equal(out, np.float32(2**-11 + 2**-24))


def test_powers_of_two_are_exact() -> None:
    exponents = np.resize(np.arange(-126, 128), 16 * LANES)
    out = np.empty(16 * LANES, np.float32)

    powers_of_two(exponents.astype(np.float32), out)

    np.testing.assert_array_equal(out, np.ldexp(1.0, exponents))


@pytest.mark.parametrize(
    ("low", "high", "tolerance"), [(-16, 200, 1e-6), (-87, -16, 5e-6)], ids=["near", "tail"]
)
def test_silu_is_right_relative_to_its_size(low: float, high: float, tolerance: float) -> None:
    """In the tail the rounding of the exponent grows with it."""
    x = np.linspace(low, high, 160_000, dtype=np.float32)
    wide = x.astype(np.float64)

    np.testing.assert_allclose(silu_of(x), wide / (1 + np.exp(-wide)), rtol=tolerance)


def test_silu_vanishes_far_below_nought_where_its_exponential_is_no_float() -> None:
    x = -np.geomspace(87, 1e30, 16_000, dtype=np.float32)

    result = silu_of(x)

    # The exponential is held at 2^126.
    assert np.all(np.abs(result) <= np.abs(x.astype(np.float64)) * 2.0**-125)
    assert abs(result[-1]) < 2e-8


def test_silu_is_its_argument_at_nought_and_far_above() -> None:
    x = np.array([0.0, 30.0, 1e30, 3.4e38] * 4, np.float32)

    np.testing.assert_array_equal(silu_of(x), x)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_silu_does_not_make_a_finite_number_of_what_is_not(bad: float) -> None:
    x = np.ones(LANES, np.float32)
    x[5] = bad

    result = silu_of(x)

    assert np.isfinite(result).tolist() == np.isfinite(x).tolist()
    assert np.isnan(result[5]) == np.isnan(bad)
