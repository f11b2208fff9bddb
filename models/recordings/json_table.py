"""Logs in JSON and YAML, read as the Parquet table that Arrow makes of them.

    {"timestamp": 1709647351.25, "joint_positions": [0.24, -1.69], "state": {"mode": "AUTO"}}

One object a line, or one document of YAML (`---`) a sample; a list of objects, by itself or under a
key; or one object of arrays over all samples. Objects within become columns state.mode, lists of
objects joints.1.position; lists as `parquet_table` has them. Also what pandas writes in any of its
orientations, and series of Prometheus and VictoriaMetrics: an object a series, with its stamps.
"""

import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.json as pa_json

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import opened, read_limited
from wrenchsight.models.recordings.json_lines import ObjectLines, has_text_before_objects
from wrenchsight.models.recordings.layouts.joint_names import is_joint_list
from wrenchsight.models.recordings.layouts.time_names import time_columns
from wrenchsight.models.recordings.parquet_table import ConvertedTable
from wrenchsight.models.recordings.recording_format import RecordingFormat

_BLOCK_BYTES: Final = 1 << 22
_LARGEST_DOCUMENT: Final = 1 << 27  # bytes of a file that is read whole; one object a line is not
_LARGEST_YAML: Final = 1 << 24  # bytes; PyYAML reads a megabyte a second
_MIN_SAMPLES: Final = 10  # of arrays; shorter ones are those of one sample
_FIRST_EPOCH_MS: Final = 1e11  # whole numbers from this on are milliseconds since 1970: from 1973
_FLOAT_TAG: Final = "tag:yaml.org,2002:float"
_PLAIN_FLOAT: Final = re.compile(r"[-+]?\d+[eE][-+]?\d+")
_TOP_KEY: Final = re.compile(rb"([A-Za-z_]\w*):(?:\s|$)")
_ARRAY: Final = re.compile(rb"(?m)^[A-Za-z_]\w*:(?: *\[|[ \r]*\n *-)\s*\[*\s*[-+.\d]")
_KEYS_OF_MESSAGES: Final = frozenset(("header",))  # of ROS, which a description has, too
_YAML_LINE: Final = re.compile(
    r"---|\{[A-Za-z_]\w*: .*\}|\s*(?:- +)*(?:[A-Za-z_]\w*:(?:\s.*)?|-\s.*|-)"
)
_YAML_STRUCTURE: Final = re.compile(r"(?m)^---\s*$|^ +(?:- +)?[A-Za-z_]\w*:(?:\s|$)")
_ONE_FORM: Final = "write one object a line, all with the same entries"
_EXPECTED: Final = (
    "write one object a sample (a line each, or a list), or arrays over all samples by name"
)


class JsonTable(ConvertedTable):
    """A log in JSON; where it has one object a line, these are the rows.

    Raises:
        InputError: no such file, no JSON, neither samples nor arrays, or entries that change their
            type.
    """

    def __init__(self, path: Path) -> None:
        with opened(path, "a log") as file:
            begin = file.read(_BLOCK_BYTES).lstrip(b"\xef\xbb\xbf \t\r\n")
        is_behind_text = has_text_before_objects(begin.decode("utf-8", "replace"))
        if not is_behind_text and not begin.startswith((b"{", b"[")):
            raise InputError(path, "", "is no JSON", "name the file by what it is, such as .csv")
        has_lines = begin.startswith(b"{") and _is_object(begin.split(b"\n")[0])
        try:
            if is_behind_text:
                objects = ObjectLines(path)
                super().__init__(path, _lines(objects.path))
                self.notices.append(objects.notice)
            elif has_lines and _is_series(json.loads(begin.split(b"\n")[0])):
                super().__init__(path, [_series_table(_objects(path), path)])
            elif has_lines and begin.count(b"\n") > 1:
                self.row_word = "line"
                super().__init__(path, _lines(path))
            else:
                document = _document(path)
                super().__init__(path, [_table_of(document, path)])
                self.joint_list = _joint_list(document)
        except (pa.ArrowException, ValueError, OSError) as error:
            if isinstance(error, InputError):
                raise
            problem = f"cannot be read as JSON ({str(error).splitlines()[0][:200]})"
            raise InputError(path, "", problem, _ONE_FORM) from error


class YamlTable(ConvertedTable):
    """A log of one YAML document a sample, or of a list of them.

    Raises:
        InputError: no such file, no YAML, or documents that are no samples.
    """

    row_word = "document"

    def __init__(self, path: Path) -> None:
        import yaml

        content = read_limited(path, _LARGEST_YAML, "a log in YAML", "write it as JSON or CSV")
        if b"&" in content and b"*" in content:  # aliases can stand for more than any memory
            raise InputError(path, "", "has aliases, which are not read", "write it as JSON or CSV")
        try:
            # YAML 1.1, which PyYAML reads, takes a number such as 2e-05 for a word.
            loader: Any = type("_Loader", (getattr(yaml, "CSafeLoader", yaml.SafeLoader),), {})
            loader.add_implicit_resolver(_FLOAT_TAG, _PLAIN_FLOAT, list("-+0123456789"))
            documents = [part for part in yaml.load_all(content, loader) if part is not None]
            whole = documents[0] if len(documents) == 1 else documents
            super().__init__(path, [_table_of(whole, path)])
            self.joint_list = _joint_list(whole)
        except (yaml.YAMLError, RecursionError, pa.ArrowException) as error:
            problem = f"cannot be read as YAML ({' '.join(str(error).split())[:200]})"
            raise InputError(path, "", problem, "write it as JSON or CSV") from error


def is_yaml_log(path: Path) -> bool:
    """Whether a file of YAML is a log; False where it is none, or cannot be read.

    It is one if it holds several documents, a list, an array under a key, or no key of a
    description: then its keys are those of arrays, or of a message.
    """
    try:
        with path.open("rb") as file:
            head = file.read(_BLOCK_BYTES)
    except OSError:
        return False
    lines = [line.rstrip() for line in head.splitlines() if line.strip()]
    keys = {match[1].decode() for line in lines if (match := _TOP_KEY.match(line))}
    described = {field.name for field in fields(RecordingFormat)} - _KEYS_OF_MESSAGES
    is_list = any(line.startswith(b"- ") for line in lines[:1])
    is_foreign = bool(keys) and keys.isdisjoint(described)
    return b"---" in lines[1:] or is_list or is_foreign or _ARRAY.search(head) is not None


def is_yaml(head: str) -> bool:
    """Whether a text, whatever its file is called, begins as YAML: documents, or keys in keys."""
    lines = [line for line in head.splitlines()[:-1] if line.strip()]  # the last one may be cut off
    return (
        len(lines) > 1
        and all(_YAML_LINE.fullmatch(line.rstrip()) for line in lines)
        and _YAML_STRUCTURE.search(head) is not None
    )


def _is_object(line: bytes) -> bool:
    """Whether a line is a whole object."""
    try:
        return isinstance(json.loads(line), dict)
    except (ValueError, RecursionError):
        return False


def _document(path: Path) -> Any:
    """The content of a file that is one document.

    Raises:
        ValueError: it is no JSON.
    """
    remedy = "write one object a line, such as by jq -c '.[]' log.json > log.jsonl"
    content = read_limited(path, _LARGEST_DOCUMENT, "JSON that is no object a line", remedy)
    try:
        return json.loads(content)
    except RecursionError as error:
        raise ValueError("objects within objects without end") from error


def _table_of(document: Any, path: Path) -> pa.Table:
    """The samples of a document: a list of objects, or arrays by name, perhaps under a key.

    Raises:
        InputError: it holds neither, or a plan.
        pa.ArrowException: entries change their type.
    """
    if _is_plan(document):
        problem = "is a planned trajectory (points with time_from_start): nothing in it is measured"
        raise InputError(path, "", problem, "record /joint_states while the robot drives it")
    if isinstance(document, list) and document and all(_is_series(x) for x in document):
        return _series_table(document, path)
    if isinstance(document, dict):
        arrays = _of_pandas(document) or _arrays(document)
        if arrays:
            return arrays
        inner = [value for value in document.values() if isinstance(value, list | dict) and value]
        if inner:
            return _table_of(max(inner, key=len), path)
    if isinstance(document, list) and document and all(isinstance(x, dict) for x in document):
        return pa.Table.from_pylist(document)
    raise InputError(path, "", "holds neither samples nor arrays", _EXPECTED)


def _is_plan(document: Any) -> bool:
    """Whether a document is a trajectory_msgs/JointTrajectory, or holds one; or a list of them."""
    if isinstance(document, list):
        return bool(document) and all(isinstance(x, dict) and _is_plan(x) for x in document)
    if not isinstance(document, dict):
        return False
    points = document.get("points")
    if isinstance(points, list) and points:
        return all(isinstance(point, dict) and "time_from_start" in point for point in points)
    return any(_is_plan(value) for value in document.values() if isinstance(value, dict))


def _is_series(document: Any) -> bool:
    """Whether an object is a series of Prometheus or VictoriaMetrics."""
    return (
        isinstance(document, dict)
        and isinstance(document.get("metric"), dict)
        and isinstance(document.get("values"), list)
    )


def _objects(path: Path) -> list[Any]:
    """The objects of a file of one a line, all at once.

    Raises:
        ValueError: it is no JSON.
    """
    remedy = "export fewer series or a shorter time"
    content = read_limited(path, _LARGEST_DOCUMENT, "JSON with a series a line", remedy)
    return [json.loads(line) for line in content.splitlines() if line.strip()]


def _series_table(objects: list[Any], path: Path) -> pa.Table:
    """The series as columns, a row for each stamp: named by their metric and what tells them apart.

    VictoriaMetrics has stamps in ms beside the values, Prometheus pairs of stamps in s and texts.

    Raises:
        InputError: an object is no series, or two have one name.
    """
    if not all(_is_series(entry) for entry in objects):
        raise InputError(path, "", "has lines that are no series beside series", _ONE_FORM)
    keys = {key for entry in objects for key in entry["metric"] if key != "__name__"}
    telling = sorted(
        key for key in keys if len({str(entry["metric"].get(key)) for entry in objects}) > 1
    )
    columns: dict[str, pd.Series[Any]] = {}
    for entry in objects:
        labels = entry["metric"]
        words = [*(labels.get(key, "") for key in telling), labels.get("__name__", "")]
        name = " ".join(str(word) for word in words if word)
        if name in columns:
            problem = f"has two series {name}"
            raise InputError(path, "", problem, "export one series for each joint and quantity")
        stamps, values = entry.get("timestamps"), entry["values"]
        if stamps is None:
            stamps, values = zip(*values, strict=True) if values else ((), ())
            stamps = [float(stamp) for stamp in stamps]
        else:
            stamps = [1e-3 * stamp for stamp in stamps]
        columns[name] = pd.Series(pd.to_numeric(pd.Series(values), errors="coerce").array, stamps)
    try:
        frame = pd.concat(columns, axis=1).sort_index()
    except ValueError as error:  # pandas' own
        problem = "has a series with two values of one stamp"
        raise InputError(path, "", problem, "export each sample once") from error
    frame.insert(0, "t", frame.index)
    return pa.Table.from_pandas(frame, preserve_index=False)


def _of_pandas(document: Mapping[str, Any]) -> pa.Table | None:
    """A table that pandas has written with its index; None where it is none of these.

    orient="split" has the columns' names, the index and the rows; orient="columns" an object for
    each column, with the index for keys; orient="index" one for each row. The index is a column of
    time unless it counts the rows.
    """
    names, rows = document.get("columns"), document.get("data")
    if isinstance(names, list) and isinstance(rows, list) and rows and isinstance(rows[0], list):
        if any(not isinstance(row, list) or len(row) != len(names) for row in rows):
            return None
        columns = dict(zip(map(str, names), map(list, zip(*rows, strict=True)), strict=True))
        return _indexed(columns, document.get("index"))
    objects = list(document.values())
    if not objects or not all(isinstance(x, dict) and x.keys() == objects[0].keys()
                              for x in objects):  # fmt: skip
        return None
    if len(objects[0]) >= _MIN_SAMPLES and all(map(_is_index, objects[0])):
        columns = {name: list(column.values()) for name, column in document.items()}
        return _indexed(columns, list(objects[0]))
    if len(objects) >= _MIN_SAMPLES and all(map(_is_index, document)):
        return _indexed({name: [x[name] for x in objects] for name in objects[0]}, list(document))
    return None


def _is_index(key: str) -> bool:
    """Whether a key is a number or a stamp that begins with one, as those of a pandas index."""
    return key[:1].isdigit() or (key[:1] == "-" and key[1:2].isdigit())


def _indexed(columns: Mapping[str, Any], index: Any) -> pa.Table | None:
    """Columns with their index in front; without it where it counts, or there is a time already."""
    count = len(next(iter(columns.values()), []))
    if count < _MIN_SAMPLES:
        return None
    if not isinstance(index, list) or len(index) != count or time_columns(list(columns)):
        return pa.table(dict(columns))
    numbers = pd.to_numeric(pd.Series(index), errors="coerce").to_numpy(dtype=float)
    if np.isnan(numbers).any():
        return pa.table({"time": [str(stamp) for stamp in index], **columns})
    if np.array_equal(numbers, numbers[0] + np.arange(count)):
        return pa.table(dict(columns))
    is_epoch_ms = (numbers >= _FIRST_EPOCH_MS).all() and (numbers == np.round(numbers)).all()
    return pa.table({"time": 1e-3 * numbers if is_epoch_ms else numbers, **columns})


def _joint_list(document: Any) -> tuple[str, ...]:
    """The names of the joints that an object lists once for all samples; none where it does not."""
    if not isinstance(document, dict):
        return ()
    for name, value in document.items():
        is_list = isinstance(value, list) and all(isinstance(word, str) for word in value)
        if is_list and value and is_joint_list(name):
            return tuple(value)
    inner = [value for value in document.values() if isinstance(value, dict)]
    return next((found for value in inner if (found := _joint_list(value))), ())


def _arrays(document: Mapping[str, Any]) -> pa.Table | None:
    """The arrays of an object as a table; None where no two are over the same samples.

    Arrays with a list for each joint, of as many numbers as there are samples, are turned.
    """
    lists = {name: value for name, value in document.items() if isinstance(value, list) and value}
    flat = [len(value) for value in lists.values() if not isinstance(value[0], list | dict)]
    of_lists = [len(x) for value in lists.values() if isinstance(value[0], list)
                for x in (value, value[0])]  # fmt: skip
    # Without a vector the longer side of the arrays is that of the samples.
    count = Counter(flat).most_common(1)[0][0] if flat else max(of_lists, default=0)
    columns = {}
    for name, value in lists.items():
        turned = isinstance(value[0], list) and len(value) != count
        if turned and all(isinstance(row, list) and len(row) == count for row in value):
            value = np.array(value, dtype=float).T.tolist()
        if len(value) == count and not isinstance(value[0], dict):
            columns[name] = value
    return pa.table(columns) if count >= _MIN_SAMPLES and len(columns) > 1 else None


def _lines(path: Path) -> Iterator[pa.Table]:
    """The objects of a file of one a line, some megabytes at a time.

    Raises:
        pa.ArrowException, ValueError: it is no JSON, or its entries change their type.
    """
    options = pa_json.ReadOptions(block_size=_BLOCK_BYTES, use_threads=False)
    with pa_json.open_json(path, read_options=options) as batches:
        schema = pa.schema([(field.name, _widened(field.type)) for field in batches.schema])
    parsing = pa_json.ParseOptions(explicit_schema=schema, unexpected_field_behavior="ignore")
    with pa_json.open_json(path, read_options=options, parse_options=parsing) as batches:
        for batch in batches:
            yield pa.Table.from_batches([batch])


def _widened(kind: pa.DataType) -> pa.DataType:
    """A type that also holds what a later line may have: numbers with a fraction."""
    if pa.types.is_integer(kind):
        return pa.float64()
    if pa.types.is_list(kind):
        return pa.list_(_widened(kind.value_type))
    if pa.types.is_struct(kind):
        return pa.struct([(field.name, _widened(field.type)) for field in kind])
    return kind
