"""Torque per unit of effort from known weights, on logs whose unit is made up."""

import numpy as np
import pytest

from wrenchsight.models.calibration.effort_scale import scale_from_gravity, scale_from_weight
from wrenchsight.models.calibration.load_parameters import body_parameters, load_columns
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

_UNITS = np.array([3.0, -7.0, 0.2, 40.0, -0.05, 1.0])  # N m per unit, some counting back


def _moving(robot: Robot, seed: int, duration: float = 60.0) -> Recording:
    """Friction, an offset, rotors that the robot's file does not know, and noise that lasts."""
    t = np.arange(0.0, duration, 0.02)
    rng = np.random.default_rng(seed)
    q, v, vdot = (np.zeros((len(t), 6)) for _ in range(3))
    for _ in range(3):
        w, p = rng.uniform(0.3, 1.2, 6), rng.uniform(0.0, 6.0, 6)
        a = 0.4 * rng.uniform(0.5, 1.0, 6)
        q += a * np.sin(np.outer(t, w) + p)
        v += a * w * np.cos(np.outer(t, w) + p)
        vdot -= a * w**2 * np.sin(np.outer(t, w) + p)
    q += robot.home
    tau = np.asarray(robot.chain.inverse_dynamics(q, v, vdot)) + 0.4 * vdot
    tau += 0.02 * robot.effort_limit * np.tanh(v / 0.02) + 0.5 * v + 0.3
    slow = np.repeat(rng.normal(size=(len(t) // 25 + 1, 6)), 25, axis=0)[: len(t)]
    tau += 0.005 * robot.effort_limit * (slow + rng.normal(size=tau.shape))
    return Recording(t, q, v, tau / _UNITS, "log")


def test_gravity_determines_the_scale_within_its_error(ur10e):
    """Over seeds: no bias, and standard errors of the size of the errors."""
    scales = [scale_from_gravity([_moving(ur10e, seed)], ur10e) for seed in range(8)]
    for scale in scales:
        is_determined = scale.is_determined.tolist()
        assert is_determined == [False, True, True, True, is_determined[4], False]
    shown = [1, 2, 3]
    z = np.array([(scale.torque_per_unit - _UNITS)[shown] / scale.standard_error[shown]
                  for scale in scales])  # fmt: skip
    assert 0.5 < np.sqrt((z**2).mean()) < 1.6  # 24 draws; 1 where the errors are right
    assert np.abs(z.mean(axis=0)).max() < 1.2  # of 0.35 each


def test_several_logs_have_a_smaller_standard_error(ur10e):
    logs = [_moving(ur10e, seed) for seed in range(4)]
    of_one_log, of_four_logs = scale_from_gravity(logs[:1], ur10e), scale_from_gravity(logs, ur10e)
    ratio = of_four_logs.standard_error[1:4] / of_one_log.standard_error[1:4]
    assert (ratio < 0.75).all()  # a half, but for the spread of standard errors


def test_a_vertical_axis_has_no_scale(ur10e):
    scale = scale_from_gravity([_moving(ur10e, 1)], ur10e)
    assert np.isnan(scale.torque_per_unit[[0, 5]]).all()
    assert scale.known_torque_sd[0] == pytest.approx(0.0, abs=1e-9)


def _held(postures: np.ndarray, tau: np.ndarray, rng: np.random.Generator) -> Recording:
    """A second in each posture, with a motion between."""
    rows = 50
    q = np.repeat(postures, rows, axis=0)
    v = np.zeros_like(q)
    v[::rows] = 0.5  # which ends the stretch
    effort = np.repeat(tau, rows, axis=0) + 0.02 * rng.normal(size=q.shape)
    return Recording(0.02 * np.arange(len(q)), q, v, effort / _UNITS, "log")


@pytest.mark.parametrize("postures", [2, 6])
def test_one_weight_in_two_postures(ur10e, postures):
    """Whatever the arm weighs: its own torque is taken off."""
    rng = np.random.default_rng(3)
    q = ur10e.home + rng.uniform(-0.6, 0.6, (postures, 6))
    weight = body_parameters(4.0, np.array([0.02, 0.03, 0.1]), np.zeros((3, 3)))
    arm = 1.3 * np.asarray(ur10e.chain.gravity_torque(q)) + 2.0  # heavier than its file says
    still = np.zeros_like(q)
    load = load_columns(ur10e, q, still, still) @ weight
    empty = _held(q, arm, rng)
    laden = _held(q[::-1] + 0.01, (arm + load)[::-1], rng)
    scale = scale_from_weight([empty], [laden], ur10e, weight)
    assert scale.count == postures
    np.testing.assert_allclose(scale.torque_per_unit[1:5], _UNITS[1:5], rtol=0.05)
    assert not scale.is_determined[0]
    with pytest.raises(InputError, match=r"1 postures are held .* hold the same postures"):
        scale_from_weight([empty], [laden[:50]], ur10e, weight)


def test_short_logs_and_coupled_motors_are_refused(ur10e, coupled_wrist):
    with pytest.raises(InputError, match="lasts less than the 15 s"):
        scale_from_gravity([_moving(ur10e, 1, 8.0)], ur10e)
    with pytest.raises(InputError, match="motors that share joints"):
        scale_from_gravity([_moving(ur10e, 1)], coupled_wrist)
