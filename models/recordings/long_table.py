"""Tables with a row for each joint, or for each signal, turned into a row for each sample.

    time, joint, position, effort          time, signal, value
    0.00, shoulder, 0.1, 12                0.00, q1, 0.1
    0.00, elbow, 1.2, 7                    0.00, i1, 1.5

The columns become `shoulder position` and so on, or what the signal column calls them. Rows with
one stamp become one sample, in the order of the log.
"""

import io
import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.layouts.signal_words import column_name, names_quantity_alone
from wrenchsight.models.recordings.layouts.time_names import time_columns
from wrenchsight.models.recordings.log_container import LogTable
from wrenchsight.models.recordings.parquet_table import ConvertedTable, ParquetTable
from wrenchsight.models.recordings.recording_format import column_numbers
from wrenchsight.models.recordings.text_table import TextTable

_JOINT_WORDS: Final = frozenset((
    "joint", "joint_name", "joint_names", "joint_id", "joint_index", "joint_no", "axis",
    "axis_id", "axis_no", "axis_name", "ax", "achse", "gelenk", "motor", "motor_id",
    "motor_name", "drive", "drive_id", "servo", "servo_id", "node", "can_id", "arbitration_id",
    "actuator", "actuator_id", "name",
    "id", "eje", "articulacion", "axe", "device", "node_id", "关节", "轴",
))  # fmt: skip
_SIGNAL_WORDS: Final = frozenset((
    "signal", "signal_name", "variable", "variable_name", "var", "name", "tag", "tag_name",
    "tagname", "channel", "channel_name", "key", "field", "metric", "measurement", "topic",
    "series", "quantity", "信号",
))  # fmt: skip
_VALUE_WORDS: Final = frozenset((
    "value", "values", "val", "wert", "valeur", "valor", "data", "reading", "值",
))  # fmt: skip
_ADDRESS: Final = re.compile(r"(0x[0-9a-fA-F]{1,8}|[1-9]\d{0,8})")
_MIN_ADDRESSES: Final = 2  # joints; fewer, and numbers from 0 or 1 on, are numbers of joints
_LARGEST_TABLE: Final = 1 << 28  # bytes: it is turned in memory
_MOST_JOINTS: Final = 256  # different names in a column of joints or signals
_FIRST_ROWS: Final = 2000  # in which the names show whether they are those of joints


class _LongColumns(NamedTuple):
    """The columns of a long table, by their numbers from 0."""

    keys: list[int]  # of the joint, of the signal, or both
    times: list[int]
    values: list[int]


def as_samples(table: LogTable, path: Path) -> LogTable:
    """The table, or one of a row a sample where it has a row for each joint or signal.

    Raises:
        InputError: it is too large, or two rows of one stamp are of one joint.
    """
    if table.names is None or not isinstance(table, TextTable | ParquetTable):
        return table
    columns = _long_columns(table.names)
    if columns is None or not _is_long(table, columns):
        return table
    return _SampleTable(table, columns, path)


class _SampleTable(ConvertedTable):
    """A long table, turned; its rows count the samples."""

    row_word = "sample"

    def __init__(self, table: TextTable | ParquetTable, columns: _LongColumns, path: Path) -> None:
        assert table.names is not None
        super().__init__(path, [_turned(_frame(table), table.names, columns, path)])
        listed = ", ".join(table.names[key] for key in columns.keys)
        self.notices = [*table.notices, f"a row for each {listed}: turned into a row a sample"]


def _long_columns(names: Sequence[str]) -> _LongColumns | None:
    """Which columns of a table may be those of a long one; None where it is none by its names."""
    words = [_plain(name) for name in names]
    time = time_columns(names)
    value = next((k for k, word in enumerate(words) if word in _VALUE_WORDS), None)
    signal = next((k for k, word in enumerate(words) if word in _SIGNAL_WORDS), None)
    joint = next((k for k, word in enumerate(words) if word in _JOINT_WORDS and k != signal), None)
    if joint is None and value is None:
        joint = signal  # "name" may stand for either
    times = [] if time is None else column_numbers(time)
    if value is not None and signal is not None:
        keys = [key for key in (joint, signal) if key is not None]
        return _LongColumns(keys, times, [value])
    values = [
        k
        for k, name in enumerate(names)
        if names_quantity_alone(column_name(_last_part(name))) and k not in times
    ]
    return _LongColumns([joint], times, values) if joint is not None and values else None


def _last_part(name: str) -> str:
    """The name of a column without the objects that hold it: state.position, msg/position."""
    return re.split(r"[./](?=[^\W\d])", name)[-1]


def _plain(name: str) -> str:
    """A name in lower case with underscores between its words: Joint Name, jointName."""
    spaced = "".join(f"_{x}" if x.isupper() and y.islower() else x for y, x in pairwise(f" {name}"))
    return "_".join(spaced.strip().lower().replace("-", " ").replace("_", " ").split())


def _is_long(table: TextTable | ParquetTable, columns: _LongColumns) -> bool:
    """Whether the names of joints or signals repeat, as they do if each row is of one of them."""
    head = _frame(table, _FIRST_ROWS)
    keys = head.iloc[:, columns.keys]
    if any(isinstance(cell, list | np.ndarray | dict) for cell in keys.iloc[:1].to_numpy().ravel()):
        return False
    num_names = len(keys.drop_duplicates())
    return 1 < num_names <= _MOST_JOINTS and 2 * num_names <= len(head)


def _frame(table: TextTable | ParquetTable, num_rows: int | None = None) -> pd.DataFrame:
    """The rows of a table with their texts, the columns numbered.

    Raises:
        InputError: it is too large.
    """
    if isinstance(table, ParquetTable):
        frame = table.frame(num_rows)
    else:
        text = table.text(_LARGEST_TABLE, num_rows)
        try:
            frame = pd.read_csv(
                io.BytesIO(text), sep=table.separator, header=None, names=range(table.num_columns),
                decimal=table.decimal_mark, skipinitialspace=True, index_col=False,
                on_bad_lines="skip", low_memory=False, comment="#", encoding_errors="replace",
            )  # fmt: skip
        except ValueError as error:  # also pandas' own, such as of quotes that do not end
            problem = f"cannot be read as a table ({' '.join(str(error).split())[:200]})"
            raise InputError(table.path, "", problem, "correct or remove the line") from error
    frame.columns = pd.RangeIndex(len(frame.columns))
    return frame


def _turned(
    frame: pd.DataFrame, names: Sequence[str], columns: _LongColumns, path: Path
) -> pa.Table:
    """The table with a row for each stamp.

    Without a time, each name that comes again begins a sample.

    Raises:
        InputError: two rows of one stamp are of one joint or signal.
    """
    labels = [_label([str(_whole(cell)) for cell in row], columns)
              for row in frame[columns.keys].itertuples(index=False)]  # fmt: skip
    codes, joints = pd.factorize(np.array(_without_addresses(labels), dtype=object))
    if columns.times:
        stamps = pd.MultiIndex.from_frame(frame[columns.times])
        samples, _ = pd.factorize(stamps)
    else:
        samples = np.asarray(pd.Series(codes).groupby(codes).cumcount())
    places = pd.MultiIndex.from_arrays([samples, codes])
    if places.has_duplicates:
        k = int(np.argmax(places.duplicated()))
        problem = f"has two rows of {labels[k]} with one stamp"
        raise InputError(path, f"row {k + 1}", problem, "record each joint once a sample")
    first_rows = np.flatnonzero(~pd.Series(samples).duplicated())
    turned: dict[str, Any] = {
        names[k]: frame[k].iloc[first_rows].reset_index(drop=True) for k in columns.times
    }
    for column in columns.values:
        numbers = pd.to_numeric(frame[column], errors="coerce").set_axis(places)
        by_joint = numbers.astype(float).unstack()  # by sample and joint
        is_signal = len(columns.values) == 1 and _plain(names[column]) in _VALUE_WORDS
        for j, joint in enumerate(joints):
            turned[joint if is_signal else f"{joint} {_last_part(names[column])}"] = by_joint[j]
    try:
        return pa.Table.from_pandas(pd.DataFrame(turned), preserve_index=False)
    except (pa.ArrowException, OverflowError) as error:
        problem = f"has a time that is no number ({str(error).splitlines()[0][:200]})"
        place = f"column {', '.join(names[k] for k in columns.times)}"
        raise InputError(path, place, problem, "correct or remove the row") from error


def _without_addresses(labels: Sequence[str]) -> Sequence[str]:
    """The labels; those of joints by addresses of a bus that follow each other by their numbers."""
    numbers = {
        label: int(match[1], 0)
        for label in set(labels)
        if (match := _ADDRESS.fullmatch(label.removeprefix("joint ")))
    }
    first = min(numbers.values(), default=0)
    follow = sorted(numbers.values()) == list(range(first, first + len(numbers)))
    if len(numbers) < len(set(labels)) or len(numbers) < _MIN_ADDRESSES or first < _MIN_ADDRESSES:
        return labels
    return [f"joint {numbers[label] - first + 1}" for label in labels] if follow else labels


def _whole(cell: Any) -> Any:
    """A whole number without a fraction: 1.0 is joint 1."""
    return int(cell) if isinstance(cell, float) and cell.is_integer() else cell


def _label(cells: Sequence[str], columns: _LongColumns) -> str:
    """What a row is of, in words that name a joint or a signal."""
    first = f"joint {cells[0]}" if cells[0].isdigit() else cells[0]
    return " ".join([first, *cells[1:]]) if len(columns.keys) > 1 else first
