"""Where a log counts its angles from 0 to 360 deg, they are continued within the joints' limits."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.wrapped_angles import Unwrapper
from wrenchsight.models.robot.robot import Robot

TURN = 2.0 * np.pi


@pytest.fixture(scope="module")
def panda():
    return Robot.load("panda")


def log(robot):
    """All joints swing about home by .3 rad; some cross zero."""
    t = np.arange(0.0, 10.0, 0.01)
    q = robot.home + 0.3 * np.sin(t[:, None])
    return Recording(t, q, np.gradient(q, t, axis=0), np.zeros_like(q), "log.csv")


def test_angles_from_0_to_360_degrees_come_back_within_the_limits(panda):
    recording, unwrapper = log(panda), Unwrapper(panda)
    counted = replace(recording, q=recording.q % TURN)
    parts = [counted[:300], counted[300:]]
    q = np.vstack([unwrapper.unwrapped(part).q for part in parts])
    np.testing.assert_allclose(q, recording.q, rtol=0, atol=1e-12)  # rounding of a turn
    assert any("a turn is taken off" in notice for notice in unwrapper.notice())


def test_a_turn_is_taken_off_only_where_all_angles_count_so(panda):
    """One joint that is a turn off in another log is the owner's to explain."""
    recording, unwrapper = log(panda), Unwrapper(panda)
    q = recording.q + TURN * (np.arange(7) == 3)
    np.testing.assert_array_equal(unwrapper.unwrapped(replace(recording, q=q)).q, q)
    assert unwrapper.notice() == ()
