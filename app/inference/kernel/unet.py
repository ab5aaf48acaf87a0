"""The network's forward pass as one compiled kernel, a row after the other.

Nothing here knows PyTorch.
"""

import numpy as np
from numpy.typing import NDArray

from app.compilation import compiled
from app.inference.kernel.convolution import (
    TILE,
    Scratch,
    activate,
    convolve,
    gather,
    make_scratch,
    pad,
)
from app.inference.kernel.matrix_product import Floats, multiply
from app.inference.kernel.simd import LANES, load, store
from app.inference.kernel.weights import Weights

LENGTH_MULTIPLE = 2 * TILE
"""Both lengths, H and H/2, are whole numbers of tiles."""


@compiled
def predict_rows(
    weights: Weights,
    controls: Floats,
    times: NDArray[np.int64],
    time_table: Floats,
    embedding: Floats,
    noise: Floats,
) -> None:
    """Predict the noise of some rows (paper, Eq. 3 and Table 1).

    Args:
        controls: (B, H), noisy and scaled; H a multiple of 8.
        times: (B,), rows of `time_table`.
        time_table: (T, 6 C), what each diffusion time adds in each block.
        embedding: (B, 6 C), what the row's condition adds in each block.
        noise: (B, H), written.
    """
    rows, horizon = controls.shape
    channels = weights.input_bias.size
    full, half = horizon * channels, horizon // 2 * channels
    x, skip, y = np.empty(full, np.float32), np.empty(full, np.float32), np.empty(half, np.float32)
    hidden, scratch = np.empty(full, np.float32), make_scratch(horizon, channels)
    line = np.zeros(horizon + 2, np.float32)
    column = np.empty(horizon * LANES, np.float32)
    added = np.empty(embedding.shape[1], np.float32)
    for row in range(rows):
        added[:] = time_table[times[row]] + embedding[row]
        line[1 : horizon + 1] = controls[row]
        multiply(line, 0, 1, weights.input_kernel, 0, x, 0, channels, horizon, 3, channels)
        _add(x, weights.input_bias, horizon)
        _block(weights, 0, added, x, horizon, hidden, scratch)
        _block(weights, 1, added, x, horizon, hidden, scratch)
        skip[:] = x
        _downsample(weights, x, horizon, y, scratch)
        _block(weights, 2, added, y, horizon // 2, hidden, scratch)
        _block(weights, 3, added, y, horizon // 2, hidden, scratch)
        _upsample(weights, y, horizon // 2, x, scratch)
        x += skip
        _block(weights, 4, added, x, horizon, hidden, scratch)
        _block(weights, 5, added, x, horizon, hidden, scratch)
        padded = pad(x, horizon, channels, scratch)
        multiply(
            padded, 0, channels, weights.output_kernel, 0, column, 0, LANES,
            horizon, 3 * channels, LANES,
        )  # fmt: skip
        for position in range(horizon):
            noise[row, position] = column[position * LANES] + weights.output_bias[0]


@compiled
def _add(x: Floats, bias: Floats, length: int) -> None:
    """Add `bias` (C,) at each of `length` positions of `x`."""
    for position in range(length):
        for c in range(0, bias.size, LANES):
            index = position * bias.size + c
            store(x, index, load(x, index) + load(bias, c))


@compiled
def _downsample(weights: Weights, x: Floats, length: int, out: Floats, scratch: Scratch) -> None:
    """Convolve with kernel 4 and stride 2: a window of four positions, two apart from the next."""
    channels = weights.downsampling_bias.size
    multiply(
        pad(x, length, channels, scratch), 0, 2 * channels, weights.downsampling_kernel, 0,
        out, 0, channels, length // 2, 4 * channels, channels,
    )  # fmt: skip
    _add(out, weights.downsampling_bias, length // 2)


@compiled
def _upsample(weights: Weights, x: Floats, length: int, out: Floats, scratch: Scratch) -> None:
    """Convolve transposed with kernel 4 and stride 2: even and odd positions each have two taps."""
    channels = weights.upsampling_bias.size
    padded = pad(x, length, channels, scratch)
    multiply(
        padded, 0, channels, weights.upsampling_even_kernel, 0,
        out, 0, 2 * channels, length, 2 * channels, channels,
    )  # fmt: skip
    multiply(
        padded, channels, channels, weights.upsampling_odd_kernel, 0,
        out, channels, 2 * channels, length, 2 * channels, channels,
    )  # fmt: skip
    _add(out, weights.upsampling_bias, 2 * length)


@compiled
def _block(
    weights: Weights,
    block: int,
    added: Floats,
    x: Floats,
    length: int,
    hidden: Floats,
    scratch: Scratch,
) -> None:
    """Add to `x` two pre-activated convolutions of it, the embedding added between them."""
    channels = weights.input_bias.size
    first, second = 2 * block, 2 * block + 1
    activate(x, length, weights.norm_scales[first], weights.norm_shifts[first], scratch)
    convolve(weights.block_kernels[first], length, channels, scratch)
    gather(added[block * channels :], length, channels, scratch.products, hidden, False)
    activate(hidden, length, weights.norm_scales[second], weights.norm_shifts[second], scratch)
    convolve(weights.block_kernels[second], length, channels, scratch)
    gather(weights.second_biases[block], length, channels, scratch.products, x, True)
