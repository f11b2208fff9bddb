"""Friction refreshed from seconds of a log: of a simulated arm, of the UR10e, and bad input."""

import copy
import json
from dataclasses import replace

import numpy as np
import pytest
from ur10e_logs import COULOMB, VISCOUS, log_of, model_of

from wrenchsight.analyses.methods.identify.identification import predict_torque
from wrenchsight.analyses.methods.identify.identification_config import (
    IdentificationConfig,
    IdentifySettings,
    RefreshConfig,
)
from wrenchsight.analyses.methods.identify.known_model.friction_refreshing import (
    friction_figure,
    refresh_log,
    refresh_model,
)
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.recording_writer import write_recording


@pytest.fixture(scope="module")
def model(ur10e):
    return model_of(ur10e)


def recording(robot, seed, coulomb=COULOMB, viscous=VISCOUS, duration=6.0, still=()):
    """A log of the arm with this friction."""
    return log_of(
        robot,
        seed,
        duration,
        1.1 * np.arange(1, 4),
        coulomb=coulomb,
        viscous=viscous,
        moving=sorted({*range(6)} - {*still}),
    )


def test_changed_friction_is_found_and_predicts_the_next_log(ur10e, model):
    coulomb, viscous = 1.05 * COULOMB, 1.25 * VISCOUS
    result = refresh_model(recording(ur10e, 1, coulomb, viscous), ur10e, model)
    errors = (result.refresh.change[:, 1] - 0.25 * VISCOUS) / result.refresh.standard_deviation[
        :, 1
    ]
    # The log's noise is white and small, the stated one a real arm's: well inside.
    assert np.abs(errors).max() < 2.0
    later = recording(ur10e, 2, coulomb, viscous)
    previous, after = (
        predict_torque([later], ur10e, fitted, IdentificationConfig())[0].rmse
        for fitted in (model, result.model)
    )
    assert (after < 0.4 * previous).all()


def test_only_the_three_numbers_change(ur10e, model):
    result = refresh_model(recording(ur10e, 1, viscous=1.2 * VISCOUS), ur10e, model).model
    np.testing.assert_array_equal(result.inertial_parameters, model.inertial_parameters)
    np.testing.assert_array_equal(result.residual_covariance, model.residual_covariance)
    (source,) = result.provenance.refreshes
    assert source.log.name == "log_1.csv"
    np.testing.assert_allclose(
        result.friction.coulomb_viscous.viscous, VISCOUS + source.viscous, rtol=1e-12
    )


def test_a_joint_at_rest_keeps_its_friction_and_is_named(ur10e, model):
    log = recording(ur10e, 3, viscous=1.3 * VISCOUS, still=(4,))
    result = refresh_model(log, ur10e, model)
    np.testing.assert_allclose(result.refresh.change[4, :2], 0.0, atol=1e-9)
    assert any("wrist_2_joint" in line and "hardly determines" in line for line in result.warnings)


def test_a_residual_that_friction_cannot_explain_warns(ur10e, model):
    log = recording(ur10e, 4)
    swing = 3.0 * np.sin(log.q)  # A, about 35 N m that follow the posture
    result = refresh_model(replace(log, current=log.current + swing), ur10e, model)
    assert any("friction does not explain" in line for line in result.warnings)


def settings(folder, logs, config=None):
    model = str(folder / "model.yaml")
    return IdentifySettings(
        robot="ur10e", logs=logs, refresh=model, refreshing=config or RefreshConfig()
    )


def test_command_writes_a_model_that_loads_again(ur10e, model, tmp_path):
    log = tmp_path / "today.csv"
    write_recording(recording(ur10e, 1, viscous=1.2 * VISCOUS), log)
    model.save(tmp_path / "model.yaml")
    out = tmp_path / "out"
    config = RefreshConfig(part=[0.0, 4.0])
    result = refresh_log(settings(tmp_path, [str(log)], config), out)
    again = IdentifiedModel.load(out / "model.yaml", ur10e)
    np.testing.assert_array_equal(
        again.friction.coulomb_viscous.viscous, result.refresh.after.viscous
    )
    assert again.provenance.refreshes[0].log.duration == pytest.approx(4.0, abs=0.02)
    metrics = json.loads((out / "metrics.json").read_text(encoding="utf-8"))
    np.testing.assert_allclose(
        metrics["viscous"]["standard_errors"], result.refresh.standard_errors[:, 1]
    )
    assert (out / "figures" / "friction.png").is_file()


def test_short_logs_and_stretches_are_taken_together(ur10e, model, tmp_path):
    log = recording(ur10e, 1, viscous=1.2 * VISCOUS)
    write_recording(log, tmp_path / "a.csv")
    write_recording(recording(ur10e, 2, viscous=1.2 * VISCOUS)[:250], tmp_path / "b.csv")
    model.save(tmp_path / "model.yaml")
    logs = [f"{tmp_path / 'a.csv'}=0,1.6,2.5,4.2", str(tmp_path / "b.csv")]
    result = refresh_log(settings(tmp_path, logs), tmp_path / "out")
    error = result.refresh.after.viscous - 1.2 * VISCOUS
    assert (np.abs(error) < 3.0 * result.refresh.standard_deviation[:, 1]).all()
    assert (result.refresh.determined_share[:3, 1] > 0.3).all()
    # Half a second of each end is the filter's, and .2 s of what borders on other stretches.
    assert 25 <= len(result.residual_before.t) <= 45
    again = IdentifiedModel.load(tmp_path / "out" / "model.yaml", ur10e)
    (source,) = again.provenance.refreshes
    assert [source.log.name, *(log.name for log in source.further)] == ["a.csv", "b.csv"]


def test_of_a_part_only_the_stretches_inside_it_count(ur10e, model):
    log = recording(ur10e, 1)
    counts = (log.t - log.t[0] < 2.5) | (log.t - log.t[0] > 4.5)
    result = refresh_model([(log, counts)], ur10e, model, RefreshConfig(part=[0.0, 4.0]))
    cut = log[log.t - log.t[0] <= 4.0]
    inside = cut.t - cut.t[0] < 2.5
    of_cut = refresh_model([(cut, inside)], ur10e, model)
    np.testing.assert_array_equal(result.refresh.change, of_cut.refresh.change)


def test_two_and_a_half_seconds_are_enough(ur10e, model):
    log = recording(ur10e, 1, viscous=1.2 * VISCOUS)
    result = refresh_model(log, ur10e, model, RefreshConfig(part=[0.0, 2.5]))
    assert (result.refresh.determined_share[:2, 1] > 0.3).all()


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (RefreshConfig(part=[4.0, 0.0]), "--part"),
        (RefreshConfig(part=[1.0]), "--part"),
        (RefreshConfig(part=[100.0, 104.0]), "holds no samples from 100 to 104 s"),
        (RefreshConfig(part=[0.0, 1.0]), "must last 1.5 s"),
        (RefreshConfig(part=[0.0, 1.8]), "rows of the logs can be used, 13 are needed"),
        (RefreshConfig(viscous_drift=0.0), "viscous_drift"),
    ],
)
def test_bad_input_is_one_line(ur10e, model, config, message):
    with pytest.raises(InputError, match=message) as caught:
        refresh_model(recording(ur10e, 1), ur10e, model, config)
    assert "\n" not in str(caught.value)


def test_an_arm_at_rest_is_refused(ur10e, model):
    log = recording(ur10e, 1, still=range(6))
    log = replace(log, v=np.zeros_like(log.v))
    with pytest.raises(InputError, match="no joint moves"):
        refresh_model(log, ur10e, model)


@pytest.mark.long
def test_seven_weeks_of_drift_of_a_real_arm(ur10e, real_model, data):
    """4 s of the UR10e seven weeks before its model: the rest of that log."""
    whole = read_recording(
        data("ur10e_more/ur-19_12_23_free.csv"), "ur10e-dynamic-calibration", ur10e
    )[5:2019]
    result = refresh_model(whole[:372], ur10e, real_model)
    # Joints 1 and 2, viscous: more than chance alone moves one number in a hundred.
    assert result.refresh.standard_errors[:2, 1].min() > 2.6
    previous, after = (
        predict_torque([whole[372:]], ur10e, fitted, IdentificationConfig())[0].rmse
        for fitted in (real_model, result.model)
    )
    assert after[1] < 0.65 * previous[1]
    assert (after < 1.1 * previous).all()


def test_sliding_joints_are_refreshed_in_newtons_and_metres(ur10e, model):
    slides = np.arange(6) == 0
    arm = copy.copy(ur10e)
    result = refresh_model(recording(ur10e, 1), ur10e, model)
    arm.chain = replace(ur10e.chain, prismatic=slides)
    panels = friction_figure(replace(result, robot=arm)).axes
    assert panels[-1].get_xlabel() == "joint velocity [rad/s or m/s]"
    assert panels[0].get_ylabel() == "torque residual [N m or N]"
    assert panels[0].get_title(loc="left").endswith(" N")
    assert panels[1].get_title(loc="left").endswith(" N m")
    still = recording(ur10e, 1, still=range(6))
    with pytest.raises(InputError, match=r"0\.\d+ rad/s or m/s"):
        refresh_model(still, arm, model)
