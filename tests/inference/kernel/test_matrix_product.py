"""The tiled product against NumPy: small whole numbers, so that every sum is exact."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from app.inference.kernel.matrix_product import multiply

NOTHING = np.float32(-12345)

rows = st.integers(1, 5).map(lambda n: 4 * n)
columns = st.integers(1, 10).map(lambda n: 16 * n)
depths = st.integers(1, 40)
gaps = st.integers(0, 9)


@given(st.data(), rows, columns, depths, gaps, gaps, gaps, gaps)
def test_the_product_is_that_of_numpy_and_nothing_else_is_written(
    data: st.DataObject,
    rows: int,
    columns: int,
    depth: int,
    a_start: int,
    b_start: int,
    out_start: int,
    out_gap: int,
) -> None:
    # From windows that overlap, or are even the same, to rows with something between them.
    a_stride = data.draw(st.integers(0, depth + 5))
    out_stride = columns + out_gap
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    a = rng.integers(-9, 10, a_start + (rows - 1) * a_stride + depth).astype(np.float32)
    b = rng.integers(-9, 10, b_start + depth * columns).astype(np.float32)
    out = np.full(out_start + rows * out_stride + 7, NOTHING)
    windows = np.stack([a[a_start + row * a_stride :][:depth] for row in range(rows)])
    expected = out.copy()
    expected[out_start:][: rows * out_stride].reshape(rows, out_stride)[:, :columns] = windows @ b[
        b_start:
    ].reshape(depth, columns)

    multiply(a, a_start, a_stride, b, b_start, out, out_start, out_stride, rows, depth, columns)

    np.testing.assert_array_equal(out, expected)


def test_rows_of_two_products_interleave() -> None:
    """As the even and odd positions of a transposed convolution do."""
    rng = np.random.default_rng(0)
    a = rng.integers(-9, 10, (8, 32)).astype(np.float32)
    even, odd = rng.integers(-9, 10, (2, 32, 64)).astype(np.float32)
    out = np.full((16, 64), NOTHING)

    multiply(a.ravel(), 0, 32, even.ravel(), 0, out.ravel(), 0, 128, 8, 32, 64)
    multiply(a.ravel(), 0, 32, odd.ravel(), 0, out.ravel(), 64, 128, 8, 32, 64)

    np.testing.assert_array_equal(out[0::2], a @ even)
    np.testing.assert_array_equal(out[1::2], a @ odd)
