"""Finds the features of a LeRobot data set that hold joint positions, velocities and torques.

The name of a feature, or of an entry, states its quantity: observation.state (positions),
observation.velocity, observation.effort, joint1.effort, joint_efforts.0, shoulder_pan.pos. Goals,
actions and poses of the tool are left out. The load of a servo is its duty cycle, and a goal
current is a command: neither is torque.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.layouts.header_layouts import KnownLayout
from wrenchsight.models.recordings.lerobot.data_set import INFO, DataSet
from wrenchsight.models.recordings.log_words import IN_DEGREES, IN_RADIANS
from wrenchsight.models.recordings.recording_format import RecordingFormat, by_number, in_degrees

_QUANTITY_WORDS = {
    "position": ("pos", "position", "positions", "qpos", "q", "state", "angle", "angles"),
    "velocity": ("vel", "velocity", "velocities", "qvel", "dq", "qd"),
    "motor_torque": ("effort", "efforts", "torque", "torques", "tau", "eff"),
    "current": ("current", "currents", "cur"),
    "load": ("load", "loads", "pwm"),
}
_EFFORT_WORDS = {"effort", "efforts", "eff"}  # of a torque in N m, or of a current in A
_COMMAND_WORDS = ("goal", "target", "command", "commanded", "cmd", "action", "desired", "leader")
_OTHER_WORDS = ("ee", "eef", "tcp", "cartesian", "pose", "env", "environment", "image", "images",
                "wrench", "force", "ft", "base", "object", "gripper")  # fmt: skip
_NO_JOINT_FEATURE = {*_COMMAND_WORDS, *_OTHER_WORDS}  # words of a feature that holds no joints
_NO_JOINT_ENTRY = _NO_JOINT_FEATURE - {"gripper", "base"}  # words of an entry that is no joint
_HANDS = ("gripper", "finger", "hand", "jaw")
_FILLERS = ("observation", "state", "states", "main", "follower", "joint", "joints", "arm", "motor",
            "motors", "present", "robot", "measured", "filtered")  # fmt: skip
_POSE = {"x", "y", "z", "rx", "ry", "rz", "qw", "qx", "qy", "qz", "roll", "pitch", "yaw", "delta"}
_SINGLE_NUMBERS = "one number a feature"  # the group of all features of one number
_LONGEST_NOTICE = 200  # characters of the features of a quantity
_LARGEST_RAD = 4.0 * np.pi  # no joint turns twice about itself to either side
_MAX_NORMALISED = 100.5  # LeRobot's normalised positions end at 100
_DESCRIBE = (
    'name the columns with --log-format, such as position: {columns: "observation.state.{1..6}"}'
)


@dataclass(frozen=True)
class _Entry:
    """One number of a frame that may be a joint's."""

    quantity: str  # a key of _QUANTITY_WORDS
    joint: str  # its name without the words of the quantity; '' where none are left
    group: str  # the same for the entries of all joints
    column: int  # of the table
    feature: str
    index: int  # in the feature
    is_effort: bool  # whether its name, or its feature's, calls it an effort


class _JointEntries(NamedTuple):
    """The entries of a quantity that are the robot's joints, base to tool."""

    entries: list[_Entry]
    note: str  # what was assumed of them, or why there are none; '' for nothing


def feature_layout(
    data_set: DataSet,
    columns: Sequence[str],
    joint_names: Sequence[str] | None,
    prismatic: Sequence[bool] | None = None,
    angle: str = "",
) -> KnownLayout:
    """The description of a data set's columns, by the words in the names of its features.

    The joints of the positions are the robot's; velocity, torque and current count where they are
    of as many joints. Torque comes before current.

    Args:
        data_set: whose features are read, by its description.
        columns: columns of its tables, as `parquet_table` names them: FEATURE.1..FEATURE.k.
        joint_names: joint names of the robot, base to tool; None: all joints, in the data set's
            order.
        prismatic: which of the joints slide, whose positions are in m; None: none.
        angle: unit of the other positions, deg or rad; '': decided by their size.

    Raises:
        InputError: the data set holds no joint positions, those of other joints, or positions
            whose size does not decide their unit.
    """
    entries = _entries(data_set, columns)
    joints = {
        quantity: _joints_of(
            [entry for entry in entries if entry.quantity == quantity], joint_names
        )
        for quantity in ("position", "velocity", "motor_torque", "current")  # torque first
    }
    positions = joints["position"]
    if not positions.entries:
        raise _no_positions(data_set, entries, positions.note)
    if "timestamp" not in columns:
        path = data_set.root / INFO
        raise InputError(path, "features", "lacks timestamp", "convert the data set with LeRobot")
    form = RecordingFormat(time=by_number([list(columns).index("timestamp")]))
    unit, unit_notices = _angle_unit(data_set, positions.entries, prismatic, angle)
    degrees = {"position": "deg", "velocity": "deg/s"} if unit == "deg" else {}
    assignments, order_notices = [], [positions.note] if positions.note else []
    for quantity, (joint_entries, note) in joints.items():
        if len(joint_entries) != len(positions.entries):
            continue
        if quantity == "current" and form.motor_torque is not None:
            continue  # torque needs no torque constant
        signal = by_number([entry.column for entry in joint_entries])
        if quantity in degrees:
            signal = in_degrees(signal, degrees[quantity], prismatic or ())
        setattr(form, quantity, signal)  # the quantities are fields of RecordingFormat
        name = quantity.replace("_", " ")
        features = ", ".join(dict.fromkeys(entry.feature for entry in joint_entries))
        assignments.append(f"{name} from {features}"[:_LONGEST_NOTICE])
        if note and note != positions.note:
            order_notices.append(f"{name}: {note}")
    notices = [f"data set read: {'; '.join(assignments)}", *order_notices]
    notices += unit_notices
    torque_substitute = ""
    if form.motor_torque is None and form.current is None:
        torque_substitute = _torque_substitute(entries, columns)
    is_effort = form.motor_torque is not None and any(
        entry.is_effort for entry in joints["motor_torque"].entries
    )
    return KnownLayout(form, tuple(notices), torque_substitute, is_effort)


def _no_positions(data_set: DataSet, entries: Sequence[_Entry], note: str) -> InputError:
    """The error of a data set without the positions of the robot's joints."""
    problem = "no feature holds the joints' positions"
    features = sorted({entry.feature for entry in entries if entry.quantity == "position"})
    if features:
        problem += f"; {', '.join(features)} {note or 'are of other joints'}"
    return InputError(data_set.root / INFO, "features", problem, _DESCRIBE)


def _torque_substitute(entries: Sequence[_Entry], columns: Sequence[str]) -> str:
    """A notice of features that may be taken for torque but are none; '' where there are none."""
    loads = list(dict.fromkeys(entry.feature for entry in entries if entry.quantity == "load"))
    if loads:
        return f"{', '.join(loads)[:100]} is not read: a servo's duty cycle is no torque"
    for name in columns:
        words = set(_words(name))
        if words & {"current", "torque", "effort", "load"} and words & set(_COMMAND_WORDS):
            return f"{name[:60]} is not read: a commanded value is no torque that was measured"
    return ""


def _entries(data_set: DataSet, columns: Sequence[str]) -> list[_Entry]:
    """Every number of a frame that may be a joint's: with its quantity, joint, group and column.

    Numbers of one feature are a group; features of one number each are one group together. A number
    is left out where its name, or its feature's, has a word for something else (a gripper's width,
    a pose, an action), or none for a quantity.

    Args:
        data_set: whose features are looked at.
        columns: names of the table's columns: FEATURE, or FEATURE.1..FEATURE.k.
    """
    place_of = {name: k for k, name in enumerate(columns)}
    entries: list[_Entry] = []
    for feature in data_set.features.values():
        feature_words = _words(feature.name)
        if not feature.is_number or _NO_JOINT_FEATURE.intersection(feature_words):
            continue
        group = feature.name if feature.size > 1 else _SINGLE_NUMBERS
        for k in range(min(feature.size, len(columns))):  # a damaged size may be anything
            column_name = feature.name if feature.size == 1 else f"{feature.name}.{k + 1}"
            if column_name not in place_of:
                continue
            entry_words = _words(feature.names[k]) if feature.names else []
            if _NO_JOINT_ENTRY.intersection(entry_words):
                continue
            quantity = _quantity(entry_words) or _quantity(feature_words)
            if not quantity:
                continue
            quantity_words = _QUANTITY_WORDS[quantity]
            other_words = [w for w in (entry_words or feature_words) if w not in quantity_words]
            if other_words and set(other_words) <= _POSE:
                continue
            joint = "_".join(word for word in other_words if word not in _FILLERS)
            entries.append(
                _Entry(
                    quantity=quantity,
                    joint=joint,
                    group=group,
                    column=place_of[column_name],
                    feature=feature.name,
                    index=k,
                    is_effort=not _EFFORT_WORDS.isdisjoint((*feature_words, *entry_words)),
                )
            )
    return entries


def _quantity(words: Sequence[str]) -> str:
    """The quantity that the words of a name state, the last word first; '' where none does."""
    for word in reversed(words):
        for quantity, quantity_words in _QUANTITY_WORDS.items():
            if word in quantity_words:
                return quantity
    return ""


def _joints_of(entries: Sequence[_Entry], joint_names: Sequence[str] | None) -> _JointEntries:
    """The joints among the entries of one quantity, from the first group that holds them."""
    groups: dict[str, list[_Entry]] = {}
    for entry in entries:
        groups.setdefault(entry.group, []).append(entry)
    joints = _JointEntries([], "")
    for group in groups.values():
        # Beside numbered joints may stand a sensor's entries of the quantity: torque.x, offset.z.
        numbered = [entry for entry in group if entry.joint.isdecimal()]
        for candidates in (group, numbered) if numbered else (group,):
            joints = _joints_of_group(candidates, joint_names)
            if joints.entries:
                return joints
    return joints


def _joints_of_group(group: list[_Entry], joint_names: Sequence[str] | None) -> _JointEntries:
    """The joints of a group: by their names, else in the data set's order."""
    arm = [entry for entry in group if not any(hand in entry.joint for hand in _HANDS)]
    if joint_names is None:
        return _JointEntries(arm, "joints are taken in the data set's order")
    by_name: dict[str, _Entry] = {}
    for entry in group:
        by_name.setdefault(_without_fillers(entry.joint), entry)
    names = [_without_fillers(name) for name in joint_names]
    if "" not in names and len(set(names)) == len(names) and set(names) <= by_name.keys():
        return _JointEntries([by_name[name] for name in names], "")
    size = len(joint_names)
    is_unnamed = all(not entry.joint or entry.joint.isdecimal() for entry in group)
    if len(arm) == size:
        order = ", ".join(entry.joint or str(entry.index + 1) for entry in arm)
        return _JointEntries(arm, f"joints are taken in the data set's order: {order}")
    if is_unnamed and len(arm) == size + 1:
        note = "joints are taken in the data set's order, its last number as the gripper"
        return _JointEntries(arm[:size], note)
    return _JointEntries([], f"hold {len(arm)} joints, the robot has {size}")


def _without_fillers(name: str) -> str:
    return "".join(word for word in _words(name) if word not in _FILLERS)


def _words(name: str) -> list[str]:
    """The words and numbers of a name, in lower case."""
    spaced = re.sub(r"([a-z])([A-Z])", r"\1_\2", name[:200])
    return re.findall(r"[a-z]+|\d+", spaced.lower())


def _angle_unit(
    data_set: DataSet, joints: Sequence[_Entry], prismatic: Sequence[bool] | None, angle: str
) -> tuple[str, list[str]]:
    """Unit of the positions of revolute joints, and notices of how it was decided.

    Beyond _LARGEST_RAD they are no radians; up to _MAX_NORMALISED they may be degrees or LeRobot's
    -100..100. Their size is that of the data set's statistics; without these they are radians.

    Args:
        data_set: whose statistics show the positions' size.
        joints: entries of the positions; where `prismatic` is given, one of each of these joints.
        prismatic: which of them slide; None: none.
        angle: deg or rad as the user states; '': the size decides.

    Raises:
        InputError: the size of the positions does not decide it.
    """
    is_prismatic = list(prismatic or [False] * len(joints))
    sliding = ", of joints that slide in m" if any(is_prismatic) else ""
    if angle:
        return angle, [f"positions are read in {angle}{sliding}, as --log-format says"]
    largest = 0.0
    for joint, slides in zip(joints, is_prismatic, strict=True):
        magnitudes = data_set.largest(joint.feature)  # of all entries of the feature
        if magnitudes is not None and not slides:
            largest = max(largest, float(magnitudes[joint.index]))
    if largest <= _LARGEST_RAD:
        return "rad", []
    if largest > _MAX_NORMALISED:
        return "deg", [f"positions are read in degrees{sliding}: they reach {largest:.0f}"]
    robot_type = f" ({data_set.robot_type[:40]})" if data_set.robot_type else ""
    problem = (
        f"positions reach {largest:.0f}: degrees, or LeRobot's positions normalised to -100..100"
        f"{robot_type}; the data set does not state which"
    )
    remedy = (
        f"add --log-format {IN_DEGREES} or {IN_RADIANS}; for normalised positions describe gain "
        "and offset of each joint, from the arm's calibration (--log-format FILE.yaml)"
    )
    raise InputError(data_set.root / INFO, joints[0].feature, problem, remedy)
