"""Tables of numbers in Parquet files: read batch by batch with constant memory, and written."""

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from wrenchsight.models.arrays import Array
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import whole_file, writing_to
from wrenchsight.models.recordings.recording_format import RecordingFormat
from wrenchsight.models.recordings.table_checks import first_missing, rows_within

Lines = NDArray[np.int64]

_BATCH_ROWS = 1 << 16
_MAGIC = b"PAR1"


class ParquetContainer:
    """Logs in Parquet files; implements `log_container.LogContainer`."""

    suffixes: tuple[str, ...] = (".parquet", ".pq")

    def open(self, path: Path, form: RecordingFormat | None) -> "ParquetTable":
        """As the protocol; the file says all by itself, so that `form` is not read."""
        return ParquetTable(path)

    def write(self, path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
        """As the protocol."""
        with whole_file(path) as partial, writing_to(path):
            pq.write_table(pa.table(dict(columns)), partial, row_group_size=1 << 18)


class ParquetTable:
    """A Parquet file of numbers, one sample a row; rows are counted from 1.

    Raises:
        InputError: no such file, a directory, not a Parquet file or a damaged one, no rows.
    """

    row_word = "row"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notices: list[str] = []
        self.progress = 0.0  # share of the file that has been read
        file = self._opened()
        try:
            schema = file.schema_arrow
            self.names: tuple[str, ...] | None = tuple(schema.names)
            self.num_columns = len(schema.names)
            self.num_rows = file.metadata.num_rows
            self._types = schema.types
        finally:
            file.close()
        if self.num_rows == 0:
            raise InputError(path, "", "has no rows", "record the log again")

    def blocks(
        self,
        columns: list[int],
        rows: tuple[int, int] | None = None,
        may_be_empty: Collection[int] = (),
    ) -> Iterator[tuple[Array, Lines]]:
        """Reads the columns of the given numbers (0-based), batch by batch.

        Args:
            rows: first and last row, counted from 1.
            may_be_empty: those of the columns in which a value may be missing: NaN.

        Yields:
            (N, k) values, all others finite, and (N,) their rows.

        Raises:
            InputError: a column holds no numbers, a value is missing or not finite, or the file
                is damaged or ends before the last row.
        """
        assert self.names is not None
        names = [self.names[k] for k in columns]
        for column in columns:
            self._check_type(column)
        optional = np.array([column in may_be_empty for column in columns])
        first, last = rows_within(self.path, rows, self.num_rows, "rows")
        file = self._opened()
        begin = 1
        try:
            for batch in file.iter_batches(batch_size=_BATCH_ROWS, columns=names):
                end = begin + batch.num_rows
                self.progress = (end - 1) / self.num_rows
                if begin > last:
                    break
                if end > first:
                    start, stop = max(first - begin, 0), min(last + 1 - begin, batch.num_rows)
                    part = batch.slice(start, stop - start)
                    yield self._values(part, names, begin + start, optional)
                begin = end
        except (pa.ArrowException, OSError) as error:
            raise InputError(
                self.path, f"near row {begin}", f"is damaged ({error})", "write the file again"
            ) from error
        finally:
            file.close()

    def _values(
        self, batch: pa.RecordBatch, names: list[str], row: int, optional: NDArray[np.bool_]
    ) -> tuple[Array, Lines]:
        values = np.empty((batch.num_rows, len(names)))
        for k, name in enumerate(names):
            column = batch.column(name)
            if pa.types.is_timestamp(column.type):
                column = column.cast(pa.timestamp("ns")).cast(pa.int64())
                values[:, k] = column.to_numpy(zero_copy_only=False) * 1e-9
            else:
                column = column.cast(pa.float64(), safe=False)
                values[:, k] = column.to_numpy(zero_copy_only=False)
        missing = first_missing(values, optional)
        if missing is not None:
            i, k = missing
            raise InputError(
                self.path,
                f"row {row + i}, column {names[k]}",
                "is empty or not finite, expected a number",
                "correct or remove the row; a short gap is bridged",
            )
        return values, np.arange(row, row + batch.num_rows)

    def _check_type(self, column: int) -> None:
        assert self.names is not None
        kind = self._types[column]
        numeric = (pa.types.is_integer, pa.types.is_floating, pa.types.is_boolean)
        if not any(check(kind) for check in (*numeric, pa.types.is_timestamp)):
            raise InputError(
                self.path,
                f"column {self.names[column]}",
                f"holds {kind}, expected numbers",
                "write one numeric column per joint",
            )

    def _opened(self) -> pq.ParquetFile:
        path = self.path
        if path.is_dir():
            raise InputError(path, "", "is a directory, expected a log", "name a file in it")
        try:
            with path.open("rb") as raw:
                head = raw.read(4)
            if not head:
                raise InputError(path, "", "is empty", "record the log again")
            if head != _MAGIC:
                raise InputError(path, "", "is no Parquet file", "name a CSV file .csv")
            # Without read-ahead and memory mapping the memory stays that of some pages.
            return pq.ParquetFile(path, buffer_size=1 << 20, pre_buffer=False, memory_map=False)
        except FileNotFoundError as error:
            raise InputError(path, "", "no such file", "check the path") from error
        except (pa.ArrowException, OSError) as error:
            raise InputError(
                path, "", f"is a damaged Parquet file ({error})", "write the file again"
            ) from error
