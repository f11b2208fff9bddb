"""Fields of a record as arrays of any shape."""

import numpy as np

from wrenchsight.models.numerics.arrays import Array, Record, record
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.views import plain


@kernel
def scaled(matrix: Array, gain: float) -> float:
    total = 0.0
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            matrix[i, j] *= gain
            total += matrix[i, j]
    return total


@kernel
def scaled_of(terms: Record) -> float:
    return float(scaled(plain(terms[0].M), terms[0].gain))


def test_arrays_of_records_of_any_size_are_one_type() -> None:
    for n in (2, 3):
        M = np.arange(1.0 * n * n).reshape(n, n)
        terms = record(before=np.ones(n), M=M, gain=2.0)
        assert scaled_of(terms) == 2.0 * np.sum(M)
        np.testing.assert_array_equal(terms["M"][0], 2.0 * M)
    assert scaled(np.ones((1, 4)), 3.0) == 12.0
    assert len(scaled.signatures) == 1  # type: ignore[attr-defined]
