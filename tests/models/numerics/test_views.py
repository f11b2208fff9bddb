"""Views of flat memory."""

import sys

import numpy as np

from wrenchsight.models.numerics.arrays import Array, Record, record
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.views import (
    borrowed,
    copy_to,
    copy_whole,
    plain,
    read_only,
    view_2d,
)


@kernel
def viewed(flat: Array, start: int, rows: int, columns: int) -> Array:
    view: Array = view_2d(flat, start, rows, columns)
    return view


def test_a_view_is_the_reshaped_slice_and_writes_through() -> None:
    flat = np.arange(30.0)
    for start, rows, columns in ((0, 5, 6), (3, 4, 2), (7, 0, 3), (30, 0, 0)):
        view = viewed(flat, start, rows, columns)
        expected = flat[start : start + rows * columns].reshape(rows, columns)
        np.testing.assert_array_equal(view, expected)
        assert view.flags.c_contiguous and (not rows or np.shares_memory(view, flat))
    viewed(flat, 3, 4, 2)[1, 0] = -1.0
    assert flat[5] == -1.0


def test_a_view_keeps_the_memory_that_it_shows() -> None:
    views = [viewed(np.full(1000, float(k)), 0, 10, 100) for k in range(50)]
    assert [view[9, 99] for view in views] == [float(k) for k in range(50)]


@kernel
def doubled(flat: Array, scratch: Array) -> float:
    values, total = borrowed(flat), 0.0
    work = view_2d(borrowed(scratch), 1, 2, 3)
    for k in range(values.shape[0]):
        values[k] *= 2.0
        work[1, k] = values[k]
    for value in values[1:]:
        total += value
    return total


def test_a_borrowed_array_is_the_same_memory() -> None:
    flat, scratch = np.arange(6.0), np.zeros(8)
    even = flat[::2]
    held = sys.getrefcount(even), sys.getrefcount(scratch)
    assert doubled(even, scratch) == 2.0 * (2.0 + 4.0)
    np.testing.assert_array_equal(flat, [0.0, 1.0, 4.0, 3.0, 8.0, 5.0])
    np.testing.assert_array_equal(scratch, [0.0, 0.0, 0.0, 0.0, 0.0, 4.0, 8.0, 0.0])
    assert (sys.getrefcount(even), sys.getrefcount(scratch)) == held


@kernel
def summed(flat: Array) -> float:
    total = 0.0
    for value in flat:
        total += value
    return total


@kernel
def copied(target: Array, source: Array, row: Array) -> float:
    copy_whole(target[1:], source)
    copy_to(target[0], row)
    return float(summed(read_only(source[0])))


def test_numbers_are_copied_and_what_may_not_be_written_is_one_type() -> None:
    target, source, row = np.zeros((3, 4)), np.arange(8.0).reshape(2, 4), np.arange(8.0)[1::2]
    assert copied(target, source, row) == 6.0
    np.testing.assert_array_equal(target, [row, *source])
    closed = np.arange(3.0)
    closed.flags.writeable = False
    assert summed(closed) == 3.0
    assert len(summed.signatures) == 1  # type: ignore[attr-defined]


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
