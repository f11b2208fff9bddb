"""Logs in JSON, one object a line: read as the Parquet table that Arrow makes of them.

    {"timestamp": 1709647351.25, "joint_positions": [0.24, -1.69], "state": {"mode": "AUTO"}}

Objects within become columns state.mode; lists as `parquet_table` has them.
"""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.json as pa_json
import pyarrow.parquet as pq
from numpy.typing import NDArray

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import opened
from wrenchsight.models.recordings.parquet_table import ParquetTable, flattened
from wrenchsight.models.recordings.recording_format import RecordingFormat

_BLOCK_BYTES: Final = 1 << 22
_ONE_A_LINE: Final = "write one object a line, such as by jq -c '.[]' log.json > log.jsonl"
_AS_ARRAYS: Final = (
    "write one object for each sample, a line each; or, if its entries are arrays over all "
    "samples, save them as npz, such as by numpy.savez('log.npz', **json.load(open('log.json')))"
)


class JsonLinesContainer:
    """Logs of JSON objects; implements `log_container.LogContainer`."""

    suffixes: tuple[str, ...] = (".jsonl", ".ndjson", ".json")

    def open(self, path: Path, form: RecordingFormat | None) -> "JsonLinesTable":
        """As the protocol; the file describes itself, so that `form` is not used."""
        return JsonLinesTable(path)

    def write(self, path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
        """Not for JSON.

        Raises:
            InputError: always.
        """
        raise InputError(path, "", "is not written as JSON", "give it an ending such as .csv")


class JsonLinesTable(ParquetTable):
    """A log in JSON, one sample a line; the Parquet table of it lasts as long as this object.

    Raises:
        InputError: no such file, no JSON, another JSON than one object a line, or objects whose
            entries change their type.
    """

    row_word = "line"

    def __init__(self, path: Path) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="wrenchsight", ignore_cleanup_errors=True)
        copy = Path(self._folder.name) / path.name
        with opened(path, "a log") as file:
            begin = file.read(_BLOCK_BYTES).lstrip(b"\xef\xbb\xbf \t\r\n")
        if begin.startswith(b"["):
            raise InputError(path, "", "is JSON, but not one object a line", _ONE_A_LINE)
        if not begin.startswith(b"{"):
            raise InputError(path, "", "is no JSON", "name the file by what it is, such as .csv")
        try:
            _write_parquet(path, copy)
        except (pa.ArrowException, ValueError, OSError) as error:
            problem = f"cannot be read as JSON ({str(error).splitlines()[0][:200]})"
            remedy = "write one object a line, all with the same entries"
            raise InputError(path, "", problem, remedy) from error
        super().__init__(path, source=copy)
        if self.num_rows == 1:
            raise InputError(path, "", "is one JSON object, expected one a sample", _AS_ARRAYS)


def _write_parquet(path: Path, copy: Path) -> None:
    """Writes the objects of a file as a Parquet file, some megabytes at a time.

    Raises:
        pa.ArrowException, ValueError: it is no JSON, or its entries change their type.
    """
    options = pa_json.ReadOptions(block_size=_BLOCK_BYTES, use_threads=False)
    with pa_json.open_json(path, read_options=options) as batches:
        schema = pa.schema([(field.name, _widened(field.type)) for field in batches.schema])
    parsing = pa_json.ParseOptions(explicit_schema=schema, unexpected_field_behavior="ignore")
    with pa_json.open_json(path, read_options=options, parse_options=parsing) as batches:
        flat_schema = flattened(schema.empty_table()).schema
        with pq.ParquetWriter(copy, flat_schema) as writer:
            for batch in batches:
                writer.write_table(flattened(pa.Table.from_batches([batch])))


def _widened(kind: pa.DataType) -> pa.DataType:
    """A type that also holds what a later line may have: numbers with a fraction."""
    if pa.types.is_integer(kind):
        return pa.float64()
    if pa.types.is_list(kind):
        return pa.list_(_widened(kind.value_type))
    if pa.types.is_struct(kind):
        return pa.struct([(field.name, _widened(field.type)) for field in kind])
    return kind
