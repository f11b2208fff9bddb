"""A log whose gears ripple as the model's did not: the band holds it, and the user is told."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from sample_models import torque_error
from scipy.signal import lfilter

from wrenchsight.analyses.methods.estimate.estimate_config import EstimateConfig
from wrenchsight.analyses.methods.estimate.estimation import EstimateResult, estimate_log
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import (
    IdentifiedModel,
    LogSource,
    Provenance,
)
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot

T, ROWS, VISCOUS, NOISE = 0.01, 2000, 20.0, 0.2  # s, -, N m s/rad, N m
PERIODS, RIPPLE = 60.0, np.array([0.0, 0.8, 0.6, 0.0, 0.0, 0.0])  # a turn; N m

pytestmark = pytest.mark.usefixtures("no_figures")


def slow_motion(robot: Robot, ripple: Array) -> Recording:
    """Untouched, with viscous friction as the model has it; torque by pinocchio."""
    model = pinocchio.buildModelFromXML(robot.urdf_text)
    model.armature = np.asarray(robot.reflected_inertia)
    data = model.createData()
    t = np.asarray(T * np.arange(ROWS), float)
    rate = np.array([0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
    phase = t[:, None] * rate + np.arange(6)
    q = robot.home + 0.2 * np.sin(phase)
    v, vdot = 0.2 * rate * np.cos(phase), -0.2 * rate**2 * np.sin(phase)
    tau = np.array([pinocchio.rnea(model, data, *row) for row in zip(q, v, vdot, strict=True)])
    white = np.random.default_rng(0).normal(size=(ROWS, 6))
    tau += NOISE * np.sqrt(1.0 - 0.9**2) * lfilter([1.0], [1.0, -0.9], white, axis=0)
    tau += VISCOUS * v + ripple * np.sin(PERIODS * q)
    current = tau / (robot.torque_per_ampere * robot.current_sign)
    return Recording(t=t, q=q, v=v, current=current, source="synthetic")


@pytest.fixture(scope="module")
def model_file(sts: Robot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    one, zero = np.ones(6), np.zeros(6)
    path = tmp_path_factory.mktemp("model") / "model.yaml"
    replace(
        IdentifiedModel.nominal(sts),
        friction=SemiParametricFriction(CoulombViscous(zero, VISCOUS * one, zero)),
        residual_covariance=NOISE**2 * np.eye(6),
        torque_error=torque_error(constant=NOISE),
        provenance=Provenance(logs=[LogSource(name="a.csv")]),
    ).save(path)
    return path


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
