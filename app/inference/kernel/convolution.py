"""What the network spends its time on: GroupNorm, SiLU and a three-wide convolution, compiled.

A row's activations are (length, channels), float32 and flat, and stay in the core's own caches
from one layer to the next. The convolution takes half of its multiplications by Winograd's F(4, 3):
tiles of four outputs from six products.
"""

from typing import NamedTuple

import numpy as np

from app.compilation import compiled
from app.inference.checkpoint import GROUPS
from app.inference.kernel.matrix_product import TILE_ROWS, Floats, multiply
from app.inference.kernel.simd import LANES, load, multiply_add, silu, spread, store

TILE = 4
"""Outputs of a Winograd tile; a length is a whole number of them."""
POINTS = 6
"""Products of a tile: one for each of the points 0, 1, -1, 2, -2 and infinity."""
KERNEL_TRANSFORM = np.array(
    [
        [1 / 4, 0, 0],
        [-1 / 6, -1 / 6, -1 / 6],
        [-1 / 6, 1 / 6, -1 / 6],
        [1 / 24, 1 / 12, 1 / 6],
        [1 / 24, -1 / 12, 1 / 6],
        [0, 0, 1],
    ]
)
"""G of F(4, 3) (Lavin and Gray 2016, Sect. 4.1), (points, taps)."""

_ZERO, _ONE = np.float32(0), np.float32(1)
_TWO, _FOUR, _FIVE, _EIGHT = np.float32(2), np.float32(4), np.float32(5), np.float32(8)
_EPSILON = np.float32(1e-5)


class Scratch(NamedTuple):
    """Room for one row of (length, channels)."""

    padded: Floats
    """(length + 2, channels): an activation, a position of zeros before and after it."""
    tiles: Floats
    """(points, tiles, channels): the transformed input; tiles rounded up to a multiple of 4."""
    products: Floats
    """(points, tiles, channels)."""
    factors: Floats
    """(channels,)."""
    summands: Floats
    """(channels,)."""


@compiled
def make_scratch(length: int, channels: int) -> Scratch:
    """Return room for rows of up to `length` positions."""
    size = POINTS * points_apart(length, channels)
    return Scratch(
        np.empty((length + 2) * channels, np.float32),
        # The matrix product works on four tiles at a time; those beyond the last are never read.
        np.zeros(size, np.float32),
        np.empty(size, np.float32),
        np.empty(channels, np.float32),
        np.empty(channels, np.float32),
    )


@compiled
def points_apart(length: int, channels: int) -> int:
    """Return the distance of one point's tiles from the next's."""
    return -(-length // (TILE * TILE_ROWS)) * TILE_ROWS * channels


@compiled
def pad(x: Floats, length: int, channels: int, scratch: Scratch) -> Floats:
    """Return `x` with a position of zeros before and after, in `scratch.padded`."""
    padded = _between_zeros(length, channels, scratch)
    padded[channels : (length + 1) * channels] = x
    return padded


@compiled
def _between_zeros(length: int, channels: int, scratch: Scratch) -> Floats:
    """Return `scratch.padded` with zeros before and after where `length` positions will go."""
    padded = scratch.padded
    padded[:channels] = _ZERO
    padded[(length + 1) * channels : (length + 2) * channels] = _ZERO
    return padded


@compiled
def activate(x: Floats, length: int, scale: Floats, shift: Floats, scratch: Scratch) -> None:
    """Write SiLU(GroupNorm(x)) to `scratch.padded`, a position of zeros before and after it."""
    channels = scale.size
    factors, summands = scratch.factors, scratch.summands
    _normalisation(x, length, scale, shift, factors, summands)
    padded = _between_zeros(length, channels, scratch)
    for c in range(0, channels, LANES):
        factor, summand = load(factors, c), load(summands, c)
        for position in range(length):
            normalised = multiply_add(load(x, position * channels + c), factor, summand)
            store(padded, (position + 1) * channels + c, silu(normalised))


@compiled
def _normalisation(
    x: Floats, length: int, scale: Floats, shift: Floats, factors: Floats, summands: Floats
) -> None:
    """Write the factor and the summand by which GroupNorm takes each channel of `x`."""
    channels = scale.size
    for c in range(0, channels, LANES):
        even = odd = even_squared = odd_squared = spread(_ZERO)
        for position in range(0, length, 2):
            v = load(x, position * channels + c)
            w = load(x, (position + 1) * channels + c)
            even, even_squared = even + v, multiply_add(v, v, even_squared)
            odd, odd_squared = odd + w, multiply_add(w, w, odd_squared)
        # Sums and sums of squares, until the group's are known.
        store(factors, c, even + odd)
        store(summands, c, even_squared + odd_squared)
    size = channels // GROUPS
    weight = _ONE / np.float32(size * length)
    for start in range(0, channels, size):
        mean = np.sum(factors[start : start + size]) * weight
        variance = np.sum(summands[start : start + size]) * weight - mean * mean
        inverse = _ONE / np.sqrt(max(variance, _ZERO) + _EPSILON)
        for c in range(start, start + size):
            factors[c] = scale[c] * inverse
            summands[c] = shift[c] - mean * factors[c]


@compiled
def convolve(kernel: Floats, length: int, channels: int, scratch: Scratch) -> None:
    """Multiply the tiles of `scratch.padded` by a transformed kernel (points, channels, channels).

    `gather` makes the convolution of `scratch.products`.
    """
    scatter(scratch.padded, length, channels, scratch.tiles)
    size, square = points_apart(length, channels), channels * channels
    for point in range(POINTS):
        multiply(
            scratch.tiles, point * size, channels, kernel, point * square,
            scratch.products, point * size, channels, size // channels, channels, channels,
        )  # fmt: skip


@compiled
def scatter(padded: Floats, length: int, channels: int, out: Floats) -> None:
    """Transform a padded input: B^T d of F(4, 3) for each tile, point by point."""
    size = points_apart(length, channels)
    four, five, two = spread(_FOUR), spread(_FIVE), spread(_TWO)
    for tile in range(length // TILE):
        for c in range(0, channels, LANES):
            window = TILE * tile * channels + c
            d0 = load(padded, window)
            d1 = load(padded, window + channels)
            d2 = load(padded, window + 2 * channels)
            d3 = load(padded, window + 3 * channels)
            d4 = load(padded, window + 4 * channels)
            d5 = load(padded, window + 5 * channels)
            index = tile * channels + c
            store(out, index, multiply_add(four, d0, d4 - five * d2))
            even, odd = d4 - four * d2, d3 - four * d1
            store(out, index + size, even + odd)
            store(out, index + 2 * size, even - odd)
            even, odd = d4 - d2, two * (d3 - d1)
            store(out, index + 3 * size, even + odd)
            store(out, index + 4 * size, even - odd)
            store(out, index + 5 * size, multiply_add(four, d1, d5 - five * d3))


@compiled
def gather(
    bias: Floats, length: int, channels: int, products: Floats, out: Floats, accumulate: bool
) -> None:
    """Transform the output: A^T m of F(4, 3) for each tile, plus a bias, plus what was there."""
    two, four, eight = spread(_TWO), spread(_FOUR), spread(_EIGHT)
    size = points_apart(length, channels)
    for c in range(0, channels, LANES):
        summand = load(bias, c)
        for tile in range(length // TILE):
            index = tile * channels + c
            m0, m5 = load(products, index), load(products, index + 5 * size)
            m1, m2 = load(products, index + size), load(products, index + 2 * size)
            m3, m4 = load(products, index + 3 * size), load(products, index + 4 * size)
            even1, odd1, even2, odd2 = m1 + m2, m1 - m2, m3 + m4, m3 - m4
            y0 = m0 + even1 + even2 + summand
            y1 = multiply_add(two, odd2, odd1 + summand)
            y2 = multiply_add(four, even2, even1 + summand)
            y3 = multiply_add(eight, odd2, odd1 + m5 + summand)
            first = TILE * tile * channels + c
            if accumulate:
                y0 = y0 + load(out, first)
                y1 = y1 + load(out, first + channels)
                y2 = y2 + load(out, first + 2 * channels)
                y3 = y3 + load(out, first + 3 * channels)
            store(out, first, y0)
            store(out, first + channels, y1)
            store(out, first + 2 * channels, y2)
            store(out, first + 3 * channels, y3)
