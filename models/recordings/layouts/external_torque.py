"""Recognises logs of external joint torque, as arms with torque sensors report it.

Such a log has the time, the external torque of every joint and, to estimate a wrench, either the
Jacobian or the joint positions:

    t, timestamp, time, __time; or seconds and nanoseconds
    tau_ext_1.., external_torque[0]..       N m, on the robot from outside; numbered from 0 or 1
    tau_ext_hat_filtered_0.., tau_ext_hat[0]..      N m, as Franka reports it: exerted by the arm on
                                                     the environment, so that its sign is changed
    jacobian_0_0 .. jacobian_5_6 or J_1_1 ..; or jacobian.1 .., row by row
    q1.., q_0.., joint_position[0]..        rad; and v1.., dq_0.., joint_velocity[0].. rad/s
    tau_J_0.., tau_J[0]..                   N m, of the arm's sensors, with gravity: motor torque

Each name may follow the topic or object it comes from (/states/tau_ext_hat_filtered[0],
state.tau_ext_hat_filtered[0]). Other columns are not read. The linear rows of the Jacobian come
first, as in every file.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.layouts.header_layouts import KnownLayout
from wrenchsight.models.recordings.layouts.time_names import time_columns
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_format import (
    ENVIRONMENT,
    TAU_EXT,
    RecordingFormat,
    SignalColumns,
)
from wrenchsight.models.rigid_body.spatial_vectors import FORCE_FIRST

JACOBIAN = "jacobian"  # the signal of a recording
_INDEX = r"(?:[._]?(\d+)|\[(\d+)\])"
_TORQUE = re.compile(
    rf"(?:.*[/.])?(?:tau_ext(?:_hat)?(?:_filtered)?|external_?torques?){_INDEX}", re.I
)
_JOINT_TORQUE = re.compile(rf"(?:.*[/.])?tau_?J{_INDEX}")  # not dtau_J, tau_J_d
_FRANKA_TORQUE = re.compile(r"tau_ext_hat", re.I)
_POSITION = re.compile(rf"(?:.*[/.])?(?:q|joint_?positions?){_INDEX}", re.I)
_VELOCITY = re.compile(rf"(?:.*[/.])?(?:v|dq|joint_?velocit(?:y|ies)){_INDEX}", re.I)
_JACOBIAN_ENTRY = re.compile(r"(?:.*[/.])?(?:jacobian|J)(?:_(\d+)_(\d+)|\[(\d+)\]\[(\d+)\])", re.I)
_FLAT_JACOBIAN = re.compile(rf"(?:.*[/.])?jacobian{_INDEX}", re.I)
_Key = TypeVar("_Key", int, tuple[int, int])
_CHECKED_SAMPLES = 100  # Jacobians of a log, evenly spread, that are looked at
_UNIT_LENGTH = 0.02  # by which the length of an angular column of a Jacobian may differ from 1
_DESCRIBE = "name its columns in a description (--log-format), extra, jacobian, linear rows first"


def external_torque_layout(names: Sequence[str], path: Path) -> KnownLayout | None:
    """The description of a log of external torque; None where the log is not of this kind.

    The torque becomes the extra signal TAU_EXT, positive along the motion that it causes, a
    Jacobian the extra signal JACOBIAN.

    Args:
        names: names of the columns; those of torques, positions and velocities end in a number.
        path: path of the log, for error lines.

    Raises:
        InputError: the log is of this kind, but columns are missing in between, or it has neither
            a Jacobian nor a position for each joint.
    """
    torque = _numbered(names, _TORQUE)  # column by the joint's number in its name, as below
    times = time_columns(names)
    if not torque or times is None:
        return None
    form = RecordingFormat(time=times)
    n = len(torque)
    form.extra[TAU_EXT] = _columns(torque, _joint_numbers(torque, n), names, path)
    notices: tuple[str, ...] = (f"read as a log of the external torque of {n} joints",)
    if all(_FRANKA_TORQUE.search(names[column]) for column in torque.values()):
        form.extra[TAU_EXT].exerted_on = ENVIRONMENT
        notices += (
            f"the sign of {names[torque[min(torque)]]} and the other torques is changed: Franka "
            "reports the torque that the arm exerts on the environment; add --torque-sign robot to "
            "read them as they are",
        )
    measured = _numbered(names, _JOINT_TORQUE)
    if len(measured) == n:
        form.motor_torque = _columns(measured, _joint_numbers(measured, n), names, path)
        first, last = names[measured[min(measured)]], names[measured[max(measured)]]
        notices += (
            f"{first} .. {last}, the measured joint torques, are read as motor torque: `identify` "
            "and `estimate` with --model take them, `estimate` without a model the external ones",
        )
    jacobian = _jacobian_columns(names, n, path)
    if jacobian is not None:
        form.extra[JACOBIAN] = jacobian
    position = _numbered(names, _POSITION)
    if jacobian is None and not position:
        problem = f"holds the external torque of {n} joints, but neither a Jacobian nor positions"
        raise InputError(path, "header", problem, "add q1.. and name the robot, or " + _DESCRIBE)
    if position:
        joint_numbers = _joint_numbers(position, n)
        form.position = _columns(position, joint_numbers, names, path)
        velocity = _numbered(names, _VELOCITY)
        if set(joint_numbers) <= set(velocity):
            form.velocity = _columns(velocity, joint_numbers, names, path)
    return KnownLayout(form, notices)


def _joint_numbers(numbered: Mapping[int, int], n: int) -> range:
    """The numbers of n joints, from the smallest one on, which is 0 or 1."""
    return range(min(numbered), min(numbered) + n)


def _jacobian_columns(names: Sequence[str], n: int, path: Path) -> SignalColumns | None:
    """The columns of the Jacobian (6, n), row by row; None where there are none."""
    entries: dict[tuple[int, int], int] = {}  # column by row and joint
    for column, name in enumerate(names):
        match = _JACOBIAN_ENTRY.fullmatch(name)
        if match:
            entries[int(match[1] or match[3]), int(match[2] or match[4])] = column
    flat = _numbered(names, _FLAT_JACOBIAN)
    if entries:
        top_row = min(row for row, _ in entries)
        base_joint = min(joint for _, joint in entries)
        keys = [(top_row + i, base_joint + j) for i in range(6) for j in range(n)]
        jacobian = _columns(entries, keys, names, path)
    elif flat:
        jacobian = _columns(flat, range(min(flat), min(flat) + 6 * n), names, path)
    else:
        return None
    jacobian.shape = [6, n]
    return jacobian


def jacobians(recording: Recording) -> Array:
    """The Jacobians of a recording (T, 6, n), rows [angular; linear].

    The extra signal JACOBIAN has its linear rows first, row by row; FORCE_FIRST exchanges them with
    the angular ones. About a hundred samples are checked.

    The angular column of a revolute joint has length 1 in any axes: all links that it carries turn
    at its rate. This shows the order of the rows.

    Raises:
        InputError: the columns are no Jacobian in SI units with linear rows first.
    """
    J = np.asarray(recording.extra[JACOBIAN])[:, FORCE_FIRST]
    sample = J[:: max(1, len(J) // _CHECKED_SAMPLES)]
    if _may_be_jacobian(sample):
        return J
    as_logged = sample[:, FORCE_FIRST]
    if _may_be_jacobian(as_logged):
        problem = "has its angular rows first"
    elif any(_may_be_jacobian(reading) for reading in _column_by_column(as_logged)):
        problem = "is written column by column"
    else:
        length = np.linalg.norm(sample[:, :3], axis=1).mean(axis=0)
        lengths = " ".join(f"{value:.3g}" for value in length)
        problem = (
            f"is no Jacobian: its angular columns have lengths {lengths}, expected 1 (0 for a "
            "prismatic joint)"
        )
    raise InputError(recording.source, JACOBIAN, problem, _DESCRIBE)


def _column_by_column(J: Array) -> tuple[Array, Array]:
    """(N, 6, n) with its numbers read column by column, in either order of rows."""
    transposed = J.reshape(len(J), -1, 6).transpose(0, 2, 1)
    return transposed, transposed[:, FORCE_FIRST]


def _may_be_jacobian(J: Array) -> bool:
    """Whether (N, 6, n), angular rows first, can be a geometric Jacobian in SI units."""
    angular = np.linalg.norm(J[:, :3], axis=1)
    linear = np.linalg.norm(J[:, 3:], axis=1)
    is_revolute = np.abs(angular - 1.0) < _UNIT_LENGTH
    is_prismatic = (angular < _UNIT_LENGTH) & (np.abs(linear - 1.0) < _UNIT_LENGTH)
    is_missing = ~np.isfinite(angular)
    return bool((is_revolute | is_prismatic | is_missing).all())


def _numbered(names: Sequence[str], pattern: re.Pattern[str]) -> dict[int, int]:
    """The columns (from 0) whose names match a pattern, by the number in their names."""
    columns: dict[int, int] = {}
    for column, name in enumerate(names):
        match = pattern.fullmatch(name)
        if match:
            columns.setdefault(int(match[1] or match[2]), column)
    return columns


def _name_like(name: str, key: int | tuple[int, int]) -> str:
    """A column's name with these numbers in place of its last ones."""
    parts = re.split(r"(\d+)", name)  # every other part is a number
    numbers = [str(number) for number in np.atleast_1d(key)]
    places = range(1, len(parts), 2)[-len(numbers) :]
    for place, number in zip(places, numbers, strict=True):
        parts[place] = number
    return "".join(parts)


def _columns(
    columns: Mapping[_Key, int], keys: Sequence[_Key], names: Sequence[str], path: Path
) -> SignalColumns:
    """The columns of a signal, one for each key.

    Args:
        columns: of the signal, by key: the numbers in their names.
        keys: of the columns that the signal needs.
        names: of all columns.
        path: path of the log, for error lines.

    Raises:
        InputError: a key has no column.
    """
    missing = [key for key in keys if key not in columns]
    if missing:
        others = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
        problem = f"lacks {_name_like(names[next(iter(columns.values()))], missing[0])}{others}"
        raise InputError(path, "header", problem, "export all of its columns")
    return SignalColumns(", ".join(str(columns[key] + 1) for key in keys))
