"""Settings of `watch`, their checks, and the robot and model that they name."""

from dataclasses import dataclass, field, replace
from pathlib import Path

from wrenchsight.analyses.methods.estimate.estimate_config import (
    EstimateConfig,
    checked_config,
    stated_prior,
)
from wrenchsight.models.calibration.known_tool import with_known_tool
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.live.live_estimator import LiveConfig
from wrenchsight.models.robot.robot import Robot

RECORDS = ("mcap", "parquet")
VIEWS = ("terminal", "lines", "meshcat", "foxglove", "none")
LONGEST_LATE, LONGEST_ZERO = 10.0, 3600.0  # s


@dataclass
class WatchConfig:
    """How a stream is read."""

    live: LiveConfig = field(default_factory=LiveConfig)
    """estimator and stream"""
    prior: str = "live"
    """prior sds of force and moment: live (half the rated payload), or two numbers in N and N m"""
    check: bool = True
    """weigh the stream against the model"""
    tool: bool = False
    """the tool in robot.yaml is on the arm and known: put it on a model that was identified with
    another one, or without"""
    other_robot: bool = False
    """read even where robot.yaml differs from that of the identification"""


@dataclass
class WatchSettings:
    """All that a run of `watch` depends on, as its config.yaml holds it."""

    command: str = "watch"
    """which wrote it"""
    source: str = ""
    """rtde://HOST[:PORT], replay://FILE, lcm://CHANNEL, ros2://TOPIC, franka://HOST"""
    robot: str = ""
    """a bundled robot's name, or the path of a robot.yaml"""
    model: str | None = None
    """model.yaml that identify wrote; else the robot's own files, and no reading is valid"""
    duration_s: float = 0.0
    """s after the first reading, when it ends; 0: when the stream does"""
    record: str | None = None
    """a new folder for what is read"""
    record_format: str = "mcap"
    """of the recording: mcap (as estimate --mcap) or parquet"""
    publish: list[str] = field(default_factory=list)
    """where readings are sent: udp://HOST:PORT, lcm://CHANNEL, ros2://TOPIC"""
    view: str = "terminal"
    """what shows readings: terminal, lines (one a second), meshcat or foxglove (arm and arrow
    besides), none"""
    watch: WatchConfig = field(default_factory=WatchConfig)
    """how"""


def checked_settings(settings: WatchSettings, robot: Robot) -> WatchSettings:
    """Returns the settings with their prior filled in: that of the rated payload, or two numbers.

    The options that `estimate` has as well are checked as there.

    Raises:
        InputError: a setting that makes no sense.
    """

    def refuse(option: str, value: object, expected: str) -> InputError:
        return InputError("watch", option, f"is {value}, expected {expected}")

    config = settings.watch
    if not 0.0 <= settings.duration_s < 1e9:
        raise refuse("duration", f"{settings.duration_s:g} s", "0 (no end) or more")
    if not 0.0 <= config.live.zero_s <= LONGEST_ZERO:
        raise refuse("zero", f"{config.live.zero_s:g} s", f"0 to {LONGEST_ZERO:g}")
    if not 0.0 < config.live.late <= LONGEST_LATE:
        raise refuse("late", f"{config.live.late:g} s", f"more than 0, at most {LONGEST_LATE:g}")
    for option, value, choices in (
        ("record_format", settings.record_format, RECORDS),
        ("view", settings.view, VIEWS),
    ):
        if value not in choices:
            raise refuse(option, f'"{value}"', " or ".join(choices))
    if config.prior == "log":
        raise refuse("prior", '"log"', "live or two numbers: a stream is not known to its end")
    # Every option that both commands have: one that is left out here goes unchecked.
    estimate_config = EstimateConfig(
        prior=config.prior,
        estimator=config.live.estimator,
        detection=config.live.detection,
        max_gap=config.live.max_gap,
        track=config.live.track,
        contact=config.live.contact,
        torque_sd=config.live.torque_sd,
    )
    checked = checked_config(estimate_config, robot)
    prior = stated_prior(checked, robot)
    assert prior is not None  # it is None of "log" alone
    estimator = checked.estimator
    reconstruction = estimator.reconstruction.with_prior(*prior)
    estimator = replace(estimator, reconstruction=reconstruction)
    live = replace(config.live, estimator=estimator)
    return replace(settings, watch=replace(config, live=live))


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
        problem = "states no torque error: friction cannot be followed, nor a payload zeroed"
        raise InputError(path, "", problem, "identify it again, or leave --track and --zero out")
    model = with_known_tool(model, robot, path, config.tool, config.other_robot)
    return settings, robot, model
