"""Recognises logs of arrays with usual names: npz files of other tools, Parquet files with lists,
tables with a numbered column for each joint.

`times` (T,), `positions` (T, n), `velocities` (T, n), `torques` (T, n) and the like. Their columns
are numbered (`positions.1`.., as `npz_table` and `parquet_table` name them), from 0 or 1 on, with
or without brackets, and may follow the topic or object that they come from: `state.q[0]`,
`/joint_states/position[0]`, `field.position0`.

Where the rows name the joints (a Parquet column `name` of lists of words, or `field.name0`.. as
`rostopic echo -p` writes them), the joints are put in the robot's order.
"""

import re
from collections.abc import Sequence
from pathlib import Path

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.layouts.header_layouts import (
    JointOrder,
    KnownLayout,
    joint_order,
)
from wrenchsight.models.recordings.layouts.time_names import time_columns
from wrenchsight.models.recordings.log_container import RowWords
from wrenchsight.models.recordings.log_words import LogWords
from wrenchsight.models.recordings.recording_format import (
    RecordingFormat,
    SignalColumns,
    by_number,
    column_numbers,
)

_ARRAYS = {
    "position": ("q", "qpos", "position", "positions", "joint_position", "joint_positions",
                 "observation.state"),
    "velocity": ("v", "dq", "qd", "qdot", "qvel", "velocity", "velocities", "joint_velocity",
                 "joint_velocities"),
    "current": ("i", "current", "currents", "motor_current", "motor_currents", "joint_current",
                "joint_currents"),
    "motor_torque": ("tau", "tau_J", "torque", "torques", "motor_torque", "motor_torques",
                     "joint_torque", "joint_torques", "effort", "efforts"),
}  # fmt: skip
_NAMES = ("name", "names", "joint_name", "joint_names")
_NUMBERED = re.compile(r"(.*?)[._]?\[?(\d{1,4})\]?")
_STAMP = "field.header.stamp"


def array_layout(
    names: Sequence[str],
    path: Path,
    row_words: RowWords,
    joint_names: Sequence[str] | None,
    words: LogWords,
) -> KnownLayout | None:
    """The description of a log of arrays such as q.1..q.6; None without known time or positions.

    Of the arrays whose names are known words for a quantity (_ARRAYS), those with as many entries
    as there are positions become its columns, in the robot's order of joints; all other arrays
    become extra signals, but those that name joints.

    Args:
        names: names of the columns.
        path: path of the log, for error lines.
        row_words: row words of the log.
        joint_names: joint names of the robot, base to tool; None: those of the log, in its order.
        words: what the user states.

    Raises:
        InputError: the rows name the joints, but not those of the robot.
    """
    series: dict[str, dict[int, int]] = {}  # by array's name and number of the entry: the column
    for column, name in enumerate(names):
        match = _NUMBERED.fullmatch(name)
        if match and match[1]:
            series.setdefault(match[1], {})[int(match[2])] = column
    # Columns of each array whose entries are numbered without a gap, from 0 or 1.
    arrays = {
        name: [columns[number] for number in sorted(columns)]
        for name, columns in series.items()
        if sorted(columns) in (list(range(len(columns))), list(range(1, len(columns) + 1)))
    }
    time = _time(names, row_words)
    if time is None:
        return None
    form = RecordingFormat(time=time)
    time_names = " and ".join(names[column] for column in column_numbers(time))
    assignments = [f"{time_names} as time"]
    array_of = {key: _array(arrays, array_words) for key, array_words in _ARRAYS.items()}
    position = array_of["position"]
    if position is None:
        return None
    num_joints = len(arrays[position])
    order = _order(names, arrays, num_joints, path, row_words, joint_names, words)
    for key, array in array_of.items():  # no array has two keys: their words differ
        if array is not None and len(arrays[array]) == num_joints:
            columns = arrays.pop(array)  # what is left is no signal of the joints
            setattr(form, key, by_number([columns[j] for j in order.indices]))
            assignments.append(f"{array} as {key.replace('_', ' ')}")
    # Not what `rostopic echo -p` writes beside the joints' arrays (field.header.seq and the like).
    joint_name_arrays = [name for name in arrays if _last_word(name) in _NAMES]
    form.extra = {
        re.sub(r"\W", "_", name).strip("_"): by_number(columns)
        for name, columns in arrays.items()
        if name not in joint_name_arrays and not name.startswith("field.")
    }
    torque_array = array_of["motor_torque"] or ""
    is_effort = form.motor_torque is not None and "effort" in _last_word(torque_array)
    notices = (f"arrays read by their names: {', '.join(assignments)}", *order.notices)
    return KnownLayout(form, notices, torque_is_effort=is_effort)


def _time(names: Sequence[str], row_words: RowWords) -> SignalColumns | None:
    """The stamp in a message's header, if there is one, or else the log's time."""
    if _STAMP in names and any(row_words([list(names).index(_STAMP)], False)[0].strip("0.")):
        return by_number([list(names).index(_STAMP)], unit="ns")
    return time_columns(names)


def _array(arrays: dict[str, list[int]], array_words: Sequence[str]) -> str | None:
    """The only array whose name is one of these words, or ends in one; the first word counts."""
    for word in array_words:
        if word in arrays:
            return word
    for word in array_words:
        matching = [name for name in arrays if _last_word(name) == word.lower()]
        if len(matching) == 1:
            return matching[0]
    return None


def _last_word(name: str) -> str:
    return re.split(r"[/.]", name)[-1].lower()


def _order(
    names: Sequence[str],
    arrays: dict[str, list[int]],
    num_joints: int,
    path: Path,
    row_words: RowWords,
    joint_names: Sequence[str] | None,
    words: LogWords,
) -> JointOrder:
    """The robot's joints among those that the rows name; the log's order where they name none."""
    listed = [column for column, name in enumerate(names) if _last_word(name) in _NAMES]
    numbered = [columns for name, columns in arrays.items() if _last_word(name) in _NAMES]
    if len(listed) != 1 and len(numbered) != 1:
        return JointOrder(list(range(num_joints)), [])
    joints = list(row_words(numbered[0] if len(numbered) == 1 else listed))
    if len(joints) != num_joints:
        if len(joints) < num_joints and len(numbered) != 1:
            return JointOrder(list(range(num_joints)), [])  # a name of the row, not of its joints
        problem = f"names {len(joints)} joints in a row, but holds {num_joints} positions"
        raise InputError(path, "joints", problem, "write one name for each position")
    order = joint_order(joints, path, joint_names, words)
    if joint_names is not None:
        order.notices.append("joints are put in the robot's order by the names in the rows")
    return order
