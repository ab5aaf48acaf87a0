"""The network as vector code that Numba compiles at its first call; this is its only door.

Nothing in here knows PyTorch.
"""

from app.inference.kernel.matrix_product import Floats, multiply
from app.inference.kernel.simd import LANES
from app.inference.kernel.unet import LENGTH_MULTIPLE, predict_rows
from app.inference.kernel.warm_up import warm_up
from app.inference.kernel.weights import Weights, arrange

__all__ = [
    "LANES",
    "LENGTH_MULTIPLE",
    "Floats",
    "Weights",
    "arrange",
    "multiply",
    "predict_rows",
    "warm_up",
]
