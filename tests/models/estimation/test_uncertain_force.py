"""Why the force is too uncertain, and which joint counts most."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import null_space

from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.uncertain_force import UncertainForce
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.robot.robot import Robot


@pytest.fixture(scope="module")
def robot():
    return Robot.load("sts_sre4_600")


def judged(robot, sd, max_force_sd=None):
    """The verdict at home, and what the estimator reads there once it has settled."""
    model = IdentifiedModel.nominal(robot)
    model = replace(model, residual_covariance=np.diag(np.square(sd)))
    config = WrenchEstimatorConfig()
    config.observer.time_step = 1e-3
    config.reconstruction.max_force_sd = max_force_sd
    estimator = WrenchEstimator(robot, model, config)
    q = np.tile(robot.home, (200, 1))
    batch = estimator.run(estimator.initial_state(), q, np.zeros_like(q), np.zeros_like(q))
    return UncertainForce.of(estimator, batch.J[5:], batch.torque_sd[5:]), batch


def test_the_sd_is_the_estimators_and_valid_ends_at_the_limit(robot):
    sd = [3.0, 2.5, 1.5, 0.3, 0.5, 0.2]
    judgement, batch = judged(robot, sd)
    # By the same formula, inverted instead of factorised; the prior is the live one.
    assert judgement.sd == pytest.approx(stated(batch), rel=1e-9)
    assert judged(robot, sd, 1.01 * judgement.sd)[1].valid[-1]
    assert not judged(robot, sd, 0.99 * judgement.sd)[1].valid[-1]
    assert judged(robot, sd, 12.0)[0].limit == 12.0


def stated(batch):
    return np.sqrt(np.linalg.eigvalsh(batch.covariance[-1, 3:, 3:])[-1])


def test_the_joint_that_counts_most_is_named_with_the_remedy(robot):
    sd = np.array([30.0, 25.0, 15.0, 3.0, 5.0, 2.0])
    judgement, _ = judged(robot, sd)
    # By what the estimator states where one joint after the other is ten times better.
    better = [stated(judged(robot, sd / np.where(np.arange(6) == j, 10, 1))[1]) for j in range(6)]
    worst = int(np.argmin(better))
    assert judgement.joint == robot.joint_names[worst]
    message = judgement.sentence(0.0)
    assert message.startswith("no reading is valid: the force's sd is ")
    assert "payload 4 kg in robot.yaml" in message
    assert (
        f"of {judgement.joint}, {sd[worst]:g} N m, counts most; it is assumed: pass --model"
        in message
    )
    fitted = replace(judgement, assumed=False).sentence(0.2)
    assert fitted.startswith("20 % of readings are valid")
    assert "--max-force-sd" in fitted


def test_the_payload_that_would_be_enough_is_said(robot):
    sd = np.array([30.0, 25.0, 15.0, 3.0, 5.0, 2.0])
    judgement, _ = judged(robot, sd, None)
    fitted = replace(judgement, assumed=False)
    payload = judgement.enough_payload
    assert f"rated payload is {payload:.2g} kg or more" in fitted.sentence(0.0)
    # With it the limit, a sixth of its weight, is above the sd, and not far.
    stronger = replace(robot.config, payload=payload)
    heavy = Robot(stronger, robot.source, robot._urdf)
    assert 0.8 < judged(heavy, sd, None)[0].sd / (9.81 * payload / 6.0) < 1.0
    # An error that only another arm could have is no matter of the payload.
    assert "rated payload" not in judged(robot, 100.0 * sd)[0].sentence(0.0)


def test_a_force_that_no_joint_feels_has_the_prior_alone(robot):
    """As of an arm of two joints: what they do not feel must not be lost to rounding."""
    estimator = WrenchEstimator(robot, IdentifiedModel.nominal(robot))
    J = np.zeros((5, 6, 6))
    J[:, :, :2] = 1e3 * np.random.default_rng(0).normal(size=(6, 2))
    judgement = UncertainForce.of(estimator, J, np.full((5, 6), 1e-3))
    _, _, force_sd, moment_sd = estimator.reading.reconstruction.limits
    # Torques without an error leave what they do not feel, N, to the prior: N (N^T P N)^-1 N^T.
    N = null_space(J[0, :, :2].T)
    P = np.diag([moment_sd**-2.0] * 3 + [force_sd**-2.0] * 3)
    left = N @ np.linalg.inv(N.T @ P @ N) @ N.T
    expected = np.sqrt(np.linalg.eigvalsh(left[3:, 3:])[-1])
    assert judgement.sd == pytest.approx(expected, rel=1e-3)  # of 1e-6 N of the torques' error
    assert np.isfinite(judgement.enough_payload)
    assert judgement.is_unfelt


def test_the_direction_of_a_force_that_no_joint_feels_is_named(robot):
    """Not a joint's torque error, which would change nothing."""
    estimator = WrenchEstimator(robot, IdentifiedModel.nominal(robot))
    J = np.random.default_rng(0).normal(size=(50, 6, 6))
    judgement = UncertainForce.of(estimator, J, np.full((50, 6), 0.1))
    assert not judgement.is_unfelt
    J[:, 4] = 0.0  # as of a lift with an arm along x
    sentence = UncertainForce.of(estimator, J, np.full((50, 6), 0.1)).sentence(0.0)
    assert sentence.startswith("no reading is valid: no joint feels a force at E along (0, 1, 0)")
    assert "counts most" not in sentence
    # As of an arm that turns: in each posture there is one, but never the same.
    J[25:] = np.random.default_rng(1).normal(size=(25, 6, 6))
    J[25:, 3] = 0.0
    turning = UncertainForce.of(estimator, J, np.full((50, 6), 0.1))
    assert "along a direction that turns with the arm, and its sd" in turning.sentence(0.0)


def test_a_joint_without_an_error_to_speak_of_is_judged(robot):
    judgement, _ = judged(robot, [3.0, 2.5, 1.5, 1e-100, 0.5, 0.2])
    assert np.isfinite(judgement.sd)


def test_a_force_that_the_joints_feel_as_a_moment_is_no_joints_torque_error(robot):
    """Behind a lift, a wrist's joints turn E in place: a force across them has a lever of 4 mm."""
    estimator = WrenchEstimator(robot, IdentifiedModel.nominal(robot))
    J = np.zeros((20, 6, 6))
    J[:, 5, 0] = 1.0  # the lift, along z
    J[:, :3, 1:4] = np.eye(3)  # a spherical wrist
    J[:, 4, 3] = 0.004  # a lever along x
    J[:, 3, 1] = 0.05  # z of a wrist's joint: along x it feels a force well enough
    sd = np.full((20, 6), 1e-3)
    judgement = UncertainForce.of(estimator, J, sd)
    assert judgement.is_unfelt
    assert judgement.is_like_moment
    assert "as a small moment there does" in judgement.sentence(0.0)
    assert "counts most" not in judgement.sentence(0.0)
