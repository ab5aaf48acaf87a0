"""The arrays of the domain."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from app.compilation import compiled

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]


@compiled
def copy_into(target: FloatArray, source: FloatArray) -> None:
    """Copy `source` (N,) into `target`, which is as long.

    In a kernel an assignment to a slice takes two seconds more to compile, since it broadcasts.
    """
    for i in range(target.size):
        target[i] = source[i]
