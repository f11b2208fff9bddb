import math
from pathlib import Path

import numpy as np
import pinocchio
import pytest
import yaml
from numpy.typing import NDArray

from models.motion.branches import all_branches, is_closed_form
from models.motion.inverse_kinematics import inverse_kinematics
from models.robot.robot import Robot

Array = NDArray[np.float64]


@pytest.fixture(scope="module", params=["sts_sre4_600", "ur10e"])
def arm(request: pytest.FixtureRequest) -> Robot:
    return Robot.load(request.param)


@pytest.fixture(scope="module")
def seven(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """A seven-joint arm: shoulder, elbow and wrist of three, one and three axes, 3 rad each way."""
    folder = tmp_path_factory.mktemp("seven")
    joints = [
        ("0 0 1", "0 0 0.3"),
        ("0 1 0", "0 0 0"),
        ("0 0 1", "0 0 0"),
        ("0 1 0", "0 0 0.4"),
        ("0 0 1", "0 0 0.35"),
        ("0 1 0", "0 0 0"),
        ("0 0 1", "0.05 0 0"),
    ]
    parts = ['<robot name="seven"><link name="l0"/>']
    for i, (axis, xyz) in enumerate(joints):
        parts.append(
            f'<link name="l{i + 1}"><inertial><mass value="1"/><inertia ixx=".01" iyy=".01" '
            'izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/>'
            f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>'
            '<limit lower="-3" upper="3" velocity="1" effort="10"/></joint>'
        )
    (folder / "robot.urdf").write_text("".join(parts) + "</robot>")
    config = {
        "name": "seven",
        "urdf": "robot.urdf",
        "base_link": "l0",
        "flange": "l7",
        "payload": 1.0,
        "tool_frame": {"xyz": [0.0, 0.0, 0.15]},
        "home": [0.1, 0.6, 0.1, 1.2, 0.1, 0.8, 0.1],
        "drives": [
            {"joint": f"j{i}", "torque_per_ampere": 1.0, "rotor_inertia": 0.0} for i in range(7)
        ],
    }
    path = Path(folder / "robot.yaml")
    path.write_text(yaml.safe_dump(config))
    return Robot.load(path)


def pinocchio_poses(robot: Robot, q: Array) -> tuple[Array, Array]:
    model = pinocchio.buildModelFromXML(robot.urdf_text)
    data, frame = model.createData(), model.getFrameId("E")
    R, p = np.empty((len(q), 3, 3)), np.empty((len(q), 3))
    for i, row in enumerate(q):
        pinocchio.framesForwardKinematics(model, data, row)
        R[i], p[i] = data.oMf[frame].rotation, data.oMf[frame].translation
    return R, p


def test_all_branches_are_those_found_pose_by_pose(arm: Robot) -> None:
    rng = np.random.default_rng(3)
    R_WE, p_WE = arm.chain.pose(rng.uniform(-2.0, 2.0, (25, 6)))
    found = all_branches(arm, R_WE, p_WE)
    for i in range(len(p_WE)):
        expected = inverse_kinematics(arm, R_WE[i], p_WE[i])
        here = found[i][np.isfinite(found[i, :, 0])]
        distance = np.abs(expected[:, np.newaxis] - here).max(axis=2)
        # Both hold the pose to 1e-9; 1e-6 allows for a |J^-1| of 1000.
        assert np.all(np.min(distance, axis=1) < 1e-6)
        assert np.all(np.min(distance, axis=0) < 1e-6)


def test_every_solution_reaches_its_pose(arm: Robot) -> None:
    rng = np.random.default_rng(4)
    R_WE, p_WE = arm.chain.pose(rng.uniform(-2.5, 2.5, (60, 6)))
    found = all_branches(arm, R_WE, p_WE)
    row, branch = np.nonzero(np.isfinite(found[..., 0]))
    R, p = pinocchio_poses(arm, found[row, branch])
    np.testing.assert_allclose(p, p_WE[row], rtol=0, atol=2e-9)
    np.testing.assert_allclose(R, R_WE[row], rtol=0, atol=2e-9)


def test_whole_turns_within_the_limits_are_solutions_of_their_own() -> None:
    arm = Robot.load("sts_sre4_600")  # joint 4 has 4.71 rad to either side
    q = np.array([0.3, 0.2, -0.4, 2.0, 0.7, 0.1])
    R_WE, p_WE = arm.chain.pose(q)
    joint_4 = np.array([False, False, False, True, False, False])
    plain = all_branches(arm, R_WE, p_WE)[0]
    every = all_branches(arm, R_WE, p_WE, turns_of=joint_4)[0]
    turned = q - 2.0 * math.pi * joint_4
    assert np.min(np.abs(every - q).max(axis=1)) < 1e-8
    assert np.min(np.abs(every - turned).max(axis=1)) < 1e-8
    assert np.min(np.abs(plain - turned).max(axis=1)) > 1.0
    assert np.all(every >= arm.position_lower) and np.all(every <= arm.position_upper)


def test_an_unreachable_pose_has_no_solution(arm: Robot) -> None:
    q = np.zeros((1, 6))
    R_WE, p_WE = arm.chain.pose(np.concatenate([q, q]))
    p_WE[1] = [5.0, 0.0, 0.0]
    found = all_branches(arm, R_WE, p_WE)
    assert not np.any(np.isfinite(found[1]))
    assert all_branches(arm, R_WE[1:], p_WE[1:]).shape == (1, 0, 6)


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
