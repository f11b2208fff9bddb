"""A log whose gears ripple as the model's did not: the band holds it, and the user is told."""

from pathlib import Path

import numpy as np
import pytest
from viscous_arm import save_viscous_model, untouched_log

from wrenchsight.analyses.methods.estimate.estimate_config import EstimateConfig
from wrenchsight.analyses.methods.estimate.estimation import EstimateResult, estimate_log
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot

PERIODS, RIPPLE = 60.0, np.array([0.0, 0.8, 0.6, 0.0, 0.0, 0.0])  # a turn; N m

pytestmark = pytest.mark.usefixtures("no_figures")


def slow_motion(robot: Robot, ripple: Array) -> Recording:
    """Untouched, with viscous friction as the model has it and gears that ripple."""
    rate = [0.5, 0.6, 0.7, 0.8, 0.9, 1.0]
    return untouched_log(robot, 2000, 0.2, rate, lambda q, _: ripple * np.sin(PERIODS * q))


@pytest.fixture(scope="module")
def model_file(sts: Robot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_viscous_model(sts, tmp_path_factory.mktemp("model") / "model.yaml")


def read(robot: Robot, ripple: Array, model_file: Path, out: Path) -> tuple[EstimateResult, Array]:
    log = out.with_suffix(".csv")
    write_recording(slow_motion(robot, ripple), log)
    result = estimate_log(log, "sts_sre4_600", model_file, out, config=EstimateConfig(prior="live"))
    return result, np.genfromtxt(result.table, delimiter=",", skip_header=1)


def test_the_band_holds_the_ripple_that_the_log_shows(
    sts: Robot, model_file: Path, tmp_path: Path
) -> None:
    result, table = read(sts, RIPPLE, model_file, tmp_path / "rippled")
    plain, usual = read(sts, 0.0 * RIPPLE, model_file, tmp_path / "plain")
    shown = result.metrics()["gear_ripple"]
    # Four periods of each ripple to and fro; noise of .2 N m that correlates over .1 s.
    np.testing.assert_allclose(np.asarray(shown["amplitude_nm"])[1:3], RIPPLE[1:3], rtol=0.25)
    np.testing.assert_allclose(np.asarray(shown["periods_per_turn"])[1:3], PERIODS, rtol=0.05)
    (line,) = (line for line in result.warnings if "ripples" in line)
    assert "joint_2 0." in line and "joint_3 0." in line and "joint_1" not in line
    # The ripple's rms makes the band wider, and only where it is.
    assert (table[100:, 7:10].mean(axis=0) > usual[100:, 7:10].mean(axis=0)).all()
    inside = np.mean(np.abs(table[100:, 1:4]) <= 1.96 * table[100:, 7:10], axis=0)
    assert inside.min() > 0.9
    assert plain.metrics()["gear_ripple"] is None
    assert not any("ripples" in line for line in plain.warnings)
