"""`identify --scale` on logs of a real UR10e, and what it writes."""

import json
from dataclasses import replace

import numpy as np
import pytest

from wrenchsight.analyses.methods.identify.identification_config import IdentifySettings
from wrenchsight.analyses.methods.identify.known_model.scale_finding import (
    ScaleResult,
    find_scale,
    sentences,
)
from wrenchsight.models.calibration.effort_scale import EffortScale
from wrenchsight.models.calibration.load_parameters import body_parameters, load_columns
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.recording import Recording
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


def test_a_weight_without_a_centre_of_mass_counts_as_at_the_flange(tmp_path, ur10e):
    """Two postures, each held for a second without the weight and with it; statics alone."""
    turns = np.array([[0.0, 0.3, -0.4, 0.5, 0.2, 0.0], [0.0, -0.4, 0.5, -0.6, 0.4, 0.0]])
    q = np.repeat(ur10e.home + turns, 50, axis=0)
    still = np.zeros_like(q)
    moved = still.copy()
    moved[::50] = 0.5  # rad/s: a posture ends
    gravity = np.asarray(ur10e.chain.gravity_torque(q))
    weight = body_parameters(4.0, np.zeros(3), np.zeros((3, 3)))
    load = load_columns(ur10e, q, still, still) @ weight
    for name, torque in (("empty", gravity), ("laden", gravity + load)):
        current = np.asarray(ur10e.motor_current(torque)) / 3.0  # a unit that nobody knows
        recording = Recording(0.02 * np.arange(len(q)), q, moved, current, name)
        write_recording(recording, tmp_path / f"{name}.csv")
    log, laden = str(tmp_path / "empty.csv"), str(tmp_path / "laden.csv")
    settings = IdentifySettings(logs=[log], robot="ur10e", scale=True, load=[laden + "=4"])
    result = find_scale(settings, tmp_path / "out")
    expected = 3.0 * ur10e.torque_per_ampere * ur10e.current_sign
    shown = result.scale.is_determined
    assert shown[1:3].all()
    # The postures are held once each; what is left is the resolution of numbers in the file.
    np.testing.assert_allclose(result.scale.torque_per_unit[shown], expected[shown], rtol=1e-3)
    assert any("counts as at the flange's origin" in notice for notice in result.notices)
    settings = replace(settings, load=[laden + "=4,0,0,0"])
    assert find_scale(settings, tmp_path / "stated").notices == ()


def test_more_than_one_weight_is_refused_before_a_log_is_read(tmp_path):
    settings = IdentifySettings(
        logs=["missing.csv"], robot="ur10e", scale=True, load=["a.csv=1", "b.csv=2"]
    )
    with pytest.raises(InputError, match="one weight is enough"):
        find_scale(settings, tmp_path / "out")


def test_a_stated_value_that_the_logs_refute_is_told(ur10e):
    estimate = np.array([np.nan, 0.0115, 9.0, 0.9, 10.0, 0.01])
    error = np.array([np.inf, 0.0012, 1.5, 0.2, 0.1, 0.004])
    scale = EffortScale(estimate, error, known_torque_sd=np.ones(6), count=100)
    result = ScaleResult(scale, ur10e, np.full(6, 10.0), of_torque=False, notices=())
    (note,) = [text for text in sentences(result, False) if "certainly not right" in text]
    # Joint 3 agrees within its error, joint 5 is determined.
    lift, wrist_1, wrist_3 = (ur10e.joint_names[j] for j in (1, 3, 5))
    assert f"{lift} 0.011 +- 0.001 (stated 10), {wrist_1} 0.9 +- 0.2 (stated 10), {wrist_3}" in note
