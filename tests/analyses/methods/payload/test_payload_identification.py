"""Payloads of a simulated log and of the UR10e's two weighed ones, and bad input."""

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml
from ur10e_logs import COULOMB, VISCOUS, log_of, model_of

from wrenchsight.analyses.methods.payload.payload_config import PayloadConfig, PayloadSettings
from wrenchsight.analyses.methods.payload.payload_identification import (
    identify_payload,
    payload_log,
)
from wrenchsight.models.calibration.load_parameters import body_parameters, flange_map, load_columns
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot

COM = np.array([0.03, -0.05, 0.11])
BODY = body_parameters(2.0, COM, np.diag([0.008, 0.01, 0.006]))


@pytest.fixture(scope="module")
def model(ur10e):
    return model_of(ur10e)


def recording(robot, seed, load=BODY, duration=12.0):
    return log_of(robot, seed, duration, 1.1 * np.arange(1, 4), load=load)


def test_a_load_is_found(ur10e, model):
    result = identify_payload(recording(ur10e, 1), ur10e, model, PayloadConfig(gain_sd=0.0))
    load = result.load
    # The log's noise is far below what the model states: well inside its errors.
    assert load.mass == pytest.approx(2.0, abs=load.sd.mass)
    np.testing.assert_allclose(load.com, COM, atol=float(load.sd.com.max()))
    assert result.load.com_determined.all()


def test_the_model_with_the_load_explains_the_log(ur10e, model):
    result = identify_payload(recording(ur10e, 1), ur10e, model)
    laden = result.model.inertial_parameters - model.inertial_parameters
    np.testing.assert_allclose(laden[:-1], 0.0)
    body = body_parameters(result.load.mass, result.load.com, result.load.realisable)
    np.testing.assert_allclose(laden[-1], flange_map(ur10e) @ body, atol=1e-12)
    again = identify_payload(recording(ur10e, 2), ur10e, result.model)
    assert not again.load.is_present


def settings(folder, log):
    return PayloadSettings(robot="ur10e", model=str(folder / "model.yaml"), logs=[log])


def test_command_writes_a_tool_that_a_robot_takes(ur10e, model, tmp_path):
    log = tmp_path / "laden.csv"
    write_recording(recording(ur10e, 1), log)
    model.save(tmp_path / "model.yaml")
    result = payload_log(settings(tmp_path, str(log)), tmp_path / "out")
    config = yaml.safe_load(ur10e.source.read_text(encoding="utf-8"))
    config |= yaml.safe_load((tmp_path / "out" / "tool.yaml").read_text(encoding="utf-8"))
    config["urdf"] = str(ur10e.source.with_name(config["urdf"]))
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(config), encoding="utf-8")
    robot = Robot.load(tmp_path / "robot.yaml")
    added = robot.chain.inertial_parameters - ur10e.chain.inertial_parameters
    # Six digits in the block.
    np.testing.assert_allclose(
        added[-1], (result.model.inertial_parameters - model.inertial_parameters)[-1], atol=1e-5
    )
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text(encoding="utf-8"))
    assert metrics["mass_kg"] == pytest.approx(result.load.mass)
    assert metrics["mass_sd_kg"] >= metrics["mass_sd_of_gains_kg"]
    assert (tmp_path / "out" / "figures" / "load.png").is_file()
    IdentifiedModel.load(tmp_path / "out" / "model.yaml", robot)


def test_two_short_logs_determine_the_load_as_one_long_log_does(ur10e, model):
    long = recording(ur10e, 1)
    halves = [(long[:600], None), (long[600:], None)]
    whole, apart = (
        identify_payload(logs, ur10e, model, PayloadConfig(gain_sd=0.0)) for logs in (long, halves)
    )
    # A second of each is the filter's: 9 of 10 rows are left.
    assert len(apart.rows.t) == pytest.approx(0.91 * len(whole.rows.t), rel=0.03)
    sd = apart.load.sd.mass
    assert sd == pytest.approx(whole.load.sd.mass, rel=0.2)
    assert abs(apart.load.mass - whole.load.mass) < sd
    assert (np.diff(apart.rows.t) > 0.0).all()


@pytest.mark.long
def test_stretches_of_a_log_leave_out_contact(ur10e, model, tmp_path):
    log = recording(ur10e, 1)
    touched = log.current.copy()
    t = log.t - log.t[0]
    touched[(t > 4.0) & (t < 7.0), :3] += 3.0  # A, some 30 N m
    write_recording(replace(log, current=touched), tmp_path / "a.csv")
    model.save(tmp_path / "model.yaml")
    stretches = f"{tmp_path / 'a.csv'}=0,4,7,12"
    result = payload_log(settings(tmp_path, stretches), tmp_path / "out")
    assert result.load.mass == pytest.approx(2.0, abs=0.05)
    spoilt = payload_log(settings(tmp_path, str(tmp_path / "a.csv")), tmp_path / "all")
    assert result.load.scale[:3].max() < 0.5 * spoilt.load.scale[:3].max()
    for words, message in (("5,4", "LOG=BEGIN,END"), ("90,99", "holds no samples from 90 to 99 s")):
        stretches = f"{tmp_path / 'a.csv'}={words}"
        with pytest.raises(InputError, match=message):
            payload_log(settings(tmp_path, stretches), tmp_path / "no")


def test_an_undetermined_centre_of_mass_is_named_and_not_written(ur10e, model):
    """The first joint alone turns, about the vertical: no weight's place shows."""
    log = recording(ur10e, 1)
    q = np.tile(ur10e.home, (log.num_samples, 1))
    q[:, :2] += 0.3 * np.sin(1.3 * log.t[:, None] + np.array([0.0, 1.0]))
    v, vdot = (np.gradient(x, 0.01, axis=0) for x in (q, np.gradient(q, 0.01, axis=0)))
    tau = ur10e.chain.inverse_dynamics(q, v, vdot) + COULOMB * np.sign(v) + VISCOUS * v
    tau = tau + load_columns(ur10e, q, v, vdot) @ BODY
    current = tau / (ur10e.torque_per_ampere * ur10e.current_sign)
    result = identify_payload(replace(log, q=q, v=v, current=current), ur10e, model)
    assert result.load.is_present
    unknown = ~result.load.com_determined
    assert unknown.any()
    np.testing.assert_allclose(np.array(result.tool.com)[unknown], 0.0, atol=1e-9)
    axes = ", ".join(axis for axis, is_unknown in zip("xyz", unknown, strict=True) if is_unknown)
    assert (
        f"not determined along {axes}, where it is taken to lie at the flange"
        in result.tool_block()
    )
    assert any("taken to lie at the flange" in line for line in result.warnings)


def test_without_a_load_nothing_is_written_for_the_robot(ur10e, model, tmp_path):
    log = tmp_path / "empty.csv"
    write_recording(recording(ur10e, 1, load=np.zeros(10)), log)
    model.save(tmp_path / "model.yaml")
    result = payload_log(settings(tmp_path, str(log)), tmp_path / "out")
    assert "no load" in result.warnings[0]
    assert not (tmp_path / "out" / "tool.yaml").exists()
    assert (tmp_path / "out" / "metrics.json").is_file()


def test_logs_without_the_load_are_checked_where_those_with_it_are(ur10e, model, tmp_path):
    model.save(tmp_path / "model.yaml")
    write_recording(recording(ur10e, 1), tmp_path / "laden.csv")
    empty = recording(ur10e, 2, load=np.zeros(10))
    empty.q[40, 2] = 9.0  # rad, beyond the limits
    write_recording(empty, tmp_path / "empty.csv")
    given = settings(tmp_path, str(tmp_path / "laden.csv"))
    given = replace(given, empty=[str(tmp_path / "empty.csv")])
    with pytest.raises(InputError, match=r"empty\.csv"):
        payload_log(given, tmp_path / "checked")
    payload_log(replace(given, check=False), tmp_path / "unchecked")


def test_what_reading_a_log_without_the_load_involved_is_said_too(ur10e, model, tmp_path):
    model.save(tmp_path / "model.yaml")
    write_recording(recording(ur10e, 1, duration=6.0), tmp_path / "laden.csv")
    log = recording(ur10e, 2, np.zeros(10), duration=6.0)
    header = "t," + ",".join(f"{key}{j}" for key in "qi" for j in range(1, 7))  # no velocities
    columns = np.c_[log.t, log.q, log.current]
    np.savetxt(tmp_path / "empty.csv", columns, "%.12g", ",", header=header, comments="")
    given = settings(tmp_path, str(tmp_path / "laden.csv"))
    result = payload_log(replace(given, empty=[str(tmp_path / "empty.csv")]), tmp_path / "out")
    assert any("no velocities" in line for line in result.warnings)


@pytest.mark.parametrize(
    ("config", "message"),
    [(PayloadConfig(gain_sd=-1.0), "gain_sd"), (PayloadConfig(name="my tool"), "link's name")],
)
def test_bad_settings_are_one_line(ur10e, model, config, message):
    with pytest.raises(InputError, match=message):
        identify_payload(recording(ur10e, 1), ur10e, model, config)


def test_another_robots_model_is_refused(ur10e, sts):
    with pytest.raises(InputError, match="of robot"):
        identify_payload(recording(ur10e, 1), ur10e, IdentifiedModel.nominal(sts))


@pytest.mark.parametrize(
    ("name", "rows", "mass", "within"),
    [
        ("ur10e/ur-20_02_19_14harm50secLoad.csv", slice(307, 5071), 2.805, 0.03),
        ("ur10e_more/ur-19_12_23_load.csv", slice(2, 2040), 1.069, 0.05),
    ],
)
@pytest.mark.long
def test_weighed_loads_of_a_real_arm(ur10e, real_model, data, name, rows, mass, within):
    log = read_recording(data(name), "ur10e-dynamic-calibration", ur10e)
    log = log[rows] if log.num_samples > rows.stop - rows.start else log
    load = identify_payload(log, ur10e, real_model).load
    assert load.mass == pytest.approx(mass, abs=within)
    assert abs(load.mass - mass) < 2.0 * load.sd.mass
