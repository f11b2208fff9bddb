"""Condition numbers of Jacobians, one or a million.

One-sided Jacobi (Hestenes, 1958; Demmel and Veselic, 1992): pairs of rows of J (of its columns
where n < 6) are turned until all are orthogonal; their lengths are then the singular values. Their
errors are relative to each of them, so that condition numbers hold to 1e-9 as far as the entries
of J determine them.

One sample takes some eighty turns, each waiting for the last one's square roots. Many samples are
therefore turned in groups, the same arithmetic side by side in vector registers.
LAPACK's singular values take 2.7 times as long from numpy, 5 times from numba
(`tests/benchmarks/bench_small_matrices.py`).
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.row_blocks import in_row_blocks

# Two rows are orthogonal below this cosine: a few rounding errors of a dot product.
ORTHOGONAL_COSINE = 1e-14

# Five to six sweeps are usual, and convergence is quadratic: only NaN would go on for ever.
MAX_SWEEPS = 40

# A smallest singular value below this part of the largest, times the matrix's size, is rounding.
_MACHINE_EPSILON = float(np.finfo(np.float64).eps)

# Samples turned side by side: two full vector registers at least, yet all fits the first cache.
_NUM_LANES = 16

# Samples that are worth a thread: a millisecond.
_BLOCK_SAMPLES = 128 * _NUM_LANES


@kernel
def _ratio(squares: Array, size: float) -> float:
    """Largest over smallest singular value from their squares; inf within rounding of zero."""
    smallest, largest, total = math.inf, 0.0, 0.0
    for square in squares:
        smallest = min(smallest, square)
        largest = max(largest, square)
        total += square
    if not math.isfinite(total):
        return math.nan
    rounding = size * _MACHINE_EPSILON
    if smallest <= rounding * rounding * largest:
        return math.inf
    return math.sqrt(largest / smallest)


@kernel
def _sweep(rows: Array) -> bool:
    """Turns each pair of rows of matrices (count, length, lanes) once; whether any pair turned.

    Every inner loop runs over the lanes without a branch.
    """
    count, length, lanes = rows.shape
    ii, jj, ij = np.empty(lanes), np.empty(lanes), np.empty(lanes)  # products of the two rows
    c, s = np.empty(lanes), np.empty(lanes)  # cosine and sine of the turn
    num_turned = 0.0
    for i in range(count - 1):
        for j in range(i + 1, count):
            for m in range(lanes):
                ii[m], jj[m], ij[m] = 0.0, 0.0, 0.0
            for k in range(length):
                for m in range(lanes):
                    x, y = rows[i, k, m], rows[j, k, m]
                    ii[m] += x * x
                    jj[m] += y * y
                    ij[m] += x * y
            for m in range(lanes):
                is_skew = ij[m] * ij[m] > (ORTHOGONAL_COSINE * ORTHOGONAL_COSINE) * (ii[m] * jj[m])
                difference = jj[m] - ii[m]
                root = math.sqrt(difference * difference + 4.0 * ij[m] * ij[m])
                twice = 2.0 * ij[m] if difference >= 0.0 else -2.0 * ij[m]
                tangent = twice / (abs(difference) + root) if is_skew else 0.0
                c[m] = 1.0 / math.sqrt(1.0 + tangent * tangent)
                s[m] = c[m] * tangent
                # Not the tangent: what is not finite in one lane must not end the others' turns.
                num_turned += 1.0 if abs(tangent) > 0.0 else 0.0
            for k in range(length):
                for m in range(lanes):
                    x, y = rows[i, k, m], rows[j, k, m]
                    rows[i, k, m] = c[m] * x - s[m] * y
                    rows[j, k, m] = s[m] * x + c[m] * y
    return num_turned > 0.0


@kernel(nogil=True)
def condition_numbers_of(J: Array, condition_numbers: Array) -> None:
    """Writes condition numbers (N,) of Jacobians (N, 6, n), for other kernels' blocks of samples.

    One is NaN where J is not finite.
    """
    N, _, n = J.shape
    count, length = min(6, n), max(6, n)
    squares = np.empty(count)  # of the singular values, in no order
    for first in range(0, N, _NUM_LANES):
        lanes = min(_NUM_LANES, N - first)
        rows = np.empty((count, length, lanes))
        for m in range(lanes):
            for i in range(count):
                for k in range(length):
                    rows[i, k, m] = J[first + m, i, k] if n >= 6 else J[first + m, k, i]
        for _ in range(MAX_SWEEPS):
            if not _sweep(rows):
                break
        for m in range(lanes):
            for i in range(count):
                squares[i] = 0.0
                for k in range(length):
                    squares[i] += rows[i, k, m] * rows[i, k, m]
            condition_numbers[first + m] = _ratio(squares, length)


def condition_number(J: ArrayLike) -> Array:
    """Largest over smallest singular value, (...), of Jacobians (..., 6, n).

    Lengths in m and angles in rad make it what the article calls JCN. Of fewer than six joints
    it takes the n singular values that there are. It is inf where the smallest is zero within
    rounding (6 or n times 2.2e-16 of the largest), and NaN where J is not finite.
    """
    array = np.asarray(J, dtype=np.float64)
    if array.ndim < 2 or array.shape[-2] != 6 or array.shape[-1] == 0:
        raise ValueError(f"expected Jacobians of shape (..., 6, n), n > 0, got {array.shape}")
    rows = np.ascontiguousarray(array).reshape(-1, 6, array.shape[-1])
    condition_numbers = np.empty(len(rows))
    in_row_blocks(
        lambda part: condition_numbers_of(rows[part], condition_numbers[part]),
        len(rows),
        _BLOCK_SAMPLES,
    )
    return condition_numbers.reshape(array.shape[:-2])
