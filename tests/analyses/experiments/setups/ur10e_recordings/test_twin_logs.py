"""Twins of a log: its motion, its rows, and their own truth."""

import numpy as np
import pytest

from wrenchsight.analyses.experiments.setups.ur10e_recordings.twin_logs import (
    commanded_motion,
    twin_log,
)
from wrenchsight.models.robot.robot_config import ToolConfig


def test_the_command_is_the_motion_without_its_steps(swing):
    motion = commanded_motion(swing)
    np.testing.assert_allclose(motion.q, swing.q, atol=1e-3)
    assert np.abs(np.diff(motion.q, 3, axis=0)).max() < np.abs(np.diff(swing.q, 3, axis=0)).max()


def test_a_twin_has_the_logs_rows_and_resolution(ur10e, swing):
    twin = twin_log(swing, ur10e, seed=1)
    np.testing.assert_array_equal(twin.t, swing.t)
    np.testing.assert_allclose(twin.q, swing.q, atol=5e-3)  # a drive's error of tracking
    np.testing.assert_allclose(twin.q / 1e-4, np.rint(twin.q / 1e-4), atol=1e-6)
    assert np.abs(twin.current).max() > 1.0


def test_days_and_payloads_tell(ur10e, swing):
    one, other = (twin_log(swing, ur10e, day=day, seed=1).current for day in (0, 1))
    assert np.any(one != other)
    load = ToolConfig("load", 3.0, [0.0, 0.0, 0.05], [0.004, 0.004, 0.004, 0.0, 0.0, 0.0])
    loaded = twin_log(swing, ur10e, day=0, seed=1, payload=load)
    gained = (loaded.current - one).mean(axis=0) * ur10e.torque_per_ampere
    weight = ur10e.with_tool(load, ur10e.config.tool_frame).chain.gravity_torque(swing.q)
    expected = (weight - ur10e.chain.gravity_torque(swing.q)).mean(axis=0)
    # Friction by load comes on top, a tenth of it at most
    assert gained[1] == pytest.approx(expected[1], rel=0.15)
