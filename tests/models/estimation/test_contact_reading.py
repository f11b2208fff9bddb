"""The contact reading of an arm whose contact force is known, in one piece and in parts."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchsight.models.estimation.contact_filter import ContactConfig
from wrenchsight.models.estimation.contact_reading import ContactReader
from wrenchsight.models.estimation.estimator import (
    EstimateBatch,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.presliding_friction import PreslidingFriction
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.robot.robot import Robot

_STEP = 0.002  # s
_K_0 = 20.0  # 1/s
_SD = 0.5  # N m, stated of each joint
_FORCE = 40.0  # N
_GAP = slice(600, 640)


def _log(robot: Robot, stop: float = 9.0) -> tuple[np.ndarray, ...]:
    """A slow slide until `stop` s that presses with _FORCE along tool z from 1 s on."""
    t = _STEP * np.arange(1505)
    phase = np.minimum(t, stop)[:, None] * np.array([0.5, 0.7, 0.9, 1.1, 1.3, 1.5])
    q = np.array([0.2, -1.3, 1.6, -1.9, -1.5, 0.1]) + 0.1 * np.sin(phase)
    v = np.gradient(q, _STEP, axis=0)
    vdot = np.gradient(v, _STEP, axis=0)
    R_WE, _ = robot.chain.pose(q)
    force = -np.where(t < 1.0, 0.0, _FORCE)[:, None] * R_WE[:, :, 2]
    external = np.einsum("kaj,ka->kj", robot.chain.jacobian(q)[:, 3:], force)
    tau_J = robot.chain.inverse_dynamics(q, v, vdot) - external
    return q, v, tau_J


def _friction(level: float) -> PreslidingFriction:
    zero = np.zeros(6)
    return PreslidingFriction(
        SemiParametricFriction(CoulombViscous.zero(6)),
        coulomb=np.full(6, level),
        stribeck=zero,
        stribeck_velocity=np.ones(6),
        load=zero,
        cubic=zero,
        weight=np.ones((6, 1)),
        displacement=np.full((6, 1), 1e-4),
    )


def _read(
    robot: Robot,
    parts: int,
    config: ContactConfig,
    level: float = 0.0,
    stop: float = 9.0,
    kept: np.ndarray | float = 0.0,
    gap: slice = _GAP,
) -> tuple[EstimateBatch, np.ndarray]:
    """With dry friction of that level, N m, in the model and in the arm.

    A joint of the arm keeps the share `kept` of it once it rests.
    """
    q, v, tau_J = _log(robot, stop)
    before = np.sign(v[int(stop / _STEP) - 5 if stop < _STEP * len(v) else -1])
    tau_J = tau_J + level * np.where(v == 0.0, kept * before, np.sign(v))
    observer = MomentumObserverConfig([_K_0], _STEP, "trapezoidal")
    estimator_config = WrenchEstimatorConfig(observer, check_samples=False)
    nominal = replace(
        IdentifiedModel.nominal(robot),
        residual_covariance=_SD**2 * np.eye(6),
        friction=_friction(level),
    )
    estimator = WrenchEstimator(robot, nominal, estimator_config)
    batch = estimator.run(estimator.initial_state(), q, v, robot.motor_current(tau_J))
    reader = ContactReader(robot, np.full(robot.num_joints, _K_0), _STEP, config)
    known = np.ones(len(q), bool)
    known[gap] = False
    ready = []
    for rows in np.array_split(np.arange(len(q)), parts):
        estimates = EstimateBatch._make(column[rows] for column in batch)
        ready.append(reader.take(q[rows], v[rows], tau_J[rows], known[rows], estimates))
    ready.append(reader.finish())
    whole = EstimateBatch._make(np.concatenate(columns) for columns in zip(*ready, strict=True))
    R_WE, _ = robot.chain.pose(q)
    return whole, -np.einsum("ki,ki->k", whole.wrench[:, 3:], R_WE[:, :, 2])


def test_a_pressing_force_is_read_without_the_observer_s_lag(ur10e: Robot) -> None:
    batch, force = _read(ur10e, 1, ContactConfig(axis="tool_z"))
    t = _STEP * np.arange(len(force))
    assert np.abs(force[t < 0.9]).max() < 1.0
    # The observer alone would still miss 5.4 N at its best there: 40 N exp(-K_0 0.1 s).
    assert np.abs(force[(t > 1.1) & (t < 1.15)] - _FORCE).max() < 2.5
    assert np.abs(force[t > 1.8] - _FORCE).max() < 1.5
    gap = np.zeros(len(force), bool)
    gap[_GAP] = True
    assert not batch.valid[gap].any() and not batch.valid[0]
    assert batch.valid[(t > 0.2) & (t < 0.9)].all() and batch.valid[-1]
    # A step of the force is no wander: what is read about it is not valid.
    step = (t > 0.96) & (t < 1.1)
    assert not batch.valid[step].any() and batch.valid[(t > 1.4) & ~gap][20:].all()
    assert np.linalg.eigvalsh(batch.covariance)[:, 0].min() > 0.0


@pytest.mark.parametrize("parts", [4, 40])
def test_part_by_part_is_as_one_piece(ur10e: Robot, parts: int) -> None:
    config = ContactConfig(axis="tool_z")
    whole, part = _read(ur10e, 1, config)[0], _read(ur10e, parts, config)[0]
    np.testing.assert_array_equal(part.valid, whole.valid)
    np.testing.assert_allclose(part.wrench, whole.wrench, atol=1e-9)
    np.testing.assert_allclose(part.covariance, whole.covariance, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("parts", [1, 40])
def test_a_joint_at_rest_is_expected_to_keep_the_robot_s_share(ur10e: Robot, parts: int) -> None:
    share = ur10e.rest_friction_share
    assert share.min() == 0.0 and share.max() > 0.5
    config = ContactConfig(axis="tool_z")
    _, force = _read(ur10e, parts, config, level=8.0, stop=2.0, kept=share)
    t = _STEP * np.arange(len(force))
    assert np.abs(force[(t > 1.8) & (t < 1.9)] - _FORCE).max() < 1.5
    # Measured .03 N; 1.95 N where the arm keeps nothing, 5.5 N where it keeps all.
    assert np.abs(force[t > 2.15] - _FORCE).max() < 0.2


def test_after_an_unknown_motion_a_joint_is_expected_to_keep_nothing(ur10e: Robot) -> None:
    gap = slice(980, 1020)  # it stops at sample 1,000
    config = ContactConfig(axis="tool_z")
    _, force = _read(ur10e, 1, config, level=8.0, stop=2.0, gap=gap)
    t = _STEP * np.arange(len(force))
    assert np.abs(force[t > 2.3] - _FORCE).max() < 0.2  # 1.95 N where a share is expected


def test_a_reading_that_is_too_uncertain_is_not_valid(ur10e: Robot) -> None:
    config = ContactConfig(axis="tool_z", offset_sd=500.0)
    assert not _read(ur10e, 1, config)[0].valid.any()


@pytest.mark.parametrize("moving", [1.0, 1.1])
def test_at_rest_a_joint_shows_its_torque_per_ampere_of_rest(ur10e: Robot, moving: float) -> None:
    """A robot whose drives look stronger in motion, read from the torque they show there."""
    resting = ur10e.torque_per_ampere
    robot = ur10e.with_torque_per_ampere((moving * resting).tolist(), at_rest=resting.tolist())
    q, v, tau_J = _log(ur10e, stop=2.0)
    observer = MomentumObserverConfig([_K_0], _STEP, "trapezoidal")
    model = replace(IdentifiedModel.nominal(robot), residual_covariance=_SD**2 * np.eye(6))
    model = replace(
        model,
        friction=_friction(0.0),
        inertial_parameters=moving * model.inertial_parameters,
        reflected_inertia=moving * model.reflected_inertia,
    )
    config = WrenchEstimatorConfig(observer, check_samples=False)
    estimator = WrenchEstimator(robot, model, config)
    current = ur10e.motor_current(tau_J)  # of drives as they are at rest
    batch = estimator.run(estimator.initial_state(), q, v, current)
    K_0 = np.full(robot.num_joints, _K_0)
    reader = ContactReader(robot, K_0, _STEP, ContactConfig(axis="tool_z"))
    whole = EstimateBatch.joined(
        [
            reader.take(q, v, robot.joint_torque(current), np.ones(len(q), bool), batch),
            reader.finish(),
        ]
    )
    R_WE, _ = robot.chain.pose(q)
    force = -np.einsum("ki,ki->k", whole.wrench[:, 3:], R_WE[:, :, 2])
    t = _STEP * np.arange(len(force))
    assert np.abs(force[(t > 1.8) & (t < 1.9)] - moving * _FORCE).max() < 0.5
    assert np.abs(force[t > 2.5] - _FORCE).max() < 0.5


def test_an_observer_without_a_gain_is_one_line(ur10e: Robot) -> None:
    with pytest.raises(InputError, match="--observer momentum"):
        ContactReader(ur10e, None, _STEP, ContactConfig(axis="tool_z"))
