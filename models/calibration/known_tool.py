"""A tool whose mass, centre of mass and inertia are known, on a model that was identified without.

Rigid-body torque is linear in the inertial parameters: the tool's are added to the last link's, and
those of the tool that the model was identified with are taken off. Of that one a model keeps mass
and centre of mass; its inertia about its own centre of mass stays on the arm.
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
    """Returns the model with the tool that robot.yaml states, in the place of the one it has.

    Args:
        model: whose file says which tool it was identified with; otherwise it stays as it is.
        robot: its robot, with the tool of today or without one.
    """
    own, tool = model.fitted_robot, robot.config.tool
    if not own.differs_by_tool(robot):
        return model
    change = np.zeros(10) if tool is None else tool_parameters(tool)
    if own.tool_mass:
        change -= body_parameters(own.tool_mass, np.array(own.tool_com, float), np.zeros((3, 3)))
    inertial = model.inertial_parameters.copy()
    inertial[-1] += flange_map(robot) @ change
    now = FittedRobot.of(robot)
    fitted = replace(own, tool_mass=now.tool_mass, tool_com=now.tool_com)
    return replace(model, inertial_parameters=inertial, fitted_robot=fitted)


def with_known_tool(
    model: IdentifiedModel, robot: Robot, source: Path, tool: bool, other_robot: bool
) -> IdentifiedModel:
    """Returns the model with the tool that the robot carries.

    Args:
        source: the model's file.
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
