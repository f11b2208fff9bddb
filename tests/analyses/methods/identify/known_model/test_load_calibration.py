"""Torque constants from a weighed load: what is read from the command line, and a simulated arm."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ur10e_logs import VISCOUS, log_of

from wrenchsight.analyses.methods.identify.identification_config import (
    IdentificationConfig,
    IdentifySettings,
)
from wrenchsight.analyses.methods.identify.known_model.load_calibration import (
    calibrate,
    calibrate_logs,
    known_load,
)
from wrenchsight.models.calibration.gain_calibration import KnownLoad
from wrenchsight.models.calibration.load_parameters import body_parameters
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot

RATIO = np.array([0.96, 1.05, 1.03, 0.94, 0.97, 1.06])
COM = np.array([0.04, 0.08, 0.12])
BODY = body_parameters(3.0, COM, 0.015 * np.eye(3))
PLAIN = IdentificationConfig(friction="coulomb-viscous-offset", loss="squares")


def recording(robot, seed, load=None, duration=20.0):
    """A log of an arm whose drives give RATIO times the torque that its file states."""
    return log_of(robot, seed, duration, 0.9 * np.arange(1, 5), 0.6, load=load, ratio=RATIO)


@pytest.fixture(scope="module")
def logs(ur10e):
    return [recording(ur10e, 1), recording(ur10e, 2)], recording(ur10e, 3, BODY)


@pytest.fixture(scope="module")
def result(ur10e, logs):
    bare, laden = logs
    return calibrate(bare, [(laden, KnownLoad(3.0))], ur10e, config=PLAIN)


@pytest.mark.long
def test_torque_constants_and_centre_of_mass_come_back(ur10e, result):
    outcome = result.calibration
    # 1.5 %: noise of 0.03 A on joints whose load gives a few newton metres.
    np.testing.assert_allclose(outcome.ratio, RATIO, rtol=0.015)
    np.testing.assert_array_less(np.abs(outcome.ratio - RATIO), 3.0 * outcome.ratio_sd)
    np.testing.assert_allclose(outcome.loads[0, 1:4] / 3.0, COM, atol=5e-3)
    np.testing.assert_allclose(
        result.robot.torque_per_ampere, outcome.ratio * ur10e.torque_per_ampere
    )


def test_the_model_is_in_true_torque(result):
    law = result.identification.model.friction.coulomb_viscous
    np.testing.assert_allclose(law.viscous, VISCOUS, rtol=0.05)
    assert "torque per ampere from log_3.csv 3 kg" in result.identification.model.provenance.method
    assert any("no dependence on the load" in line for line in result.warnings)


@pytest.mark.long
def test_command_writes_a_robot_that_goes_with_the_model(ur10e, logs, tmp_path):
    paths = []
    for log in (*logs[0], logs[1]):
        paths.append(tmp_path / log.source)
        write_recording(log, paths[-1])
    out = tmp_path / "out"
    plain, load = [str(path) for path in paths[:2]], [f"{paths[2]}=3.0"]
    settings = IdentifySettings(robot="ur10e", logs=plain, load=load, identification=PLAIN)
    outcome = calibrate_logs(settings, out)
    robot = Robot.load(out / "robot.yaml")
    np.testing.assert_allclose(robot.torque_per_ampere, outcome.robot.torque_per_ampere)
    np.testing.assert_array_equal(robot.reflected_inertia, ur10e.reflected_inertia)
    IdentifiedModel.load(out / "model.yaml", robot)
    assert (out / "figures" / "calibration.png").is_file()


def test_a_load_is_read_from_the_command_line():
    assert known_load("runs/a=b.csv=2.805") == (Path("runs/a=b.csv"), KnownLoad(2.805))
    path, load = known_load("a.csv=1.5,0,0.1,-0.2")
    assert (path, load) == (Path("a.csv"), KnownLoad(1.5, (0.0, 0.1, -0.2)))


@pytest.mark.parametrize("text", ["a.csv", "a.csv=", "=2", "a.csv=1,2", "a.csv=x", "a.csv=nan"])
def test_a_load_that_is_none_is_one_line(text):
    with pytest.raises(InputError, match=r"expected LOG=MASS or LOG=MASS,X,Y,Z"):
        known_load(text)


def test_a_load_without_weight_is_refused():
    with pytest.raises(InputError, match="mass above 0"):
        known_load("a.csv=0")


def test_logs_of_motor_torque_have_no_torque_per_ampere(ur10e, logs):
    (first, second), laden = logs
    torque = replace(first, tau_J=np.zeros_like(first.q))
    with pytest.raises(InputError, match="motor torque"):
        calibrate([torque, second], [(laden, KnownLoad(3.0))], ur10e, config=PLAIN)
