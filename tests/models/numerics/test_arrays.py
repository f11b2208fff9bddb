"""Records: named numbers and arrays in one argument of a kernel."""

import numpy as np

from wrenchsight.models.numerics.arrays import record
from wrenchsight.models.numerics.kernel import kernel


@kernel
def _double(pair, out):
    fields = pair[0]
    out[0] = fields.matrix[1, 0] + fields.number
    fields.matrix[0, 1] *= 2.0


def test_a_kernel_reads_and_writes_the_fields_of_a_record():
    pair, out = record(matrix=[[1.0, 2.0], [3.0, 4.0]], number=5), np.zeros(1)
    _double(pair, out)
    assert out[0] == 8.0
    np.testing.assert_array_equal(pair["matrix"][0], [[1.0, 4.0], [3.0, 4.0]])


def test_its_fields_lie_one_after_another():
    pair = record(first=[1.0, 2.0], second=3.0)
    np.testing.assert_array_equal(pair.view(np.float64), [1.0, 2.0, 3.0])
