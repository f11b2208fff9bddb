"""Ranges of the joints in which random postures are drawn."""

import numpy as np
import pytest

from wrenchsight.models.planning.motion.joint_ranges import ranges_of_postures


@pytest.mark.parametrize(
    ("limits", "slides", "expected"),
    [
        ((-1.0, 2.0), False, (-1.0, 2.0)),
        ((3.5, 6.0), False, (3.5, 6.0)),  # beyond half a turn
        ((-2.1, 3.84), False, (-2.1, 3.84)),  # over it
        ((-6.3, 6.3), False, (-np.pi, np.pi)),  # all round
        ((1.0, np.inf), False, (-np.pi, np.pi)),
        ((0.0, 9.0), True, (0.0, 9.0)),  # m, however long
        ((-np.inf, np.inf), True, (-2.0, 2.0)),
        ((-np.inf, 1.0), True, (-2.0, 1.0)),
        ((5.0, np.inf), True, (5.0, 7.0)),
    ],
)
def test_ranges_are_the_limits_but_of_joints_that_turn_round_or_have_none(limits, slides, expected):
    lower, upper = np.array(limits)[:, np.newaxis]
    ranges = ranges_of_postures(lower, upper, np.array([slides]))
    np.testing.assert_array_equal(np.ravel(ranges), expected)
