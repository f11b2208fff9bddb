"""Unit and sign of a robot's effort: logs and known weights in, torque per unit out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from wrenchsight.analyses.methods.identify.identification_config import IdentifySettings
from wrenchsight.analyses.methods.identify.known_model.load_calibration import known_load
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.models.calibration.effort_scale import (
    MAX_SCALE_ERROR,
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

# A value that the logs do not determine is refuted where both are passed.
_REFUTING_SDS = 5.0  # between it and the logs' estimate
_REFUTING_RATIO = 2.0  # of the two, which errors of the URDF's masses do not reach
_WEIGHT_AT_FLANGE = (
    "the weight's centre of mass is not stated: it counts as at the flange's origin, and the scale "
    "errs by the lever that this leaves out; state it: --load LOG=KG,X,Y,Z, in the flange's frame"
)


@dataclass(frozen=True, eq=False)
class ScaleResult:
    """The scale of the joints' efforts, and the robot with it.

    Attributes:
        scale: torque per unit of effort, by joint, with its standard error.
        robot: with the torques per unit of the joints that gravity shows; the others' as stated.
        stated: (n,) torque per unit before, with its sign.
        of_torque: whether the logs state torques (tau1..). Then the scale is a factor of these,
            which a log description takes as `gain`, and the robot stays as it is.
        notices: what reading the logs involved, one sentence each.
    """

    scale: EffortScale
    robot: Robot
    stated: Array
    of_torque: bool
    notices: tuple[str, ...]

    def metrics(self) -> dict[str, Any]:
        """All figures, as written to metrics.json."""
        scale = self.scale
        return {
            "torque_per_unit_nm": scale.torque_per_unit,
            "standard_error_nm": scale.standard_error,
            "stated_nm": self.stated,
            "known_torque_sd_nm": scale.known_torque_sd,
            "seen": scale.is_determined,
            "rows": scale.count,
            "of_torque": self.of_torque,
        }


def find_scale(
    settings: IdentifySettings, out: Path, progress: ProgressCallback = lambda share, message: None
) -> ScaleResult:
    """The command `identify --scale`: writes robot.yaml and metrics.json into `out`.

    The scale is found from gravity, or from the weight where one is given. Of logs of torques it is
    a factor of these, and robot.yaml is a copy. The logs are read unchecked: what their numbers
    mean is the question.

    Args:
        settings: the logs, and with `load` one of a known weight.

    Raises:
        InputError: as `Robot.load`, `read_recording`, `result_folder`, `scale_from_gravity` and
            `scale_from_weight`.
    """
    if len(settings.load) > 1:
        raise InputError("identify", "--load", "one weight is enough", "give one with --scale")
    with result_folder(out, "identify") as folder:
        robot = Robot.load(settings.robot)
        progress(0.1, "reading")
        recordings = _read([Path(log) for log in settings.logs], settings, robot)
        weighing = _weighing(settings.load[0], settings, robot) if settings.load else None
        notices: list[str] = []
        progress(0.5, "comparing with gravity")
        if weighing is None:
            all_logs = recordings
            scale = scale_from_gravity(recordings, robot)
        else:
            all_logs = [*recordings, *weighing.logs]
            scale = scale_from_weight(recordings, weighing.logs, robot, weighing.parameters)
            notices += weighing.notices
        are_torques = _are_torques(all_logs)
        if are_torques:
            # A log states torque in N m; the factor goes into its description, not into robot.yaml.
            scaled_robot, stated = robot, np.ones(robot.num_joints)
        else:
            scaled_robot = _with_scale(robot, scale)
            stated = np.asarray(robot.torque_per_ampere * robot.current_sign)
        notices += dict.fromkeys(notice for log in all_logs for notice in log.notices)
        result = ScaleResult(
            scale=scale,
            robot=scaled_robot,
            stated=stated,
            of_torque=are_torques,
            notices=tuple(notices),
        )
        result.robot.save(folder / "robot.yaml")
        folder.write_settings("config.yaml", settings)
        folder.write_json("metrics.json", result.metrics())
    return result


class _Weighing(NamedTuple):
    """Logs with a known weight on the flange.

    Attributes:
        logs: with the weight.
        parameters: (10,) inertial ones of the weight in the flange's frame.
        notices: on what is not stated of it.
    """

    logs: list[Recording]
    parameters: Array
    notices: list[str]


def _weighing(text: str, settings: IdentifySettings, robot: Robot) -> _Weighing:
    """Reads LOG=KG or LOG=KG,X,Y,Z.

    Raises:
        InputError: as `known_load` and `read_recording`.
    """
    path, weight = known_load(text)
    com = np.zeros(3) if weight.com is None else np.array(weight.com)
    point = np.zeros((3, 3))  # gravity alone is compared, in which inertia has no part
    return _Weighing(
        logs=_read([path], settings, robot),
        parameters=body_parameters(weight.mass, com, point),
        notices=[_WEIGHT_AT_FLANGE] if weight.com is None else [],
    )


def _are_torques(recordings: Sequence[Recording]) -> bool:
    """Whether the logs hold torques, not currents.

    Raises:
        InputError: some hold torques and some currents.
    """
    of_torque = {recording.tau_J is not None for recording in recordings}
    if len(of_torque) > 1:
        problem = "some logs hold currents and some torques"
        raise InputError("identify", "--scale", problem, "give logs of one kind")
    return of_torque == {True}


def sentences(result: ScaleResult, by_weight: bool) -> list[str]:
    """Notes on the result for the user, one sentence each.

    Args:
        by_weight: whether the scale was found from a weight, not from the links' gravity.
    """
    names = np.array(result.robot.joint_names)
    hidden = ", ".join(names[~result.scale.is_determined])
    notes = []
    if hidden:
        cause = "the weight" if by_weight else "gravity"
        notes.append(
            f"{cause} does not determine {hidden} to {100 * MAX_SCALE_ERROR:.0f} %: kept as "
            "stated; take it from the drive's data sheet, or put a weight on a lever across that "
            "axis: --load LOG=KG,X,Y,Z"
        )
    notes += _refuted(result)
    if by_weight:
        notes.append(
            "the standard errors do not include stiction, which may carry part of a joint's load "
            "at rest; approach each posture from both sides"
        )
    else:
        notes.append(
            "the standard errors hold for the masses of the URDF: where these are 10 % off, so is "
            "the scale; check it with one known weight: --scale --load LOG=KG"
        )
    if result.of_torque:
        gains = ", ".join(f"{value:.4g}" for value in _or_stated(result))
        notes.append(f"the logs hold torques: describe them with motor_torque: {{gain: [{gains}]}}")
    return notes


def _refuted(result: ScaleResult) -> list[str]:
    """The joints that keep a stated value which the logs contradict, in a sentence, if any do."""
    scale, stated = result.scale, result.stated
    with np.errstate(invalid="ignore"):  # NaN: not known at all
        is_far = np.abs(scale.torque_per_unit - stated) > _REFUTING_SDS * scale.standard_error
    ratio = np.abs(scale.torque_per_unit / stated)
    is_other_size = (ratio > _REFUTING_RATIO) | (ratio < 1.0 / _REFUTING_RATIO)
    shown = [
        f"{result.robot.joint_names[j]} {scale.torque_per_unit[j]:.2g} +- "
        f"{scale.standard_error[j]:.1g} (stated {stated[j]:.3g})"
        for j in np.flatnonzero(is_far & is_other_size & ~scale.is_determined)
    ]
    if not shown:
        return []
    return [
        f"what is stated is certainly not right for {', '.join(shown)}: do not read logs with it; "
        "give more logs, in which these joints hold other postures, to determine it"
    ]


def _or_stated(result: ScaleResult) -> Array:
    return np.where(result.scale.is_determined, result.scale.torque_per_unit, result.stated)


def _with_scale(robot: Robot, scale: EffortScale) -> Robot:
    """The robot with torque per ampere and sign of the drives that the logs show."""
    by_joint = zip(robot.joint_names, scale.torque_per_unit, scale.is_determined, strict=True)
    measured = {name: float(value) for name, value, is_shown in by_joint if is_shown}
    drives = []
    for drive in robot.config.drives:
        if drive.joint in measured:
            torque_per_unit = measured[drive.joint]
            drive = replace(
                drive,
                torque_per_ampere=abs(torque_per_unit),
                torque_constant=None,
                current_sign=1 if torque_per_unit > 0.0 else -1,
            )
        drives.append(drive)
    return robot.with_drives(drives)


def _read(paths: list[Path], settings: IdentifySettings, robot: Robot) -> list[Recording]:
    """Reads logs without a check: the meaning of their numbers is the question."""
    recordings = []
    for path in (episode for log in paths for episode in episode_paths(log)):
        form = settings.log_format
        if form is None or log_words(form) is not None:
            stated_words = None if form is None else log_words(form)
            angle_words = () if stated_words is None else stated_words.angle_words()
            form = ",".join([IN_AMPERES, *angle_words])
        RecordingReader(path, form, robot, False).require_joint_signals()
        recordings.append(read_recording(path, form, robot, check=False))
    return recordings
