"""The step of a damped least-squares problem, by the smaller of two linear systems."""

from typing import NamedTuple

import numpy as np

from app.compilation import compiled
from app.planning.arrays import FloatArray, IntArray, copy_into
from app.planning.linear_systems import solve_semidefinite


class NormalEquations(NamedTuple):
    """Of min |r + J d|^2 + damping |d|^2 over d (N,); J is (M, N).

    Either (J^T J + damping I) d = -J^T r of N unknowns, or d = -J^T z with
    (J J^T + damping I) z = r of M.
    """

    by_rows: bool
    """Whether it is the latter."""
    factors: FloatArray
    """J, or with `by_rows` J^T: the matrix is the sum of the outer products of its rows."""
    matrix: FloatArray
    """Without the damping."""
    right: FloatArray


@compiled
def normal_equations(rows: FloatArray, residuals: FloatArray, free: IntArray) -> NormalEquations:
    """Return them for J = `rows` (M, H) at the columns `free` (N,), and r = `residuals` (M,)."""
    num_rows, num_free = len(rows), free.size
    by_rows = num_rows < num_free
    size = num_rows if by_rows else num_free
    inner = num_free if by_rows else num_rows
    factors, right = np.empty((inner, size)), np.zeros(size)
    for i in range(num_rows):
        for j in range(num_free):
            value = rows[i, free[j]]
            if by_rows:
                factors[j, i] = value
            else:
                factors[i, j] = value
                right[j] -= value * residuals[i]
    if by_rows:
        copy_into(right, residuals)
    matrix = np.zeros((size, size))
    for a in range(inner):
        for i in range(size):
            value = factors[a, i]
            for j in range(i + 1):
                matrix[i, j] += value * factors[a, j]
    for i in range(size):
        for j in range(i):
            matrix[j, i] = matrix[i, j]
    return NormalEquations(by_rows, factors, matrix, right)


@compiled
def damped_step(normal: NormalEquations, damping: float, step: FloatArray) -> None:
    """Fill the first N of `step` with the minimiser d."""
    matrix, solution = normal.matrix.copy(), normal.right.copy()
    for i in range(solution.size):
        matrix[i, i] += damping
    solve_semidefinite(matrix, solution)
    if not normal.by_rows:
        copy_into(step[: solution.size], solution)
        return
    for j in range(len(normal.factors)):
        step[j] = 0.0
        for i in range(solution.size):
            step[j] -= normal.factors[j, i] * solution[i]
