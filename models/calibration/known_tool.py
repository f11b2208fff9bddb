"""Known tool: adds a tool of known mass, centre of mass and inertia to an identified model.

Rigid-body torque is linear in the inertial parameters. Those of the tool are added to the last
link's. Those of the tool with which the model was identified are subtracted. A model file states
mass and centre of mass of that tool; its inertia about its centre of mass stays on the arm.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from wrenchsight.models.calibration.load_parameters import (
    body_parameters,
    flange_map,
    tool_parameters,
)
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.fitted_robot import FittedRobot
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.robot.robot import Robot


def with_tool_of(model: IdentifiedModel, robot: Robot) -> IdentifiedModel:
    """Returns the model with its tool replaced by that of robot.yaml.

    Args:
        model: with the tool of its identification in its file; otherwise it stays as it is.
        robot: its robot, with the tool of today or without one.
    """
    fitted, tool = model.fitted_robot, robot.config.tool
    if not fitted.differs_by_tool(robot):
        return model
    change = np.zeros(10) if tool is None else tool_parameters(tool)
    if fitted.tool_mass:
        com = np.array(fitted.tool_com, float)
        change -= body_parameters(fitted.tool_mass, com, np.zeros((3, 3)))
    inertial = model.inertial_parameters.copy()
    inertial[-1] += flange_map(robot) @ change
    current = FittedRobot.of(robot)
    fitted = replace(fitted, tool_mass=current.tool_mass, tool_com=current.tool_com)
    return replace(model, inertial_parameters=inertial, fitted_robot=fitted)


def with_known_tool(
    model: IdentifiedModel, robot: Robot, source: Path, tool: bool, other_robot: bool
) -> IdentifiedModel:
    """Returns the model with the tool that the robot carries.

    Args:
        model: as its file has it, with the tool of its logs.
        robot: with the tool that robot.yaml states.
        source: the model's file, for error lines.
        tool: whether robot.yaml's tool is on the arm and known.
        other_robot: whether the model may have another tool.

    Raises:
        InputError: the model has another tool, and neither `tool` nor `other_robot` is set.
    """
    if tool:
        return with_tool_of(model, robot)
    if model.fitted_robot.differs_by_tool(robot) and not other_robot:
        raise InputError(
            source,
            "fitted_robot.tool_mass",
            model.fitted_robot.tool_difference(robot),
            "if robot.yaml's tool is on the arm and its numbers are known, pass --tool; else use "
            "the model.yaml that `wrenchsight payload` writes, or identify again; --other-robot "
            "reads its weight as a force",
        )
    return model
