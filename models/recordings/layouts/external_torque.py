"""Logs of external joint torque, as arms with torque sensors report it, known by their columns.

Wanted are the time, the external torque of every joint and, to read a wrench from it, either the
Jacobian or the joint positions:

    t, timestamp, time, __time; or seconds and nanoseconds
    tau_ext_1.., external_torque[0]..       N m, on the robot from outside; numbered from 0 or 1
    tau_ext_hat_filtered_0.., tau_ext_hat[0]..      N m, as Franka reports it: what the arm exerts
                                                     against the outside, so that it is turned
    jacobian_0_0 .. jacobian_5_6 or J_1_1 ..; or jacobian.1 .., row by row
    q1.., q_0.., joint_position[0]..        rad; and v1.., dq_0.., joint_velocity[0].. rad/s

each with the topic that it comes from before it, if there is one (/states/tau_ext_hat_filtered[0]).
All other columns are left alone. Rows of the Jacobian are linear first, as in every file.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.layouts.header_layouts import KnownLayout, time_columns
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_format import (
    ENVIRONMENT,
    RecordingFormat,
    SignalColumns,
)
from wrenchsight.models.rigid_body.spatial_vectors import FORCE_FIRST

TAU_EXT, JACOBIAN = "tau_ext", "jacobian"  # the signals of a recording
_TIMES = ("t", "time", "timestamp", "__time")
_INDEX = r"(?:[._]?(\d+)|\[(\d+)\])"
_TORQUE = re.compile(
    rf"(?:.*/)?(?:tau_ext(?:_hat)?(?:_filtered)?|external_?torques?){_INDEX}", re.I
)
_AGAINST = re.compile(r"tau_ext_hat", re.I)
_POSITION = re.compile(rf"(?:.*/)?(?:q|joint_?positions?){_INDEX}", re.I)
_VELOCITY = re.compile(rf"(?:.*/)?(?:v|dq|joint_?velocit(?:y|ies)){_INDEX}", re.I)
_ENTRY = re.compile(r"(?:.*/)?(?:jacobian|J)(?:_(\d+)_(\d+)|\[(\d+)\]\[(\d+)\])", re.I)
_FLAT = re.compile(rf"(?:.*/)?jacobian{_INDEX}", re.I)
_Key = TypeVar("_Key", int, tuple[int, int])
_UNIT_LENGTH = 0.02  # how far a Jacobian's angular column may be from length 1
_DESCRIBE = "name its columns in a description (--log-format), extra, jacobian, linear rows first"


def external_torque_layout(names: Sequence[str], path: Path) -> KnownLayout | None:
    """The description of a log of external torque; None: the log is not of this kind.

    Raises:
        InputError: it is one, but columns are missing in the middle, or there is neither a
            Jacobian nor a position for each joint.
    """
    torque = _numbered(names, _TORQUE)
    time = next((k for k, name in enumerate(names) if name.lower() in _TIMES), None)
    times = time_columns(names) if time is None else SignalColumns(str(time + 1))
    if not torque or times is None:
        return None
    form = RecordingFormat(time=times)
    n = len(torque)
    form.extra[TAU_EXT] = _columns(torque, range(min(torque), min(torque) + n), TAU_EXT, path)
    notices: tuple[str, ...] = (f"read as a log of the external torque of {n} joints",)
    if all(_AGAINST.search(names[column]) for column in torque.values()):
        form.extra[TAU_EXT].exerted_on = ENVIRONMENT
        notices += (
            f"{names[torque[min(torque)]]} and further are taken as Franka reports them, as what "
            "the arm exerts against the outside, and turned; --torque-sign robot reads them as "
            "they stand",
        )
    entries = {
        (int(m[1] or m[3]), int(m[2] or m[4])): k
        for k, name in enumerate(names)
        if (m := _ENTRY.fullmatch(name))
    }
    flat, position = _numbered(names, _FLAT), _numbered(names, _POSITION)
    if entries:
        row, column = (min(key[axis] for key in entries) for axis in (0, 1))
        wanted = [(row + i, column + j) for i in range(6) for j in range(n)]
        form.extra[JACOBIAN] = _columns(entries, wanted, JACOBIAN, path)
    elif flat:
        wanted_flat = range(min(flat), min(flat) + 6 * n)
        form.extra[JACOBIAN] = _columns(flat, wanted_flat, JACOBIAN, path)
    if entries or flat:
        form.extra[JACOBIAN].shape = [6, n]
    elif not position:
        problem = f"holds the external torque of {n} joints, but neither a Jacobian nor positions"
        raise InputError(path, "header", problem, "add q1.. and name the robot, or " + _DESCRIBE)
    if position:
        form.position = _columns(position, range(min(position), min(position) + n), "q", path)
        velocity = _numbered(names, _VELOCITY)
        if set(range(min(position), min(position) + n)) <= set(velocity):
            form.velocity = _columns(velocity, range(min(position), min(position) + n), "v", path)
    return KnownLayout(form, notices)


def jacobians(recording: Recording) -> Array:
    """The Jacobians of a recording (T, 6, n), rows [angular; linear].

    A revolute joint turns all that it carries at its own speed: its angular column has length 1 in
    any axes. That tells the order of the rows.

    Raises:
        InputError: it is no Jacobian in SI units with linear rows first.
    """
    J = np.asarray(recording.extra[JACOBIAN])[:, FORCE_FIRST]
    some = J[:: max(1, len(J) // 100)]
    if _may_be_jacobian(some):
        return J
    remedy = _DESCRIBE
    if _may_be_jacobian(some[:, FORCE_FIRST]):
        problem = "has its angular rows first"
    elif any(_may_be_jacobian(one) for one in _column_by_column(some[:, FORCE_FIRST])):
        problem = "is written column by column"
    else:
        length = np.linalg.norm(some[:, :3], axis=1).mean(axis=0)
        shown = " ".join(f"{value:.3g}" for value in length)
        problem = f"is not one: angular columns have lengths {shown}, expected 1 (a prismatic: 0)"
    raise InputError(recording.source, JACOBIAN, problem, remedy)


def _column_by_column(J: Array) -> tuple[Array, Array]:
    """What (N, 6, n) would be if its numbers stood column by column, in either order of rows."""
    turned = J.reshape(len(J), -1, 6).transpose(0, 2, 1)
    return turned, turned[:, FORCE_FIRST]


def _may_be_jacobian(J: Array) -> bool:
    """Whether (N, 6, n), angular rows first, can be a geometric Jacobian in SI units."""
    angular, linear = (np.linalg.norm(J[:, part], axis=1) for part in (slice(0, 3), slice(3, 6)))
    revolute = np.abs(angular - 1.0) < _UNIT_LENGTH
    prismatic = (angular < _UNIT_LENGTH) & (np.abs(linear - 1.0) < _UNIT_LENGTH)
    missing = ~np.isfinite(angular)
    return bool((revolute | prismatic | missing).all())


def _numbered(names: Sequence[str], pattern: re.Pattern[str]) -> dict[int, int]:
    """Number of the entry: column (0-based), of the names that a pattern takes."""
    found: dict[int, int] = {}
    for column, name in enumerate(names):
        match = pattern.fullmatch(name)
        if match:
            found.setdefault(int(match[1] or match[2]), column)
    return found


def _columns(
    found: Mapping[_Key, int], wanted: Sequence[_Key], what: str, path: Path
) -> SignalColumns:
    """The columns of what is wanted, in that order."""
    missing = [key for key in wanted if key not in found]
    if missing:
        shown = "_".join(str(part) for part in np.atleast_1d(missing[0]))
        more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
        raise InputError(path, "header", f"lacks {what}_{shown}{more}", "export it whole")
    return SignalColumns(", ".join(str(found[key] + 1) for key in wanted))
