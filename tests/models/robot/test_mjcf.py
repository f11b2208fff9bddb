"""MJCF of the arms: MuJoCo and pinocchio as oracles of what is written."""

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
import pinocchio
import pytest

from wrenchsight.models.robot.mjcf import JointProperties, chain_mjcf
from wrenchsight.models.robot.robot import Robot

SAMPLES = 20
# N m, m: sums of some hundred rounded terms of up to 1e3 N m, and MuJoCo's principal axes
CLOSE = 1e-9


def _model(robot: Robot, joints: JointProperties | None = None) -> mujoco.MjModel:
    none = np.zeros(robot.num_joints)
    joints = joints or JointProperties.unlimited(none, none)
    return mujoco.MjModel.from_xml_string(chain_mjcf(robot.name, robot.chain, joints))


def _inverse_dynamics(model: mujoco.MjModel, q: np.ndarray, v: np.ndarray, a: np.ndarray):
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
    mujoco.mj_inverse(model, data)
    return data


@pytest.mark.parametrize("name", ["ur10e", "panda", "ur5e"])
def test_mujoco_computes_the_torque_and_the_tool_point_of_the_chain(name: str) -> None:
    robot = Robot.load(name)
    model, rng = _model(robot), np.random.default_rng(0)
    for q, v, a in rng.uniform(-2.0, 2.0, (SAMPLES, 3, robot.num_joints)):
        data = _inverse_dynamics(model, q, v, a)
        torque = robot.chain.inverse_dynamics(q, v, a)
        R_WE, p_WE = robot.chain.pose(q)
        np.testing.assert_allclose(data.qfrc_inverse, torque, atol=CLOSE)
        np.testing.assert_allclose(data.site("E").xpos, p_WE, atol=CLOSE)
        np.testing.assert_allclose(data.site("E").xmat.reshape(3, 3), R_WE, atol=CLOSE)


def test_mujoco_computes_the_torque_of_pinocchio_from_the_same_urdf() -> None:
    robot = Robot.load("ur10e")
    oracle = pinocchio.buildModelFromXML(robot.urdf_text)
    oracle.armature = np.array(robot.reflected_inertia)
    oracle_data, model = oracle.createData(), _model(robot)
    for q, v, a in np.random.default_rng(1).uniform(-2.0, 2.0, (SAMPLES, 3, 6)):
        data = _inverse_dynamics(model, q, v, a)
        expected = pinocchio.rnea(oracle, oracle_data, q, v, a)
        np.testing.assert_allclose(data.qfrc_inverse, expected, atol=CLOSE)


def test_prismatic_joints_and_joints_without_limits(
    serial_robot: Callable[..., Robot],
) -> None:
    robot = serial_robot([("prismatic", "0 0 1", "0 0 0"), ("continuous", "0 1 0", "0.1 0 0.2")])
    n = robot.num_joints
    joints = JointProperties(
        np.full(n, 0.5), np.full(n, 0.2), robot.position_lower, robot.position_upper, np.ones(n)
    )
    model = _model(robot, joints)
    slide, hinge = (model.joint(name) for name in robot.joint_names)
    assert slide.type == mujoco.mjtJoint.mjJNT_SLIDE
    assert hinge.type == mujoco.mjtJoint.mjJNT_HINGE
    np.testing.assert_array_equal(slide.range, [-3.0, 3.0])
    assert slide.frictionloss == 0.5
    assert slide.damping == 0.2
    assert not model.jnt_limited[hinge.id]
    np.testing.assert_array_equal(model.actuator_ctrlrange, [[-1.0, 1.0], [-1.0, 1.0]])


def test_coupled_motors_are_refused() -> None:
    robot = Robot.load("ur5e")
    coupled = replace(robot.chain, motor_rates=np.eye(6))
    none = np.zeros(6)
    with pytest.raises(ValueError, match="motors are coupled"):
        chain_mjcf("ur5e", coupled, JointProperties.unlimited(none, none))
