"""Recognises logs of arrays with usual names: npz files of other tools, Parquet files with lists.

`times` (T,), `positions` (T, n), `velocities` (T, n), `torques` (T, n) and the like. Their columns
are numbered (`positions.1`..), as `npz_table` and `parquet_table` name them.
"""

import re
from collections.abc import Sequence

from wrenchsight.models.recordings.layouts.header_layouts import KnownLayout
from wrenchsight.models.recordings.layouts.plain_header import TIME_WORDS
from wrenchsight.models.recordings.recording_format import RecordingFormat, by_number

_ARRAYS = {
    "position": ("q", "qpos", "position", "positions", "joint_position", "joint_positions"),
    "velocity": ("v", "dq", "qd", "qdot", "qvel", "velocity", "velocities", "joint_velocity",
                 "joint_velocities"),
    "current": ("i", "current", "currents", "motor_current", "motor_currents", "joint_current",
                "joint_currents"),
    "motor_torque": ("tau", "tau_J", "torque", "torques", "motor_torque", "motor_torques",
                     "joint_torque", "joint_torques", "effort", "efforts"),
}  # fmt: skip


def array_layout(names: Sequence[str]) -> KnownLayout | None:
    """The description of a log of such arrays; None where time or positions have other names.

    Args:
        names: of the columns.
    """
    arrays: dict[str, list[int]] = {}
    for column, name in enumerate(names):
        match = re.fullmatch(r"(q|v|i|tau)(\d{1,4})", name) or re.fullmatch(
            r"(.+)\.(\d{1,4})", name
        )
        if match and int(match[2]) == len(arrays.get(match[1], [])) + 1:
            arrays.setdefault(match[1], []).append(column)
    time = next((list(names).index(word) for word in TIME_WORDS if word in names), None)
    if time is None:
        return None
    form = RecordingFormat(time=by_number([time]))
    assignments = [f"{names[time]} as time"]
    for key, words in _ARRAYS.items():
        word = next((word for word in words if word in arrays), None)
        if word is not None:
            setattr(form, key, by_number(arrays.pop(word)))
            assignments.append(f"{word} as {key.replace('_', ' ')}")
    if form.position is None:
        return None
    form.extra = {name: by_number(columns) for name, columns in arrays.items()}
    is_effort = form.motor_torque is not None and any("effort" in text for text in assignments)
    notices = (f"arrays read by their names: {', '.join(assignments)}",)
    return KnownLayout(form, notices, torque_is_effort=is_effort)
