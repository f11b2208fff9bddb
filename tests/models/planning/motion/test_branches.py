import math

import numpy as np
import pinocchio

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.branches import all_branches, is_closed_form
from wrenchsight.models.robot.robot import Robot


def pinocchio_poses(robot: Robot, q: Array) -> tuple[Array, Array]:
    model = pinocchio.buildModelFromXML(robot.urdf_text)
    data, frame = model.createData(), model.getFrameId("E")
    R, p = np.empty((len(q), 3, 3)), np.empty((len(q), 3))
    for i, row in enumerate(q):
        pinocchio.framesForwardKinematics(model, data, row)
        R[i], p[i] = data.oMf[frame].rotation, data.oMf[frame].translation
    return R, p


def branches_at(robot: Robot, R_WE: Array, p_WE: Array) -> Array:
    return all_branches(robot, R_WE[np.newaxis], p_WE[np.newaxis])[0]


def test_the_configuration_that_made_a_pose_is_among_its_branches(bundled_arm: Robot) -> None:
    rng = np.random.default_rng(0)
    lower = np.maximum(bundled_arm.position_lower, -3.0)
    upper = np.minimum(bundled_arm.position_upper, 3.0)
    for q in rng.uniform(lower, upper, (40, 6)):
        branches = branches_at(bundled_arm, *bundled_arm.chain.pose(q))
        assert np.all(branches >= bundled_arm.position_lower)
        assert np.all(branches <= bundled_arm.position_upper)
        turns = (branches - q) / (2 * np.pi)
        distance = np.max(np.abs(turns - np.round(turns)), axis=1) * 2 * np.pi
        # A pose that is exact to 1e-9 fixes q to that times |J^-1|; 1e-6 allows for 1000.
        assert np.min(distance) < 1e-6
        separate = np.abs(branches[:, None] - branches[None]).max(axis=2)
        assert np.all(separate[~np.eye(len(branches), dtype=bool)] > 1e-6)


def test_a_6r_arm_has_up_to_8_branches_and_the_articles_is_one(sts: Robot) -> None:
    R_WE = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    branches = branches_at(sts, R_WE, np.array([0.5, 0.0, 0.45]))
    assert 4 <= len(branches) <= 8
    # The posture is printed with three digits.
    posture = np.array([0.0, -0.26, -0.567, 0.0, 0.827, 0.0])
    assert np.min(np.max(np.abs(branches - posture), axis=1)) < 1e-3


def test_angles_are_wrapped_into_the_limits(sts: Robot) -> None:
    q = np.array([0.3, 0.2, -0.4, 4.2, 0.9, -5.9])
    shifted = q - [0, 0, 0, 2 * math.pi, 0, -2 * math.pi]  # nearest to the middle of the limits
    branches = branches_at(sts, *sts.chain.pose(q))
    assert np.min(np.max(np.abs(branches - shifted), axis=1)) < 1e-6


def test_a_wrist_singularity_is_solved(sts: Robot) -> None:
    q = np.array([0.2, 0.1, -0.3, 0.4, 0.0, 0.5])  # only the sum of joints 4 and 6 counts
    R_WE, p_WE = sts.chain.pose(q)
    branches = branches_at(sts, R_WE, p_WE)
    assert len(branches) > 0
    R, p = pinocchio_poses(sts, branches)
    np.testing.assert_allclose(p, np.tile(p_WE, (len(p), 1)), rtol=0, atol=2e-9)
    np.testing.assert_allclose(R, np.tile(R_WE, (len(R), 1, 1)), rtol=0, atol=2e-9)


def test_every_solution_reaches_its_pose(bundled_arm: Robot) -> None:
    rng = np.random.default_rng(4)
    R_WE, p_WE = bundled_arm.chain.pose(rng.uniform(-2.5, 2.5, (60, 6)))
    solutions = all_branches(bundled_arm, R_WE, p_WE)
    row, branch = np.nonzero(np.isfinite(solutions[..., 0]))
    R, p = pinocchio_poses(bundled_arm, solutions[row, branch])
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
    solutions = all_branches(bundled_arm, R_WE, p_WE)
    assert not np.any(np.isfinite(solutions[1]))
    assert all_branches(bundled_arm, R_WE[1:], p_WE[1:]).shape == (1, 0, 6)


def test_seven_joints_are_searched(seven: Robot) -> None:
    assert not is_closed_form(seven)
    rng = np.random.default_rng(5)
    q = rng.uniform(-1.5, 1.5, (30, 7))
    R_WE, p_WE = seven.chain.pose(q)
    solutions = all_branches(seven, R_WE, p_WE)
    row, branch = np.nonzero(np.isfinite(solutions[..., 0]))
    R, p = pinocchio_poses(seven, solutions[row, branch])
    np.testing.assert_allclose(p, p_WE[row], rtol=0, atol=2e-9)
    np.testing.assert_allclose(R, R_WE[row], rtol=0, atol=2e-9)
    assert np.all(solutions[row, branch] >= -3.0) and np.all(solutions[row, branch] <= 3.0)
    assert len(set(row.tolist())) == 30  # of these poses, none is missed
    # Started at a solution, the search stays there.
    again = all_branches(seven, R_WE, p_WE, seeds=q[:, np.newaxis])
    np.testing.assert_allclose(again[:, 0], q, rtol=0, atol=1e-12)
