"""`identify --scale` on logs of a real UR10e, and what it writes."""

import json
from dataclasses import replace

import numpy as np

from wrenchsight.analyses.methods.identify.identification_config import IdentifySettings
from wrenchsight.analyses.methods.identify.known_model.scale_finding import find_scale, sentences
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot

_LOG = "ur10e/ur-20_02_10-30sec_12harm.csv"


def test_a_real_arms_amperes(data, tmp_path, ur10e):
    """Its constants come from the controller's target torque and current: 12 9.8 10.8 N m/A.

    The maker's masses are not exact: 10 %.
    """
    log = read_recording(data(_LOG), robot=ur10e)
    spoilt = np.array([1.0, -3.0, 1e3, 0.1, 1.0, 1.0])  # a factor and a sign that nobody knows
    path = tmp_path / "log.csv"
    write_recording(replace(log, current=log.current * spoilt), path)
    settings = IdentifySettings(logs=[str(path)], robot="ur10e", scale=True)
    result = find_scale(settings, tmp_path / "out")
    shown = [1, 2, 3]  # joints
    assert result.scale.is_determined[shown].all()
    want = (ur10e.torque_per_ampere * ur10e.current_sign / spoilt)[shown]
    np.testing.assert_allclose(result.scale.torque_per_unit[shown], want, rtol=0.1)
    assert (result.scale.standard_error[shown] < 0.03 * np.abs(want)).all()
    again = Robot.load(tmp_path / "out" / "robot.yaml")
    constants = again.torque_per_ampere * again.current_sign
    np.testing.assert_allclose(constants[shown], result.scale.torque_per_unit[shown])
    assert constants[0] == ur10e.torque_per_ampere[0] * ur10e.current_sign[0]  # as it was
    assert read_recording(path, robot=again).num_samples == log.num_samples  # and passes the checks
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert metrics["seen"] == result.scale.is_determined.tolist()
    notes = " ".join(sentences(result, False))
    assert "gravity does not determine shoulder_pan_joint" in notes
    assert "masses of the URDF" in notes


def test_torques_get_a_gain(data, tmp_path, ur10e):
    """Where the log states torques, the robot's file has no factor for them."""
    log = read_recording(data(_LOG), robot=ur10e)
    tau = 2.0 * np.asarray(ur10e.joint_torque(log.current))
    path = tmp_path / "log.parquet"
    write_recording(replace(log, tau_J=tau), path)
    settings = IdentifySettings(logs=[str(path)], robot="ur10e", scale=True)
    result = find_scale(settings, tmp_path / "out")
    np.testing.assert_allclose(result.scale.torque_per_unit[[1, 2]], 0.5, rtol=0.1)
    assert "motor_torque: {gain: [1, 0.4" in " ".join(sentences(result, False))
    np.testing.assert_array_equal(
        Robot.load(tmp_path / "out/robot.yaml").torque_per_ampere, ur10e.torque_per_ampere
    )
