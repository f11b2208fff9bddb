import math

import numpy as np
import pinocchio

from wrenchsight.models.arrays import Array
from wrenchsight.models.motion.branches import all_branches, is_closed_form
from wrenchsight.models.motion.inverse_kinematics import inverse_kinematics
from wrenchsight.models.robot.robot import Robot


def pinocchio_poses(robot: Robot, q: Array) -> tuple[Array, Array]:
    model = pinocchio.buildModelFromXML(robot.urdf_text)
    data, frame = model.createData(), model.getFrameId("E")
    R, p = np.empty((len(q), 3, 3)), np.empty((len(q), 3))
    for i, row in enumerate(q):
        pinocchio.framesForwardKinematics(model, data, row)
        R[i], p[i] = data.oMf[frame].rotation, data.oMf[frame].translation
    return R, p


def test_all_branches_are_those_found_pose_by_pose(bundled_arm: Robot) -> None:
    rng = np.random.default_rng(3)
    R_WE, p_WE = bundled_arm.chain.pose(rng.uniform(-2.0, 2.0, (25, 6)))
    found = all_branches(bundled_arm, R_WE, p_WE)
    for i in range(len(p_WE)):
        expected = inverse_kinematics(bundled_arm, R_WE[i], p_WE[i])
        here = found[i][np.isfinite(found[i, :, 0])]
        distance = np.abs(expected[:, np.newaxis] - here).max(axis=2)
        # Both hold the pose to 1e-9; 1e-6 allows for a |J^-1| of 1000.
        assert np.all(np.min(distance, axis=1) < 1e-6)
        assert np.all(np.min(distance, axis=0) < 1e-6)


def test_every_solution_reaches_its_pose(bundled_arm: Robot) -> None:
    rng = np.random.default_rng(4)
    R_WE, p_WE = bundled_arm.chain.pose(rng.uniform(-2.5, 2.5, (60, 6)))
    found = all_branches(bundled_arm, R_WE, p_WE)
    row, branch = np.nonzero(np.isfinite(found[..., 0]))
    R, p = pinocchio_poses(bundled_arm, found[row, branch])
    np.testing.assert_allclose(p, p_WE[row], rtol=0, atol=2e-9)
    np.testing.assert_allclose(R, R_WE[row], rtol=0, atol=2e-9)


def test_whole_turns_within_the_limits_are_solutions_of_their_own(sts: Robot) -> None:
    q = np.array([0.3, 0.2, -0.4, 2.0, 0.7, 0.1])
    R_WE, p_WE = sts.chain.pose(q)
    joint_4 = np.array([False, False, False, True, False, False])
    plain = all_branches(sts, R_WE, p_WE)[0]
    every = all_branches(sts, R_WE, p_WE, turns_of=joint_4)[0]
    turned = q - 2.0 * math.pi * joint_4
    assert np.min(np.abs(every - q).max(axis=1)) < 1e-8
    assert np.min(np.abs(every - turned).max(axis=1)) < 1e-8
    assert np.min(np.abs(plain - turned).max(axis=1)) > 1.0
    assert np.all(every >= sts.position_lower) and np.all(every <= sts.position_upper)


def test_an_unreachable_pose_has_no_solution(bundled_arm: Robot) -> None:
    q = np.zeros((1, 6))
    R_WE, p_WE = bundled_arm.chain.pose(np.concatenate([q, q]))
    p_WE[1] = [5.0, 0.0, 0.0]
    found = all_branches(bundled_arm, R_WE, p_WE)
    assert not np.any(np.isfinite(found[1]))
    assert all_branches(bundled_arm, R_WE[1:], p_WE[1:]).shape == (1, 0, 6)


def test_seven_joints_are_searched(seven: Robot) -> None:
    assert not is_closed_form(seven)
    rng = np.random.default_rng(5)
    q = rng.uniform(-1.5, 1.5, (30, 7))
    R_WE, p_WE = seven.chain.pose(q)
    found = all_branches(seven, R_WE, p_WE)
    row, branch = np.nonzero(np.isfinite(found[..., 0]))
    R, p = pinocchio_poses(seven, found[row, branch])
    np.testing.assert_allclose(p, p_WE[row], rtol=0, atol=2e-9)
    np.testing.assert_allclose(R, R_WE[row], rtol=0, atol=2e-9)
    assert np.all(found[row, branch] >= -3.0) and np.all(found[row, branch] <= 3.0)
    assert len(set(row.tolist())) == 30  # of these poses, none is missed
    # Started at a solution, the search stays there.
    again = all_branches(seven, R_WE, p_WE, seeds=q[:, np.newaxis])
    np.testing.assert_allclose(again[:, 0], q, rtol=0, atol=1e-12)
