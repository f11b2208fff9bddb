"""What is watched: robot and model, loaded and held against each other."""

from pathlib import Path

from wrenchsight.analyses.methods.live.watch_config import WatchSettings, checked_settings
from wrenchsight.analyses.methods.reading.estimate_config import EstimateConfig
from wrenchsight.analyses.methods.reading.known_tool import with_known_tool
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.robot.robot import Robot


def load_watched(settings: WatchSettings) -> tuple[WatchSettings, Robot, IdentifiedModel]:
    """Robot, model and the settings with what they leave open filled in.

    Raises:
        InputError: as `Robot.load`, `IdentifiedModel.load` and `checked_settings`.
    """
    if not settings.robot:
        raise InputError("watch", "--robot", "is missing", "name a bundled robot or a robot.yaml")
    robot = Robot.load(settings.robot)
    settings = checked_settings(settings, robot)
    if settings.model is None:
        robot.require_inertias("watch without --model")
        return settings, robot, IdentifiedModel.nominal(robot)
    config, path = settings.watch, Path(settings.model)
    model = IdentifiedModel.load(path, robot, config.other_robot)
    if model.torque_error is None and (config.live.track or config.live.zero_s):
        problem = "states no torque error, so that friction is not followed and nothing is zeroed"
        raise InputError(path, "", problem, "identify it again, or leave --track and --zero out")
    known = EstimateConfig(tool=config.tool, other_robot=config.other_robot)
    return settings, robot, with_known_tool(model, robot, known, path)
