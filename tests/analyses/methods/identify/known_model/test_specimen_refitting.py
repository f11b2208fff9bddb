"""Friction of another specimen: logs of an arm whose level is known, in stretches and with gaps."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchsight.analyses.methods.identify.identification_config import IdentifySettings
from wrenchsight.analyses.methods.identify.known_model.specimen_refitting import (
    CRAWL_SPEED,
    SpecimenRefit,
    carried_over,
    refit_logs,
    refit_specimen,
)
from wrenchsight.analyses.methods.reference_sensor.mounting import sensor_torque
from wrenchsight.analyses.methods.reference_sensor.reference_config import (
    REFERENCE,
    ReferenceConfig,
)
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.fitted_robot import FittedRobot
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import PoseConfig, ToolConfig

_STEP = 0.002  # s
_KNOWN = np.array([10.0, 10.0, 5.0, 3.0, 3.0, 3.0])  # N m
_TRUE = np.array([10.0, 6.5, 6.0, 4.0, 3.0, 3.0])
_VISCOUS = np.array([20.0, 20.0, 14.0, 3.5, 2.0, 3.0])  # N m s/rad
_MOVING = slice(1, 4)  # joints 2, 3 and 4
_TOOL = ToolConfig(mass=3.0, com=[0.0, 0.0, 0.1], inertia=[0.02, 0.02, 0.01, 0.0, 0.0, 0.0])


def _law(coulomb: np.ndarray) -> PreslidingFriction:
    zero = np.zeros(6)
    return PreslidingFriction(
        SemiParametricFriction(CoulombViscous(zero, _VISCOUS, zero)),
        coulomb=coulomb,
        stribeck=zero,
        stribeck_velocity=np.full(6, 0.4),
        load=zero,
        cubic=zero,
        weight=np.ones((6, 1)),
        displacement=np.full((6, 1), 1e-4),
    )


def _recording(robot: Robot, sign: float, push: float = 0.0) -> Recording:
    """Joints 2 to 4 sweep for 2 s; from 1 s on `push` N m act on joint 2."""
    t = _STEP * np.arange(1000)
    v = np.zeros((1000, 6))
    v[:, _MOVING] = sign * (0.25 + 0.15 * np.sin(3.0 * t)[:, None] * np.array([1.0, -1.0, 0.5]))
    q = np.array([0.2, -1.3, 1.6, -1.9, -1.5, 0.1]) + np.cumsum(v, axis=0) * _STEP
    vdot = np.gradient(v, _STEP, axis=0)
    tau = robot.chain.inverse_dynamics(q, v, vdot) + _TRUE * np.sign(v) + _VISCOUS * v
    tau[t >= 1.0, 1] -= push
    tau += np.random.default_rng(5).normal(0.0, 0.3, tau.shape)
    return Recording(t=t, q=q, v=v, current=robot.motor_current(tau), source="synthetic")


@pytest.fixture
def model(ur10e: Robot) -> IdentifiedModel:
    return replace(
        IdentifiedModel.nominal(ur10e),
        friction=_law(_KNOWN),
        fitted_robot=FittedRobot.of(ur10e),
    )


def test_the_level_of_joints_that_move_is_found(ur10e, model):
    tooled = ur10e.with_tool(_TOOL, PoseConfig())  # of which the model knows nothing
    logs = []
    for sign in (1.0, -1.0, 1.0, -1.0):
        log = _recording(tooled, sign, push=40.0)
        log.q[300:310] = np.nan
        logs.append((log, log.t < 1.0))
    refit = refit_specimen(logs, tooled, model)
    result = refit.fit.law.coulomb_viscous
    level = result.coulomb + 0.25 * result.viscous  # at the mean speed: what the sweep tells
    np.testing.assert_allclose(level[_MOVING], (_TRUE + 0.25 * _VISCOUS)[_MOVING], atol=0.5)
    np.testing.assert_array_equal(result.coulomb[[0, 4, 5]], _KNOWN[[0, 4, 5]])
    np.testing.assert_array_equal(refit.fit.rows > 0, [False, True, True, True, False, False])
    assert refit.model.fitted_robot.tool_mass == 0.0  # the model's file stays without the tool


def _pressed(robot: Robot, sign: float, gain: float, ripple: float) -> Recording:
    """The sweep while 33 to 69 N press on E against W's z, of a robot whose torque constants are
    too small by `gain`, with a torque that repeats over joint 2."""
    log = _recording(robot, sign)
    force = 45.0 + 12.0 * sign + 6.0 * log.t  # slow: the observer's lag is none of the matter
    tau_ext = robot.chain.jacobian(log.q)[:, 5] * force[:, None]
    wave = np.zeros_like(log.q)
    wave[:, 1] = ripple * np.sin(log.q[:, 1] / 0.02)
    current = robot.motor_current((robot.joint_torque(log.current) - tau_ext) / (1.0 + gain) + wave)
    # Free motion is read as before: what explains it is too small by the same share.
    return replace(log, current=current, extra={REFERENCE: force[:, None]})


def test_a_force_sensor_tells_torque_constants_and_the_residual_along_paths(ur10e, model):
    ours = replace(model, inertial_parameters=ur10e.chain.inertial_parameters / 1.04)
    runs = [_pressed(ur10e, sign, 0.04, 4.0) for sign in (1.0, -1.0) * 4]
    config = ReferenceConfig(columns="F", frame="world", sign="robot")
    reports = [sensor_torque(run, ur10e, config) for run in runs]
    everywhere = [(run, np.ones(len(run.t), bool)) for run in runs]
    refit = refit_specimen(everywhere[:-1], ur10e, ours, reports[:-1])
    # Rows of 15 cm err together: stated is a share of .5 %.
    assert refit.fit.gain == pytest.approx(0.04, abs=4.0 * refit.fit.gain_sd)
    assert refit.fit.gain_sd < 0.02
    robot = refit.robot
    assert robot is not None
    scale = robot.torque_per_ampere / ur10e.torque_per_ampere
    np.testing.assert_allclose(scale, 1.0 + refit.fit.gain, rtol=1e-12)
    # What sliding shows has no say at rest.
    np.testing.assert_array_equal(robot.rest_torque_per_ampere, ur10e.torque_per_ampere)
    # Free motion off the paths takes the same currents as before the gain was known.
    q = np.random.default_rng(2).uniform(-1.0, 1.0, (20, 6))
    v = np.random.default_rng(3).uniform(0.1, 0.6, (20, 6))
    previous = replace(ours, friction=refit.fit.law)
    currents = [
        arm.motor_current(
            item.chain(arm).inverse_dynamics(q, v, v) + item.friction.torque_along(q, v, 0.0 * q)
        )
        for arm, item in ((robot, refit.model), (ur10e, previous))
    ]
    np.testing.assert_allclose(*currents, rtol=1e-9)
    plain = refit_specimen(everywhere[:-1], ur10e, ours)
    assert plain.robot is None
    errors = []
    for arm, result in ((robot, refit.model), (ur10e, refit_of_law(refit)), (ur10e, ours)):
        config_of = WrenchEstimatorConfig(check_samples=False)
        config_of.observer.time_step = _STEP
        estimator = WrenchEstimator(arm, result, config_of)
        run = runs[-1]
        batch = estimator.run(estimator.initial_state(), run.q, run.v, run.current)
        errors.append(np.abs(batch.tau_ext - reports[-1])[200:, 1].mean())
    assert errors[0] < 0.5 * errors[1] < errors[2]


def refit_of_law(refit: SpecimenRefit) -> IdentifiedModel:
    """The refit's level alone, neither torque constants nor places."""
    scale = 1.0 + refit.fit.gain
    inertial = refit.model.inertial_parameters / scale
    return replace(refit.model, friction=refit.fit.law, inertial_parameters=inertial)


def test_a_crawl_is_not_carried_over():
    law = replace(_law(_KNOWN), stribeck=np.full(6, -2.0))
    law = replace(law, stribeck_velocity=np.array([0.4, 0.01, 0.4, 0.05, 0.05, 0.05]))
    selected = carried_over(law).stribeck
    np.testing.assert_array_equal(selected == 0.0, law.stribeck_velocity < CRAWL_SPEED)


def test_a_model_or_log_that_cannot_be_refitted_is_one_line(ur10e, model):
    log = _recording(ur10e, 1.0)
    plain = IdentifiedModel.nominal(ur10e)
    with pytest.raises(InputError, match="--friction presliding"):
        refit_specimen([(log, log.t < 1.0)], ur10e, plain)
    with pytest.raises(InputError, match="free motion"):
        refit_specimen([(log, log.t < 0.02)], ur10e, model)


def test_the_command_takes_stretches_of_several_logs(ur10e, model, tmp_path):
    model.save(tmp_path / "model.yaml")
    for name, sign in (("up.csv", 1.0), ("down.csv", -1.0)):
        write_recording(_recording(ur10e, sign, push=40.0), tmp_path / name)
    logs = [f"{tmp_path / name}=0.01,0.5,0.5,0.99" for name in ("up.csv", "down.csv")]
    settings = IdentifySettings(robot="ur10e", logs=logs, refresh=str(tmp_path / "model.yaml"))
    refit = refit_logs(settings, tmp_path / "out")
    written = IdentifiedModel.load(tmp_path / "out" / "model.yaml", ur10e)
    result = written.friction.coulomb_viscous
    np.testing.assert_array_equal(result.coulomb, refit.fit.law.coulomb)
    level = result.coulomb + 0.25 * result.viscous
    np.testing.assert_allclose(level[_MOVING], (_TRUE + 0.25 * _VISCOUS)[_MOVING], atol=0.8)
    for wrong in ("0,1,2", "1,0", "a,b", ""):
        settings.logs = [f"{tmp_path / 'up.csv'}={wrong}"]
        with pytest.raises(InputError, match="BEGIN,END"):
            refit_logs(settings, tmp_path / "wrong")


def test_samples_that_a_log_lacks_leave_the_fit_as_it_is(ur10e, model, tmp_path):
    model.save(tmp_path / "model.yaml")
    scatter = []
    for name, lost in (("whole", 0), ("gaps", 20)):
        logs = [tmp_path / f"{name}_{way}.csv" for way in ("up", "down")]
        for log, sign in zip(logs, (1.0, -1.0), strict=True):
            is_logged = np.arange(1000) % 60 >= lost
            write_recording(_recording(ur10e, sign)[np.flatnonzero(is_logged)], log)
        settings = IdentifySettings(
            robot="ur10e", logs=list(map(str, logs)), refresh=str(tmp_path / "model.yaml")
        )
        fit = refit_logs(settings, tmp_path / name).fit
        level = fit.law.coulomb_viscous.coulomb + 0.25 * fit.law.coulomb_viscous.viscous
        np.testing.assert_allclose(level[_MOVING], (_TRUE + 0.25 * _VISCOUS)[_MOVING], atol=0.15)
        scatter.append(fit.scatter[_MOVING])
    # Of 40 ms across a gap nothing is known: 14 times the scatter where it is read as one step.
    assert (scatter[1] < 2.0 * scatter[0]).all()


def test_a_log_that_contradicts_itself_is_taken_where_that_is_asked_for(ur10e, model, tmp_path):
    model.save(tmp_path / "model.yaml")
    log = _recording(ur10e, 1.0)
    write_recording(replace(log, v=0.7 * log.v), tmp_path / "log.csv")
    settings = IdentifySettings(
        robot="ur10e", logs=[str(tmp_path / "log.csv")], refresh=str(tmp_path / "model.yaml")
    )
    with pytest.raises(InputError, match="dq/dt"):
        refit_logs(settings, tmp_path / "out")
    settings.check = False
    assert refit_logs(settings, tmp_path / "out").fit.rows.any()
