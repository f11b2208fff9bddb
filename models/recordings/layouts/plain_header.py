"""The layout of a log with the standard header t,q1..qn,v1..vn,i1..in."""

import difflib
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.layouts.shortened_list import shortened
from wrenchsight.models.recordings.layouts.time_names import time_columns
from wrenchsight.models.recordings.recording_format import (
    RecordingFormat,
    SignalColumns,
    column_numbers,
)

_DESCRIBE = "or describe the columns with --log-format (`wrenchsight log` drafts that)"
_WRENCH = re.compile(r"[fmt][_ ]?[xyz]|(force|torque|moment|wrench)([_ ]?[xyz\d])?", re.IGNORECASE)
_ID_COLUMNS = ("frame_id", "seq", "header.frame_id", "header.seq")  # beside a stamp
_JOINT_SIGNALS = {"q": "position", "v": "velocity", "i": "current", "tau": "motor_torque"}


class PlainHeader(NamedTuple):
    """The description of a log with a plain header, and the columns that are none of it."""

    form: RecordingFormat
    others: tuple[str, ...]


def header_format(names: Sequence[str], path: Path, num_joints: int | None = None) -> PlainHeader:
    """The description of a log with the header t,q1..qn,v1..vn,i1..in.

    Motor torque is tau1..taun, a flag of bridged samples dropout, and name.1..name.k a further
    signal. Other columns are left out where all joints have their signals, and v too.

    Args:
        names: names of the columns.
        path: path of the log, for error lines.
        num_joints: n; None: the largest number of a column q or v.

    Raises:
        InputError: a column is missing or named twice; one is unknown, and a joint's is missing.
    """
    time = None if "t" in names else time_columns(names)
    time_numbers = column_numbers(time) if time else []
    # A column without a name is a table's index, or follows a separator at the end of the line.
    signal_names = [name for k, name in enumerate(names) if name and k not in time_numbers]
    header = _read_names(signal_names, path, has_time_columns=time is not None)
    numbers = header.joint_numbers  # numbers of the joints, from 1, by letter: q, v, i, tau
    n = num_joints or max([*numbers["q"], *numbers["v"]], default=1)
    signals = ["q"]  # that the log must hold for every joint
    signals += [letter for letter in ("v", "tau") if numbers[letter]]
    if numbers["i"] or not numbers["tau"]:
        signals.append("i")
    missing = ["t"] if "t" not in signal_names and time is None else []
    missing += [f"{x}{j}" for x in signals for j in range(1, n + 1) if j not in numbers[x]]
    for name, entries in header.extra.items():
        missing += [f"{name}.{k}" for k in range(1, max(entries) + 1) if k not in entries]
    # What is wrong, the most telling error first: an unknown name may be a signal that is missing
    # (only beside a whole set, with v too, is it no misspelt one), and a joint too many matters
    # only where none is missing.
    is_complete = not missing and bool(numbers["v"])
    if header.others and not is_complete:
        if not any(numbers.values()):
            raise _no_known_column(signal_names, path)
        raise _unknown_column(header.others[0], path)
    if missing and signal_names and not any(numbers.values()):
        raise _no_known_column(signal_names, path)
    if missing:
        problem = f"lacks the column{'s' if len(missing) > 1 else ''} {shortened(missing)}"
        remedy = f"expected t,q1..q{n},v1..v{n},i1..i{n}; correct the header, {_DESCRIBE}"
        raise InputError(path, "header", problem, remedy)
    surplus = [f"{x}{j}" for x in signals for j in numbers[x] if j > n]
    if surplus:
        problem = (
            f"has the column{'s' if len(surplus) > 1 else ''} {shortened(surplus)}, expected {n} "
            "joints"
        )
        remedy = "if they are a gripper's, leave them out; else give the robot that the log "
        remedy += "comes from"
        raise InputError(path, "header", problem, remedy)
    form = RecordingFormat(time=time or SignalColumns("t"))
    for letter in signals:
        setattr(form, _JOINT_SIGNALS[letter], SignalColumns(f"{letter}{{1..{n}}}"))
    for name, entries in header.extra.items():
        form.extra[name] = SignalColumns(f"{name}.{{1..{max(entries)}}}")
    if "dropout" in signal_names:
        form.extra["dropout"] = SignalColumns("dropout")
    return PlainHeader(form, tuple(header.others))


# What a recording holds anyhow: a further signal cannot have one of these names.
_RECORDING_SIGNALS = ("t", "q", "v", "current", "tau_J", "dropout")


class _HeaderNumbers(NamedTuple):
    """The numbers that a header names."""

    joint_numbers: dict[str, list[int]]  # of the joints, by letter: a key of _JOINT_SIGNALS
    extra: dict[str, list[int]]  # of the entries of further signals, by name
    others: list[str]  # columns of neither


def _read_names(names: Sequence[str], path: Path, has_time_columns: bool) -> _HeaderNumbers:
    """Sorts the names of a header: joints' signals, entries of further signals, and others.

    Args:
        names: of the columns, without those of the time.
        path: path of the log, for error lines.
        has_time_columns: whether other columns than t hold the time; identifiers of messages may
            then stand beside them.

    Raises:
        InputError: a name stands for two columns.
    """
    counts = Counter(names)
    for name in names:
        if counts[name] > 1:
            problem = f'names the column "{name}" twice'
            raise InputError(path, "header", problem, "correct the header, " + _DESCRIBE)
    header = _HeaderNumbers(
        joint_numbers={letter: [] for letter in _JOINT_SIGNALS}, extra={}, others=[]
    )
    for name in names:
        joint = re.fullmatch(r"(q|v|i|tau)(\d{1,4})", name)  # no more than MOST_COLUMNS
        entry = re.fullmatch(r"(.+)\.(\d{1,4})", name)
        if joint and int(joint[2]) > 0:
            header.joint_numbers[joint[1]].append(int(joint[2]))
        elif entry and entry[1] not in _RECORDING_SIGNALS:
            header.extra.setdefault(entry[1], []).append(int(entry[2]))
        elif name not in ("t", "dropout") and not (has_time_columns and name in _ID_COLUMNS):
            header.others.append(name)
    return header


def _unknown_column(name: str, path: Path) -> InputError:
    """The error of a name that no signal has, with the name that may be meant."""
    remedy = "remove it, " + _DESCRIBE
    joint = re.fullmatch(r"(q|v|i|tau)[^\d]*(\d+)", name)
    similar = difflib.get_close_matches(name, ["t", "dropout"], n=1)
    if re.fullmatch(r"(q|v|i|tau)0", name):
        remedy = "joints are numbered from 1"
    elif joint:
        remedy = f'did you mean "{joint[1]}{joint[2]}"? Otherwise {remedy}'
    elif similar:
        remedy = f'did you mean "{similar[0]}"? Otherwise {remedy}'
    problem = f'unknown column "{name}", expected t, q1.., v1.., i1..'
    return InputError(path, "header", problem, remedy)


def _no_known_column(names: Sequence[str], path: Path) -> InputError:
    """The error of a table none of whose names is that of a signal."""
    if all(_WRENCH.fullmatch(re.split(r"[/.]", name)[-1]) for name in names):
        problem = f"holds forces ({shortened(names)}), but no joint positions"
        raise InputError(
            path, "header", problem, "this is another record: give the log of the joints"
        )
    problem = f"names no joint positions in a way that is known: {shortened(names)}"
    return InputError(path, "header", problem, f"call them q1.., v1.., i1.., {_DESCRIBE}")
