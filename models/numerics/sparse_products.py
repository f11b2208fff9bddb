"""Products A x and A^T x in which a NaN spoils only the entries that it belongs to.

A maps rates and torques between joints and motors of which one moves several joints. A product of
numpy would spoil all joints by the NaN of one: 0 times NaN is NaN.
"""

import numpy as np

from wrenchsight.models.numerics.arrays import Array, contiguous
from wrenchsight.models.numerics.kernel import kernel


def products(A: Array, x: Array) -> Array:
    """A x of N samples (N, n)."""
    A, x = contiguous(A, x)
    Ax = np.empty_like(x)
    _product_rows(A, x, Ax)
    return Ax


@kernel
def _product_rows(A: Array, x: Array, Ax: Array) -> None:
    for k in range(x.shape[0]):
        product(A, x[k], Ax[k])


@kernel
def product(A: Array, x: Array, Ax: Array) -> None:
    """Writes A x into Ax, of one sample (n,)."""
    for i in range(A.shape[0]):
        total = 0.0
        for k in range(A.shape[1]):
            if A[i, k] != 0.0:
                total += A[i, k] * x[k]
        Ax[i] = total


@kernel
def add_transposed_product(A: Array, x: Array, total: Array) -> None:
    """Adds A^T x to `total`, of one sample (n,)."""
    for i in range(A.shape[0]):
        for k in range(A.shape[1]):
            if A[i, k] != 0.0:
                total[k] += A[i, k] * x[i]
