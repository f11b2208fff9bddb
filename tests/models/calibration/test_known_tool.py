"""A model with a tool put on it, against the robot whose plant carries that tool."""

from dataclasses import replace

import numpy as np

from wrenchsight.models.calibration.known_tool import with_tool_of
from wrenchsight.models.identification.fitted_robot import FittedRobot
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import PoseConfig, ToolConfig

_TOOL = ToolConfig(
    mass=6.86, com=[0.01, -0.02, 0.15], inertia=[0.05, 0.06, 0.02, 0.001, -0.002, 0.003]
)
_FRAME = PoseConfig([0.07, -0.04, 0.26], [0.0, 0.1, -0.5])


def _torque(model: IdentifiedModel, robot: Robot) -> np.ndarray:
    rng = np.random.default_rng(4)
    q, v, vdot = rng.uniform(-1.5, 1.5, (3, 20, robot.num_joints))
    return np.asarray(model.chain(robot).inverse_dynamics(q, v, vdot))


def test_the_tool_s_torque_is_added(ur10e):
    tooled = ur10e.with_tool(_TOOL, _FRAME)
    bare = replace(IdentifiedModel.nominal(ur10e), fitted_robot=FittedRobot.of(ur10e))
    with_tool = with_tool_of(bare, tooled)
    oracle = IdentifiedModel.nominal(tooled)  # Drake's plant adds the tool's body
    np.testing.assert_allclose(_torque(with_tool, tooled), _torque(oracle, tooled), atol=1e-10)
    assert not with_tool.fitted_robot.differs_by_tool(tooled)
    assert np.abs(_torque(bare, tooled) - _torque(oracle, tooled)).max() > 10.0


def test_the_tool_that_the_model_had_is_taken_off(ur10e):
    point = ToolConfig(mass=2.0, com=[0.0, 0.05, 0.1], inertia=[1e-9, 1e-9, 1e-9, 0.0, 0.0, 0.0])
    old_robot, new_robot = ur10e.with_tool(point, PoseConfig()), ur10e.with_tool(_TOOL, _FRAME)
    model = replace(IdentifiedModel.nominal(old_robot), fitted_robot=FittedRobot.of(old_robot))
    oracle = _torque(IdentifiedModel.nominal(new_robot), new_robot)
    np.testing.assert_allclose(
        _torque(with_tool_of(model, new_robot), new_robot), oracle, atol=1e-8
    )
    assert with_tool_of(model, old_robot) is model
