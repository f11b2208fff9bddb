"""Twins of a log: its motion, its rows, and their own truth."""

import numpy as np
import pytest

from wrenchsight.analyses.experiments.setups.ur10e_recordings.twin_logs import (
    commanded_motion,
    twin_log,
)
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import ToolConfig


@pytest.fixture(scope="module")
def robot():
    return Robot.load("ur10e")


@pytest.fixture(scope="module")
def log(robot):
    t = 100.0 + 0.01 * np.arange(400)
    s = 1 - np.cos(2 * np.pi * (t - 100.0) / 4.0)
    q = np.round(np.asarray(robot.home) + 0.2 * s[:, None], 4)
    v = np.gradient(q, 0.01, axis=0)
    return Recording(t=t, q=q, v=v, current=np.zeros_like(q), source="real")


def test_the_command_is_the_motion_without_its_steps(log):
    motion = commanded_motion(log)
    np.testing.assert_allclose(motion.q, log.q, atol=1e-3)
    assert np.abs(np.diff(motion.q, 3, axis=0)).max() < np.abs(np.diff(log.q, 3, axis=0)).max()


def test_a_twin_has_the_logs_rows_and_resolution(robot, log):
    twin = twin_log(log, robot, seed=1)
    np.testing.assert_array_equal(twin.t, log.t)
    np.testing.assert_allclose(twin.q, log.q, atol=5e-3)  # a drive's error of tracking
    np.testing.assert_allclose(twin.q / 1e-4, np.rint(twin.q / 1e-4), atol=1e-6)
    assert np.abs(twin.current).max() > 1.0


def test_days_and_payloads_tell(robot, log):
    one, other = (twin_log(log, robot, day=day, seed=1).current for day in (0, 1))
    assert np.any(one != other)
    load = ToolConfig("load", 3.0, [0.0, 0.0, 0.05], [0.004, 0.004, 0.004, 0.0, 0.0, 0.0])
    loaded = twin_log(log, robot, day=0, seed=1, payload=load)
    gained = (loaded.current - one).mean(axis=0) * robot.torque_per_ampere
    weight = robot.with_tool(load, robot.config.tool_frame).chain.gravity_torque(log.q)
    expected = (weight - robot.chain.gravity_torque(log.q)).mean(axis=0)
    # Friction by load comes on top, a tenth of it at most
    assert gained[1] == pytest.approx(expected[1], rel=0.15)
