"""The TX40's model, each stretch of its recording predicted by a fit of the others."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.analyses.experiments.tx40_identification.experiment import (
    FORMAT,
    NOTES,
    held_out,
    tx40,
)
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.robot.robot import Robot

FILES = tuple(f"staubli_tx40/{name}" for name in ("excitation.csv", "robot.yaml", "robot.urdf"))
# What is asked of joint 5, and what the others have without a coupled wrist, N m.
ASKED = np.array([2.5, 2.8, 1.6, 0.8, 1.3, 1.6])


@pytest.fixture
def logged(data_holding: Callable[..., Path], tmp_path: Path) -> tuple[Robot, Recording]:
    data = data_holding(*FILES)
    robot = tx40(data, tmp_path)
    return robot, read_recording(data / FILES[0], FORMAT, robot)


def test_motors_torque_through_the_coupling_is_the_joints_torque(logged) -> None:
    robot, log = logged
    # The source's own figures, written with seven digits.
    np.testing.assert_allclose(
        robot.joint_torque(log.current), log.extra["tau_motor"], rtol=1e-4, atol=2e-3
    )


@pytest.mark.slow
def test_the_experiment_reaches_what_is_asked(ran) -> None:
    assert (ran.metrics["validation"]["rmse_nm"] <= ASKED).all()
    assert np.array(ran.metrics["coupling"])[5, 4] == -1.0
    # Without the coupling joint 5 is what makes it needed.
    assert ran.metrics["uncoupled"]["plain"]["validation"]["rmse_nm"][4] > 3.0
    assert (ran.out / "model.yaml").is_file()
    assert len(ran.notes) == len(NOTES)


def test_a_stretch_is_predicted_without_its_own_torque(logged) -> None:
    """Torque that is changed inside a stretch changes the error there, not the prediction."""
    robot, log = logged
    plain = held_out(log, robot, "coulomb-viscous", 3)
    inside = (log.t > log.t[0] + 3.6) & (log.t < log.t[0] + 5.4)  # of the second third
    bent = replace(log, current=np.where(inside[:, None], 1.5 * log.current, log.current))
    again = held_out(bent, robot, "coulomb-viscous", 3)
    second = (plain.t > log.t[0] + 3.0) & (plain.t < log.t[0] + 6.0)
    np.testing.assert_allclose(again.predicted[second], plain.predicted[second], atol=1e-9)
    assert not np.allclose(again.measured[second], plain.measured[second], atol=0.5)
