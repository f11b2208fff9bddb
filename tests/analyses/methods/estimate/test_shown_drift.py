"""A log whose friction is not the model's: its band holds what the log itself shows."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from viscous_arm import VISCOUS, save_viscous_model, untouched_log

from wrenchsight.analyses.methods.estimate.estimate_config import EstimateConfig
from wrenchsight.analyses.methods.estimate.estimation import EstimateResult, estimate_log
from wrenchsight.models.estimation.wrench_table import columns_of
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot

MORE = np.array([0.0, 10.0, 0.0, 0.0, 0.0, 0.0])  # N m s/rad

pytestmark = pytest.mark.usefixtures("no_figures")


def free_motion(robot: Robot, more: Array) -> Recording:
    """Untouched; viscous friction of `more` N m s/rad above the model's."""
    rate = [1.1, 1.3, 1.7, 1.9, 2.3, 2.9]
    return untouched_log(robot, 3000, 0.3, rate, lambda _, v: more * v)


@pytest.fixture(scope="module")
def model_file(sts: Robot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_viscous_model(sts, tmp_path_factory.mktemp("model") / "model.yaml")


def read(log: Path, model_file: Path, out: Path, **settings: Any) -> tuple[EstimateResult, Array]:
    config = EstimateConfig(prior="live", **settings)
    result = estimate_log(log, "sts_sre4_600", model_file, out, config=config)
    return result, np.genfromtxt(result.table, delimiter=",", skip_header=1)


def test_the_band_holds_what_the_log_shows_of_friction(sts, model_file, tmp_path):
    log = tmp_path / "log.csv"
    write_recording(free_motion(sts, MORE), log)
    result, table = read(log, model_file, tmp_path / "out")
    stated, usual = read(log, model_file, tmp_path / "told", drift=0.05)
    shares = result.metrics()["drift_shown"]
    assert shares[1] == pytest.approx(MORE[1] / VISCOUS, rel=0.15)
    assert max(np.delete(shares, 1)) < 0.1
    assert stated.metrics()["drift_shown"] is None
    settled = slice(100, None)
    inside, before = (
        np.mean(np.abs(wrenches[settled, 1:4]) <= 1.96 * wrenches[settled, 7:10], axis=0)
        for wrenches in (table, usual)
    )
    assert inside.min() > 0.9
    assert before.min() < 0.8
    (line,) = (line for line in result.warnings if "until then" in line)
    assert "the stated band includes the friction drift" in line
    assert f"joint_2 {100.0 * shares[1]:.0f} % of the viscous torque, other joints less" in line
    (line,) = (line for line in stated.warnings if "until then" in line)
    assert "too narrow" in line and "pass --drift 0." in line
    # What is read is what was known before the log; drift that the log shows is no contact.
    columns = columns_of(6)
    for name in ("fx", "fy", "fz", "mx"):
        k = columns.index(name)
        np.testing.assert_array_equal(table[:, k], usual[:, k])
    statistic, contact = columns.index("contact_statistic"), columns.index("contact")
    assert table[:, statistic].max() < usual[:, statistic].max()
    assert table[:, contact].mean() <= usual[:, contact].mean()
    assert (table[:, 7:13].mean(axis=0) > usual[:, 7:13].mean(axis=0)).all()


@pytest.mark.long
def test_contact_is_judged_with_the_drift_that_the_log_shows_also_beside_smoothed_readings(
    sts, model_file, tmp_path
):
    log = tmp_path / "log.csv"
    write_recording(free_motion(sts, MORE), log)
    _, table = read(log, model_file, tmp_path / "causal")
    _, smoothed = read(log, model_file, tmp_path / "smoothed", smooth=True)
    for name in ("contact_statistic", "contact"):
        k = columns_of(6).index(name)
        np.testing.assert_allclose(smoothed[:, k], table[:, k], rtol=1e-9)


@pytest.mark.long
def test_where_friction_is_the_models_the_band_is_too(sts, model_file, tmp_path):
    log = tmp_path / "log.csv"
    write_recording(free_motion(sts, 0.0 * MORE), log)
    result, table = read(log, model_file, tmp_path / "out")
    _, usual = read(log, model_file, tmp_path / "told", drift=0.05)
    assert result.metrics()["drift_shown"] is None
    assert not any("until then" in line for line in result.warnings)
    np.testing.assert_array_equal(table, usual)


@pytest.mark.long
def test_the_band_of_a_smoothed_reading_is_wider_too(sts, model_file, tmp_path):
    log = tmp_path / "log.csv"
    write_recording(free_motion(sts, MORE), log)
    _, table = read(log, model_file, tmp_path / "out", smooth=True)
    _, usual = read(log, model_file, tmp_path / "told", smooth=True, drift=0.05)
    np.testing.assert_array_equal(table[:, 1:7], usual[:, 1:7])
    assert table[:, 7:10].mean() > 1.05 * usual[:, 7:10].mean()
