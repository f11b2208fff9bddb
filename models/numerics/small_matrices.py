"""Kernels for matrices of a few rows: Cholesky factors, and an eigenvalue.

They serve kernels that go from sample to sample. numba's linear algebra takes four to five times as
long in their place, and some eight seconds to compile (`tests/benchmarks/bench_small_matrices.py`).
"""

import math

import numpy as np

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel


@kernel
def factorise(L: Array, R: Array) -> None:
    """Cholesky of a 6x6 matrix that is at least the identity, and the factor's inverse.

    Args:
        L: (6, 6+) lower triangle of the matrix; replaced by its factor.
        R: (6, 6+), written: inverse of the factor, lower triangle.
    """
    for j in range(6):
        pivot = L[j, j]
        for k in range(j):
            pivot -= L[j, k] * L[j, k]
        L[j, j] = np.sqrt(max(pivot, 1.0))
        R[j, j] = 1.0 / L[j, j]
        for i in range(j + 1, 6):
            total = L[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = total * R[j, j]
    for j in range(6):
        for i in range(j + 1, 6):
            total = 0.0
            for k in range(j, i):
                total += L[i, k] * R[k, j]
            R[i, j] = -total * R[i, i]


@kernel
def factorise_in_place(A: Array, n: int, least: float) -> bool:
    """Cholesky of a symmetric matrix, in its lower triangle.

    Args:
        A: (n+, n+) lower triangle of the matrix; replaced by its factor.
        least: every pivot must be greater.

    Returns:
        Whether every pivot was; if not, A is left half done.
    """
    for i in range(n):
        for j in range(i + 1):
            total = A[i, j]
            for k in range(j):
                total -= A[i, k] * A[j, k]
            if i > j:
                A[i, j] = total / A[j, j]
            elif total > least:
                A[i, i] = math.sqrt(total)
            else:
                return False
    return True


@kernel
def factorise_with_floor(A: Array, n: int, floor: Array) -> None:
    """As `factorise_in_place` of a matrix that is positive definite but for rounding.

    Args:
        A: (n+, n+) lower triangle of the matrix; replaced by its factor.
        n: size.
        floor: (n+,) above zero; the square of a pivot is no less.
    """
    for i in range(n):
        for j in range(i + 1):
            total = A[i, j]
            for k in range(j):
                total -= A[i, k] * A[j, k]
            A[i, j] = math.sqrt(max(total, floor[i])) if i == j else total / A[j, j]


@kernel
def solve_lower(L: Array, n: int, x: Array) -> None:
    """Solves L y = x in place of x (n+,), with the factor that `factorise_in_place` leaves."""
    for i in range(n):
        total = x[i]
        for k in range(i):
            total -= L[i, k] * x[k]
        x[i] = total / L[i, i]


@kernel
def solve_factorised(L: Array, n: int, x: Array) -> None:
    """Solves L L^T y = x in place of x (n+,), with the factor that `factorise_in_place` leaves."""
    solve_lower(L, n, x)
    for i in range(n - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, n):
            total -= L[k, i] * x[k]
        x[i] = total / L[i, i]


@kernel
def largest_eigenvalue_3x3(A: Array) -> float:
    """Largest eigenvalue of a symmetric 3x3 matrix, in closed form (Smith, 1961)."""
    mean = (A[0, 0] + A[1, 1] + A[2, 2]) / 3.0
    off = A[0, 1] ** 2 + A[0, 2] ** 2 + A[1, 2] ** 2
    a, b, c = A[0, 0] - mean, A[1, 1] - mean, A[2, 2] - mean
    size = np.sqrt((a * a + b * b + c * c + 2.0 * off) / 6.0)
    if not size > 0.0:
        return float(mean)
    a, b, c = a / size, b / size, c / size
    d, e, f = A[0, 1] / size, A[0, 2] / size, A[1, 2] / size
    half_det = 0.5 * (a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e))
    return float(mean + 2.0 * size * np.cos(np.arccos(min(max(half_det, -1.0), 1.0)) / 3.0))
