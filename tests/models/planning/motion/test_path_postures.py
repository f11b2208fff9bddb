import numpy as np
import pytest

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.branches import all_branches
from wrenchsight.models.planning.motion.inverse_kinematics import follow_path
from wrenchsight.models.planning.motion.path_postures import (
    correct_paths,
    solve_poses,
    track_paths,
    wrap_within,
)
from wrenchsight.models.planning.motion.paths import StraightPath
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot

POSTURE = np.array([0.2, -0.26, -0.6, 0.3, 0.9, 0.1])


def seven_joints(sts: Robot) -> SerialChain:
    """The arm on a turntable: seven joints."""
    chain = sts.chain
    return SerialChain(
        joint_names=("turntable", *chain.joint_names),
        prismatic=np.zeros(7, dtype=bool),
        R_PJ=np.concatenate([np.eye(3)[np.newaxis], chain.R_PJ]),
        p_PJ=np.concatenate([[[0.1, 0.05, 0.0]], chain.p_PJ + [[0.15, 0.0, 0.1]] * 6]),
        axis=np.concatenate([[[0.0, 1.0, 0.0]], chain.axis]),
        inertial_parameters=np.zeros((7, 10)),
        reflected_inertia=np.zeros(7),
        gravity=np.zeros(3),
        R_LE=chain.R_LE,
        p_LE=chain.p_LE,
    )


def path_through(chain: SerialChain, q_mid: Array, n_W: Array, segments: int) -> StraightPath:
    R_WE, p_WM = chain.pose(q_mid)
    return StraightPath(n_W, p_WM, R_WE, 0.3, segments)


@pytest.mark.parametrize("segments", [2, 7, 20])
def test_paths_are_tracked_on_the_branch_of_the_midpoints_posture(
    sts: Robot, segments: int
) -> None:
    n_W = np.array([0.3, 0.9, -0.2])
    n_W /= np.linalg.norm(n_W)
    path = path_through(sts.chain, POSTURE, n_W, segments)
    q, reached = track_paths(sts.chain, POSTURE[np.newaxis], n_W[np.newaxis], 0.3, segments)
    assert reached.tolist() == [True]
    assert q.shape == (1, segments + 1, 6)
    R, p = sts.chain.pose(q[0])
    # What the kernel promises of every point.
    np.testing.assert_allclose(p, path.points(), rtol=0, atol=1e-10)
    np.testing.assert_allclose(R, np.broadcast_to(path.R_WE, R.shape), rtol=0, atol=1e-10)
    back = follow_path(sts, *path.poses(np.linspace(0.5, 0.0, 11)), POSTURE)
    s = np.linspace(0.0, 1.0, segments + 1)
    expected = follow_path(sts, *path.poses(s), back[-1])
    np.testing.assert_allclose(q[0], expected, rtol=0, atol=1e-7)


def test_a_path_that_leaves_the_workspace_or_needs_a_jump_is_not_reached(sts: Robot) -> None:
    n_W = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    q_mid = np.array([POSTURE, POSTURE])
    _, reached = track_paths(sts.chain, q_mid, n_W, 1.2, 20)
    assert not reached[0]  # the arm would have to grow
    q, reached = track_paths(sts.chain, q_mid, n_W, 0.3, 10)
    assert reached[1]
    step = float(np.max(np.abs(np.diff(q[1], axis=0))))
    _, reached = track_paths(sts.chain, q_mid[1:], n_W[1:], 0.3, 10, max_joint_step=0.99 * step)
    assert not reached[0]


def test_one_path_of_many_is_the_same_as_alone(sts: Robot) -> None:
    rng = np.random.default_rng(0)
    q_mid = POSTURE + rng.uniform(-0.2, 0.2, (50, 6))
    n_W = rng.normal(size=(50, 3))
    n_W /= np.linalg.norm(n_W, axis=1)[:, np.newaxis]
    q, reached = track_paths(sts.chain, q_mid, n_W, 0.3, 8)
    assert np.sum(reached) > 20
    alone, reached_alone = track_paths(sts.chain, q_mid[17:18], n_W[17:18], 0.3, 8)
    assert reached_alone[0] == reached[17]
    np.testing.assert_array_equal(alone[0], q[17])


def test_poses_are_found_from_far_starts(sts: Robot) -> None:
    rng = np.random.default_rng(1)
    goal = rng.uniform(-1.0, 1.0, (200, 6))
    R_WE, p_WE = sts.chain.pose(goal)
    q, reached = solve_poses(sts.chain, R_WE, p_WE, goal + rng.uniform(-0.5, 0.5, goal.shape))
    assert np.mean(reached) > 0.9
    R, p = sts.chain.pose(q[reached])
    np.testing.assert_allclose(p, p_WE[reached], rtol=0, atol=1e-9)
    np.testing.assert_allclose(R, R_WE[reached], rtol=0, atol=1e-9)


def test_poses_out_of_reach_are_not_reached(sts: Robot) -> None:
    R_WE, p_WE = sts.chain.pose(POSTURE)
    _, reached = solve_poses(
        sts.chain, R_WE[np.newaxis], 5.0 * p_WE[np.newaxis], POSTURE[np.newaxis]
    )
    assert not reached[0]


def test_correction_brings_postures_back_onto_the_path(sts: Robot) -> None:
    n_W = np.array([[0.0, 1.0, 0.0]])
    q, _ = track_paths(sts.chain, POSTURE[np.newaxis], n_W, 0.3, 10)
    R_WE, p_WM = sts.chain.pose(POSTURE[np.newaxis])
    near = q + np.random.default_rng(2).uniform(-0.02, 0.02, q.shape)
    assert correct_paths(sts.chain, near, n_W, p_WM, R_WE, 0.3).all()
    np.testing.assert_allclose(near, q, rtol=0, atol=1e-9)


def test_angles_are_wrapped_into_their_limits(sts: Robot) -> None:
    q = POSTURE + 2.0 * np.pi * np.array([1.0, -1.0, 0.0, 2.0, 0.0, -1.0])
    wrapped = wrap_within(q, sts.position_lower, sts.position_upper, sts.chain.prismatic)
    np.testing.assert_allclose(wrapped, POSTURE, atol=1e-12)
    sliding = np.array([False] * 5 + [True])
    assert wrap_within(q, sts.position_lower, sts.position_upper, sliding)[5] == q[5]


def test_every_branch_of_the_articles_initial_path_is_followed(sts: Robot) -> None:
    R_WE = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    branches = all_branches(sts, R_WE[np.newaxis], np.array([[0.5, 0.0, 0.45]]))[0]
    n_W = np.tile([0.0, 1.0, 0.0], (len(branches), 1))
    q, reached = track_paths(sts.chain, branches, n_W, 1.0, 20)
    assert len(branches) == 4
    assert reached.all()
    largest = np.sort([np.max(sts.chain.condition_number(row)) for row in q])
    np.testing.assert_allclose(largest, [59.5311, 59.5311, 59.5668, 59.5668], atol=5e-5)
