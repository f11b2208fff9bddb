"""Identification: known parameters from simulated logs, honest errors, and bad input."""

import json
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
import yaml
from sample_models import torque_sds

from wrenchsight.analyses.methods.identify.identification import (
    identify,
    identify_logs,
    residual_covariance,
)
from wrenchsight.analyses.methods.identify.identification_config import (
    LAWS,
    IdentificationConfig,
    IdentifySettings,
)
from wrenchsight.analyses.methods.identify.law_choice import best_law
from wrenchsight.analyses.methods.identify.torque_fit import TorqueFit
from wrenchsight.analyses.methods.identify.zero_check import ZeroOffsets, zero_warnings
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.friction_structure import STRUCTURES
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot

pytestmark = pytest.mark.long  # logs are identified from start to end

STEP = 0.01
COULOMB = np.array([8.0, 7.0, 5.0, 2.0, 2.5, 1.5])
VISCOUS = np.array([10.0, 9.0, 6.0, 2.0, 2.0, 1.0])
OFFSET = np.array([0.5, -0.4, 0.3, 0.1, -0.1, 0.05])
NOISE = np.array([3.0, 2.0, 1.5, 0.5, 0.4, 0.3])  # N m, per sample of 100 Hz


@pytest.fixture(scope="module")
def truth(sts):
    """Pinocchio's model of the arm with inertias that its file does not have, and rotor inertia."""
    rng = np.random.default_rng(3)
    model = pin.buildModelFromXML(sts.urdf_text)
    for i in range(sts.num_joints):
        pi = model.inertias[i + 1].toDynamicParameters() * rng.uniform(0.7, 1.3, 10)
        model.inertias[i + 1] = pin.Inertia.FromDynamicParameters(pi)
    model.armature = rng.uniform(0.5, 2.0, sts.num_joints)
    return model


def recording(robot, truth, seed, duration=20.0, noise=0.0):
    """Five harmonics of 0.1 Hz, torque from pinocchio plus friction, read as motor current."""
    rng = np.random.default_rng(seed)
    n = robot.num_joints
    t = np.arange(0.0, duration, STEP)
    q, v, vdot = np.zeros((3, len(t), n))
    for k in range(1, 6):
        w = 2 * np.pi * 0.1 * k
        amplitude, phase = rng.uniform(0.2, 0.6, n) / k, rng.uniform(0, 2 * np.pi, n)
        angle = w * t[:, None] + phase
        q += amplitude * np.sin(angle)
        v += amplitude * w * np.cos(angle)
        vdot -= amplitude * w**2 * np.sin(angle)
    data = truth.createData()
    rigid = np.array([pin.rnea(truth, data, *row) for row in zip(q, v, vdot, strict=True)])
    tau = rigid + COULOMB * np.sign(v) + VISCOUS * v + OFFSET
    tau = tau + noise * NOISE * rng.normal(size=tau.shape)
    current = robot.motor_current(tau)
    return Recording(t=t + 5.0, q=q, v=v, current=current, source=f"run_{seed}.csv")


@pytest.fixture(scope="module")
def noisy(sts, truth):
    """Three fitted logs and one for validation, with noise."""
    return [recording(sts, truth, seed, noise=1.0) for seed in (1, 2, 3, 4)]


@pytest.fixture(scope="module")
def result(sts, noisy):
    return identify(noisy[:3], sts, noisy[3:])


def test_known_parameters_come_back_from_clean_logs(sts, truth):
    result = identify([recording(sts, truth, seed) for seed in (1, 2)], sts)
    n = sts.num_joints
    inertial = np.array([truth.inertias[i + 1].toDynamicParameters() for i in range(n)])
    item = np.stack([truth.armature, COULOMB, VISCOUS, OFFSET], axis=1)
    expected = result.base.combination @ np.concatenate([inertial.ravel(), item.ravel()])
    outcome = np.array(result.model.base_parameters.values)
    # What remains is sgn(v) on a grid: the instant of a reversal is known to 10 ms, so that a
    # reversal leaves an error of one sample's Coulomb torque. 0.2 % of the largest parameter.
    np.testing.assert_allclose(outcome, expected, atol=2e-3 * np.abs(expected).max())
    law = result.model.friction.coulomb_viscous
    np.testing.assert_allclose(law.coulomb, COULOMB, rtol=0.01)
    np.testing.assert_allclose(law.viscous, VISCOUS, rtol=0.02)
    np.testing.assert_allclose(law.offset, OFFSET, atol=0.05)
    for fit in result.cross_validation:
        assert (fit.relative < 0.01).all()


def test_validation_error_is_the_noise_that_the_filter_passes(result):
    (fit,) = result.validation
    # White noise of 100 Hz through |H|^4, cutoff 5 Hz: the share of its variance that passes is
    # the filter's mean gain, integrated here over the discrete frequencies.
    f = np.linspace(0.0, 0.5, 20001)
    with np.errstate(over="ignore"):
        gain = 1.0 / (1.0 + (np.tan(np.pi * f[:-1]) / np.tan(np.pi * 0.05)) ** 10)
    expected = NOISE * np.sqrt(np.mean(gain**2))
    # 20 s at 10 independent samples a second: 200, so a sd to 5 %; three of those, and the error
    # of the parameters on top.
    np.testing.assert_allclose(fit.rmse, expected, rtol=0.25)
    assert (fit.similarity > 0.9).all()


def test_residual_covariance_is_cross_validated(sts, noisy):
    # Plain squares: Huber's weights are found once, on all logs.
    config = IdentificationConfig(loss="squares")
    result = identify(noisy[:3], sts, config=config)

    def held_out(k):
        others = [noisy[i] for i in range(3) if i != k]
        (fit,) = identify(others, sts, [noisy[k]], config).validation
        return fit.residual

    residuals = [held_out(k) for k in range(3)]
    stacked = np.vstack(residuals)
    expected = np.einsum("ki,kj->ij", stacked, stacked) / len(stacked)
    # The base parameters are read off two logs there and three here: the same up to rounding.
    np.testing.assert_allclose(result.model.residual_covariance, expected, rtol=1e-5, atol=1e-8)
    assert "predicted from the others" in result.model.provenance.residual


def test_residual_covariance_counts_a_constant_error():
    x = np.array([[1.0, 2.0], [3.0, 2.0]])
    np.testing.assert_allclose(residual_covariance([x[:1], x[1:]]), [[5.0, 4.0], [4.0, 4.0]])


def test_a_single_log_states_the_residual_of_the_fit(sts, noisy):
    single = identify(noisy[:1], sts)
    assert single.cross_validation == ()
    assert "single log" in single.model.provenance.residual
    fit_sd = single.fit[0].rmse
    stated = np.sqrt(np.diag(single.model.residual_covariance))
    # 58 parameters on 190 rows of six joints: 5 % fewer degrees of freedom.
    assert (stated > fit_sd).all()
    np.testing.assert_allclose(stated, fit_sd, rtol=0.1)


def test_torque_fit_states_rmse_relative_error_and_similarity():
    measured = np.array([[1.0, 2.0], [-1.0, -2.0], [1.0, 2.0], [-1.0, -2.0]])
    fit = TorqueFit("x", np.arange(4.0), measured, measured * [0.5, -1.0])
    np.testing.assert_allclose(fit.rmse, [0.5, 4.0])
    np.testing.assert_allclose(fit.relative, [0.5, 2.0])
    np.testing.assert_allclose(fit.similarity, [1.0, -1.0])


def test_results_do_not_depend_on_the_logs_own_clock(sts, noisy):
    moved = [replace(r, t=r.t + 1000.0) for r in noisy[:1]]
    a, b = identify(noisy[:1], sts), identify(moved, sts)
    # 1e-9: times near 1000 s carry 1e-13, the grid's interpolation multiplies it by the slopes.
    np.testing.assert_allclose(
        a.model.base_parameters.values, b.model.base_parameters.values, atol=1e-7
    )


def test_missing_samples_are_bridged_and_a_dropout_is_left_out(sts, noisy):
    """Each 40th sample lost, and once 80 ms: the same model but for the noise of what is lost."""
    log = noisy[0]
    lost = np.arange(len(log.t)) % 40 == 7
    lost[700:708] = True
    uneven = replace(
        log,
        **{key: getattr(log, key)[~lost] for key in ("t", "q", "v", "current", "dropout")},
    )
    even, result = identify([log], sts), identify([uneven], sts)
    law, other = (r.model.friction.coulomb_viscous for r in (even, result))
    np.testing.assert_allclose(other.coulomb, law.coulomb, rtol=0.05)
    left_out = np.setdiff1d(even.fit[0].t.round(6), result.fit[0].t.round(6))
    # 80 ms and less than the filter's 200 ms, around the dropout alone.
    assert 8 <= len(left_out) <= 28
    assert log.t[690] < left_out.min() < log.t[700]


def test_kilohertz_logs_give_the_model_of_their_decimation(sts, truth):
    """The regressor is built on a coarser grid when the log is finer than the cutoff needs."""
    log = recording(sts, truth, 1)
    t = np.arange(log.t[0], log.t[-1], 0.001)
    fine = Recording(
        t=t,
        **{key: _interpolated(log, key, t) for key in ("q", "v", "current")},
        source="fine.csv",
    )
    a, b = identify([log], sts), identify([fine], sts)
    assert b.config.time_step == pytest.approx(0.001)
    law, other = (r.model.friction.coulomb_viscous for r in (a, b))
    np.testing.assert_allclose(other.coulomb, law.coulomb, rtol=0.01)
    assert len(b.fit[0].t) < 0.15 * len(t)


def _interpolated(log, key, t):
    signal = getattr(log, key)
    return np.stack([np.interp(t, log.t, signal[:, j]) for j in range(signal.shape[1])], axis=1)


def test_measured_torque_is_preferred_to_current(sts, noisy):
    log = noisy[0]
    tau = sts.joint_torque(log.current)
    direct = replace(log, tau_J=tau, current=np.zeros_like(log.current))
    np.testing.assert_allclose(
        identify([direct], sts).model.base_parameters.values,
        identify([log], sts).model.base_parameters.values,
        rtol=1e-9,
        atol=1e-9,
    )


def test_model_states_ranges_and_origin(sts, noisy, result):
    validity, provenance = result.model.validity, result.model.provenance
    q = np.vstack([log.q for log in noisy[:3]])
    # The ranges leave out half a second at each end of a log.
    assert (np.array(validity.q_min) >= q.min(axis=0) - 1e-3).all()
    assert (np.array(validity.q_max) <= q.max(axis=0) + 1e-3).all()
    assert [log.name for log in provenance.logs] == ["run_1.csv", "run_2.csv", "run_3.csv"]
    assert (provenance.time_step, provenance.cutoff) == (0.01, 5.0)
    assert provenance.logs[0].first_row == 1
    assert provenance.logs[0].last_row == 2000


def test_the_whole_command_and_its_files(sts, noisy, tmp_path):
    logs = []
    for k, log in enumerate(noisy):
        logs.append(tmp_path / f"log_{k}.csv")
        write_recording(log, logs[-1])
    reports = []
    names = [str(log) for log in logs]
    settings = IdentifySettings(robot="sts_sre4_600", logs=names[:3], validate=names[3:])
    result = identify_logs(
        settings, tmp_path / "out", progress=lambda share, step: reports.append(share)
    )
    assert reports == sorted(reports)
    assert reports[-1] == 1.0
    out = tmp_path / "out"
    assert (out / "figures" / "torque_log_3.png").stat().st_size > 10_000
    metrics = json.loads((out / "metrics.json").read_text())
    np.testing.assert_allclose(metrics["validation"]["log_3"]["rmse_nm"], result.validation[0].rmse)
    config = yaml.safe_load((out / "config.yaml").read_text())
    assert config["identification"]["cutoff"] == 5.0
    loaded = IdentifiedModel.load(out / "model.yaml", sts)
    np.testing.assert_array_equal(loaded.inertial_parameters, result.model.inertial_parameters)
    assert len(loaded.provenance.logs[0].sha256) == 64
    # The same logs give the same bytes.
    previous = {p.name: p.read_bytes() for p in out.iterdir() if p.is_file()}
    identify_logs(settings, out)
    assert previous == {p.name: p.read_bytes() for p in out.iterdir() if p.is_file()}


def test_the_check_of_logs_can_be_switched_off(noisy, tmp_path):
    in_degrees = replace(noisy[0], q=np.rad2deg(noisy[0].q), v=np.rad2deg(noisy[0].v))
    write_recording(in_degrees, tmp_path / "log.csv")
    settings = IdentifySettings(robot="sts_sre4_600", logs=[str(tmp_path / "log.csv")])
    with pytest.raises(InputError, match="degrees"):
        identify_logs(settings, tmp_path / "out")
    try:
        identify_logs(replace(settings, check=False), tmp_path / "out")
    except InputError as error:  # such a motion may be refused later, for what is fitted
        assert "degrees" not in str(error)


# ---------------------------------------------------------------------------------- bad input


def refusal(*args, **kwargs) -> str:
    with pytest.raises(InputError) as error:
        identify(*args, **kwargs)
    line = str(error.value)
    assert "\n" not in line
    return line


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"cutoff": 40.0}, "160 samples a second"),
        ({"cutoff": 0.0}, "cutoff"),
        ({"filter_order": 0}, "filter_order"),
        ({"num_passes": 0}, "num_passes"),
        ({"time_step": -1.0}, "time_step"),
        ({"friction": "presliding+net"}, 'did you mean "presliding+network"'),
    ],
)
def test_settings_that_cannot_be_are_refused(sts, noisy, config, message):
    assert message in refusal([noisy[0]], sts, config=IdentificationConfig(**config))


def test_logs_without_information_are_refused(sts, noisy):
    log = noisy[0]
    assert "no log" in refusal([], sts)
    assert "lasts 2.99 s" in refusal([log[:300]], sts)
    other = replace(log, q=log.q[:, :5], v=log.v[:, :5], current=log.current[:, :5])
    assert "5 joints" in refusal([other], sts)
    assert "5 joints" in refusal([log], sts, [other])
    q, v = log.q.copy(), log.v.copy()
    q[:, [1, 4]], v[:, [1, 4]] = 0.3, 0.0
    line = refusal([replace(log, q=q, v=v)], sts)
    assert "joint_2" in line and "joint_5" in line and "joint_3" not in line


def test_a_joint_that_moves_in_one_log_only_is_enough(sts, noisy):
    log = noisy[0]
    q, v = log.q.copy(), log.v.copy()
    q[:, 5], v[:, 5] = 0.3, 0.0
    identify([replace(log, q=q, v=v), noisy[1]], sts)


def test_validating_on_a_fitted_log_warns(sts, noisy):
    result = identify(noisy[:2], sts, [replace(noisy[1], source="copy.csv")])
    (warning,) = [w for w in result.warnings if "copy.csv" in w]
    assert "validates nothing" in warning


def test_a_log_given_twice_warns(sts, noisy):
    result = identify([noisy[0], noisy[0]], sts)
    assert any("given twice" in w for w in result.warnings)
    assert [fit.name for fit in result.fit] == ["run_1", "run_1_2"]


def test_torque_that_belongs_to_another_motion_warns(sts, noisy):
    """A wrong robot of the same number of joints looks like this: nothing explains the torque."""
    wrong = replace(noisy[0], current=noisy[1].current)
    result = identify([wrong], sts)
    (warning,) = [w for w in result.warnings if "joint_1" in w and "unexplained" in w]
    assert "sts_sre4_600" in warning and "current gains" in warning
    # A log of torques has no current that could be asked for.
    result = identify([replace(wrong, tau_J=sts.joint_torque(wrong.current))], sts)
    (warning,) = [w for w in result.warnings if "joint_1" in w and "unexplained" in w]
    assert "unit and signs of the torques" in warning and "current" not in warning


def test_negative_friction_is_reported_and_zero_friction_is_not(sts, truth):
    log = recording(sts, truth, 1)

    def negative(share):
        friction = share * (COULOMB * np.sign(log.v) + VISCOUS * log.v)
        changed = replace(log, current=log.current - sts.motor_current(friction))
        return [w for w in identify([changed], sts).warnings if "negative" in w]

    assert negative(1.0) == []  # none is left, and comes out as a few mN m of either sign
    assert len(negative(2.0)) == 2 * sts.num_joints


def loaded(robot, truth, mass):
    """The same arm with a point mass 10 cm beyond its last link's frame."""
    carrying = truth.copy()
    body = pin.Inertia(mass, np.array([0.0, 0.05, 0.1]), np.zeros((3, 3)))
    carrying.inertias[6] = carrying.inertias[6] + body
    return carrying


def test_a_payload_changed_between_logs_is_reported(sts, truth, noisy):
    carrying = recording(sts, loaded(sts, truth, 1.5), 5, noise=1.0)
    (warning,) = [w for w in identify([*noisy[:2], carrying], sts).warnings if "payload" in w]
    assert "run_5 +" in warning
    assert "run_1 -" in warning
    # The same payload in all logs is part of the last link.
    every = [recording(sts, loaded(sts, truth, 1.5), k, noise=1.0) for k in (1, 2)]
    assert not any("payload" in w for w in identify(every, sts).warnings)


@pytest.mark.parametrize("joint", [1, 2])
def test_a_wrong_torque_constant_is_reported(sts, noisy, joint):
    gain = np.ones(6)
    gain[joint] = 1.4
    wrong = [replace(log, current=log.current * gain) for log in noisy[:2]]
    (warning,) = [w for w in identify(wrong, sts).warnings if "gravity" in w]
    assert f"joint_{joint + 1}" in warning
    assert "torque_per_ampere" in warning
    torques = [replace(log, tau_J=sts.joint_torque(log.current)) for log in wrong]
    (warning,) = [w for w in identify(torques, sts).warnings if "gravity" in w]
    assert f"joint_{joint + 1}" in warning
    assert "unit of the torques" in warning and "torque_per_ampere" not in warning


def test_right_torque_constants_are_not(result):
    assert not any("gravity" in w or "payload" in w for w in result.warnings)


@pytest.mark.parametrize(("joint", "off"), [(1, 0.1), (3, -0.15)])
def test_a_zero_that_is_off_is_found_with_its_standard_error(sts, truth, joint, off):
    logs = [recording(sts, truth, seed, noise=0.02) for seed in (1, 2)]
    moved = [replace(log, q=log.q + off * np.eye(6)[joint]) for log in logs]
    result = identify(moved, sts, config=IdentificationConfig(cross_validate=False))
    offset, sd = result.zeros.offset[joint], result.zeros.sd[joint]
    # One linear step from a fit whose masses have taken up a part: a tenth of the offset is left.
    assert abs(offset + off) < 4.0 * sd + 0.1 * abs(off)
    assert sd < 0.02
    (warning,) = [text for text in result.warnings if "zero of" in text]
    assert f"set q_offset: {offset:.3f} at {sts.joint_names[joint]}" in warning


def test_what_the_file_adds_to_a_zero_stays_in_the_remedy(sts):
    """The logs' positions have it already: what is found is added to it."""
    zeros = ZeroOffsets(np.array([0.0, 0.2, 0.0]), np.array([np.inf, 0.02, 0.1]))
    turns = np.zeros(3, bool)
    (warning,) = zero_warnings(zeros, sts.joint_names, np.array([0.0, -0.5, 0.0]), turns)
    assert f"set q_offset: -0.300 at {sts.joint_names[1]}" in warning


def test_the_zero_of_a_joint_that_slides_is_off_by_metres(sts):
    zeros = ZeroOffsets(np.array([0.05, 0.2, 0.19]), np.array([0.02, 0.02, 0.02]))
    slides = np.array([False, True, False])
    (warning,) = zero_warnings(zeros, sts.joint_names, np.zeros(3), slides)
    assert f"{sts.joint_names[1]} off by -0.200 +- 0.02 m (" in warning
    assert f"{sts.joint_names[2]} off by -0.190 +- 0.02 rad)" in warning


def test_right_zeros_are_not(result, sts):
    assert not any("zero of" in warning for warning in result.warnings)
    shows = np.isfinite(result.zeros.sd)
    assert (np.abs(result.zeros.offset) < 4.0 * result.zeros.sd)[shows].all()
    # The first axis is vertical: no torque depends on its zero.
    assert not shows[0]
    assert result.metrics()["joint_zeros"]["q_offset"][0] is None


def test_progress_never_goes_back_however_many_logs_are_filtered(sts, noisy):
    """With 30 logs the share of the filters alone would reach 0.94, beyond that of the fit."""
    log, reports = noisy[0], []
    config = IdentificationConfig(cross_validate=False)
    short = log[: len(log.t) // 2]
    identify([log], sts, [short] * 30, config, lambda share, _: reports.append(share))
    assert reports == sorted(reports)


def test_spikes_in_the_current_hardly_move_the_model(sts, noisy):
    """Twenty samples of 50 A in each joint of a log: a drive's log has them."""
    rng = np.random.default_rng(6)
    current = noisy[0].current.copy()
    for j in range(6):
        rows = rng.choice(len(current), 20, replace=False)
        current[rows, j] += 50.0 * rng.choice([-1.0, 1.0], 20)
    spiked = [replace(noisy[0], current=current), noisy[1]]

    def error(loss):
        return identify(spiked, sts, noisy[3:], IdentificationConfig(loss=loss)).validation[0].rmse

    clean = identify(noisy[:2], sts, noisy[3:]).validation[0].rmse
    assert (error("huber") < 1.3 * clean).all()
    assert (error("squares") > error("huber")).all()


@pytest.mark.parametrize("law", ["coulomb-viscous", "stribeck", "presliding"])
def test_each_law_predicts_what_coulomb_and_viscous_friction_made(sts, noisy, law):
    """All of them contain it; the richer ones must not lose by it."""
    logs = [replace(log, current=log.current - sts.motor_current(OFFSET)) for log in noisy]
    outcome = identify(logs[:3], sts, config=IdentificationConfig(friction=law))
    assert outcome.law == law
    plain = identify(logs[:3], sts)
    # Up to 30 % for what ten more parameters and a displacement of at least 0.03 mrad cost.
    assert (outcome.held_out[law] < 1.3 * plain.held_out[plain.law]).all()


def test_cross_validation_chooses_a_law_and_states_all(sts, noisy):
    outcome = identify(noisy[:2], sts, config=IdentificationConfig(friction="best"))
    assert set(STRUCTURES) <= set(outcome.held_out) <= set(LAWS)
    assert outcome.law == best_law(outcome.held_out, outcome.extrapolated)
    assert set(STRUCTURES) <= set(outcome.extrapolated)
    chosen = outcome.metrics()["law_cross_validation"][outcome.law]
    assert all(len(chosen[f"{part}_rmse_nm"]) == 6 for part in ("fastest", "slowest"))
    assert outcome.metrics()["friction"]["law"] == outcome.law
    # No fit depends on those made before it: to the last bit what the law gives alone.
    alone = identify(noisy[:2], sts, config=IdentificationConfig(friction="load-dependent"))
    np.testing.assert_array_equal(
        outcome.held_out["load-dependent"], alone.held_out["load-dependent"]
    )


def test_the_best_law_weighs_joints_equally():
    held_out = {"a": np.array([10.0, 1.0]), "b": np.array([9.0, 1.2]), "c": np.array([20.0, 0.4])}
    assert best_law(held_out) == "c"


def test_the_best_law_counts_what_lies_beyond_the_fit():
    held_out = {"plain": np.array([1.0, 1.0]), "rich": np.array([0.9, 0.9])}
    beyond = {
        "plain": (np.full(2, 1.1), np.full(2, 1.0)),
        "rich": (np.full(2, 5.0), np.full(2, 0.9)),
    }
    assert best_law(held_out) == "rich"
    assert best_law(held_out, beyond) == "plain"
    assert best_law(held_out, {}) == "rich"


def test_the_fastest_samples_are_predicted_without_them(sts, truth):
    """A joint with friction that turns down beyond 80 % of its samples' speeds."""
    logs = [recording(sts, truth, seed, noise=1.0) for seed in (1, 2)]
    fast = np.quantile(np.abs(np.vstack([log.v for log in logs])), 0.8, axis=0)
    less = [8.0 * (np.abs(log.v) > fast) * np.sign(log.v) for log in logs]
    bent = [
        replace(log, current=log.current - sts.motor_current(item))
        for log, item in zip(logs, less, strict=True)
    ]
    config = IdentificationConfig(friction="best")
    straight, outcome = (identify(item, sts, config=config).extrapolated for item in (logs, bent))
    law = "coulomb-viscous-offset"
    assert (outcome[law][0] > 3.0 * straight[law][0]).all()
    assert (outcome[law][0] > 5.0).all()  # of the 8 N m that nothing slower shows


def test_logs_of_one_motion_are_held_out_together(sts, truth, noisy):
    again = replace(recording(sts, truth, 1, noise=1.0), source="again.csv")
    shifted = replace(again, t=again.t + 3.0)
    outcome = identify([noisy[0], shifted, noisy[1]], sts)
    (note,) = [line for line in outcome.warnings if "repeat one motion" in line]
    assert note.startswith("run_1, again repeat one motion: they are held out together")
    # Each is predicted from the third log alone, so that both err alike.
    first, second, _ = (fit.residual for fit in outcome.cross_validation)
    alone = identify([noisy[0], noisy[1]], sts).cross_validation[0].residual
    np.testing.assert_allclose(
        np.sqrt(np.mean(first**2, axis=0)), np.sqrt(np.mean(alone**2, axis=0)), rtol=0.05
    )
    assert second.shape == first.shape


def test_a_single_motion_is_cut_into_thirds(sts, truth, noisy):
    again = replace(recording(sts, truth, 1, noise=1.0), source="again.csv")
    outcome = identify([noisy[0], again], sts)
    (note,) = [line for line in outcome.warnings if "repeat one motion" in line]
    assert "there is no other motion" in note
    assert outcome.cross_validation == ()
    assert outcome.model.torque_error is not None


def test_the_model_holds_the_torque_error_of_the_observer(sts, result, noisy):
    """The band of the stated sds holds 95 % of what is read of a log that no fit had seen."""
    error, log = result.model.torque_error, noisy[3]
    config = WrenchEstimatorConfig(observer=MomentumObserverConfig(time_step=STEP))
    reports = WrenchEstimator(sts, result.model, config).observe(log.q, log.v, log.current)
    sd, stiction = torque_sds(
        replace(error, drift=0.0),
        result.model.friction,
        log.q,
        log.v,
        reports.tau_J - reports.tau_f,
        STEP,
    )
    selected = slice(50, None)
    inside = np.mean(np.abs(reports.tau_ext[selected]) < 1.96 * sd[selected])
    # The law has the true form, so that stiction is overstated at each reversal: above 95 %.
    assert 0.93 < inside < 0.995
    sliding = (stiction < 0.3 * error.constant)[selected]
    share = np.mean((np.abs(reports.tau_ext[selected]) < 1.96 * sd[selected])[sliding])
    assert share == pytest.approx(0.95, abs=0.02)
    np.testing.assert_array_equal(error.resolution, 0.0)


def test_without_cross_validation_nothing_is_known_of_the_error(sts, noisy):
    config = IdentificationConfig(cross_validate=False)
    assert identify(noisy[:2], sts, config=config).model.torque_error is None


def test_the_consistent_fit_is_a_robot_and_hardly_worse(sts, noisy, tmp_path):
    config = IdentificationConfig(consistent=True)
    plain = identify(noisy[:3], sts, noisy[3:])
    outcome = identify(noisy[:3], sts, noisy[3:], config)
    assert outcome.metrics()["inconsistent_links"] == []
    assert (outcome.validation[0].rmse < 1.05 * plain.validation[0].rmse).all()
    outcome.write(OutputFolder(tmp_path), IdentifySettings())
    model = pin.buildModelFromXML((tmp_path / "robot.urdf").read_text())
    found_inertias = np.array([model.inertias[i + 1].toDynamicParameters() for i in range(6)])
    np.testing.assert_allclose(
        found_inertias, outcome.model.inertial_parameters, rtol=1e-9, atol=1e-12
    )


def test_parameters_are_determined_combined_or_named_as_undetermined(result):
    parameters = result.metrics()["parameters"]
    assert "coulomb[joint_3]" in parameters["determined"]
    assert parameters["determined"]["coulomb[joint_3]"]["standard_deviation"] > 0.0
    assert "m[joint_5]" in parameters["only_in_combinations"]
    assert "m[joint_1]" in parameters["undetermined"]


def coupled_logs(robot, truth, seeds):
    """As `recording`, the torques of the motors that move several joints."""
    logs = []
    D = robot.motor_rates
    larger = D.T @ (truth.armature[:, None] * D) - np.diag(truth.armature)
    for seed in seeds:
        log = recording(robot, truth, seed)
        v_motor = log.v @ D.T
        friction = COULOMB * np.sign(v_motor) + VISCOUS * v_motor + OFFSET
        item = COULOMB * np.sign(log.v) + VISCOUS * log.v + OFFSET
        tau_J = robot.joint_torque(log.current) - item + friction @ D
        tau_J += np.gradient(log.v, STEP, axis=0) @ larger  # .5 Hz at most, known to 1e-4
        logs.append(replace(log, current=robot.motor_current(tau_J)))
    return logs


def test_friction_of_coupled_motors_comes_back(coupled_wrist, truth, tmp_path):
    outcome = identify(coupled_logs(coupled_wrist, truth, (1, 2, 3)), coupled_wrist)
    law = outcome.model.friction.coulomb_viscous
    # As without coupling: the instant of a reversal is known to 10 ms.
    np.testing.assert_allclose(law.coulomb, COULOMB, rtol=0.015)
    np.testing.assert_allclose(law.viscous, VISCOUS, rtol=0.03)
    # Alone determined only for the last three joints: others' rotors stand with a link's inertia.
    np.testing.assert_allclose(outcome.solution.parts().rotor[3:], truth.armature[3:], rtol=0.02)
    for fit in outcome.cross_validation:
        assert (fit.relative < 0.015).all()
    np.testing.assert_array_equal(outcome.metrics()["coupling"], coupled_wrist.coupling)
    outcome.model.save(tmp_path / "model.yaml")
    read = IdentifiedModel.load(tmp_path / "model.yaml", coupled_wrist)
    v = np.random.default_rng(0).normal(size=(5, 6))
    np.testing.assert_array_equal(
        read.friction.torque_along(v, v, v), outcome.model.friction.torque_along(v, v, v)
    )


def test_a_model_of_other_couplings_is_refused(sts, coupled_wrist, truth, tmp_path):
    log = coupled_logs(coupled_wrist, truth, (1,))
    identify(log, coupled_wrist).model.save(tmp_path / "model.yaml")
    with pytest.raises(InputError, match=r"current_sign|coupling"):
        IdentifiedModel.load(tmp_path / "model.yaml", sts)


TX40_COUPLING = [[float(i == k) - float((i, k) == (5, 4)) for k in range(6)] for i in range(6)]


def test_the_coupled_wrist_of_a_real_arm(data, tmp_path):
    """Joint 5 of the TX40 moves against the friction of motors 5 and 6."""
    source = data("staubli_tx40/excitation.csv").parent
    config = yaml.safe_load((source / "robot.yaml").read_text(encoding="utf-8"))
    config |= {"urdf": str(source / "robot.urdf"), "coupling": TX40_COUPLING}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(config), encoding="utf-8")
    layout = yaml.safe_load((source / "recording.yaml").read_text(encoding="utf-8"))
    layout["motor_torque"] = {"columns": layout.pop("current")["columns"], "unit": "N m"}
    (tmp_path / "log.yaml").write_text(yaml.safe_dump(layout), encoding="utf-8")
    robot = Robot.load(tmp_path / "robot.yaml")
    log = read_recording(source / "excitation.csv", tmp_path / "log.yaml", robot)
    outcome = identify([log], robot, config=IdentificationConfig(cutoff=10.0, cross_validate=False))
    # What was asked of joint 5; the others as they are without coupling, to the digit stated.
    assert (outcome.fit[0].rmse < [2.55, 2.85, 1.7, 0.9, 1.3, 1.6]).all()
