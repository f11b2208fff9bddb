import copy
from collections.abc import Callable

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.branches import all_branches
from wrenchsight.models.planning.motion.inverse_kinematics import follow_path
from wrenchsight.models.robot.robot import Robot

ARTICLE_R = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
ARTICLE_POSTURE = np.array([0.0, -0.26, -0.567, 0.0, 0.827, 0.0])


def assert_reaches(robot: Robot, q: Array, R_WE: Array, p_WE: Array) -> None:
    R, p = robot.chain.pose(q)
    # What the module promises of every solution.
    np.testing.assert_allclose(R, np.broadcast_to(R_WE, R.shape), rtol=0, atol=1e-9)
    np.testing.assert_allclose(p, np.broadcast_to(p_WE, p.shape), rtol=0, atol=1e-9)


def test_a_seed_keeps_its_turn(sts: Robot) -> None:
    q = np.array([0.3, 0.2, -0.4, 4.2, 0.9, -5.9])
    R_WE, p_WE = sts.chain.pose(q)
    np.testing.assert_allclose(follow_path(sts, R_WE, p_WE[np.newaxis], q)[0], q, atol=1e-6)


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
    q = np.random.default_rng(1).uniform(-1.0, 1.0, len(joints))
    q_path = q + np.linspace(0.0, 0.3, 20)[:, np.newaxis]
    R_WE, p_WE = robot.chain.pose(q_path)
    followed = follow_path(robot, R_WE, p_WE, q_path[0])
    assert_reaches(robot, followed, R_WE, p_WE)
    assert np.max(np.abs(np.diff(followed, axis=0))) < 0.1  # it stays on its branch


def test_joints_without_limits_turn_on_beyond_half_a_turn(sts: Robot) -> None:
    endless = copy.copy(sts)
    limits = {"position_lower": np.full(6, -np.inf), "position_upper": np.full(6, np.inf)}
    endless.__dict__.update(limits)
    q_path = ARTICLE_POSTURE + np.linspace(2.5, 4.0, 16)[:, np.newaxis] * np.eye(6)[0]
    R_WE, p_WE = sts.chain.pose(q_path)
    np.testing.assert_allclose(follow_path(endless, R_WE, p_WE, q_path[0]), q_path, atol=1e-7)


def test_a_search_that_fails_from_the_seed_goes_on_from_others(
    serial_robot: Callable[..., Robot],
) -> None:
    axes = ("0 0 1", "0 1 0", "0 0 1", "0 1 0", "0 0 1", "0 1 0", "0 0 1")
    robot = serial_robot([("revolute", axis, "0 0.05 .2") for axis in axes])
    seeds = np.random.default_rng(2).uniform(-3.0, 3.0, (40, 7))
    R_WE, p_WE = robot.chain.pose(np.full(7, 0.3))
    many = np.tile(R_WE, (40, 1, 1)), np.tile(p_WE, (40, 1))
    solutions = all_branches(robot, *many, seeds=seeds[:, np.newaxis])
    lost = np.flatnonzero(np.isnan(solutions[:, 0, 0]))
    assert 0 < len(lost) < 40
    for seed in seeds[lost[:3]]:
        assert_reaches(robot, follow_path(robot, R_WE, p_WE, seed), R_WE, p_WE)


def test_follow_path_keeps_to_the_branch_of_its_seed(sts: Robot) -> None:
    p_WE = np.array([0.5, 0.0, 0.45]) + np.linspace(0.0, 0.5, 21)[:, None] * [0.0, 1.0, 0.0]
    branches = all_branches(sts, ARTICLE_R[np.newaxis], p_WE[:1])[0]
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
    solutions = all_branches(sts, np.tile(ARTICLE_R, (len(p_WE), 1, 1)), p_WE)
    reachable = np.isfinite(solutions[..., 0]).any(axis=1).tolist()
    first = reachable.index(False)
    with pytest.raises(InputError, match=rf"path: sample {first}: sts_sre4_600 cannot reach \(0.5"):
        follow_path(sts, ARTICLE_R, p_WE, ARTICLE_POSTURE)


def test_a_jump_to_another_branch_is_an_error(sts: Robot) -> None:
    # Past the axis of joint 1 the shoulder would have to turn by half a turn at once.
    R_WE = np.diag([1.0, -1.0, -1.0])
    p_WE = np.linspace([0.3, 0.0, 0.3], [-0.3, 0.0, 0.3], 60)
    seeds = all_branches(sts, R_WE[np.newaxis], p_WE[:1])[0]
    assert len(seeds) > 0
    for seed in seeds:
        with pytest.raises(InputError, match="sample"):
            follow_path(sts, R_WE, p_WE, seed)
