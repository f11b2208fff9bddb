"""Drafts the description of a log's columns, as `--log-format` takes it.

Of a log that is read, the description says how. Of another one it names the columns that look like
positions, velocities, currents or torques by their names. What only the owner of the log can know
has a question mark: in a comment where the draft states a usual value, instead of the value where
there is none.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.hypotheses.effort_gain import RATED_UNITS
from wrenchsight.models.hypotheses.explanation import numbers_text
from wrenchsight.models.hypotheses.judgement import Judgement
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.aligned_table import AlignedTable
from wrenchsight.models.recordings.layouts.column_words import JointColumns, signal_columns
from wrenchsight.models.recordings.layouts.time_names import time_columns
from wrenchsight.models.recordings.log_container import LogTable
from wrenchsight.models.recordings.log_words import LogWords
from wrenchsight.models.recordings.plausibility.raw_words import RawWords, raw_words
from wrenchsight.models.recordings.rated_table import RatedTable
from wrenchsight.models.recordings.recording_checks import CERTAINLY_DEGREES
from wrenchsight.models.recordings.recording_format import (
    ENVIRONMENT,
    ROBOT,
    UNITS,
    Signal,
    column_items,
)
from wrenchsight.models.recordings.recording_reader import RecordingReader
from wrenchsight.models.recordings.text_table import TextTable

_KEYS = {
    "t": "time",
    "q": "position",
    "v": "velocity",
    "current": "current",
    "tau_J": "motor_torque",
}
_UNIT_QUESTIONS = {
    "position": "? rad or deg",
    "velocity": "? rad/s or deg/s",
    "current": "? A or mA; or motor_torque, in per mille of each drive's rated torque (gain)",
    "motor_torque": "? N m on the joint side; if these are currents in A, call the key current",
}
_COUNT_QUESTIONS = {  # of words, which are counts of a unit that no name states
    "position": "gain: 6.28318 / counts per turn of the joint",
    "velocity": "gain: rad/s of one count",
    "current": "gain: A of one count",
    "motor_torque": "gain: N m of one count at the joint, such as its rated torque / 1000",
}
_ANGLE_QUESTIONS = {  # of numbers beyond what a joint turns
    "position": "? unit: deg; or gain: rad of one count (and offset)",
    "velocity": "? unit: deg/s; or gain: rad/s of one count",
}
_ENCODING_ROWS = 50_000  # in which encodings of words are looked for
_UNITS_OF_SLIDING = ("mm", "mm/s")  # a gain of 0.001 is theirs, and that of thousandths of a rad
_SAME_SCALE = 1e-9  # relative, of two scales that differ by rounding
_LEAST_GAIN = 1e-8  # from 1, from which a gain is stated; less is rounding of the units
_FIRST_LINE = (
    "# Draft of `wrenchsight log`: check it, and read the log with --log-format.\n"
    "# What only the owner of the log can know has a question mark.\n"
)


@dataclass(frozen=True)
class _Entry:
    """One line of a description."""

    key: str
    values: dict[str, str]  # by key, as YAML
    question: str = ""

    def line(self, indent: str = "") -> str:
        """The line, with its question as a comment."""
        inner = ", ".join(f"{key}: {value}" for key, value in self.values.items())
        comment = f"  # {self.question}" if self.question else ""
        return f"{indent}{self.key}: {{{inner}}}{comment}\n"


def draft_of_log(
    reader: RecordingReader,
    words: dict[str, RawWords],
    knows_robot: bool,
    judgement: Judgement | None,
    largest_angle: float = 0.0,
) -> str:
    """The description of a log that is read, as YAML: a line a signal, the further ones last.

    Where the hypotheses found that the currents are parts of each drive's rated torque, they are
    described as torque, in that unit.

    Args:
        reader: reader of the log.
        words: encodings that its signals seem to have, by name.
        knows_robot: whether it was held against a robot, so that units are no question.
        judgement: what the hypotheses say of the log; None: they were not tried.
        largest_angle: of the positions as they are read, rad: beyond what a joint turns, their unit
            is a question, and that of the velocities, where no name states it.
    """
    table = reader.table
    lines = [_FIRST_LINE]
    if judgement is not None and judgement.fault is not None:
        lines.append(f"# ? {judgement.problem()}: {judgement.remedy()}\n")
    rated = _rated_torque_keys(judgement)
    lines += _text_keys(table)
    further_lines = []  # of signals without a key of their own
    for signal in reader.layout.signals:
        if signal.name == "dropout":  # the reader makes it: no column holds it
            continue
        key = _KEYS.get(signal.name, "")
        if key == "time" and isinstance(table, RatedTable):
            lines.append(f"rate_hz: {table.rate_hz:g}\n")
            continue
        entry = _entry(signal, key, table, words.get(signal.name))
        if key == "current" and rated:
            question = "? gain: rated torque of each drive at its joint, N m, by its data sheet"
            values = {"columns": entry.values["columns"], **rated}
            entry = _Entry("motor_torque", values, question)
        elif key in _ANGLE_QUESTIONS and largest_angle > CERTAINLY_DEGREES:
            if entry.values.get("unit") == next(iter(UNITS[key])):  # else a name states it
                entry = replace(entry, question=entry.question or _ANGLE_QUESTIONS[key])
        elif key in ("current", "motor_torque") and not knows_robot:
            entry = replace(entry, question=entry.question or _UNIT_QUESTIONS[key])
        if key:
            lines.append(entry.line())
        else:
            further_lines.append(entry.line("  "))
    if further_lines:
        lines += ["extra:\n", *further_lines]
    return "".join(lines)


def _rated_torque_keys(judgement: Judgement | None) -> dict[str, str]:
    """Unit and gain of currents that the hypotheses found to be parts of rated torques, as YAML.

    Empty where they found no such thing.
    """
    fault = None if judgement is None else judgement.fault
    if fault is None:
        return {}
    rated_torque, parts = fault.values.get("rated_torque_nm"), fault.values.get("parts_of_rated")
    if not isinstance(rated_torque, list) or not isinstance(parts, int | float):
        return {}
    return {"unit": RATED_UNITS[float(parts)], "gain": numbers_text(rated_torque)}


def draft_of_columns(table: LogTable, joint_names: Sequence[str] | None) -> str:
    """The description of a log that is not read, as far as the names of its columns show it.

    Of a table without names, the first column counts as the time.

    Args:
        joint_names: joint names of the robot; None: not known.
    """
    lines = [_FIRST_LINE, *_text_keys(table)]
    series = _series(table, joint_names)
    time = None if table.names is None else time_columns(table.names)
    if table.names is None:
        lines.append(_Entry("time", {"columns": "1", "unit": "s"}, "? its column and unit").line())
    elif time is not None:
        indices = [int(number) - 1 for number in str(time.columns).split(",")]  # stated from 1
        values = {"columns": _columns_text(indices, table)}
        if time.unit:
            values["unit"] = time.unit
        lines.append(_Entry("time", values).line())
    else:
        lines.append('rate_hz: "?"  # samples a second; or time: {columns: NAME, unit: s}\n')
    for key in ("position", "velocity", "current", "motor_torque"):
        if key in series:
            values = {"columns": _columns_text(series[key].columns, table)}
            if series[key].unit:
                values["unit"] = series[key].unit
            if series[key].gain != 1.0:
                values["gain"] = f"[{series[key].gain:g}]"
            question = _UNIT_QUESTIONS[key] + "; joints from base to tool"
            words = encoding_of(table, series[key].columns)
            if words is not None:
                values |= {"encoding": words.encoding, "bits": str(words.bits), "gain": '["?"]'}
                question = _COUNT_QUESTIONS[key] + "; joints from base to tool"
            lines.append(_Entry(key, values, question).line())
        elif key == "position" or (key == "current" and "motor_torque" not in series):
            question = "one column for each joint, base to tool"
            question += "; or motor_torque in its place" if key == "current" else ""
            lines.append(_Entry(key, {"columns": '"?"'}, question).line())
    return "".join(lines)


def encoding_of(table: LogTable, columns: Sequence[int]) -> RawWords | None:
    """The encoding that the numbers in some columns seem to have; None where they are numbers.

    Args:
        columns: their indices, from 0.
    """
    in_order = sorted(columns)
    try:
        values, _ = next(table.blocks(in_order, None, in_order), (None, None))
    except InputError:  # such as a cell of text
        return None
    if values is None:
        return None
    return raw_words(values[np.isfinite(values).all(axis=1)][:_ENCODING_ROWS])


def _innermost(table: LogTable) -> LogTable:
    """The table of the file."""
    while isinstance(table, RatedTable | AlignedTable):
        table = table.table
    return table


def _text_keys(table: LogTable) -> list[str]:
    """How a text is written, where that is not the usual way."""
    table = _innermost(table)
    if not isinstance(table, TextTable):
        return []
    separator = "\\t" if table.separator == "\t" else table.separator
    lines = [] if separator == "," else [f'separator: "{separator}"\n']
    if table.decimal_mark != ".":
        lines.append(f'decimal_mark: "{table.decimal_mark}"\n')
    skip_lines = table.num_head_lines if table.is_labelled else table.skip_lines
    if skip_lines:
        lines.append(f"skip_lines: {skip_lines}\n")
    if table.names is None or table.is_labelled:
        lines.append("header: false\n")
    return lines


def _entry(signal: Signal, key: str, table: LogTable, words: RawWords | None) -> _Entry:
    """The line of a signal that is read; only what differs from the defaults is stated.

    Args:
        key: of the description; empty: the signal has none, and stands by its name.
        words: encoding that its numbers seem to have; None: as the layout has it.
    """
    values = {"columns": _columns_text(signal.columns, table)}
    if not (signal.name == "t" and len(signal.columns) > 1):  # s and ns, which have no one unit
        values |= _scaling(signal, key)
    if not key and signal.shape != (len(signal.columns),):
        values["shape"] = str(list(signal.shape))
    encoding = words or (RawWords(signal.encoding, signal.bits) if signal.encoding else None)
    question = ""
    if encoding is not None:
        values |= {"encoding": encoding.encoding, "bits": str(encoding.bits)}
        if words is not None:
            question = "? gain: the unit of one count"
    if signal.wrap:
        values["wrap"] = signal.wrap
    if signal.exerted_on and signal.exerted_on != ROBOT:  # the default
        values["exerted_on"] = signal.exerted_on
    if signal.may_be_empty:
        values["may_be_empty"] = "true"
    return _Entry(key or signal.name, values, question)


def _scaling(signal: Signal, key: str) -> dict[str, str]:
    """Unit, gain and offset of a signal, as YAML; a gain of 1 and an offset of 0 are left out.

    The unit is the one of the signal's size in SI, where all columns have one size; else it is the
    first of the key's units, and a gain does the rest, which also has the sign.

    Args:
        key: of the description; empty: the signal has none, and no unit is stated.
    """
    # SI units per number of the log, without the sign that `exerted_on` states.
    scale = -signal.scale if signal.exerted_on == ENVIRONMENT else signal.scale
    units = UNITS.get(key, {"1": 1.0})
    sizes = np.abs(scale)
    of_this_size = [
        name
        for name, si in units.items()
        if name not in _UNITS_OF_SLIDING and abs(si / sizes[0] - 1.0) < _SAME_SCALE
    ]
    have_one_size = np.all(np.abs(sizes / sizes[0] - 1.0) < _SAME_SCALE)
    unit = of_this_size[0] if of_this_size and have_one_size else next(iter(units))
    values = {"unit": unit} if key else {}
    gain = scale / units[unit]
    if np.any(np.abs(gain - 1.0) > _LEAST_GAIN):
        values["gain"] = _numbers_text(gain)
    if signal.offset.any():
        values["offset"] = _numbers_text(signal.offset)
    return values


def _numbers_text(values: Array) -> str:
    shown = [values[0]] if np.all(values == values[0]) else values
    return "[" + ", ".join(f"{value:.12g}" for value in shown) + "]"


def _columns_text(columns: Sequence[int], table: LogTable) -> str:
    """Columns by their names, as a series where they are one; by number where names fail.

    Args:
        columns: their indices, from 0; the numbers in the text count from 1.
    """
    names = table.names
    text_table = _innermost(table)
    has_names = not (isinstance(text_table, TextTable) and text_table.is_labelled)
    if names is not None and has_names:
        listed = [names[column] for column in columns]
        text = _series_text(listed)
        try:
            is_same = column_items(text, "", "") == listed
        except ValueError:
            is_same = False
        is_unique = all(names.count(name) == 1 for name in listed)
        is_number = any(name.strip().isdigit() for name in listed)  # taken for a column's number
        if (
            is_same
            and is_unique
            and not is_number
            and not any(re.search(r'["\\\n]', name) for name in listed)
        ):
            return f'"{text}"'
    first, last = columns[0] + 1, columns[-1] + 1
    if len(columns) > 1 and list(columns) == list(range(first - 1, last)):
        return f'"{first}-{last}"'
    return '"' + ", ".join(str(column + 1) for column in columns) + '"'


def _series_text(names: Sequence[str]) -> str:
    """Names that count through one number as "q{1..6}"; others with commas between them."""
    if len(names) > 1:
        for match in re.finditer(r"\d+", names[0]):
            before, behind = names[0][: match.start()], names[0][match.end() :]
            first = int(match[0])
            if list(names) == [f"{before}{first + k}{behind}" for k in range(len(names))]:
                return f"{before}{{{first}..{first + len(names) - 1}}}{behind}"
    return ", ".join(names)


def _series(table: LogTable, joint_names: Sequence[str] | None) -> dict[str, JointColumns]:
    """The columns that look like a signal of all joints, by the key of the description."""
    if table.names is not None:
        try:
            return signal_columns(table.names, Path(), joint_names, LogWords())
        except InputError:  # they are those of several arms
            return {}
    count = table.num_columns - 1
    sizes = [len(joint_names)] if joint_names else range(4, 9)
    n = next((size for size in sizes if count >= size and count % size == 0), 0)
    return {
        key: JointColumns(list(range(1 + k * n, 1 + (k + 1) * n)), "", "")
        for k, key in enumerate(("position", "velocity", "current"))
        if n and 1 + (k + 1) * n <= table.num_columns
    }
