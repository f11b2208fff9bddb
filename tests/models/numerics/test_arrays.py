"""Records: named numbers and arrays in one argument of a kernel."""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.numerics.arrays import record, record_of
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


class _Filter(NamedTuple):
    pole: float
    gain: float


class _Numbers(NamedTuple):
    period: float
    slow: _Filter
    fast: _Filter


@kernel
def _sum_of(numbers, out):
    out[0] = numbers.period + 10.0 * numbers.slow.gain + 100.0 * numbers.fast.pole


@kernel
def _sum_of_record(numbers, out):
    _sum_of(numbers[0], out)


def test_a_kernel_names_the_fields_of_a_named_tuple_and_of_its_record_alike():
    numbers = _Numbers(period=1, slow=_Filter(2.0, 3.0), fast=_Filter(4.0, np.inf))
    out, of_record = np.zeros(1), np.zeros(1)
    for pole in (4.0, 5.0):
        changed = numbers._replace(fast=_Filter(pole, np.inf))
        _sum_of(changed, out)
        _sum_of_record(record_of(changed), of_record)
        assert of_record[0] == out[0] == 31.0 + 100.0 * pole
