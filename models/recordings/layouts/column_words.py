"""Recognises the columns of any table by the words in their names.

`Base Position [deg]`, `left_elbow_joint_pos`, `AxisAct_A1`, `q1_deg`: a name is a quantity, perhaps
its unit, and a joint, by its number or its name. What a controller commands (target, desired, ..)
and what is no signal of a joint are left out. Where no column says that it is a position, those of
the axes' actual values (`Achse1_Ist`, `J1`) are. A table that names two series of one quantity is
refused: only its owner knows which one counts.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.layouts.header_layouts import KnownLayout
from wrenchsight.models.recordings.layouts.joint_names import (
    DESCRIBE,
    is_nameless,
    matched_joints,
)
from wrenchsight.models.recordings.layouts.signal_words import (
    QUANTITIES,
    ColumnName,
    column_name,
    name_tokens,
    without_joint_words,
)
from wrenchsight.models.recordings.layouts.time_names import time_columns
from wrenchsight.models.recordings.log_words import LogWords
from wrenchsight.models.recordings.recording_format import (
    PER_CENT,
    PER_MILLE,
    UNITS,
    RecordingFormat,
    by_number,
    column_numbers,
)

_LISTED_NAMES = 6  # of the columns that are left out, in a notice
_SIGNAL_COLUMNS = ("signal", "variable", "name", "tag", "channel", "key", "field", "metric")
_VALUE_COLUMNS = ("value", "values", "val", "wert", "valeur", "valor")
_JOINT_COLUMNS = ("joint", "joint_name", "joint_names", "joint_id", "axis", "name")


class _Column(NamedTuple):
    """A column that holds a signal of a joint, at its place among all columns."""

    place: int
    name: ColumnName


def column_words_layout(
    names: Sequence[str], path: Path, joint_names: Sequence[str] | None, words: LogWords
) -> KnownLayout | None:
    """The description of a table by the words in its columns' names; None where they leave doubt.

    There is no doubt where time is named, position and current or torque of as many joints each,
    and every column whose name has a word for a quantity is one of these joints' columns.

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
    named = {column_name(name).quantity for name in names} - {""}  # quantities that some name has
    has_drives = not series.keys().isdisjoint(("current", "motor_torque"))
    if not named <= series.keys():
        # Refused, unless plain names (q1..) stand among them: then the plain header's own error
        # says what is wrong.
        _refuse_doubtful_series(names, named - series.keys(), path)
        return None
    if not ("position" in series and has_drives):
        _refuse_positions_alone(names, joint_names, path)
        return None
    if len({len(signal.columns) for signal in series.values()}) > 1:
        return None
    form = RecordingFormat(time=time)
    used_columns = set(column_numbers(time))
    assignments = []
    for key, signal in series.items():
        # A share of a rated value is read as a current of an unknown scale: of which value, the
        # hypotheses find and the user must say. A torque in such shares says nothing more where
        # there are currents.
        is_share = signal.unit in (PER_CENT, PER_MILLE)
        if is_share and key == "motor_torque" and "current" in series:
            continue
        columns = by_number(signal.columns, "" if is_share else signal.unit)
        setattr(form, "current" if is_share else key, columns)
        used_columns |= set(signal.columns)
        first, last = names[signal.columns[0]], names[signal.columns[-1]]
        in_unit = f" in {signal.unit}" if signal.unit else ""
        assignments.append(f"{first} .. {last} as {key.replace('_', ' ')}{in_unit}")
    notices = [f"columns read by the words in their names: {', '.join(assignments)}"]
    notices += dict.fromkeys(signal.how for signal in series.values() if signal.how)
    others = [name for k, name in enumerate(names) if k not in used_columns and name]
    if others:
        num_more = len(others) - _LISTED_NAMES
        more = f" and {num_more} more" if num_more > 0 else ""
        notices.append(f"columns left out: {', '.join(others[:_LISTED_NAMES])}{more}")
    called_effort = {"effort", "efforts", "eff"}
    is_effort = form.motor_torque is not None and any(
        "effort" in name.lower() or called_effort & set(name_tokens(name)) for name in names
    )
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
    """The columns of all joints by quantity: position, velocity, current, motor_torque.

    A quantity is left out where its columns are not one of each joint, or have several units.

    Args:
        names, path, joint_names, words: as `column_words_layout`.

    Raises:
        InputError: as `matched_joints`.
    """
    by_quantity: dict[str, list[_Column]] = {}
    bare: list[_Column] = []  # names of a joint without a word for a quantity
    for place, name in enumerate(names):
        column = _Column(place, column_name(name))
        if column.name.quantity:
            by_quantity.setdefault(column.name.quantity, []).append(column)
        elif column.name.is_bare:
            bare.append(column)
    if not by_quantity.keys().isdisjoint(("current", "motor_torque")):
        by_quantity.setdefault("position", bare)  # Axis 1 Actual beside Axis 1 Current
    joint_columns: dict[str, JointColumns] = {}
    for quantity in ("position", "velocity", "current", "motor_torque"):
        columns = by_quantity.get(quantity, [])
        match = _numbered(columns, joint_names) or _named(columns, joint_names, path, words)
        if match is None:
            continue
        places, how_matched = match  # of the joints, base to tool
        unit_of = {column.place: column.name.unit for column in columns}
        units = {unit_of[place] for place in places}
        if len(units) == 1 and units <= {"", *UNITS[quantity]}:
            joint_columns[quantity] = JointColumns(places, units.pop(), how_matched)
    return joint_columns


def _numbered(
    columns: Sequence[_Column], joint_names: Sequence[str] | None
) -> tuple[list[int], str] | None:
    """The only series of columns that count through the joints, from 0 or 1 on."""
    series: dict[tuple[str, ...], dict[int, int]] = {}
    for column in columns:
        words = column.name.words
        for k, word in enumerate(words):
            if word.isdigit() and len(word) < 4:
                stem = (*words[:k], "#", *words[k + 1 :])
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
        index_of.setdefault("_".join(column.name.words), column.place)
    ours = ["_".join(name_tokens(name)) for name in joint_names]
    theirs = [name for name in index_of if name]
    if not theirs or is_nameless(theirs):
        return None
    plain = [[without_joint_words(name) for name in joints] for joints in (ours, theirs)]
    for known, logged in ((ours, theirs), (plain[0], plain[1])):
        if len(set(known)) < len(known) or len(set(logged)) < len(logged):
            continue
        match = matched_joints(logged, known, path, words)
        if match is not None:
            places = [logged.index(joint) for joint in match.joints]
            return [index_of[theirs[place]] for place in places], match.how
    return None


def _refuse_doubtful_series(names: Sequence[str], quantities: set[str], path: Path) -> None:
    """Refuses a table without a plain header whose columns of a quantity are not one a joint."""
    if any(re.fullmatch(r"(q|v|i|tau)\d{1,4}", name) for name in names):
        return
    quantity = next(key for key in QUANTITIES if key in quantities)
    columns = [name for name in names if column_name(name).quantity == quantity]
    more = f" and {len(columns) - 6} more" if len(columns) > 6 else ""
    words = quantity.replace("_", " ")
    problem = f"names {words}s that are not one for each joint of the robot, by number or name: "
    problem += f"{', '.join(columns[:6])}{more}"
    remedy = f"leave one for each joint and call it {words} 1.. from base to tool, {DESCRIBE}"
    raise InputError(path, "header", problem, remedy)


def _refuse_positions_alone(
    names: Sequence[str], joint_names: Sequence[str] | None, path: Path
) -> None:
    """Refuses a table of one number for each axis (J1.., A1..) and no word for a current or torque.

    Args:
        names, path: as `column_words_layout`.
        joint_names: of the robot; None: any number of axes.

    Raises:
        InputError: it is such a table.
    """
    taken = [column_name(name) for name in names]
    has_drives = any(column.quantity in ("current", "motor_torque") for column in taken)
    columns = [
        _Column(place, column)
        for place, column in enumerate(taken)
        if column.is_bare or column.quantity == "position"
    ]
    if has_drives or not columns:
        return
    match = _numbered(columns, joint_names)
    if match is None:
        return
    first, last = names[match[0][0]], names[match[0][-1]]
    problem = f"holds joint positions ({first} .. {last}), but no motor current or joint torque"
    remedy = "record the motors' currents or torques beside them (of an ABB arm through EGM: test "
    remedy += "signals of the motors' torque), from which the wrench is estimated"
    raise InputError(path, "header", problem, remedy)


def _refuse_joint_rows(names: Sequence[str], path: Path) -> None:
    """Refuses a table with a row for each joint, or each signal, instead of one for each sample."""
    by_word = {name.strip().lower(): name for name in names}
    signal = next((by_word[word] for word in _SIGNAL_COLUMNS if word in by_word), None)
    value = next((by_word[word] for word in _VALUE_COLUMNS if word in by_word), None)
    time = next((by_word[word] for word in ("t", "time", "timestamp") if word in by_word), "time")
    if signal is not None and value is not None:
        problem = f'has a row for each signal (columns "{signal}", "{value}"), expected one for '
        problem += "each sample"
        remedy = f"turn it, such as by pandas: table.pivot(index={time!r}, columns={signal!r}, "
        remedy += f"values={value!r}).to_csv('turned.csv')"
        raise InputError(path, "header", problem, remedy)
    joint = next((name for name in names if name.strip().lower() in _JOINT_COLUMNS), None)
    if joint is None:
        return
    taken = [column_name(name) for name in names]
    if any(column.quantity == "position" and not column.words for column in taken):
        problem = f'has a row for each joint (column "{joint}"), expected one for each sample'
        remedy = "write a row a sample with a column for each joint and quantity, such as "
        remedy += "q1..qn, v1..vn, i1..in, or JOINT_position, JOINT_velocity, JOINT_current"
        raise InputError(path, "header", problem, remedy)
