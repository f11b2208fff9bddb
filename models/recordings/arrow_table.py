"""Logs in Arrow's files (IPC, also called Feather), as pandas and polars write them."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.feather as pa_feather
from numpy.typing import NDArray

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import opened
from wrenchsight.models.files.whole_file import whole_file, writing_to
from wrenchsight.models.recordings.parquet_table import ConvertedTable
from wrenchsight.models.recordings.recording_format import RecordingFormat

ARROW_MAGIC: Final = b"ARROW1"
FEATHER_1_MAGIC: Final = b"FEA1"


class ArrowContainer:
    """Logs in Arrow's files; implements `log_container.LogContainer`."""

    suffixes: tuple[str, ...] = (".feather", ".arrow", ".ipc")

    def open(self, path: Path, form: RecordingFormat | None) -> ConvertedTable:
        """As the protocol; the file describes itself, so that `form` is not used."""
        with opened(path, "a log") as file:
            head = file.read(len(ARROW_MAGIC))
        if not head:
            raise InputError(path, "", "is empty", "record the log again")
        try:
            return ConvertedTable(path, _parts(path, head))
        except (pa.ArrowException, OSError) as error:
            problem = f"is no Arrow file, or a damaged one ({str(error)[:200]})"
            raise InputError(path, "", problem, "write the file again") from error

    def write(self, path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
        """As the protocol."""
        table = pa.table(dict(columns))
        with (
            whole_file(path) as partial,
            writing_to(path),
            pa.OSFile(str(partial), "wb") as file,
            pa.ipc.new_file(file, table.schema) as writer,
        ):
            writer.write_table(table, max_chunksize=1 << 16)


def _parts(path: Path, head: bytes) -> Iterator[pa.Table]:
    """The batches of a file or a stream; a Feather file of the first version whole.

    Args:
        path: of the log.
        head: its first bytes.

    Raises:
        pa.ArrowException: it is damaged.
    """
    if head.startswith(FEATHER_1_MAGIC):
        yield pa_feather.read_table(path, memory_map=False)
        return
    with pa.OSFile(str(path), "rb") as source:
        if head == ARROW_MAGIC:
            reader = pa.ipc.open_file(source)
            for k in range(reader.num_record_batches):
                yield pa.Table.from_batches([reader.get_batch(k)])
        else:
            for batch in pa.ipc.open_stream(source):
                yield pa.Table.from_batches([batch])
