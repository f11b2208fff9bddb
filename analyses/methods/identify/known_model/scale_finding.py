"""In which unit is a robot's effort, and with which sign? Torque per unit from known weights."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from wrenchsight.analyses.methods.identify.identification_config import IdentifySettings
from wrenchsight.analyses.methods.identify.known_model.load_calibration import known_load
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.models.calibration.effort_scale import (
    DETERMINED,
    EffortScale,
    scale_from_gravity,
    scale_from_weight,
)
from wrenchsight.models.calibration.load_parameters import body_parameters
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.lerobot.data_set import episode_paths
from wrenchsight.models.recordings.log_words import IN_AMPERES, log_words
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import RecordingReader, read_recording
from wrenchsight.models.robot.robot import Robot

ProgressCallback = Callable[[float, str], None]


@dataclass(frozen=True, eq=False)
class ScaleResult:
    """What was found, and the robot with it.

    Attributes:
        robot: with the torques per unit of the joints that gravity shows; the others' as stated.
        of_torque: whether the logs state torques (tau1..): then the scale is a factor of these,
            which a description takes as `gain`, and the robot stays as it is.
    """

    scale: EffortScale
    robot: Robot
    stated: Array
    of_torque: bool
    notices: tuple[str, ...]

    def metrics(self) -> dict[str, Any]:
        """All figures, as written to metrics.json."""
        found = self.scale
        return {
            "torque_per_unit_nm": found.torque_per_unit,
            "standard_error_nm": found.standard_error,
            "stated_nm": self.stated,
            "known_torque_sd_nm": found.gravity,
            "seen": found.is_determined,
            "rows": found.count,
            "of_torque": self.of_torque,
        }


def find_scale(
    settings: IdentifySettings, out: Path, progress: ProgressCallback = lambda share, what: None
) -> ScaleResult:
    """The command `identify --scale`: writes robot.yaml and metrics.json into `out`.

    Args:
        settings: the logs, and with `load` one of a known weight.

    Raises:
        InputError: as `Robot.load`, `read_recording`, `result_folder`, `scale_from_gravity` and
            `scale_from_weight`.
    """
    with result_folder(out, "identify") as folder:
        robot = Robot.load(settings.robot)
        logs = [Path(log) for log in settings.logs]
        progress(0.1, "reading")
        recordings = _read(logs, settings, robot)
        laden, parameters = [], np.zeros(10)
        for text in settings.load:
            path, load = known_load(text)
            com = np.zeros(3) if load.com is None else np.array(load.com)
            parameters = body_parameters(load.mass, com, np.zeros((3, 3)))
            laden += _read([path], settings, robot)
        of_torque = {one.tau_J is not None for one in (*recordings, *laden)}
        if len(of_torque) > 1:
            problem = "some logs hold currents and some torques"
            raise InputError("identify", "--scale", problem, "give logs of one kind")
        progress(0.5, "comparing with gravity")
        if len(settings.load) > 1:
            raise InputError("identify", "--load", "one weight is enough", "give one with --scale")
        scale = (
            scale_from_weight(recordings, laden, robot, parameters)
            if laden
            else scale_from_gravity(recordings, robot)
        )
        torque = of_torque == {True}
        stated = np.ones(robot.num_joints) if torque else robot.torque_per_ampere
        stated = stated * (1.0 if torque else robot.current_sign)
        result = ScaleResult(
            scale,
            robot if torque else _with_scale(robot, scale),
            np.asarray(stated),
            torque,
            tuple(dict.fromkeys(text for one in (*recordings, *laden) for text in one.notices)),
        )
        result.robot.save(folder / "robot.yaml")
        folder.write_settings("config.yaml", settings)
        folder.write_json("metrics.json", result.metrics())
    return result


def sentences(result: ScaleResult, by_weight: bool) -> list[str]:
    """What a person should know of the result, one sentence each."""
    names = np.array(result.robot.joint_names)
    hidden = ", ".join(names[~result.scale.is_determined])
    said = []
    if hidden:
        what = "the weight" if by_weight else "gravity"
        said.append(
            f"{what} does not show {hidden} to {100 * DETERMINED:.0f} %: kept as stated; the "
            "drive's data sheet has it, or a weight on a lever across that axis: "
            "--load LOG=KG,X,Y,Z"
        )
    if by_weight:
        said.append(
            "a joint at rest may hold part of the weight by stiction, which the standard error of "
            "few postures does not show: come to each posture from both sides"
        )
    else:
        said.append(
            "the standard errors hold for the masses of the URDF: where these are 10 % off, so is "
            "the scale; one known weight tells: --scale --load LOG=KG"
        )
    if result.of_torque:
        gains = ", ".join(f"{value:.4g}" for value in _or_stated(result))
        said.append(f"the logs hold torques: describe them with motor_torque: {{gain: [{gains}]}}")
    return said


def _or_stated(result: ScaleResult) -> Array:
    return np.where(result.scale.is_determined, result.scale.torque_per_unit, result.stated)


def _with_scale(robot: Robot, scale: EffortScale) -> Robot:
    found = dict(zip(robot.joint_names, scale.torque_per_unit, strict=True))
    seen = dict(zip(robot.joint_names, scale.is_determined, strict=True))
    drives = [
        replace(
            drive,
            torque_per_ampere=abs(float(found[drive.joint])),
            torque_constant=None,
            current_sign=1 if found[drive.joint] > 0.0 else -1,
        )
        if seen[drive.joint]
        else drive
        for drive in robot.config.drives
    ]
    return robot.with_drives(drives)


def _read(paths: list[Path], settings: IdentifySettings, robot: Robot) -> list[Recording]:
    """Logs as they are: what their numbers mean is the question, so that none is refused for it."""
    found = []
    for path in (episode for one in paths for episode in episode_paths(one)):
        form = settings.log_format
        if form is None or log_words(form) is not None:
            words = [IN_AMPERES, *(log_words(form).angle_words() if form else ())]  # type: ignore[union-attr]
            form = ",".join(words)
        RecordingReader(path, form, robot, False).require_joint_signals()
        found.append(read_recording(path, form, robot, check=False))
    return found
