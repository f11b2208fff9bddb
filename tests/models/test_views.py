"""Views of flat memory."""

import numpy as np

from wrenchsight.models.arrays import Array
from wrenchsight.models.kernel import kernel
from wrenchsight.models.views import view_2d


@kernel
def viewed(flat: Array, start: int, rows: int, columns: int) -> Array:
    view: Array = view_2d(flat, start, rows, columns)
    return view


def test_a_view_is_the_reshaped_slice_and_writes_through() -> None:
    flat = np.arange(30.0)
    for start, rows, columns in ((0, 5, 6), (3, 4, 2), (7, 0, 3), (30, 0, 0)):
        found = viewed(flat, start, rows, columns)
        expected = flat[start : start + rows * columns].reshape(rows, columns)
        np.testing.assert_array_equal(found, expected)
        assert found.flags.c_contiguous and (not rows or np.shares_memory(found, flat))
    viewed(flat, 3, 4, 2)[1, 0] = -1.0
    assert flat[5] == -1.0


def test_a_view_keeps_the_memory_that_it_shows() -> None:
    views = [viewed(np.full(1000, float(k)), 0, 10, 100) for k in range(50)]
    assert [view[9, 99] for view in views] == [float(k) for k in range(50)]
