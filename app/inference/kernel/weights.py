"""The network's weights as the kernel reads them, arranged from those of a checkpoint."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from app.inference.checkpoint import BLOCKS
from app.inference.kernel.convolution import KERNEL_TRANSFORM
from app.inference.kernel.matrix_product import Floats
from app.inference.kernel.simd import LANES

CACHE_LINE = 64
"""Bytes. A vector fills one; weights across two of them cost a tenth of a prediction's time."""


class Weights(NamedTuple):
    """The weights of the convolutions and norms, float32, contiguous, from a cache line's start.

    C channels; 6 residual blocks in their order, two convolutions each. A kernel of k taps is a
    flat (k C, C), tap by tap. The embeddings are not among them: a row brings the sum that they
    add in each block.
    """

    input_kernel: Floats
    """(3 C,)."""
    input_bias: Floats
    """(C,)."""
    norm_scales: Floats
    """(12, C)."""
    norm_shifts: Floats
    """(12, C)."""
    block_kernels: Floats
    """(12, 6 C C): transformed, point by point."""
    second_biases: Floats
    """(6, C); the first convolution's bias belongs to the embedding."""
    downsampling_kernel: Floats
    """(4 C C,)."""
    downsampling_bias: Floats
    """(C,)."""
    upsampling_even_kernel: Floats
    """(2 C C,): what positions 0, 2, 4 ... take from the position before and their own."""
    upsampling_odd_kernel: Floats
    """(2 C C,): what positions 1, 3, 5 ... take from their own position and the next."""
    upsampling_bias: Floats
    """(C,)."""
    output_kernel: Floats
    """(3 C 16,): one column and fifteen of zeros."""
    output_bias: Floats
    """(1,)."""


def arrange(parameters: Mapping[str, Floats]) -> Weights:
    """Arrange a checkpoint's parameters, whose shapes are those of `parameter_shapes`.

    The kernel checks no bounds: the shapes are to be compared before.
    """

    def taps_first(name: str) -> Floats:
        """Return a convolution's (out, in, 1, taps) as (taps in, out)."""
        kernel = parameters[f"{name}.weight"].squeeze(2).transpose(2, 1, 0)
        return kernel.reshape(-1, kernel.shape[2])

    def both(name: str) -> Floats:
        """Return a parameter of the first and second half of every block, in order: (12, ...)."""
        return np.stack(
            [parameters[f"{block}.{name.format(half)}"] for block in BLOCKS for half in (1, 2)]
        )

    taps = both("conv{}.weight").squeeze(3).astype(np.float64)
    # (12, out, in, points) as (12, points, in, out).
    block_kernels = (taps @ KERNEL_TRANSFORM.T).transpose(0, 3, 2, 1)
    upsampling = parameters["upsampling.weight"].squeeze(2).transpose(2, 0, 1)
    return Weights(
        input_kernel=_floats(taps_first("input").ravel()),
        input_bias=_floats(parameters["input.bias"]),
        norm_scales=_floats(both("norm{}.weight")),
        norm_shifts=_floats(both("norm{}.bias")),
        block_kernels=_floats(block_kernels.reshape(len(block_kernels), -1)),
        second_biases=_floats(np.stack([parameters[f"{block}.conv2.bias"] for block in BLOCKS])),
        downsampling_kernel=_floats(taps_first("downsampling").ravel()),
        downsampling_bias=_floats(parameters["downsampling.bias"]),
        upsampling_even_kernel=_floats(upsampling[[3, 1]].ravel()),
        upsampling_odd_kernel=_floats(upsampling[[2, 0]].ravel()),
        upsampling_bias=_floats(parameters["upsampling.bias"]),
        output_kernel=_floats(np.pad(taps_first("output"), ((0, 0), (0, LANES - 1))).ravel()),
        output_bias=_floats(parameters["output.bias"]),
    )


def _floats(array: Floats) -> Floats:
    """Return a contiguous float32 copy that begins at the beginning of a cache line."""
    size = array.size * np.dtype(np.float32).itemsize
    memory = np.empty(size + CACHE_LINE, np.uint8)
    start = -memory.ctypes.data % CACHE_LINE
    copy = memory[start : start + size].view(np.float32).reshape(array.shape)
    copy[...] = array
    return copy
