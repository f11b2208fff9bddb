"""Arms whose joints are not where the nominal one has them."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from models.files.input_error import InputError
from models.robot.robot import Robot
from models.robot.truth_config import KinematicsConfig, MechanismsConfig
from models.truth.true_robot import hard_truth, true_robot


@pytest.fixture(scope="module", params=["sts_sre4_600", "ur10e"])
def robot(request):
    return Robot.load(request.param)


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


def test_bad_input(robot, tmp_path):
    with pytest.raises(InputError, match=r"kinematics\.rotation_sd"):
        true_robot(built(robot, rotation_sd=-1.0))
    elsewhere = Robot(robot.config, tmp_path / "robot.yaml", robot._urdf)
    with pytest.raises(InputError, match="hard_truth"):
        hard_truth(elsewhere)
