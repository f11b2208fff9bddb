"""The layout of a log whose header says it all: t,q1..qn,v1..vn,i1..in."""

import difflib
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.layouts.header_layouts import time_columns
from wrenchsight.models.recordings.recording_format import RecordingFormat, SignalColumns

TIME_WORDS = ("t", "times", "time", "timestamps", "timestamp", "time_s", "t_s")
_DESCRIBE = "or describe the columns with --log-format"
_ID_COLUMNS = ("frame_id", "seq", "header.frame_id", "header.seq")  # beside a stamp
_JOINT_SIGNALS = {"q": "position", "v": "velocity", "i": "current", "tau": "motor_torque"}


def header_format(
    names: Sequence[str], path: Path, num_joints: int | None = None
) -> RecordingFormat:
    """The description of a log whose header says it all: t,q1..qn,v1..vn,i1..in.

    Motor torque is tau1..taun, a flag for bridged samples dropout, and name.1..name.k a further
    signal.

    Args:
        num_joints: n, if it is known.

    Raises:
        InputError: a column is missing, unknown or there twice.
    """
    place = "header"
    stamps = None if "t" in names else time_columns(names) or _single_time(names)
    split = [int(column) - 1 for column in str(stamps.columns).split(",")] if stamps else []
    # Without a name: a table's index, or a separator at the line's end.
    names = [name for k, name in enumerate(names) if name and k not in split]
    times_there = Counter(names)
    for name in names:
        if times_there[name] > 1:
            what = f'the column "{name}" is there twice'
            raise InputError(path, place, what, "correct the header, " + _DESCRIBE)
    joints: dict[str, list[int]] = {letter: [] for letter in _JOINT_SIGNALS}
    extra: dict[str, list[int]] = {}
    for name in names:
        joint = re.fullmatch(r"(q|v|i|tau)(\d{1,4})", name)  # no more than MOST_COLUMNS
        part = re.fullmatch(r"(.+)\.(\d{1,4})", name)
        if joint and int(joint[2]) > 0:
            joints[joint[1]].append(int(joint[2]))
        elif part and part[1] not in ("t", "q", "v", "current", "tau_J", "dropout"):
            extra.setdefault(part[1], []).append(int(part[2]))
        elif name not in ("t", "dropout") and not (stamps and name in _ID_COLUMNS):
            raise _unknown(name, names, path)
    size = num_joints or max((max(v) for k, v in joints.items() if v and k in "qv"), default=1)
    wanted = ["q"] + (["v"] if joints["v"] else []) + (["tau"] if joints["tau"] else [])
    wanted += ["i"] if joints["i"] or not joints["tau"] else []
    missing = ["t"] if "t" not in names and stamps is None else []
    missing += [f"{k}{j}" for k in wanted for j in range(1, size + 1) if j not in joints[k]]
    missing += [f"{k}.{j}" for k, v in extra.items() for j in range(1, max(v) + 1) if j not in v]
    if missing:
        problem = f"lacks the column{'s' if len(missing) > 1 else ''} {_listed(missing)}"
        remedy = f"expected t,q1..q{size},v1..v{size},i1..i{size}; correct the header, {_DESCRIBE}"
        raise InputError(path, place, problem, remedy)
    surplus = [f"{k}{j}" for k in wanted for j in joints[k] if j > size]
    if surplus:
        problem = (
            f"has the column{'s' if len(surplus) > 1 else ''} {_listed(surplus)}, expected {size} "
            "joints"
        )
        remedy = "give the robot that the log comes from, or correct the header"
        raise InputError(path, place, problem, remedy)
    form = RecordingFormat(time=stamps or SignalColumns("t"))
    for letter in wanted:
        setattr(form, _JOINT_SIGNALS[letter], SignalColumns(f"{letter}{{1..{size}}}"))
    form.extra = {k: SignalColumns(f"{k}.{{1..{max(v)}}}") for k, v in extra.items()}
    if "dropout" in names:
        form.extra["dropout"] = SignalColumns("dropout")
    return form


def _single_time(names: Sequence[str]) -> SignalColumns | None:
    there = [k for k, name in enumerate(names) if name in TIME_WORDS]
    return SignalColumns(str(there[0] + 1)) if len(there) == 1 else None


def _unknown(name: str, names: Sequence[str], path: Path) -> InputError:
    remedy = "remove it, " + _DESCRIBE
    if re.fullmatch(r"(q|v|i|tau)0", name):
        remedy = "joints are numbered from 1"
    elif match := re.fullmatch(r"(q|v|i|tau)[^\d]*(\d+)", name):
        remedy = f'did you mean "{match[1]}{match[2]}"? Otherwise {remedy}'
    elif near := difflib.get_close_matches(name, ["t", "dropout"], n=1):
        remedy = f'did you mean "{near[0]}"? Otherwise {remedy}'
    return InputError(
        path, "header", f'unknown column "{name}", expected t, q1.., v1.., i1..', remedy
    )


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")
