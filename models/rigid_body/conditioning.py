"""Condition numbers of Jacobians, one or a million.

One-sided Jacobi (Hestenes, 1958; Demmel and Veselic, 1992): pairs of rows of J (of its columns
where n < 6) are turned until all are orthogonal; their lengths are then the singular values. Their
errors are relative to each of them, so that condition numbers hold to 1e-9 as far as the entries
of J determine them.

One sample takes some eighty turns, each waiting for the last one's square roots. Many samples are
therefore turned in groups, the same arithmetic side by side in vector registers (three times as
fast, and the same bits). A group has a number of lanes that the compiler knows: left open, it takes
1.7 times as long. LAPACK's singular values take 4.9 times as long from numpy, 9 times from numba
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
MACHINE_EPSILON = float(np.finfo(np.float64).eps)

# Samples turned side by side: two full vector registers at least, yet all fits the first cache.
_NUM_LANES = 16

# Samples that are worth a thread: a millisecond.
_BLOCK_SAMPLES = 128 * _NUM_LANES


@kernel
def _turn_rows(B: Array, p: int, q: int, length: int) -> tuple[float, float]:
    """Makes two rows of B orthogonal to each other, by the smaller of two possible rotations.

    Returns:
        Cosine and sine of the rotation; a sine of 0.0 where the rows were orthogonal to rounding.
    """
    pp, qq, pq = 0.0, 0.0, 0.0
    for k in range(length):
        x, y = B[p, k], B[q, k]
        pp += x * x
        qq += y * y
        pq += x * y
    if not pq * pq > (ORTHOGONAL_COSINE * ORTHOGONAL_COSINE) * (pp * qq):
        return 1.0, 0.0
    z = qq - pp
    t = 2.0 * pq / (z + math.copysign(math.sqrt(z * z + 4.0 * pq * pq), z))
    c = 1.0 / math.sqrt(1.0 + t * t)
    s = c * t
    for k in range(length):
        x, y = B[p, k], B[q, k]
        B[p, k] = c * x - s * y
        B[q, k] = s * x + c * y
    return c, s


@kernel
def _orthogonalise(J: Array, work: Array) -> tuple[int, int]:
    """Writes rows (columns where n < 6) of J into `work`, made orthogonal; returns its shape."""
    n = J.shape[1]
    if n >= 6:
        count, length = 6, n
        for i in range(6):
            for k in range(n):
                work[i, k] = J[i, k]
    else:
        count, length = n, 6
        for i in range(n):
            for k in range(6):
                work[i, k] = J[k, i]
    for _ in range(MAX_SWEEPS):
        has_turned = False
        for i in range(count - 1):
            for j in range(i + 1, count):
                has_turned = _turn_rows(work, i, j, length)[1] != 0.0 or has_turned
        if not has_turned:
            break
    return count, length


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
    rounding = size * MACHINE_EPSILON
    if smallest <= rounding * rounding * largest:
        return math.inf
    return math.sqrt(largest / smallest)


@kernel
def _turn_side_by_side(rows: Array, a: Array, b: Array, g: Array, c: Array, s: Array) -> bool:
    """One sweep over all pairs of rows, of a matrix in each lane; whether any lane turned.

    Each pair x, y is turned, as by `_turn_rows`, so that it becomes orthogonal:

        x <- c x - s y,   y <- s x + c y,   t = s / c the smaller root of t^2 + 2 z t - 1 = 0,
        z = (|y|^2 - |x|^2) / (2 x.y)

    Every inner loop runs over the lanes without a branch, so that the compiler makes vectors of
    them.

    Args:
        rows: (count, length, lanes): a matrix of `count` rows of `length` in each lane; changed.
        a, b, g: (lanes,) scratch: |x|^2, |y|^2, x.y; g then says (1 or 0) whether a lane turned.
        c, s: (lanes,) scratch: cosine and sine.

    Returns:
        Whether any lane turned: as long as one does, another sweep is due.
    """
    count, length, lanes = rows.shape
    num_turned = 0.0
    for i in range(count - 1):
        for j in range(i + 1, count):
            for m in range(lanes):
                a[m] = 0.0
                b[m] = 0.0
                g[m] = 0.0
            for k in range(length):
                for m in range(lanes):
                    x, y = rows[i, k, m], rows[j, k, m]
                    a[m] += x * x
                    b[m] += y * y
                    g[m] += x * y
            for m in range(lanes):
                turn = g[m] * g[m] > (ORTHOGONAL_COSINE * ORTHOGONAL_COSINE) * (a[m] * b[m])
                difference = b[m] - a[m]
                root = math.sqrt(difference * difference + 4.0 * g[m] * g[m])
                twice = 2.0 * g[m] if difference >= 0.0 else -2.0 * g[m]
                t = twice / (abs(difference) + root) if turn else 0.0
                c[m] = 1.0 / math.sqrt(1.0 + t * t)
                s[m] = c[m] * t
                # Not t itself: what is not finite in one lane must not end the others' turns.
                g[m] = 1.0 if abs(t) > 0.0 else 0.0
            for m in range(lanes):
                num_turned += g[m]
            for k in range(length):
                for m in range(lanes):
                    x, y = rows[i, k, m], rows[j, k, m]
                    rows[i, k, m] = c[m] * x - s[m] * y
                    rows[j, k, m] = s[m] * x + c[m] * y
    return num_turned > 0.0


@kernel(inline="always")
def _squared_singular_values(J: Array, squares: Array) -> None:
    """Writes the squares (N, min(6, n)), in no order, of N Jacobians (N, 6, n).

    As many as fill whole groups of _NUM_LANES are turned side by side, the rest one by one. Once
    the rows of a Jacobian are orthogonal, their squared lengths are the squares sought.
    """
    n = J.shape[2]
    # A Jacobian of fewer than six columns is turned round, so that its rows are the shorter side.
    count, length = min(6, n), max(6, n)
    grouped = J.shape[0] - J.shape[0] % _NUM_LANES
    if grouped > 0:
        rows = np.empty((count, length, _NUM_LANES))
        a, b, g = np.empty(_NUM_LANES), np.empty(_NUM_LANES), np.empty(_NUM_LANES)
        c, s = np.empty(_NUM_LANES), np.empty(_NUM_LANES)
    for first in range(0, grouped, _NUM_LANES):
        for m in range(_NUM_LANES):
            for i in range(count):
                for k in range(length):
                    rows[i, k, m] = J[first + m, i, k] if n >= 6 else J[first + m, k, i]
        for _ in range(MAX_SWEEPS):
            if not _turn_side_by_side(rows, a, b, g, c, s):
                break
        for i in range(count):
            for m in range(_NUM_LANES):
                a[m] = 0.0  # squared length of row i
            for k in range(length):
                for m in range(_NUM_LANES):
                    a[m] += rows[i, k, m] * rows[i, k, m]
            for m in range(_NUM_LANES):
                squares[first + m, i] = a[m]
    if grouped < J.shape[0]:
        # The rows that `_orthogonalise` turns, as above: the first `count` of six.
        work = np.empty((6, length))
        for m in range(grouped, J.shape[0]):
            _orthogonalise(J[m], work)
            for i in range(count):
                total = 0.0
                for k in range(length):
                    total += work[i, k] * work[i, k]
                squares[m, i] = total


@kernel(nogil=True)
def condition_numbers_of(J: Array, condition_numbers: Array) -> None:
    """Condition numbers (N,) of Jacobians (N, 6, n), for other kernels' blocks of samples."""
    squares = np.empty((J.shape[0], min(6, J.shape[2])))
    _squared_singular_values(J, squares)
    for m in range(J.shape[0]):
        condition_numbers[m] = _ratio(squares[m], max(6, J.shape[2]))


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
