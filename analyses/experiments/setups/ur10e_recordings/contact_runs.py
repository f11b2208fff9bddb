"""Runs of a UR10e that presses a roller on a workpiece: their files, their tools, their intervals.

The files of data set `ur10e_contact` are found by their names alone,
`<scene>_<controller>_F<force>_<setting>_v<speed>.csv`; nothing else in the folder is read.

Positions and velocities are rebuilt from the scripted path. Where that path has a corner, the
rebuilt velocity jumps. The robot rounds the corner off over the last 10 or 15 mm before it: the
scripts' blend radii, at which the measured currents show the pulse to begin. `rounded_corners` does
the same.
"""

import csv
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from wrenchsight.analyses.data_sets.places import data_set_folder
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import PoseConfig, ToolConfig

FOLDER: Final = "ur10e_contact"  # below the data folder
FORMAT: Final = "ur10e-contact"
SCENES: Final = ("straight", "ramp", "direct")
CONTROLLERS: Final = ("acf", "ur")
CONTACT: Final = "contact"  # from the touch to the end of the lift, with all that lies between
INTERVALS: Final = ("approach", "touch", "hold1", "slide", "hold2", "lift", CONTACT)
JUDGED: Final = ("hold1", "slide", "hold2")

# Column `phase` of the log.
_APPROACH, _TOUCH, _HOLD, _SLIDE, _SECOND_HOLD, _LIFT, _BEYOND = 1, 2, 3, 4, 6, 7, 8
_END_MARGIN = 0.048  # s that a hold or a steady slide keeps off its ends
_EDGE_MARGIN = 0.1  # s that the roller needs clear of the ramp's edge under position control
_SETTLING_TIME = 1.5  # s after contact, when the active flange has settled
_STEADY_SPEED_SHARE = 0.98  # share of the set speed
_LIFT_TIME = 0.3  # s after the lift begins: the tool is off the workpiece, and the arm calm

_CORNER_JUMP = 1.0  # rad/m a sample, all joints together, that begins a corner
_MIN_CORNER_JUMP = 8.0  # rad/m of all its jumps together
_CORNER_STEPS = 4  # samples between jumps of one corner
_MIN_SPEED = 0.02  # m/s, for a division
_BEFORE_CORNER, _AFTER_CORNER = 0.12, 0.15  # s about a corner in which it counts as near
_MIN_CORNER_SPEED = 0.03  # m/s, above which a jump is a corner
# m before the ramp's corners, in their order
BLEND_RADII: Final = (0.015, 0.010, 0.010, 0.015, 0.015)

_TOOL_MASS = 6.86  # kg, active flange and tool
_TOOL_INERTIA = [0.05, 0.05, 0.02, 0.0, 0.0, 0.0]  # kg m^2; not published: a cylinder of its size
_TOOL_COM = {"acf": [-0.005, -0.00866, 0.16225], "ur": [0.001, -0.002, 0.150]}  # m in the flange
_CONTACT_POINT = {"acf": [0.07188, -0.0415, 0.2774], "ur": [0.07188, -0.0415, 0.2594]}  # m
_TOOL_RPY = [0.0, 0.0, -np.pi / 6]

_NAME = re.compile(r"(straight|ramp|direct)_(ACF|UR)_F(\d+)_([A-Za-z0-9.]+)_v(\d+\.\d+)")


@dataclass(frozen=True, order=True)
class RunName:
    """The fields of a run's file name."""

    scene: str  # one of SCENES
    controller: str  # "acf": an active flange regulates the force; "ur": the robot does
    speed: float  # m/s
    force: int  # N, set
    setting: str  # of the controller
    stem: str  # of the file

    @classmethod
    def parse(cls, stem: str) -> "RunName | None":
        """Reads the stem of a file's name; None where it names no run."""
        match = _NAME.fullmatch(stem)
        if match is None:
            return None
        scene, controller, force, setting, speed = match.groups()
        return cls(
            scene=scene,
            controller=controller.lower(),
            speed=float(speed),
            force=int(force),
            setting=setting,
            stem=stem,
        )

    @property
    def group(self) -> str:
        """Scene and controller, as a key of the metrics: `straight_acf`."""
        return f"{self.scene}_{self.controller}"

    @property
    def speed_key(self) -> str:
        """The speed as a key of the metrics, in cm/s: `v25`."""
        return f"v{round(100 * self.speed):02d}"


@dataclass(frozen=True, eq=False)
class ContactRun:
    """One run; T samples, six joints.

    Attributes:
        log: as recorded, corners of the path rounded in its v; q and v are NaN where they are not
            known; t is 0 at the first contact.
        current_desired: (T, 6) A.
        sensor_force: (T,) N along the tool, positive where it presses.
        phase: (T,) of the log.
        corners: (T,) True from shortly before a corner of the path to shortly after.
        intervals: first and last time of each interval that the run has, s.
    """

    name: RunName
    log: Recording
    current_desired: Array
    sensor_force: Array
    phase: NDArray[np.int64]
    corners: Flags
    intervals: dict[str, tuple[float, float]]

    @property
    def t(self) -> Array:
        """(T,) s."""
        return self.log.t

    @property
    def q(self) -> Array:
        """(T, 6) rad."""
        return self.log.q

    @property
    def is_free(self) -> Flags:
        """(T,) where it moves and nothing touches the tool: on the way, and once it has lifted."""
        free = self.phase == _APPROACH
        lift = np.flatnonzero(self.phase == _LIFT)
        if len(lift):
            free |= (self.phase == _LIFT) & (self.t > self.t[lift[0]] + _LIFT_TIME)
        return np.asarray(free)


def find_runs(data: Path | None) -> list[Path]:
    """The runs' files, sorted by name.

    Args:
        data: the folder of recordings that is given.

    Raises:
        InputError: there are no such files.
    """
    folder = data_set_folder(FOLDER, data)
    files = sorted(path for path in folder.glob("*.csv") if RunName.parse(path.stem) is not None)
    if not files:
        raise InputError(
            folder,
            "",
            "holds no run of the kind straight_ACF_F15_r0.0z0_v0.25.csv",
            "give the folder of the recordings with --data",
        )
    return files


def read_run(path: Path) -> ContactRun:
    """Reads one run.

    Raises:
        InputError: the file is missing or damaged, or not named like a run.
    """
    name = RunName.parse(path.stem)
    if name is None:
        raise InputError(path, "", "is not named like a run", "expected straight_ACF_F15_..._v0.25")
    log = read_recording(path, FORMAT)
    phase = log.extra["phase"][:, 0].astype(np.int64)
    speed = log.extra["tcp_speed_desired"][:, 0]
    step = log.time_step
    v = log.v
    corners = np.zeros(log.num_samples, bool)
    if name.scene == "ramp":  # the others' paths are straight
        v, corners = rounded_corners(log.v, speed, np.isin(phase, (_SLIDE, _BEYOND)), step)
    return ContactRun(
        name=name,
        log=replace(log, v=v),
        current_desired=log.extra["current_desired"],
        sensor_force=log.extra["sensor_force"][:, 0],
        phase=phase,
        corners=corners,
        intervals=_intervals(name, log, phase, speed),
    )


def _intervals(
    name: RunName, log: Recording, phase: NDArray[np.int64], speed: Array
) -> dict[str, tuple[float, float]]:
    """Begin and end, s, of the INTERVALS that a run has, by its phases and its target speed.

    Args:
        phase: (T,) as the log's column.
        speed: (T,) m/s, target of the tool.
    """
    t = log.t  # 0 at the first contact
    intervals = {}
    steady = (phase == _SLIDE) & (speed >= _STEADY_SPEED_SHARE * name.speed)
    position_controlled_ramp = name.scene == "ramp" and name.controller == "acf"
    # By interval: samples (T,) from the first to the last of which it lasts; s off its two ends.
    rules = {
        "approach": (phase == _APPROACH, 0.0, 0.0),
        "touch": (phase == _TOUCH, 0.0, 0.0),
        "hold1": (phase == _HOLD, 0.0, _END_MARGIN),
        "slide": (steady, _END_MARGIN, _EDGE_MARGIN if position_controlled_ramp else _END_MARGIN),
        "hold2": (phase == _SECOND_HOLD, 0.0, _END_MARGIN),
        "lift": (phase == _LIFT, 0.0, 0.0),
    }
    for key, (samples, begin_margin, end_margin) in rules.items():
        rows = np.flatnonzero(samples)
        # `direct` presses in one place: what its phases call a slide is none.
        if not len(rows) or (key == "slide" and name.scene == "direct"):
            continue
        begin, end = float(t[rows[0]]) + begin_margin, float(t[rows[-1]]) - end_margin
        if key == "hold1" and name.controller == "acf":
            begin = max(begin, _SETTLING_TIME)
        if end > begin:
            intervals[key] = (begin, end)
    if "touch" in intervals:
        intervals[CONTACT] = (intervals["touch"][0], max(end for _, end in intervals.values()))
    return intervals


def rounded_corners(
    v: Array, speed: Array, where: Flags, step: float, blends: tuple[float, ...] = BLEND_RADII
) -> tuple[Array, Flags]:
    """Rounds the corners of a path off as the robot does.

    A corner is where joint velocity per tool speed jumps. From the beginning of a blend to its
    corner the velocity runs linearly from one to the other; a blend that is longer than the path
    before its corner begins where the path does.

    Args:
        v: (T, n) rad/s along the path with corners; NaN where it is not known.
        speed: (T,) m/s of the tool.
        where: (T,) samples of the path; the arm rests before the first.
        step: s between samples.
        blends: m before each corner, in their order; further corners take the last.

    Returns:
        The velocity, and (T,) True from _BEFORE_CORNER before a corner to _AFTER_CORNER after.
    """
    direction = v / np.maximum(speed, _MIN_SPEED)[:, None]  # (T, n) rad/m
    # (T - 1,) rad/m, all joints together, from sample k to k + 1.
    jump = np.nan_to_num(np.abs(np.diff(direction, axis=0)).sum(axis=1))
    jumps = np.flatnonzero((jump > _CORNER_JUMP) & where[1:] & (speed[1:] > _MIN_CORNER_SPEED))
    # Jumps of a few samples one after another are one corner.
    apart = np.flatnonzero(np.diff(jumps) >= _CORNER_STEPS) + 1
    corners = [corner for corner in np.split(jumps, apart) if jump[corner].sum() > _MIN_CORNER_JUMP]
    rounded = v.copy()
    is_near_corner = np.zeros(len(v), bool)
    travelled = np.cumsum(speed) * step  # m
    for number, corner in enumerate(corners):
        end = int(corner[-1]) + 1  # first sample behind the corner
        blend = blends[min(number, len(blends) - 1)]
        blend_start = int(np.searchsorted(travelled, travelled[end] - blend))
        path_start = int(np.flatnonzero(where)[0])
        # Not behind the corner's first jump, not before the path.
        start = max(min(blend_start, int(corner[0])), path_start)
        share = np.linspace(0.0, 1.0, end - start + 1)[:, None]
        rounded[start : end + 1] = v[start] + (v[end] - v[start]) * share
        begin_near = max(end - round(_BEFORE_CORNER / step), 0)
        is_near_corner[begin_near : end + round(_AFTER_CORNER / step)] = True
    return rounded, is_near_corner


def write_rounded(run: ContactRun, file: Path, out: Path) -> None:
    """Writes a run's file again, with the rounded velocities in their columns."""
    with file.open(newline="") as source, out.open("w", newline="") as target:
        rows, writer = csv.reader(source), csv.writer(target)
        header = next(rows)
        writer.writerow(header)
        columns = [header.index(f"v{j + 1}") for j in range(run.log.v.shape[1])]
        for row, v in zip(rows, run.log.v, strict=True):
            for column, value in zip(columns, v, strict=True):
                row[column] = f"{value:.9g}" if np.isfinite(value) else ""
            writer.writerow(row)


def tooled(robot: Robot, controller: str) -> Robot:
    """The arm with the run's tool, E at the contact, z out of the tool.

    Args:
        robot: the bundled ur10e.
        controller: "acf" or "ur"; the active flange is retracted where the robot regulates.
    """
    tool = ToolConfig(mass=_TOOL_MASS, com=_TOOL_COM[controller], inertia=_TOOL_INERTIA)
    return robot.with_tool(tool, PoseConfig(_CONTACT_POINT[controller], _TOOL_RPY))
