"""Recognises the columns of any table by the words in their names.

`Base Position [deg]`, `left_elbow_joint_pos`, `AxisAct_A1`, `q1_deg`, `state.q[0]`: a name is a
quantity, perhaps its unit, and a joint, by its number or its name. Arrays of npz, Parquet and other
files have a column for each entry (`positions.1`..). What a controller commands (target, desired,
..) and what is no signal of a joint are left out. Where no column says that it is a position, those
of the axes' actual values (`Achse1_Ist`, `J1`) are. Of two series of one quantity that counts which
is called measured; a table that leaves it open is refused: only its owner knows.

Where the rows name the joints (a Parquet column `name` of lists of words, or `field.name0`.. as
`rostopic echo -p` writes them), the joints are put in the robot's order.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.layouts.header_layouts import (
    JointOrder,
    KnownLayout,
    joint_order,
)
from wrenchsight.models.recordings.layouts.joint_names import (
    DESCRIBE,
    is_joint_list,
    is_nameless,
    matched_joints,
)
from wrenchsight.models.recordings.layouts.shortened_list import shortened
from wrenchsight.models.recordings.layouts.signal_words import (
    ColumnName,
    as_measured,
    column_name,
    is_commanded,
    is_measured,
    is_of_drive,
    is_qualified,
    is_raw,
    name_tokens,
    without_joint_words,
    without_qualifiers,
    without_value_words,
)
from wrenchsight.models.recordings.layouts.time_names import clock_numbers, time_columns
from wrenchsight.models.recordings.log_container import RowWords
from wrenchsight.models.recordings.log_words import LogWords
from wrenchsight.models.recordings.recording_format import (
    PER_CENT,
    PER_MILLE,
    UNITS,
    RecordingFormat,
    SignalColumns,
    by_number,
    column_numbers,
)

_QUANTITIES = ("position", "velocity", "current", "motor_torque")
_FREE_BASE = {"position": 7, "velocity": 6, "motor_torque": 6}  # columns before the joints'
_ENTRY = re.compile(r"(.+)\.(\d{1,4})")  # of an array: its name and number
_DUTY_WORDS = frozenset(("load", "loads", "pwm", "duty"))  # of a servo
_STAMP = "field.header.stamp"
_NUMBERED_NAME = re.compile(r"(?P<word>.*?)[._]?\[?(?P<number>\d{1,4})\]?")  # name[0]
_NAME_OF_ENTRY = re.compile(
    r".*?[._\[](?P<number>\d{1,4})\]?[._/](?P<word>[a-z_]+)"
)  # joints.1.name


class _Column(NamedTuple):
    """A column that holds a signal of a joint, at its place among all columns."""

    place: int
    name: ColumnName


def column_words_layout(
    names: Sequence[str],
    path: Path,
    row_words: RowWords,
    joint_names: Sequence[str] | None,
    words: LogWords,
) -> KnownLayout | None:
    """The description of a table by the words in its columns' names; None without known time.

    There is no doubt where time is named, and position and current or torque of each joint; or
    position and velocity where no name is one of a current or torque. A velocity in doubt is left
    out. Arrays that are no such signal become extra ones.

    Args:
        names: names of the columns.
        path: path of the log, for error lines.
        row_words: row words of the log.
        joint_names: joint names of the robot, base to tool; None: those of the log, in its order.
        words: what the user states.

    Raises:
        InputError: a quantity is there in another number than one a joint, or only positions are;
            as `matched_joints`; or the rows name the joints, but not those of the robot.
    """
    time = _time(names, row_words)
    if time is None:
        return None
    listed = _joints_in_rows(names, row_words)
    series = signal_columns(names, path, joint_names, words, len(listed))
    drives = {"current", "motor_torque"}
    names_drives = not drives.isdisjoint(column_name(name).quantity for name in names)
    # Positions and velocities alone are read, too: who needs currents says so.
    needed = drives if names_drives or "velocity" not in series else {"velocity"}
    is_complete = "position" in series and not needed.isdisjoint(series)
    if not is_complete or _has_broken_series(names, series):
        _refuse_doubt(names, series, joint_names, path)
        return None
    num_joints = len(series["position"].columns)
    series = {key: signal for key, signal in series.items() if len(signal.columns) == num_joints}
    if needed.isdisjoint(series):
        return None
    order = _order_in_rows(listed, num_joints, path, joint_names, words)
    form = RecordingFormat(time=time)
    used_columns = set(column_numbers(time))
    assignments = [f"{', '.join(names[column] for column in column_numbers(time))} as time"]
    torque_names: list[str] = []
    share_notices: list[str] = []
    for key, signal in series.items():
        # A share of a rated value is read as a current of an unknown scale: of which value, the
        # hypotheses find and the user must say. A torque in such shares says nothing more where
        # there are currents.
        is_share = signal.unit in (PER_CENT, PER_MILLE)
        if is_share and key == "motor_torque" and "current" in series:
            continue
        places = [signal.columns[j] for j in order.indices]
        columns = by_number(places, "" if is_share else signal.unit)
        columns.gain = [signal.gain] if signal.gain != 1.0 else []
        setattr(form, "current" if is_share else key, columns)
        if key == "motor_torque" and not signal.unit:
            torque_names = [names[place] for place in places]
        used_columns |= set(places)
        first, last = names[signal.columns[0]], names[signal.columns[-1]]
        scale = f"{signal.gain:g} " if signal.gain != 1.0 else ""
        in_unit = f" in {scale}{signal.unit}" if signal.unit else ""
        if is_share:
            share_notices.append(_share_notice(signal, names))
        assignments.append(f"{first} .. {last} as {key.replace('_', ' ')}{in_unit}")
    notices = [f"columns read by the words in their names: {', '.join(assignments)}"]
    for signal in series.values():
        notices += [x for x in (signal.how, signal.left_out) if x and x not in notices]
    notices += [*share_notices, *order.notices]
    form.extra = _further_arrays(names, used_columns)
    used_columns |= {c for columns in form.extra.values() for c in column_numbers(columns)}
    others = [name for k, name in enumerate(names) if k not in used_columns and name]
    if others:
        notices.append(f"columns left out: {shortened(others)}")
    called_effort = {"effort", "efforts", "eff"}
    is_effort = any(called_effort & set(name_tokens(name)) for name in torque_names)
    return KnownLayout(form, tuple(notices), torque_is_effort=is_effort)


def _time(names: Sequence[str], row_words: RowWords) -> SignalColumns | None:
    """The stamp in a message's header, if there is one that is set, or else the log's time."""
    if _STAMP in names and any(row_words([list(names).index(_STAMP)], False)[0].strip("0.")):
        return by_number([list(names).index(_STAMP)], unit="ns")
    return time_columns(names)


def _further_arrays(names: Sequence[str], used: set[int]) -> dict[str, SignalColumns]:
    """The arrays (NAME.1 .. NAME.k) among the columns that are not used, but of messages' fields.

    Args:
        names: of all columns.
        used: columns that are signals of the joints or the time.
    """
    arrays: dict[str, dict[int, int]] = {}
    for column, name in enumerate(names):
        match = _ENTRY.fullmatch(name)
        if match and column not in used and not name.startswith("field."):
            arrays.setdefault(match[1], {})[int(match[2])] = column
    return {
        re.sub(r"\W", "_", name).strip("_"): by_number([entries[k] for k in sorted(entries)])
        for name, entries in arrays.items()
        if not is_joint_list(name) and _counts(entries)
    }


def _joints_in_rows(names: Sequence[str], row_words: RowWords) -> list[str]:
    """The joints that the rows name, in their order; none where they name none."""
    listed = [column for column, name in enumerate(names) if is_joint_list(name)]
    entries: dict[int, int] = {}
    for column, name in enumerate(names):
        for pattern in (_NUMBERED_NAME, _NAME_OF_ENTRY):
            match = pattern.fullmatch(name)
            if match and is_joint_list(match["word"]):
                entries[int(match["number"])] = column
    if not entries and len(listed) != 1:
        return []
    joints = list(row_words([entries[k] for k in sorted(entries)] or listed))
    return joints if entries or len(joints) > 1 else []  # else a name of the row


def _order_in_rows(
    joints: Sequence[str],
    num_joints: int,
    path: Path,
    joint_names: Sequence[str] | None,
    words: LogWords,
) -> JointOrder:
    """The robot's joints among those that the rows name; as they stand where the rows name none.

    Args:
        joints: that the rows name.
        num_joints: columns of each quantity.
        path, joint_names, words: as `column_words_layout`.
    """
    if not joints:
        return JointOrder(list(range(num_joints)), [])
    if len(joints) != num_joints:
        problem = f"names {len(joints)} joints in a row, but holds {num_joints} positions"
        raise InputError(path, "joints", problem, "write one name for each position")
    order = joint_order(joints, path, joint_names, words)
    if joint_names is not None:
        order.notices.append("joints are put in the robot's order by the names in the rows")
    return order


def _counts(entries: Mapping[int, int]) -> bool:
    """Whether the keys are numbers without a gap, from 0 or 1 on."""
    return sorted(entries) in (list(range(len(entries))), list(range(1, len(entries) + 1)))


class JointColumns(NamedTuple):
    """The columns of one quantity, one for each joint from base to tool.

    Attributes:
        columns: counted from 0.
        unit: as descriptions have it; empty where the names state none.
        how: a sentence on how the joints were matched, or which of several series was taken; empty
            where they are numbered in one.
        left_out: a sentence on columns of the same values, raw or filtered; empty: there are none.
        gain: of the unit.
    """

    columns: list[int]
    unit: str
    how: str
    left_out: str = ""
    gain: float = 1.0


def _share_notice(signal: JointColumns, names: Sequence[str]) -> str:
    """What a current or torque in parts of each drive's rated value needs."""
    listed = ", ".join(names[column] for column in signal.columns)
    return (
        f"{names[signal.columns[0]]} .. are in {signal.unit} of each drive's rated value, which "
        f'the log does not hold: describe them as motor_torque: {{columns: "{listed}", unit: '
        f"{signal.unit}, gain: [rated torque of each joint, N m]}} (--log-format)"
    )


def signal_columns(
    names: Sequence[str],
    path: Path,
    joint_names: Sequence[str] | None,
    words: LogWords,
    num_listed: int = 0,
) -> dict[str, JointColumns]:
    """The columns of all joints by quantity: position, velocity, current, motor_torque.

    A quantity is left out where its columns are not one of each joint, or have several units.

    Args:
        names, path, joint_names, words: as `column_words_layout`.
        num_listed: joints that the rows name, a gripper's among them; 0: they name none.

    Raises:
        InputError: as `matched_joints`.
    """
    num_joints = num_listed or (0 if joint_names is None else len(joint_names))
    by_quantity: dict[str, list[_Column]] = {}
    bare: list[_Column] = []  # names of a joint without a word for a quantity
    others: list[_Column] = []
    clocks = clock_numbers(names)  # t_pos is none of the positions
    for place, name in enumerate(names):
        if place in clocks:
            continue
        column = _Column(place, column_name(name))
        if column.name.quantity:
            by_quantity.setdefault(column.name.quantity, []).append(column)
        else:
            others.append(column)
            bare += [column] if column.name.is_bare else []
    # arm_joint_0 beside arm_joint_vel_0, or else Axis 1 Actual beside Axis 1 Current
    of_joints = {column.name.words for columns in by_quantity.values() for column in columns}
    of_joints -= {()}
    same = [column for column in others if column.name.words in of_joints]
    has_drives = not by_quantity.keys().isdisjoint(("current", "motor_torque"))
    if same or has_drives:
        by_quantity.setdefault("position", same or bare)
    qualified: dict[str, str] = {}  # a sentence on the columns left out, by quantity
    for quantity, columns in by_quantity.items():
        by_quantity[quantity], qualified[quantity] = _without_qualified(columns, names)
    for quantity in ("velocity", "motor_torque"):
        columns = by_quantity.get(quantity, [])
        behind_gear = [column for column in columns if not is_of_drive(names[column.place])]
        by_quantity[quantity] = behind_gear or columns
    joint_columns: dict[str, JointColumns] = {}
    behind_base = _behind_free_base(by_quantity, num_joints, names)
    for quantity in _QUANTITIES:
        columns = by_quantity.get(quantity, [])
        match = (
            behind_base.get(quantity)
            or _numbered(columns, num_joints, quantity, names)
            or _named(columns, joint_names, path, words)
        )
        if match is None:
            continue
        places, how_matched = match  # of the joints, base to tool
        unit_of_place = {column.place: (column.name.unit, column.name.gain) for column in columns}
        units = {unit_of_place[place] for place in places}
        unit, gain = next(iter(units))
        if len(units) == 1 and unit in ("", *UNITS[quantity]):
            left_out = qualified.get(quantity, "")
            joint_columns[quantity] = JointColumns(places, unit, how_matched, left_out, gain)
    return joint_columns


def _without_qualified(
    columns: Sequence[_Column], names: Sequence[str]
) -> tuple[list[_Column], str]:
    """The columns but for those that are raw, filtered or commanded ones of others, and a sentence.

    Of q_1 and q_raw_1 the first is kept; of q_measured_1 and q_raw_1, or q_1 and q_raw_measured_1,
    the one that is not called raw; of qIn_1 and qOut_1 what goes into the controller.
    """
    plain = {column.name.words: column for column in columns if not is_qualified(column.name)}
    values = {without_value_words(words): column for words, column in plain.items()}
    kept: list[_Column] = []
    sentence = ""
    for column in columns:
        words = without_qualifiers(column.name.words)
        other = plain.get(words)
        if other is None and is_raw(column.name):
            other = values.get(without_value_words(words))
        if column.name.words != (measured := as_measured(column.name.words)):
            other = plain.get(measured)
        if other is None or other is column:
            kept.append(column)
        elif not sentence:
            sentence = f"{names[other.place]} .. is read, not {names[column.place]} .."
    return kept, sentence


def _numbered(
    columns: Sequence[_Column], num_joints: int, quantity: str, names: Sequence[str]
) -> tuple[list[int], str] | None:
    """The only series of columns that count through the joints, from 0 or 1 on.

    Of several one that is called measured is the only one, and of positions and velocities then
    one that is not the motors'; a sentence says which one, and which others are not read. Where the
    number of joints is not known (0) the longest count.
    """
    series = _series(columns) | _lettered_series(columns)
    complete = {
        stem: entries
        for stem, entries in series.items()
        if _counts(entries) and num_joints in (0, len(entries))
    }
    if not num_joints:
        longest = max((len(entries) for entries in complete.values()), default=0)
        complete = {stem: x for stem, x in complete.items() if len(x) == longest > 1}
    series_of_joints = complete
    of_place = {column.place: column.name for column in columns}
    measured = {stem: x for stem, x in complete.items() if is_measured(of_place[min(x.values())])}
    complete = measured or complete
    if quantity in ("position", "velocity"):
        of_joints = {stem: x for stem, x in complete.items() if "motor" not in stem}
        complete = of_joints or complete
    complete = _unqualified(complete) or complete
    if len(complete) != 1:
        return None
    (entries,) = complete.values()
    others = [f"{names[min(x.values())]} .." for x in series_of_joints.values() if x != entries]
    how = f"{names[min(entries.values())]} .. is read, not {shortened(others)}" if others else ""
    return [entries[k] for k in sorted(entries)], how


def _behind_free_base(
    by_quantity: Mapping[str, Sequence[_Column]], num_joints: int, names: Sequence[str]
) -> dict[str, tuple[list[int], str]]:
    """The joints' columns behind those of a base that is free to move, and a sentence on that.

    Such a base has 7 positions (a place and a quaternion), and 6 velocities and torques, as in
    MuJoCo's qpos, qvel and qfrc_actuator.

    Returns:
        By quantity; empty where the numbers of positions and velocities are others.
    """
    if not num_joints:
        return {}
    found: dict[str, tuple[list[int], str]] = {}
    for quantity, num_base in _FREE_BASE.items():
        match = _numbered(by_quantity.get(quantity, []), num_base + num_joints, quantity, names)
        if match is not None:
            how = (
                "the first columns are those of a free base (7 positions, 6 velocities): left out; "
                "it must stand still and upright"
            )
            found[quantity] = (match[0][num_base:], how)
    return found if "position" in found and "velocity" in found else {}


def _unqualified(
    complete: Mapping[tuple[str, ...], dict[int, int]],
) -> dict[tuple[str, ...], dict[int, int]]:
    """Of q_1.. and q_raw_1.. the first: the series all of whose words the others have, too."""
    return {
        stem: entries
        for stem, entries in complete.items()
        if all({*stem} < {*other} for other in complete if other != stem)
    }


def _series(columns: Sequence[_Column]) -> dict[tuple[str, ...], dict[int, int]]:
    """The places of columns that differ in one number, by the words around it and that number."""
    series: dict[tuple[str, ...], dict[int, int]] = {}
    for column in columns:
        words = column.name.words
        for k, word in enumerate(words):
            if word.isdigit() and len(word) < 4:
                stem = (*words[:k], "#", *words[k + 1 :])
                series.setdefault(stem, {})[int(word)] = column.place
    return series


def _lettered_series(columns: Sequence[_Column]) -> dict[tuple[str, ...], dict[int, int]]:
    """As `_series`, of columns with a number and a letter of their own: joint_1_s, joint_2_l."""
    letters: dict[tuple[str, ...], dict[int, dict[str, int]]] = {}  # places by number and letter
    for column in columns:
        words = column.name.words
        for k, word in enumerate(words[:-1]):
            letter = words[k + 1]
            if word.isdigit() and len(word) < 4 and len(letter) == 1 and letter.isalpha():
                stem = (*words[:k], "#", *words[k + 2 :])
                numbers = letters.setdefault(stem, {})
                numbers.setdefault(int(word), {})[letter] = column.place
    series: dict[tuple[str, ...], dict[int, int]] = {}
    for stem, numbers in letters.items():
        all_letters = [letter for of_number in numbers.values() for letter in of_number]
        if len(numbers) == len(all_letters) == len({*all_letters}):
            series[stem] = {k: next(iter(x.values())) for k, x in numbers.items()}
    return series


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


def _has_broken_series(names: Sequence[str], found: Mapping[str, JointColumns]) -> bool:
    """Whether plain names (v1, tau2) are there for some joints only: which, the owner must say."""
    letters = {"q": "position", "v": "velocity", "i": "current", "tau": "motor_torque"}
    plain = [re.fullmatch(r"(q|v|i|tau)\d{1,4}", name) for name in names]
    return any(match is not None and letters[match[1]] not in found for match in plain)


def _refuse_doubt(
    names: Sequence[str],
    found: Mapping[str, JointColumns],
    joint_names: Sequence[str] | None,
    path: Path,
) -> None:
    """Says why a table is not read: a quantity is not there once a joint, or only positions are.

    A table with plain names (q1..) is left to the plain header's own error.

    Args:
        names: of the columns.
        found: quantities that are there for all joints.
        joint_names: of the robot; None: any number of joints.
        path: of the log.

    Raises:
        InputError: unless no name has a word for a quantity.
    """
    if any(re.fullmatch(r"(q|v|i|tau)\d{1,4}", name) for name in names):
        return
    columns_of: dict[str, list[_Column]] = {}
    for place, name in enumerate(names):
        column = column_name(name)
        key = "position" if column.is_bare else column.quantity
        if key and (column.words or not column.is_bare):
            columns_of.setdefault(key, []).append(_Column(place, column))
    commanded = [name for name in names if is_commanded(name)]
    if commanded and "position" not in columns_of:
        problem = f"names commanded values only ({shortened(commanded)}), no measured position"
        remedy = "record the measured positions, and currents or torques (actual_q, actual_current)"
        raise InputError(path, "header", problem, remedy)
    doubtful = [key for key in ("position", "current", "motor_torque")
                if key in columns_of and key not in found]  # fmt: skip
    drives = {"current", "motor_torque"}
    if "position" in columns_of and drives.isdisjoint(columns_of):
        if all(column.name.is_bare for column in columns_of["position"]):
            num_joints = 0 if joint_names is None else len(joint_names)
            if _numbered(columns_of["position"], num_joints, "position", names) is None:
                return  # such as a column Value
        raise _no_drives(columns_of["position"], found, names, joint_names, path)
    if "position" not in columns_of and not drives.isdisjoint(columns_of):
        key = next(key for key in ("current", "motor_torque") if key in columns_of)
        listed = shortened([names[column.place] for column in columns_of[key]])
        problem = f"names no joint positions beside the {key.replace('_', ' ')}s ({listed})"
        raise InputError(path, "header", problem, f"call them position 1.., {DESCRIBE}")
    if doubtful:
        key = doubtful[0]
        raise _doubt_of(key, columns_of[key], names, joint_names, path, "position" in found)


def _no_drives(
    columns: Sequence[_Column],
    found: Mapping[str, JointColumns],
    names: Sequence[str],
    joint_names: Sequence[str] | None,
    path: Path,
) -> InputError:
    """The error of a table of positions without currents; arguments as `_refuse_doubt`."""
    num_joints = 0 if joint_names is None else len(joint_names)
    match = _numbered(columns, num_joints, "position", names)
    if match is not None:
        places = match[0]
    elif "position" in found:
        places = found["position"].columns
    else:
        places = [column.place for column in columns]
    first, last = names[places[0]], names[places[-1]]
    problem = f"holds joint positions ({first} .. {last}), but no motor current or joint torque"
    duties = [name for name in names if not _DUTY_WORDS.isdisjoint(name_tokens(name))]
    if len(duties) > 1:
        problem += f"; {shortened(duties[:2])} .. is a servo's duty cycle, which is neither"
    remedy = "record the motors' currents or torques beside them (of an ABB arm through EGM: "
    remedy += "test signals of the motors' torque), from which the wrench is estimated"
    return InputError(path, "header", problem, remedy)


def _doubt_of(
    quantity: str,
    columns: Sequence[_Column],
    names: Sequence[str],
    joint_names: Sequence[str] | None,
    path: Path,
    has_positions: bool,
) -> InputError:
    """The error of a quantity that is not there once a joint.

    Args:
        quantity: key of a description.
        columns: of that quantity.
        names, joint_names, path: as `_refuse_doubt`.
        has_positions: whether the position of each joint is there: then the robot is the log's.
    """
    words = quantity.replace("_", " ")
    plural = words.replace("velocity", "velocitie") + "s"
    listed = shortened([names[column.place] for column in columns])
    counting = [x for x in _series(columns).values() if _counts(x) and len(x) > 1]
    lengths = {len(x) for x in counting}
    num_joints = 0 if joint_names is None else len(joint_names)
    if joint_names is not None and len(lengths) == 1 and num_joints not in lengths:
        count = lengths.pop()
        problem = f"numbers {count} {plural} ({listed}), but the robot has {num_joints} joints"
        remedy = f"give the robot that the log comes from, {DESCRIBE}"
        if has_positions and count < num_joints:
            remedy = f"record those of all joints, {DESCRIBE}"
        elif count == num_joints + 1:
            remedy = f"if one is a gripper's, leave it out; else {remedy}"
        return InputError(path, "header", problem, remedy)
    if joint_names is not None and len(columns) < num_joints:
        problem = f"names {len(columns)} {plural} ({listed}), but the robot has {num_joints} "
        problem += f"joints: {', '.join(joint_names)}"
        return InputError(path, "header", problem, f"record all of its joints, {DESCRIBE}")
    complete = [x for x in counting if num_joints in (0, len(x))]
    if len(complete) > 1:
        firsts = shortened([f"{names[min(x.values())]} .." for x in complete])
        problem = f"names {len(complete)} series of {plural} ({firsts}), but not which counts"
        return InputError(path, "header", problem, f"leave one of them, {DESCRIBE}")
    if joint_names is not None and len(columns) == num_joints:
        problem = f"names {num_joints} {plural}, but neither by the robot's joints "
        problem += f"({', '.join(joint_names)}) nor by numbers: {listed}"
        remedy = f"call them {words} 1.. from base to tool, {DESCRIBE}"
        return InputError(path, "header", problem, remedy)
    problem = f"names {plural} that are not one for each joint of the robot, by number or name: "
    problem += listed
    remedy = f"leave one for each joint and call it {words} 1.. from base to tool, {DESCRIBE}"
    return InputError(path, "header", problem, remedy)
