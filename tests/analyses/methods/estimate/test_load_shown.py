"""A log of an arm that carries something: a load is told, and no drift for it; friction tracked."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wrenchsight.analyses.experiments.setups.ur10e_recordings.known_payload import payload_reference
from wrenchsight.analyses.methods.estimate.estimate_config import (
    EstimateConfig,
    checked_config,
    with_observer,
)
from wrenchsight.analyses.methods.estimate.estimation import EstimateResult, estimate_log
from wrenchsight.analyses.methods.identify.identification import identify
from wrenchsight.analyses.methods.identify.identification_config import IdentificationConfig
from wrenchsight.models.estimation.point_of_action import jacobian_at
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.estimation.wrench_table import columns_of
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.sliding_friction import dry_and_viscous
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.motors import motor_gain
from wrenchsight.models.robot.robot import Robot

pytestmark = [pytest.mark.usefixtures("no_figures"), pytest.mark.long]


@pytest.fixture(scope="module")
def model_file(
    ur10e: Robot, data: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """Of the two longer runs; the law that is found fastest and knows load."""
    names = ("12-40sec", "12-50sec")
    logs = [read_recording(data(f"ur10e/ur-20_02_{n}_12harm.csv"), robot=ur10e) for n in names]
    config = IdentificationConfig(friction="load-dependent")
    path = tmp_path_factory.mktemp("model") / "model.yaml"
    identify(logs, ur10e, config=config).model.save(path)
    return path


def read(
    log: Path, model_file: Path, out: Path, config: EstimateConfig
) -> tuple[EstimateResult, Array]:
    result = estimate_log(log, "ur10e", model_file, out, config=replace(config, prior="live"))
    return result, np.genfromtxt(result.table, delimiter=",", skip_header=1)


def inside(table: Array, begin: float = 1.0) -> Array:
    t = table[:, 0] - table[0, 0]
    rows = (t > begin) & (t < t[-1] - 1.0)
    return np.asarray(np.mean(np.abs(table[rows, 1:4]) <= 1.96 * table[rows, 7:10], axis=0))


@pytest.mark.parametrize(
    ("name", "mass"),
    [("ur10e/ur-20_02_19_14harm50secLoad", 2.805), ("ur10e_more/ur-19_12_23_load", 1.069)],
)
def test_a_real_load_is_weighed(data, model_file, tmp_path, name, mass):
    result, _ = read(data(f"{name}.csv"), model_file, tmp_path / "out", EstimateConfig())
    load: Any = result.metrics()["load"]
    assert load["told"]
    assert abs(load["mass_kg"] - mass) < 2.0 * load["mass_sd_kg"]
    assert load["mass_sd_kg"] < 0.05 * mass
    assert result.contacts[0].startswith("unmodelled load at the tool: ")
    refresh = [line for line in result.warnings if line.startswith("refresh the model's friction")]
    assert all("without the load" in line for line in refresh)


def test_the_smoothed_band_holds_a_real_load(ur10e, data, model_file, tmp_path):
    """Knowing nothing of load friction and single gears it held 86 to 87 % an axis."""
    log = data("ur10e/ur-20_02_19_14harm50secLoad.csv")
    result, table = read(log, model_file, tmp_path / "out", EstimateConfig(smooth=True))
    load: Any = result.metrics()["load"]
    recording = resampled(read_recording(log, robot=ur10e), 0.01)
    direction = payload_reference(ur10e, recording, 5.0, np.array(load["com_m"]))
    t = table[:, 0]
    weight = [np.interp(t, recording.t, 2.805 * axis) for axis in direction.T]
    table[:, 1:4] -= np.stack(weight, axis=1)
    assert inside(table).min() > 0.9


def test_a_load_taken_up_half_way_is_reported_and_not_as_drift(ur10e, data, model_file, tmp_path):
    """2 kg from 25 s on, put into a real log's currents with the friction that the law adds."""
    mass, begin, com = 2.0, 25.0, np.array([0.03, 0.05, 0.06])
    log = resampled(read_recording(data("ur10e/ur-20_02_19_14harm50sec.csv"), robot=ur10e), 0.01)
    model = IdentifiedModel.load(model_file, ur10e)
    t = log.t - log.t[0]
    R_WE, _ = ur10e.chain.pose(log.q)
    weight = payload_reference(ur10e, log, 5.0, com) * mass
    weight[t < begin] = 0.0
    J = jacobian_at(ur10e.chain.jacobian(log.q), R_WE, com)
    tau = np.einsum("kaj,ka->kj", J[:, 3:], weight)
    carried = model.chain(ur10e).gravity_torque(log.q)
    dry, _ = dry_and_viscous(model.friction, log.q, log.v, carried)
    more, _ = dry_and_viscous(model.friction, log.q, log.v, carried - tau)
    gain = motor_gain(ur10e.torque_per_ampere, ur10e.current_sign)
    made = replace(log, t=t, current=log.current + (more - dry - tau) / gain)
    write_recording(made, tmp_path / "log.csv")
    result, table = read(tmp_path / "log.csv", model_file, tmp_path / "out", EstimateConfig())
    load: Any = result.metrics()["load"]
    assert load["told"]
    assert load["begin_s"] == pytest.approx(begin, abs=0.2)
    assert abs(load["mass_kg"] - mass) < 3.0 * load["mass_sd_kg"]
    assert f"since t = {load['begin_s']:.1f} +- 0.1 s" in result.contacts[0]
    assert result.metrics()["drift_shown"] is None  # as without the load
    table[:, 1:4] -= np.stack([np.interp(table[:, 0], t, axis) for axis in weight.T], axis=1)
    assert inside(table[table[:, 14] == 1.0]).min() > 0.9


@pytest.mark.parametrize("joint", [1, 2, 3, 4])
def test_an_empty_arm_that_moves_one_joint_shows_no_load(data, model_file, tmp_path, joint):
    """The model's error of that joint looks like a load: 0.9 kg in joint_4, 14 kg in joint_1."""
    log = data(f"ur10e/ur-20_01_22-joint_{joint}.csv")
    result, _ = read(log, model_file, tmp_path / "out", EstimateConfig())
    load: Any = result.metrics()["load"]
    assert not load["told"]
    assert not any("unmodelled load" in line for line in result.contacts)


def test_an_empty_arm_carries_nothing(data, model_file, tmp_path):
    log = data("ur10e_more/ur-19_12_23_free.csv")
    result, _ = read(log, model_file, tmp_path / "out", EstimateConfig())
    load: Any = result.metrics()["load"]
    assert not load["told"]
    assert load["probability"]["drift"] > 0.9
    assert result.contacts == ("no contact found",)
    shown: Any = result.metrics()["drift_shown"]
    assert shown[1] > 0.15


def test_the_kalman_observers_band_holds_a_drifted_log(data, model_file, tmp_path):
    """Its band knew of no drift, and held 36 to 94 % of such logs."""
    kalman = with_observer(EstimateConfig(), "kalman")
    log = data("ur10e_more/ur-19_12_23_free.csv")
    _, table = read(log, model_file, tmp_path / "out", kalman)
    _, usual = read(log, model_file, tmp_path / "told", replace(kalman, drift=0.05))
    assert inside(table).min() > 0.9
    assert inside(usual).min() < 0.85


def test_tracked_a_drifted_log_reads_better_within_its_band(data, model_file, tmp_path):
    log = data("ur10e_more/ur-19_12_23_free.csv")
    result, table = read(log, model_file, tmp_path / "out", EstimateConfig(track=True))
    _, usual = read(log, model_file, tmp_path / "told", EstimateConfig(drift=0.05))
    assert inside(table).min() > 0.9
    assert inside(usual).min() < 0.85
    late = table[:, 0] - table[0, 0] > 5.0
    rms = [np.sqrt(np.mean(wrenches[late, 1:4] ** 2)) for wrenches in (table, usual)]
    assert rms[0] < 0.7 * rms[1]
    tracked: Any = result.metrics()["friction_tracked"]
    assert tracked["viscous"]["change_nms_per_rad"][1] == pytest.approx(4.5, abs=1.5)
    assert tracked["seconds"] > 10.0
    assert result.metrics()["load"] is None
    assert columns_of(6)[1] == "fx"


@pytest.mark.parametrize(
    ("changes", "option"),
    [
        ({"smooth": True}, "smooth"),
        ({"drift": 0.1}, "drift"),
    ],
)
def test_options_that_exclude_tracking_are_refused(ur10e, changes, option):
    with pytest.raises(InputError, match=option):
        checked_config(EstimateConfig(track=True, **changes), ur10e)


def test_an_observer_or_a_method_that_cannot_be_tracked_is_refused(ur10e, coupled_wrist):
    with pytest.raises(InputError, match="estimates the wrench, not the torque"):
        checked_config(with_observer(EstimateConfig(track=True), "kalman"), ur10e)
    config = EstimateConfig(track=True)
    reading = WrenchReconstructionConfig("damped")
    config = replace(config, estimator=replace(config.estimator, reconstruction=reading))
    with pytest.raises(InputError, match="with which friction cannot be followed"):
        checked_config(config, ur10e)
    with pytest.raises(InputError, match="coupled joints"):
        checked_config(EstimateConfig(track=True), coupled_wrist)
