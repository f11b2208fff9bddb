"""Which features of a LeRobot data set hold the joints' positions, velocities and torques.

A feature, or an entry of one, says by its name what it holds: observation.state (positions),
observation.velocity, observation.effort, joint1.effort, joint_efforts.0, shoulder_pan.pos. Goals,
actions and poses of the tool are left out. Load of a servo is its duty cycle, and a goal current is
what was asked for: neither is torque.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.layouts.header_layouts import KnownLayout
from wrenchsight.models.recordings.lerobot.data_set import INFO, DataSet
from wrenchsight.models.recordings.log_words import IN_DEGREES, IN_RADIANS
from wrenchsight.models.recordings.recording_format import RecordingFormat, by_number

_KINDS = {
    "position": ("pos", "position", "positions", "qpos", "q", "state", "angle", "angles"),
    "velocity": ("vel", "velocity", "velocities", "qvel", "dq", "qd"),
    "motor_torque": ("effort", "efforts", "torque", "torques", "tau", "eff"),
    "current": ("current", "currents", "cur"),
    "load": ("load", "loads", "pwm"),
}
_NO_MEASUREMENT = ("goal", "target", "command", "commanded", "cmd", "action", "desired", "leader")
_NO_JOINTS = ("ee", "eef", "tcp", "cartesian", "pose", "env", "environment", "image", "images",
              "wrench", "force", "ft", "base", "object", "gripper")  # fmt: skip
_HANDS = ("gripper", "finger", "hand", "jaw")
_FILLERS = ("observation", "state", "states", "main", "follower", "joint", "joints", "arm", "motor",
            "motors", "present", "robot", "measured", "filtered")  # fmt: skip
_POSE = {"x", "y", "z", "rx", "ry", "rz", "qw", "qx", "qy", "qz", "roll", "pitch", "yaw", "delta"}
_LARGEST_RAD = 4.0 * np.pi
_NORMALISED = 100.5  # LeRobot's own normalised positions end at 100
_DESCRIBE = (
    'name the columns with --log-format, such as position: {columns: "observation.state.{1..6}"}'
)


@dataclass(frozen=True)
class _Entry:
    """One number of a frame."""

    kind: str
    joint: str  # what its name says besides the kind; '' where it says nothing
    source: str  # what it shares with the other joints' entries
    column: int
    feature: str
    index: int  # in the feature


def feature_layout(
    data_set: DataSet,
    columns: Sequence[str],
    joint_names: Sequence[str] | None,
    prismatic: Sequence[bool] | None = None,
    angle: str = "",
) -> KnownLayout:
    """The description of a data set's columns.

    Args:
        columns: of its tables, as `parquet_table` names them: FEATURE.1..FEATURE.k.
        joint_names: of the robot, base to tool; None: all joints, in the data set's order.
        prismatic: which of them slide; None: none.
        angle: unit of the positions, deg or rad; '': what their size says.

    Raises:
        InputError: it holds no joint positions, those of other joints, or in a unit that its
            numbers do not tell.
    """
    entries = _entries(data_set, columns)
    path = data_set.root / INFO
    found = {
        kind: _joints_of([one for one in entries if one.kind == kind], joint_names)
        for kind in ("position", "velocity", "motor_torque", "current")
    }
    position, said = found["position"]
    if not position:
        there = sorted({one.feature for one in entries if one.kind == "position"})
        lacks = f"; {', '.join(there)} {said or 'are of other joints'}" if there else ""
        problem = f"no feature holds the joints' positions{lacks}"
        raise InputError(path, "features", problem, _DESCRIBE)
    time = list(columns).index("timestamp") if "timestamp" in columns else None
    if time is None:
        raise InputError(path, "features", "lacks timestamp", "convert the data set with LeRobot")
    form = RecordingFormat(time=by_number([time]))
    unit, notices = _angle_unit(data_set, position, prismatic, angle)
    read = []
    for kind, (joints, _) in found.items():
        if joints and len(joints) == len(position):
            turned = {"position": unit, "velocity": f"{unit}/s" if unit == "deg" else ""}
            setattr(form, kind, by_number([one.column for one in joints], turned.get(kind, "")))
            sources = ", ".join(dict.fromkeys(one.feature for one in joints))
            read.append(f"{kind.replace('_', ' ')} from {sources}"[:200])
    if form.current is not None and form.motor_torque is not None:
        form.current = None  # torque needs no constant
    notices = [f"data set read: {'; '.join(read)}", *([said] if said else []), *notices]
    if form.motor_torque is None and form.current is None:
        notices += _no_torque(entries, columns)
    is_effort = form.motor_torque is not None and any(
        "eff" in (one.feature + one.joint + columns[one.column]).lower()
        for one in found["motor_torque"][0]
    )
    return KnownLayout(form, tuple(notices), torque_is_effort=is_effort)


def _no_torque(entries: Sequence[_Entry], columns: Sequence[str]) -> list[str]:
    loads = list(dict.fromkeys(one.feature for one in entries if one.kind == "load"))
    goals = [
        name
        for name in columns
        if {"current", "torque", "effort", "load"} & set(_words(name))
        and set(_words(name)) & set(_NO_MEASUREMENT)
    ]
    if loads:
        return [f"{', '.join(loads)[:100]} is a servo's duty cycle, no torque: not read"]
    if goals:
        return [f"{goals[0][:60]} is what was asked for, no torque that was measured: not read"]
    return []


def _entries(data_set: DataSet, columns: Sequence[str]) -> list[_Entry]:
    """Every number of a frame that may be a joint's."""
    places = {name: k for k, name in enumerate(columns)}
    entries: list[_Entry] = []
    for feature in data_set.features.values():
        own = _words(feature.name)
        if not feature.is_number or set(own) & {*_NO_MEASUREMENT, *_NO_JOINTS}:
            continue
        for k in range(min(feature.size, len(columns))):
            name = feature.name if feature.size == 1 else f"{feature.name}.{k + 1}"
            if name not in places:
                continue
            entry = feature.names[k] if feature.names else ""
            words = _words(entry)
            if set(words) & {*_NO_MEASUREMENT, *(set(_NO_JOINTS) - {"gripper", "base"})}:
                continue
            kind = _kind(words) or _kind(own)
            if not kind:
                continue
            inner = [word for word in (words or own) if word not in _KINDS[kind]]
            if set(inner) and set(inner) <= _POSE:
                continue
            joint = "_".join(word for word in inner if word not in _FILLERS)
            source = feature.name if feature.size > 1 else "one number a feature"
            entries.append(_Entry(kind, joint, source, places[name], feature.name, k))
    return entries


def _kind(words: Sequence[str]) -> str:
    """What the words of a name say of its kind, the last one first."""
    for word in reversed(words):
        for kind, own in _KINDS.items():
            if word in own:
                return kind
    return ""


def _joints_of(
    entries: Sequence[_Entry], joint_names: Sequence[str] | None
) -> tuple[list[_Entry], str]:
    """The entries of one kind that are the robot's joints, base to tool, and what is assumed."""
    sources: dict[str, list[_Entry]] = {}
    for one in entries:
        sources.setdefault(one.source, []).append(one)
    said = ""
    for own in sources.values():
        joints, said = _matched(own, joint_names)
        if joints:
            return joints, said
    return [], said


def _matched(own: list[_Entry], joint_names: Sequence[str] | None) -> tuple[list[_Entry], str]:
    arm = [one for one in own if not any(hand in one.joint for hand in _HANDS)]
    if joint_names is None:
        return arm, "joints in the data set's order"
    by_name: dict[str, _Entry] = {}
    for one in own:
        by_name.setdefault(_plain(one.joint), one)
    wanted = [_plain(name) for name in joint_names]
    if "" not in wanted and len(set(wanted)) == len(wanted) and set(wanted) <= by_name.keys():
        return [by_name[name] for name in wanted], ""
    size = len(joint_names)
    unnamed = all(not one.joint or one.joint.isdecimal() for one in own)
    if len(arm) == size:
        order = ", ".join(one.joint or str(one.index + 1) for one in arm)
        return arm, f"joints taken in the data set's order: {order}"
    if unnamed and len(arm) == size + 1:
        return arm[:size], "joints taken in the data set's order, its last number as the gripper"
    return [], f"hold {len(arm)} joints, the robot has {size}"


def _plain(name: str) -> str:
    return "".join(word for word in _words(name) if word not in _FILLERS)


def _words(name: str) -> list[str]:
    """In lower case, letters and digits apart."""
    spaced = re.sub(r"([a-z])([A-Z])", r"\1_\2", name[:200])
    return re.findall(r"[a-z]+|\d+", spaced.lower())


def _angle_unit(
    data_set: DataSet, joints: Sequence[_Entry], prismatic: Sequence[bool] | None, angle: str
) -> tuple[str, list[str]]:
    """Unit of the positions of turning joints, and what is said of it."""
    if angle:
        return angle, [f"positions read in {angle}, as asked for"]
    sliding = list(prismatic or [False] * len(joints))
    largest = 0.0
    for one, slides in zip(joints, sliding, strict=False):
        limits = data_set.largest(one.feature)
        if limits is not None and not slides:
            largest = max(largest, float(limits[one.index]))
    if largest <= _LARGEST_RAD:
        return "rad", []
    if largest > _NORMALISED:
        return "deg", [f"positions reach {largest:.0f}: read as degrees"]
    servo = f" ({data_set.robot_type[:40]})" if data_set.robot_type else ""
    problem = (
        f"positions reach {largest:.0f}: degrees, or LeRobot's positions normalised to -100..100"
        f"{servo}; the data set does not say which"
    )
    remedy = (
        f"for degrees add --log-format {IN_DEGREES}; normalised ones need the calibration of the "
        f"arm: describe gain and offset of each joint (--log-format FILE.yaml); {IN_RADIANS} for "
        "radians"
    )
    raise InputError(data_set.root / INFO, joints[0].feature, problem, remedy)
