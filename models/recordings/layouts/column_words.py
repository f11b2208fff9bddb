"""Recognises the columns of any table by the words in their names.

`Base Position [deg]`, `left_elbow_joint_pos`, `AxisAct_A1`, `q1_deg`: a name is a quantity, perhaps
its unit, and a joint, by its number or its name. What a controller commands (target, desired, ..)
and what is no signal of a joint are left out. A table that names two series of one quantity, or
one that lacks joints, is not recognised: only its owner knows which one counts.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.layouts.header_layouts import KnownLayout
from wrenchsight.models.recordings.layouts.joint_names import is_nameless, matched_joints
from wrenchsight.models.recordings.layouts.time_names import time_columns
from wrenchsight.models.recordings.log_words import LogWords
from wrenchsight.models.recordings.recording_format import (
    PER_CENT,
    PER_MILLE,
    UNITS,
    RecordingFormat,
    by_number,
)

_QUANTITIES = {  # in this order: "current as torque" is a torque, "joint speed" a velocity
    "velocity": {"vel", "velocity", "velocities", "velocityactual", "speed", "speeds", "qd", "dq",
                 "qdot", "qvel", "omega", "v", "geschw", "geschwindigkeit"},
    "motor_torque": {"tau", "trq", "torque", "torques", "moment", "effort", "efforts", "taumsr",
                     "drehmoment"},
    "current": {"cur", "curr", "current", "currents", "amp", "amps", "ampere", "i", "iq", "strom"},
    "position": {"pos", "position", "positions", "angle", "angles", "theta", "q", "qpos", "winkel"},
}  # fmt: skip
_ASIDE = {  # words of what is no measured signal of a joint
    "target", "desired", "des", "d", "cmd", "command", "commanded", "goal", "ref", "reference",
    "set", "setpoint", "soll", "ext", "external", "error", "err", "temp", "temperature", "voltage",
    "limit", "max", "min", "acc", "acceleration", "tcp", "ee", "wrench", "mode", "status",
    "gripper", "finger", "digital", "output", "input", "gravity", "coriolis", "friction", "control",
}  # fmt: skip
_MEASURED = {"actual", "act", "measured", "meas", "msr", "real", "ist", "feedback", "fb", "motor",
             "joint", "axis", "raw", "axes", "achse", "gelenk"}  # fmt: skip
_UNITS = {
    "rad": "rad", "rads": "rad", "radian": "rad", "radians": "rad", "deg": "deg", "degree": "deg",
    "degrees": "deg", "°": "deg", "grad": "deg", "rev": "rev", "mm": "mm", "rad/s": "rad/s",
    "rad_s": "rad/s", "radps": "rad/s", "rad_per_s": "rad/s", "rad/sec": "rad/s", "deg/s": "deg/s",
    "°/s": "deg/s", "deg_s": "deg/s", "degps": "deg/s", "deg_per_s": "deg/s", "deg/sec": "deg/s",
    "rpm": "rpm", "a": "A", "amp": "A", "ampere": "A", "amperes": "A", "ma": "mA", "nm": "N m",
    "n*m": "N m", "n.m": "N m", "n m": "N m", "mnm": "mN m", "%": PER_CENT, "percent": PER_CENT,
    "pct": PER_CENT, "permille": PER_MILLE, "promille": PER_MILLE, "‰": PER_MILLE,
}  # fmt: skip
_INNER_UNITS = ("rad", "deg", "ma", "nm", "mnm", "percent", "pct", "permille", "promille")
_IN_BRACKETS = re.compile(r"\s*[\[(<]\s*([^\])>]+?)\s*[\])>]\s*$")
_AT_END = re.compile(
    r"[\s_.\-](rad[_/]s|rad_per_s|deg[_/]s|deg_per_s|rad/sec|deg/sec|[a-z%°‰]+)$", re.IGNORECASE
)
_MAX_NAME = 200  # characters
_JOINT_COLUMNS = ("joint", "joint_name", "joint_names", "joint_id", "axis", "name")


class _Column(NamedTuple):
    """A column that holds a signal of a joint, at its place among all columns."""

    place: int
    unit: str
    words: tuple[str, ...]  # of its joint: all but quantity and unit


def column_words_layout(
    names: Sequence[str], path: Path, joint_names: Sequence[str] | None, words: LogWords
) -> KnownLayout | None:
    """The description of a table by the words in its columns' names; None where they leave doubt.

    Args:
        names: names of the columns.
        path: path of the log, for error lines.
        joint_names: joint names of the robot, base to tool; None: those of the log, in its order.
        words: what the user states.

    Raises:
        InputError: each row holds one joint; as `matched_joints`.
    """
    time = time_columns(names)
    if time is None:
        return None
    series = signal_columns(names, path, joint_names, words)
    _refuse_joint_rows(names, path)
    named = {_taken_apart(name, k)[0] for k, name in enumerate(names)} - {""}
    has_drives = not series.keys().isdisjoint(("current", "motor_torque"))
    if not (named <= series.keys() and "position" in series and has_drives):
        return None
    if len({len(found.columns) for found in series.values()}) > 1:
        return None
    form = RecordingFormat(time=time)
    used = {int(column) - 1 for column in str(time.columns).split(",")}
    assignments = []
    for key, found in series.items():
        unit, key_of_unit = found.unit, key
        if unit in (PER_CENT, PER_MILLE):  # of what, the hypotheses find and the user must say
            unit, key_of_unit = "", "current"
        setattr(form, key_of_unit, by_number(found.columns, unit))
        used |= set(found.columns)
        first, last = names[found.columns[0]], names[found.columns[-1]]
        in_unit = f" in {found.unit}" if found.unit else ""
        assignments.append(f"{first} .. {last} as {key.replace('_', ' ')}{in_unit}")
    notices = [f"columns read by the words in their names: {', '.join(assignments)}"]
    notices += dict.fromkeys(found.how for found in series.values() if found.how)
    others = [name for k, name in enumerate(names) if k not in used and name]
    if others:
        more = f" and {len(others) - 6} more" if len(others) > 6 else ""
        notices.append(f"columns left out: {', '.join(others[:6])}{more}")
    is_effort = form.motor_torque is not None and any("effort" in name.lower() for name in names)
    return KnownLayout(form, tuple(notices), torque_is_effort=is_effort)


class JointColumns(NamedTuple):
    """The columns of one quantity, one for each joint from base to tool.

    Attributes:
        columns: counted from 0.
        unit: as descriptions have it; empty where the names state none.
        how: a sentence on how the joints were matched; empty where they are numbered.
    """

    columns: list[int]
    unit: str
    how: str


def signal_columns(
    names: Sequence[str],
    path: Path,
    joint_names: Sequence[str] | None,
    words: LogWords,
) -> dict[str, JointColumns]:
    """The columns of all joints by key of a description, where the names leave no doubt.

    Args:
        names, path, joint_names, words: as `column_words_layout`.

    Raises:
        InputError: as `matched_joints`.
    """
    by_quantity: dict[str, list[_Column]] = {}
    for index, name in enumerate(names):
        quantity, column = _taken_apart(name, index)
        if quantity:
            by_quantity.setdefault(quantity, []).append(column)
    found: dict[str, JointColumns] = {}
    for quantity in ("position", "velocity", "current", "motor_torque"):
        columns = by_quantity.get(quantity, [])
        joints = _numbered(columns, joint_names) or _named(columns, joint_names, path, words)
        if joints is None:
            continue
        by_index = {column.place: column for column in columns}
        units = {by_index[k].unit for k in joints[0]}
        if len(units) == 1 and units <= {"", *UNITS[quantity]}:
            found[quantity] = JointColumns(joints[0], units.pop(), joints[1])
    return found


def _taken_apart(name: str, place: int) -> tuple[str, _Column]:
    """The quantity of a column, empty where it is none of a joint, and the column."""
    if len(name) > _MAX_NAME:
        return "", _Column(place, "", ())
    unit, rest = _unit(name.strip())
    tokens = _tokens(rest)
    if not unit:  # percent_1, or pos_deg_1
        unit = next((_UNITS[token] for token in tokens if token in _INNER_UNITS), "")
        tokens = [token for token in tokens if token not in _INNER_UNITS]
    found = [key for key, known in _QUANTITIES.items() if known & set(tokens)]
    quantity = found[0] if found else next(
        (key for key in _QUANTITIES if unit in UNITS[key] and unit not in (PER_CENT, PER_MILLE)), ""
    )  # fmt: skip
    if not tokens or _ASIDE & set(tokens):
        quantity = ""
    known = set().union(*(_QUANTITIES[key] for key in found))
    joint = tuple(token for token in tokens if token not in known)
    return quantity, _Column(place, unit, joint)


def _unit(name: str) -> tuple[str, str]:
    """The unit at the end of a column's name, and the name without it."""
    for pattern in (_IN_BRACKETS, _AT_END):
        match = pattern.search(name)
        if match and match[1].lower() in _UNITS and match.start():
            return _UNITS[match[1].lower()], name[: match.start()]
    return "", name


def _tokens(text: str) -> list[str]:
    """Words and numbers of a name, in lower case; AxisAct_A1 has four."""
    return [token.lower() for token in re.findall(r"[A-Z]?[a-zäöü]+|[A-Z]+(?![a-z])|\d+", text)]


def _numbered(
    columns: Sequence[_Column], joint_names: Sequence[str] | None
) -> tuple[list[int], str] | None:
    """The only series of columns that count through the joints, from 0 or 1 on."""
    series: dict[tuple[str, ...], dict[int, int]] = {}
    for column in columns:
        for k, word in enumerate(column.words):
            if word.isdigit() and len(word) < 4:
                stem = (*column.words[:k], "#", *column.words[k + 1 :])
                series.setdefault(stem, {})[int(word)] = column.place
    complete = [
        [numbers[k] for k in sorted(numbers)]
        for numbers in series.values()
        if sorted(numbers) in (list(range(len(numbers))), list(range(1, len(numbers) + 1)))
        and len(numbers) == (len(columns) if joint_names is None else len(joint_names))
    ]
    return (complete[0], "") if len(complete) == 1 else None


def _named(
    columns: Sequence[_Column], joint_names: Sequence[str] | None, path: Path, words: LogWords
) -> tuple[list[int], str] | None:
    """The columns of the robot's joints by their names, and how these were matched."""
    if joint_names is None:
        return None
    index_of: dict[str, int] = {}
    for column in columns:
        index_of.setdefault("_".join(column.words), column.place)
    ours = ["_".join(_tokens(name)) for name in joint_names]
    theirs = [name for name in index_of if name]
    if not theirs or is_nameless(theirs):
        return None
    for known, logged in ((ours, theirs), ([_plain(n) for n in ours], [_plain(n) for n in theirs])):
        if len(set(known)) < len(known) or len(set(logged)) < len(logged):
            continue
        match = matched_joints(logged, known, path, words)
        if match is not None:
            places = [logged.index(joint) for joint in match.joints]
            return [index_of[theirs[place]] for place in places], match.how
    return None


def _plain(joint: str) -> str:
    """A joint's name without words that say no more than that it is one."""
    return "_".join(word for word in joint.split("_") if word not in _MEASURED) or joint


def _refuse_joint_rows(names: Sequence[str], path: Path) -> None:
    """Refuses a table with a row for each joint instead of one for each sample."""
    joint = next((name for name in names if name.strip().lower() in _JOINT_COLUMNS), None)
    if joint is None:
        return
    rest = [_taken_apart(name, k) for k, name in enumerate(names)]
    if any(quantity == "position" and not column.words for quantity, column in rest):
        problem = f'has a row for each joint (column "{joint}"), expected one for each sample'
        remedy = "write a row a sample with a column for each joint and quantity, such as "
        remedy += "q1..qn, v1..vn, i1..in, or JOINT_position, JOINT_velocity, JOINT_current"
        raise InputError(path, "header", problem, remedy)
