"""Passes that repeat themselves, by construction."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchsight.analyses.experiments.air_pass.repeated_pass import Pass, alignment, loaded_pass
from wrenchsight.analyses.experiments.setups.ur10e_recordings.known_payload import (
    END_MARGIN,
    LEARNING_TIME,
    TIME_STEP,
)
from wrenchsight.models.estimation.point_of_action import jacobian_at
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

_MASS, _POINT = 2.0, np.array([0.02, 0.1, 0.05])
_DURATION, _AHEAD = 20.0, 0.037


def _recording(robot: Robot, ahead: float) -> Recording:
    """A slow motion of all joints that starts `ahead` later than its log."""
    t = np.arange(0.0, _DURATION, TIME_STEP)
    rates = 0.2 + 0.05 * np.arange(robot.num_joints)
    phase = np.outer(t - ahead, rates)
    q = np.array(robot.home) + 0.4 * np.sin(phase)
    v = 0.4 * rates * np.cos(phase)
    return Recording(t=t, q=q, v=v, current=np.zeros_like(q), source="test")


def _pass(robot: Robot, ahead: float, load: float, motion_error_scale: float) -> Pass:
    """What an observer without lag would read: a load, and an error of the motion, scaled."""
    recording = _recording(robot, ahead)
    J, (R_WE, _) = robot.chain.jacobian(recording.q), robot.chain.pose(recording.q)
    weight = load * np.array([0.0, 0.0, -9.81])
    tau = np.einsum("kij,i->kj", jacobian_at(J, R_WE, _POINT)[:, 3:], weight)
    error = 3.0 * np.sin(7.0 * recording.q) + recording.v
    return Pass(recording, tau + motion_error_scale * error, J)


def test_passes_are_aligned_by_their_positions(ur10e: Robot) -> None:
    ahead = alignment(_recording(ur10e, _AHEAD), _recording(ur10e, 0.0))
    # What linear interpolation between samples leaves.
    assert ahead == pytest.approx(_AHEAD, abs=2e-4)


def test_the_repeating_torque_is_subtracted(ur10e: Robot) -> None:
    empty, loaded = _pass(ur10e, _AHEAD, 0.0, 1.0), _pass(ur10e, 0.0, _MASS, 1.0)
    result = loaded_pass(ur10e, np.eye(6), empty, loaded, _POINT, _MASS)
    assert len(result.v) == round((_DURATION - LEARNING_TIME - END_MARGIN) / TIME_STEP)
    # The reference holds the acceleration of the slow motion, 0.1 N, which is not in the torque.
    assert np.all(result.corrected.mean_square < 0.2**2)
    assert np.all(result.repeated_share > 0.98)
    assert np.all(result.correlation > 0.98)
    assert all(judged.rmse < 0.5 for judged in result.corrected.judged)
    assert max(judged.rmse for judged in result.plain.judged) > 2.0


def test_half_of_the_error_that_repeats_leaves_the_other_half(ur10e: Robot) -> None:
    """With a load that doubles the error, 1 - (1/2)^2 of its mean square goes."""
    empty, loaded = _pass(ur10e, 0.0, 0.0, 1.0), _pass(ur10e, 0.0, _MASS, 2.0)
    result = loaded_pass(ur10e, np.eye(6), empty, loaded, _POINT, _MASS)
    assert np.allclose(result.repeated_share, 0.75, atol=0.02)


def test_shares_are_parts_of_one_whole(ur10e: Robot) -> None:
    empty, loaded = _pass(ur10e, 0.0, 0.0, 1.0), _pass(ur10e, 0.0, _MASS, 2.0)
    result = loaded_pass(ur10e, np.eye(6), empty, loaded, _POINT, _MASS)
    # Nothing is carried where no current flows: no load to grow with.
    current = np.random.default_rng(0).normal(size=result.v.shape)
    shares = replace(result, load_growth=current).shares()
    assert np.allclose(sum(shares.values()), 1.0)
    assert np.allclose(shares["repeated"], result.repeated_share)
    assert all(np.all(part > -1e-12) for part in shares.values())
