"""The least motion of a joint: travel, slide and speed."""

import numpy as np
import pytest

from wrenchsight.models.identification.least_motion import LEAST_SPEED, LEAST_TRAVEL, moves


@pytest.mark.parametrize(("factor", "expected"), [(1.0, [1, 1, 0, 0]), (1.5, [0, 1, 0, 0])])
def test_joints_that_travel_and_are_fast_enough_move(factor, expected):
    """A turn of 1.2 times the least, the same as a slide, one of 0.9 times, and a slow one."""
    q = np.outer([0.0, 1.0], LEAST_TRAVEL * np.array([1.2, 1.2, 0.9, 10.0]))
    v = np.outer([0.0, -1.0], LEAST_SPEED * np.array([1.2, 2.0, 9.0, 0.9]))
    is_sliding = np.array([False, True, False, False])
    np.testing.assert_array_equal(moves(q, v, is_sliding, factor), expected)


def test_without_samples_nothing_moves():
    none = np.empty((0, 2))
    assert not moves(none, none, np.array([False, True])).any()
