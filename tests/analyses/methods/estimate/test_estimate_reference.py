"""`estimate --reference`: a sensor in the log, found again as it was put there, and bad input."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.analyses.methods.estimate.estimate_config import EstimateConfig
from wrenchsight.analyses.methods.estimate.estimation import EstimateResult, estimate_log
from wrenchsight.analyses.methods.reference_sensor.reference_config import ReferenceConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.robot.robot import Robot

_STEP, _DELAY = 0.004, 0.04
_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_TARE = np.array([1.0, -2.0, 3.0])


@pytest.fixture(scope="module")
def log(sts: Robot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """8 s under a force that swells and turns, 2 s at rest; a sensor on the tool that is turned,
    says what the robot does, has a zero, and is late."""
    t = _STEP * np.arange(round(10.0 / _STEP))
    slow = np.clip(t - 2.0, 0.0, None)
    q = sts.home + 0.3 * (1.0 - np.cos(np.outer(slow, [0.5, 0.6, 0.7, 0.8, 0.9, 1.0])))
    v = np.gradient(q, _STEP, axis=0)
    force = np.stack([15 * np.sin(2 * t), 10 * np.cos(3 * t), 30 + 10 * np.sin(1.3 * t)], axis=1)
    force *= np.where(t > 1.0, 1.0, 0.0)[:, None]
    J, (R_WE, _) = sts.chain.jacobian(q), sts.chain.pose(q)
    tau = sts.chain.inverse_dynamics(q, v, np.gradient(v, _STEP, axis=0))
    tau -= np.einsum("kij,ki->kj", J[:, 3:], force)
    sensor = -np.einsum("kji,kj->ki", R_WE @ _TURN, force)
    late = round(_DELAY / _STEP)
    sensor = np.concatenate([np.tile(sensor[:1], (late, 1)), sensor[:-late]]) + _TARE
    current = tau / (sts.torque_per_ampere * sts.current_sign)
    names = [f"{letter}{j + 1}" for letter in "qvi" for j in range(6)] + ["FX", "FY", "FZ"]
    path = tmp_path_factory.mktemp("log") / "log.csv"
    table = np.column_stack([t, q, v, current, sensor])
    np.savetxt(path, table, delimiter=",", header=",".join(["t", *names]), comments="")
    return path


@pytest.fixture(scope="module")
def model_file(sts: Robot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "model.yaml"
    exact = replace(IdentifiedModel.nominal(sts), residual_covariance=0.05**2 * np.eye(6))
    exact.save(path)
    return path


def _compared(log: Path, model: Path, out: Path, reference: ReferenceConfig) -> EstimateResult:
    config = EstimateConfig(prior="100,10", reference=reference)
    config.estimator.observer.K_0 = [100.0]
    return estimate_log(log, "sts_sre4_600", model, out, config=config)


def test_the_sensor_is_found_as_it_is_mounted(log, model_file, tmp_path):
    result = _compared(log, model_file, tmp_path / "out", ReferenceConfig("FX, FY, FZ", tare="fit"))
    reference = result.metrics()["reference"]
    mounting = reference["mounting"]
    assert (mounting["frame"], mounting["sign"]) == ("tool", -1)
    assert np.array_equal(mounting["axes"], _TURN)
    # The observer's own lag of 10 ms is the reading's, and the grid is of 20 ms.
    assert mounting["delay_s"] == pytest.approx(_DELAY - 0.01, abs=0.02)
    assert np.allclose(mounting["tare"], _TARE, atol=0.3)
    for axis in ("fx", "fy", "fz"):
        assert reference["all"][axis]["rmse_n"] < 1.0
        assert reference["contact_moving"][axis]["correlation"] > 0.99
    shares = [reference[phase]["share_pct"] for phase in reference if phase != "mounting"]
    assert shares[0] == pytest.approx(100.0, abs=2.0)  # the delay leads out of the log's end
    assert sum(shares[1:]) == pytest.approx(shares[0])
    assert reference["free_rest"]["share_pct"] == pytest.approx(10.0, abs=2.0)
    assert (tmp_path / "out" / "figures" / "reference.png").is_file()
    assert not result.notices


def test_a_log_compared_as_given(log, model_file, tmp_path):
    given = ReferenceConfig(
        "FX,FY,FZ", "tool", [0.0, 0.0, np.pi / 2], "environment", "1,-2,3", "0.04"
    )
    reference = _compared(log, model_file, tmp_path / "out", given).metrics()["reference"]
    assert np.allclose(reference["mounting"]["axes"], _TURN)
    assert reference["all"]["fz"]["rmse_n"] < 0.5  # the observer's lag of a force that swells


def test_without_a_reference_nothing_is_compared(log, sts, model_file, tmp_path):
    result = _compared(log, model_file, tmp_path / "out", ReferenceConfig())
    assert "reference" not in result.metrics()
    assert any("FX, FY, FZ" in note for note in result.notices), result.notices
    assert not (tmp_path / "out" / "figures" / "reference.png").exists()


@pytest.mark.parametrize(
    ("columns", "tare", "message"),
    [
        ("FX,FY,FW", "none", 'lacks the column "FW", which estimate .--reference. names'),
        ("FX,FY", "none", "names 2 columns, expected 1"),
        ("FX,FX,FZ", "none", "names a column twice"),
        ("FX,,FZ", "none", "names no column"),
        ("FX,FY,FZ", "1,2", "--reference-tare: has 2 numbers for 3 columns"),
    ],
)
def test_bad_columns_are_refused_before_anything_is_written(
    log, model_file, tmp_path, columns, tare, message
):
    with pytest.raises(InputError, match=message):
        _compared(log, model_file, tmp_path / "out", ReferenceConfig(columns, tare=tare))
    assert not (tmp_path / "out" / "wrench.csv").exists()


def test_columns_that_the_description_names_may_be_the_sensors(log, model_file, tmp_path):
    """A log in its plain form has further signals as name.1, name.2, ..."""
    renamed = tmp_path / "renamed.csv"
    text = log.read_text()
    renamed.write_text(text.replace("FX,FY,FZ", "sensor.1,sensor.2,sensor.3", 1))
    reference = ReferenceConfig("sensor.{1..3}", tare="fit")
    result = _compared(renamed, model_file, tmp_path / "out", reference)
    assert result.metrics()["reference"]["mounting"]["frame"] == "tool"
