"""Arms whose joints are not where the nominal one has them."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import ToolConfig
from wrenchsight.models.robot.truth_config import KinematicsConfig, MechanismsConfig, PayloadConfig
from wrenchsight.models.truth.true_robot import plain_truth, true_robot, with_truth_named


@pytest.fixture(scope="module", params=["sts_sre4_600", "ur10e"])
def robot(request):
    return plain_truth(Robot.load(request.param))


def built(robot, **errors):
    mechanisms = MechanismsConfig(kinematics=KinematicsConfig(**errors), individual=4)
    truth = dataclasses.replace(robot.config.simulated_truth, mechanisms=mechanisms)
    return robot.with_truth(truth)


def test_without_errors_it_is_the_same_robot(robot):
    assert true_robot(robot) is robot
    same = true_robot(built(robot)).chain
    np.testing.assert_allclose(same.p_PJ, robot.chain.p_PJ, atol=1e-15)
    np.testing.assert_allclose(same.R_PJ, robot.chain.R_PJ, atol=1e-12)  # through angles and back


def test_moved_joints_are_the_nominal_ones_moved_in_their_own_axes(robot):
    rng = np.random.default_rng(5)
    n = robot.num_joints
    translation, rotation = rng.normal(0, 1e-3, (n, 3)), rng.normal(0, 0.02, (n, 3))
    moved, nominal = robot.with_moved_joints(translation, rotation).chain, robot.chain
    for i in range(n):
        R = nominal.R_PJ[i] @ Rotation.from_rotvec(rotation[i]).as_matrix()
        np.testing.assert_allclose(moved.R_PJ[i], R, atol=1e-12)
        p = nominal.p_PJ[i] + nominal.R_PJ[i] @ translation[i]
        np.testing.assert_allclose(moved.p_PJ[i], p, atol=1e-14)
    np.testing.assert_array_equal(nominal.p_PJ, robot.chain.p_PJ)


def test_the_tool_is_off_by_what_the_joints_add_up_to(robot):
    true = true_robot(built(robot, translation_sd=3e-4, rotation_sd=3e-4))
    _, p = true.chain.pose(robot.home)
    _, p_nominal = robot.chain.pose(robot.home)
    assert 1e-4 < np.linalg.norm(p - p_nominal) < 5e-3
    again = true_robot(built(robot, translation_sd=3e-4, rotation_sd=3e-4)).chain
    np.testing.assert_array_equal(again.p_PJ, true.chain.p_PJ)


def test_a_heavier_tool_is_felt_as_its_weight(robot):
    tool = robot.config.tool or ToolConfig(
        mass=2.0, com=[0.0, 0.0, 0.1], inertia=[1e-3] * 3 + [0.0] * 3
    )
    nominal = robot.with_tool(tool, robot.config.tool_frame)
    mechanisms = MechanismsConfig(payload=PayloadConfig(1.25))
    truth = dataclasses.replace(robot.config.simulated_truth, mechanisms=mechanisms)
    true = true_robot(nominal.with_truth(truth))
    without = dataclasses.replace(tool, mass=1e-6, inertia=[1e-9] * 3 + [0.0] * 3)
    bare = nominal.with_tool(without, robot.config.tool_frame).chain
    q = np.asarray(robot.home) + 0.2
    weight = nominal.chain.gravity_torque(q) - bare.gravity_torque(q)
    added_torque = true.chain.gravity_torque(q) - bare.gravity_torque(q)
    np.testing.assert_allclose(added_torque, 1.25 * weight, atol=2e-5)  # the bare one's milligram
    assert np.abs(weight).max() > 0.5


def test_bad_input(robot, tmp_path):
    with pytest.raises(InputError, match=r"kinematics\.rotation_sd"):
        true_robot(built(robot, rotation_sd=-1.0))
    truth = dataclasses.replace(
        robot.config.simulated_truth, mechanisms=MechanismsConfig(payload=PayloadConfig(-1.0))
    )
    with pytest.raises(InputError, match=r"payload\.factor"):
        true_robot(robot.with_truth(truth))
    elsewhere = Robot(robot.config, tmp_path / "robot.yaml", robot._urdf)
    (tmp_path / "plain_truth.yaml").write_text("friction: {stiction: [1.0]}")
    with pytest.raises(InputError, match=r"friction\.stiction: 1 numbers"):
        plain_truth(elsewhere)
    with pytest.raises(InputError, match="'soft', expected own, plain, hard"):
        with_truth_named(robot, "soft")


@pytest.mark.parametrize("name", ["sts_sre4_600", "ur10e", "panda"])
def test_the_plain_truth_is_dry_friction_alone(name):
    robot = Robot.load(name)
    plain = with_truth_named(robot, "plain")
    assert with_truth_named(robot, "own") is robot
    assert plain.config.simulated_truth.mechanisms is None
    assert true_robot(plain) is plain
    np.testing.assert_array_less(0.0, plain.truth.stiction)
    # Nothing that an estimator may read has changed.
    same = dataclasses.replace(plain.config, simulated_truth=robot.config.simulated_truth)
    assert same == robot.config
    if name != "panda":  # its own truth is plain
        assert true_robot(robot) is not robot


def test_the_harder_truth_is_another_of_the_same_arm():
    sts, ur10e = Robot.load("sts_sre4_600"), Robot.load("ur10e")
    hard = with_truth_named(sts, "hard")
    assert hard.config.simulated_truth.mechanisms.slip is not None
    assert hard.config.simulated_truth != sts.config.simulated_truth
    same = dataclasses.replace(hard.config, simulated_truth=sts.config.simulated_truth)
    assert same == sts.config
    assert with_truth_named(ur10e, "hard") is ur10e  # its own is as hard as logs say
