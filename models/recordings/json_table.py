"""Logs in JSON and YAML, read as the Parquet table that Arrow makes of them.

    {"timestamp": 1709647351.25, "joint_positions": [0.24, -1.69], "state": {"mode": "AUTO"}}

One object a line, or one document of YAML (`---`) a sample; a list of objects, by itself or under a
key; or one object of arrays over all samples. Objects within become columns state.mode, lists of
objects joints.1.position; lists as `parquet_table` has them.
"""

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.json as pa_json
from numpy.typing import NDArray

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import opened, read_limited
from wrenchsight.models.recordings.layouts.joint_names import is_joint_list
from wrenchsight.models.recordings.parquet_table import ConvertedTable
from wrenchsight.models.recordings.recording_format import RecordingFormat

_BLOCK_BYTES: Final = 1 << 22
_LARGEST_DOCUMENT: Final = 1 << 27  # bytes of a file that is read whole; one object a line is not
_LARGEST_YAML: Final = 1 << 24  # bytes; PyYAML reads a megabyte a second
_MIN_SAMPLES: Final = 10  # of arrays; shorter ones are those of one sample
_ONE_FORM: Final = "write one object a line, all with the same entries"
_EXPECTED: Final = (
    "write one object a sample (a line each, or a list), or arrays over all samples by name"
)


class JsonContainer:
    """Logs in JSON; implements `log_container.LogContainer`."""

    suffixes: tuple[str, ...] = (".jsonl", ".ndjson", ".json")

    def open(self, path: Path, form: RecordingFormat | None) -> "JsonTable":
        """As the protocol; the file describes itself, so that `form` is not used."""
        return JsonTable(path)

    def write(self, path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
        """Not for JSON.

        Raises:
            InputError: always.
        """
        raise InputError(path, "", "is not written as JSON", "give it an ending such as .csv")


class JsonTable(ConvertedTable):
    """A log in JSON; where it has one object a line, these are the rows.

    Raises:
        InputError: no such file, no JSON, neither samples nor arrays, or entries that change their
            type.
    """

    def __init__(self, path: Path) -> None:
        with opened(path, "a log") as file:
            begin = file.read(_BLOCK_BYTES).lstrip(b"\xef\xbb\xbf \t\r\n")
        if not begin.startswith((b"{", b"[")):
            raise InputError(path, "", "is no JSON", "name the file by what it is, such as .csv")
        has_lines = begin.startswith(b"{") and _is_object(begin.split(b"\n")[0])
        try:
            if has_lines and begin.count(b"\n") > 1:
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


class YamlContainer:
    """Logs of YAML documents; implements `log_container.LogContainer`."""

    suffixes: tuple[str, ...] = ()  # those of a description; its documents show that it is a log

    def open(self, path: Path, form: RecordingFormat | None) -> "YamlTable":
        """As the protocol; the file describes itself, so that `form` is not used."""
        return YamlTable(path)

    def write(self, path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
        """Not for YAML.

        Raises:
            InputError: always.
        """
        raise InputError(path, "", "is not written as YAML", "give it an ending such as .csv")


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
        loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        try:
            documents = [part for part in yaml.load_all(content, loader) if part is not None]
            whole = documents[0] if len(documents) == 1 else documents
            super().__init__(path, [_table_of(whole, path)])
            self.joint_list = _joint_list(whole)
        except (yaml.YAMLError, RecursionError, pa.ArrowException) as error:
            problem = f"cannot be read as YAML ({' '.join(str(error).split())[:200]})"
            raise InputError(path, "", problem, "write it as JSON or CSV") from error


def is_yaml_log(path: Path) -> bool:
    """Whether a file of YAML is a log: several documents, or a list; False where it is none."""
    try:
        with path.open("rb") as file:
            head = file.read(_BLOCK_BYTES)
    except OSError:
        return False
    lines = [line.rstrip() for line in head.splitlines() if line.strip()]
    return b"---" in lines[1:] or any(line.startswith(b"- ") for line in lines[:1])


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
        InputError: it holds neither.
        pa.ArrowException: entries change their type.
    """
    if isinstance(document, dict):
        arrays = _arrays(document)
        if arrays:
            return arrays
        inner = [value for value in document.values() if isinstance(value, list | dict) and value]
        if inner:
            return _table_of(max(inner, key=len), path)
    if isinstance(document, list) and document and all(isinstance(x, dict) for x in document):
        return pa.Table.from_pylist(document)
    raise InputError(path, "", "holds neither samples nor arrays", _EXPECTED)


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
