import math
from collections.abc import Callable

import numpy as np
import pytest

from wrenchsight.models.arrays import Array
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.motion.inverse_kinematics import follow_path, inverse_kinematics
from wrenchsight.models.robot.robot import Robot

ARTICLE_R = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
ARTICLE_POSTURE = np.array([0.0, -0.26, -0.567, 0.0, 0.827, 0.0])


def assert_reaches(robot: Robot, q: Array, R_WE: Array, p_WE: Array) -> None:
    R, p = robot.chain.pose(q)
    # What the module promises of every solution.
    np.testing.assert_allclose(R, np.broadcast_to(R_WE, R.shape), rtol=0, atol=1e-9)
    np.testing.assert_allclose(p, np.broadcast_to(p_WE, p.shape), rtol=0, atol=1e-9)


def test_the_configuration_that_made_a_pose_is_among_its_branches(bundled_arm: Robot) -> None:
    rng = np.random.default_rng(0)
    lower, upper = (
        np.maximum(bundled_arm.position_lower, -3.0),
        np.minimum(bundled_arm.position_upper, 3.0),
    )
    for q in rng.uniform(lower, upper, (40, 6)):
        R_WE, p_WE = bundled_arm.chain.pose(q)
        branches = inverse_kinematics(bundled_arm, R_WE, p_WE)
        assert_reaches(bundled_arm, branches, R_WE, p_WE)
        assert np.all(branches >= bundled_arm.position_lower)
        assert np.all(branches <= bundled_arm.position_upper)
        turns = (branches - q) / (2 * np.pi)
        distance = np.max(np.abs(turns - np.round(turns)), axis=1) * 2 * np.pi
        # A pose that is exact to 1e-9 fixes q to that times |J^-1|; 1e-6 allows for 1000.
        assert np.min(distance) < 1e-6
        separate = np.abs(branches[:, None] - branches[None]).max(axis=2)
        assert np.all(separate[~np.eye(len(branches), dtype=bool)] > 1e-6)


def test_a_6r_arm_has_up_to_8_branches_and_the_articles_is_one(sts: Robot) -> None:
    branches = inverse_kinematics(sts, ARTICLE_R, np.array([0.5, 0.0, 0.45]))
    assert 4 <= len(branches) <= 8
    # The posture is printed with three digits.
    assert np.min(np.max(np.abs(branches - ARTICLE_POSTURE), axis=1)) < 1e-3


def test_angles_are_wrapped_into_the_limits(sts: Robot) -> None:
    q = np.array([0.3, 0.2, -0.4, 4.2, 0.9, -5.9])
    R_WE, p_WE = sts.chain.pose(q)
    branches = inverse_kinematics(sts, R_WE, p_WE)
    shifted = q - [0, 0, 0, 2 * math.pi, 0, -2 * math.pi]  # nearest to the middle of the limits
    assert np.min(np.max(np.abs(branches - shifted), axis=1)) < 1e-6
    followed = follow_path(sts, R_WE, p_WE[np.newaxis], q)  # but a seed keeps its turn
    np.testing.assert_allclose(followed[0], q, atol=1e-6)


def test_out_of_reach_has_no_branch(bundled_arm: Robot) -> None:
    assert inverse_kinematics(bundled_arm, np.eye(3), np.array([3.0, 0.0, 0.0])).shape == (0, 6)


def test_a_wrist_singularity_is_solved(sts: Robot) -> None:
    q = np.array([0.2, 0.1, -0.3, 0.4, 0.0, 0.5])  # only the sum of joints 4 and 6 counts
    R_WE, p_WE = sts.chain.pose(q)
    branches = inverse_kinematics(sts, R_WE, p_WE)
    assert len(branches) > 0
    assert_reaches(sts, branches, R_WE, p_WE)


@pytest.mark.parametrize(
    "joints",
    [
        [("revolute", axis, "0 0.05 .2") for axis in ("0 0 1", "0 1 0", "0 0 1", "0 1 0") * 2][:7],
        [
            ("prismatic", "1 0 0", "0 0 0"),
            ("prismatic", "0 1 0", "0 0 0"),
            ("prismatic", "0 0 1", "0 0 0"),
            ("revolute", "0 0 1", "0 0 0.1"),
            ("revolute", "0 1 0", "0 0 0.1"),
            ("revolute", "1 0 0", "0 0 0.1"),
        ],
    ],
    ids=["seven joints", "prismatic"],
)
def test_other_arms_are_solved_numerically(
    serial_robot: Callable[..., Robot], joints: list[tuple[str, str, str]]
) -> None:
    robot = serial_robot(joints)
    rng = np.random.default_rng(1)
    for q in rng.uniform(-1.0, 1.0, (5, len(joints))):
        R_WE, p_WE = robot.chain.pose(q)
        branches = inverse_kinematics(robot, R_WE, p_WE)
        assert len(branches) > 0
        assert_reaches(robot, branches, R_WE, p_WE)
        assert np.all(np.abs(branches) <= 3.0)
    q_path = q + np.linspace(0.0, 0.3, 20)[:, np.newaxis]
    R_WE, p_WE = robot.chain.pose(q_path)
    followed = follow_path(robot, R_WE, p_WE, q_path[0])
    assert_reaches(robot, followed, R_WE, p_WE)
    assert np.max(np.abs(np.diff(followed, axis=0))) < 0.1  # it stays on its branch


def test_follow_path_keeps_to_the_branch_of_its_seed(sts: Robot) -> None:
    p_WE = np.array([0.5, 0.0, 0.45]) + np.linspace(0.0, 0.5, 21)[:, None] * [0.0, 1.0, 0.0]
    branches = inverse_kinematics(sts, ARTICLE_R, p_WE[0])
    ends = []
    for branch in branches:
        q = follow_path(sts, ARTICLE_R, p_WE, branch)
        assert_reaches(sts, q, ARTICLE_R, p_WE)
        # A quarter of the step: the path is smooth, so halving it halves the steps.
        coarse = np.max(np.abs(np.diff(q, axis=0)))
        fine_p = p_WE[0] + np.linspace(0.0, 0.5, 81)[:, None] * [0.0, 1.0, 0.0]
        fine_q = follow_path(sts, ARTICLE_R, fine_p, branch)
        assert np.max(np.abs(np.diff(fine_q, axis=0))) < 0.5 * coarse
        np.testing.assert_allclose(fine_q[::4], q, atol=1e-8)
        ends.append(q[-1])
    separate = np.abs(np.array(ends)[:, None] - np.array(ends)[None]).max(axis=2)
    assert np.all(separate[~np.eye(len(ends), dtype=bool)] > 1e-3)


def test_follow_path_is_the_same_however_far_apart_the_samples_are(sts: Robot) -> None:
    ends = np.array([[0.5, -0.5, 0.45], [0.5, 0.5, 0.45]])
    start = follow_path(
        sts, ARTICLE_R, np.linspace([0.5, 0.0, 0.45], ends[0], 30), ARTICLE_POSTURE
    )[-1]
    two = follow_path(sts, ARTICLE_R, ends, start)
    many = follow_path(sts, ARTICLE_R, np.linspace(*ends, 101), start)
    np.testing.assert_allclose(two[-1], many[-1], atol=1e-8)


def test_follow_path_turns_the_tool_too(sts: Robot) -> None:
    q_path = ARTICLE_POSTURE + np.linspace(0.0, 1.0, 9)[:, None] * [0.1, 0.2, -0.3, 0.8, 0.4, 1.5]
    R_WE, p_WE = sts.chain.pose(q_path)
    np.testing.assert_allclose(follow_path(sts, R_WE, p_WE, q_path[0]), q_path, atol=1e-7)


def test_the_first_sample_out_of_reach_is_named(sts: Robot) -> None:
    p_WE = np.array([0.5, 0.0, 0.45]) + np.linspace(0.0, 1.0, 11)[:, None] * [0.0, 1.0, 0.0]
    reachable = [len(inverse_kinematics(sts, ARTICLE_R, p)) > 0 for p in p_WE]
    first = reachable.index(False)
    with pytest.raises(InputError, match=rf"path: sample {first}: sts_sre4_600 cannot reach \(0.5"):
        follow_path(sts, ARTICLE_R, p_WE, ARTICLE_POSTURE)


def test_a_jump_to_another_branch_is_an_error(sts: Robot) -> None:
    # Past the axis of joint 1 the shoulder would have to turn by half a turn at once.
    R_WE = np.diag([1.0, -1.0, -1.0])
    p_WE = np.linspace([0.3, 0.0, 0.3], [-0.3, 0.0, 0.3], 60)
    seeds = inverse_kinematics(sts, R_WE, p_WE[0])
    assert len(seeds) > 0
    for seed in seeds:
        with pytest.raises(InputError, match="sample"):
            follow_path(sts, R_WE, p_WE, seed)
