"""What a person knows beside the log: the tool on the flange."""

from pathlib import Path

from wrenchsight.analyses.methods.reading.estimate_config import EstimateConfig
from wrenchsight.models.calibration.known_tool import with_tool_of
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.robot.robot import Robot


def with_known_tool(
    model: IdentifiedModel, robot: Robot, config: EstimateConfig, source: Path
) -> IdentifiedModel:
    """Returns the model with the tool that the robot carries.

    Raises:
        InputError: the model has another tool, and it is not said what that means.
    """
    if config.tool:
        return with_tool_of(model, robot)
    if model.fitted_robot.differs_by_tool(robot) and not config.other_robot:
        raise InputError(
            source,
            "fitted_robot.tool_mass",
            model.fitted_robot.tool_difference(robot),
            "if robot.yaml's tool is on the arm and its numbers are known, say --tool; else use "
            "the model.yaml that payload writes, or identify again; --other-robot reads its "
            "weight as a force",
        )
    return model
