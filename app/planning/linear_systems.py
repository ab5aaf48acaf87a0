"""Linear systems that several kernels solve."""

import numpy as np

from app.compilation import compiled
from app.planning.arrays import FloatArray

DEPENDENT = 1e-11
"""A row of which less than this share is left depends on those before it."""


@compiled
def solve_semidefinite(matrix: FloatArray, unknowns: FloatArray) -> None:
    """Solve in place by elimination; a row that depends on those before it gets zero.

    Args:
        matrix: (N, N), symmetric and positive semidefinite; overwritten.
        unknowns: (N,), the right-hand side, and then the solution.
    """
    size = unknowns.size
    original = np.empty(size)
    for i in range(size):
        original[i] = matrix[i, i]
    for i in range(size):
        if matrix[i, i] <= DEPENDENT * original[i]:
            continue
        for j in range(i + 1, size):
            factor = matrix[j, i] / matrix[i, i]
            for k in range(i + 1, size):
                matrix[j, k] -= factor * matrix[i, k]
            unknowns[j] -= factor * unknowns[i]
    for i in range(size - 1, -1, -1):
        if matrix[i, i] <= DEPENDENT * original[i]:
            unknowns[i] = 0.0
            continue
        for j in range(i + 1, size):
            unknowns[i] -= matrix[i, j] * unknowns[j]
        unknowns[i] /= matrix[i, i]
