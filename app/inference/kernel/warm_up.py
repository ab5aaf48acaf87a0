"""A tiny prediction, for which every kernel of the network is compiled."""

import numpy as np

from app.inference.checkpoint import BLOCKS, Widths, parameter_shapes
from app.inference.kernel.simd import LANES
from app.inference.kernel.unet import LENGTH_MULTIPLE, predict_rows
from app.inference.kernel.weights import arrange


def warm_up() -> None:
    """Predict a row of the least size, with weights of zero."""
    shapes = parameter_shapes(Widths(LANES, 2, 1, 1))
    added = np.zeros((1, len(BLOCKS) * LANES), np.float32)
    row = np.zeros((1, LENGTH_MULTIPLE), np.float32)
    weights = arrange({name: np.zeros(shape, np.float32) for name, shape in shapes.items()})
    predict_rows(weights, row, np.zeros(1, np.int64), added, added, row)
