"""Tables of numbers in Parquet files: read batch by batch with constant memory, and written.

A column of lists, all of one length k, becomes the columns NAME.1..NAME.k. Lists of lists are read
row by row; a list of one number is that number. The fields of a column of records (a struct)
become the columns NAME.FIELD, those of a list of k records NAME.1.FIELD..NAME.k.FIELD. Numbers and
dates with times that are written as text are read, times of a day and durations in s.

Files of other kinds are read as a Parquet table that is made of them (`ConvertedTable`).
"""

import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import opened
from wrenchsight.models.files.whole_file import whole_file, writing_to
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.date_stamps import StampForm, stamp_form, stamp_seconds
from wrenchsight.models.recordings.recording_format import RecordingFormat
from wrenchsight.models.recordings.table_checks import (
    no_words,
    other_words,
    refuse_missing,
    rows_within,
)

Lines = NDArray[np.int64]

_BATCH_ROWS = 1 << 16
_MAGIC = b"PAR1"
_MOST_ENTRIES = 4096  # of a list
_MOST_LEVELS = 8  # of records and lists of them within records
_ONE_FORM = "write all samples with the same entries"


class _Place(NamedTuple):
    """Where a column of the table is stored."""

    name: str  # of the column in the file
    entry: int  # of its lists


class ParquetContainer:
    """Logs in Parquet files; implements `log_container.LogContainer`."""

    suffixes: tuple[str, ...] = (".parquet", ".pq")

    def open(self, path: Path, form: RecordingFormat | None) -> "ParquetTable":
        """As the protocol; the file describes itself, so that `form` is not used."""
        if not _has_records(path):
            return ParquetTable(path)
        try:
            with pq.ParquetFile(path) as file:
                return ConvertedTable(path, map(_as_table, file.iter_batches(_BATCH_ROWS)))
        except (pa.ArrowException, OSError) as error:
            raise InputError(path, "", f"is damaged ({error})", "write the file again") from error

    def write(self, path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
        """As the protocol."""
        with whole_file(path) as partial, writing_to(path):
            pq.write_table(pa.table(dict(columns)), partial, row_group_size=1 << 18)


class ParquetTable:
    """A Parquet file of numbers or lists of them, one sample a row; rows are counted from 1.

    Args:
        path: path of the file.
        part: rows of the file that are the table, counted from 0; None: all.

    Raises:
        InputError: no such file, a directory, not a Parquet file or a damaged one, no rows.
    """

    row_word = "row"
    joint_list: tuple[str, ...] = ()  # names of the joints, where the file lists them once

    def __init__(self, path: Path, part: range | None = None, source: Path | None = None) -> None:
        """Reads the file's schema and the lengths of its lists.

        Args:
            path: of the file.
            part: rows of the file, from 0, that are the table's; None: all.
            source: the file that is read for the log at `path`; None: the log itself.

        Raises:
            InputError: the file is damaged, has no rows, or fewer than `part` says.
        """
        self.path = path
        self._source = source or path
        self.notices: list[str] = []
        self.progress = 0.0  # share of the file that has been read
        file = self._opened()
        try:
            schema = file.schema_arrow
            self.num_rows = file.metadata.num_rows  # below, of `part` alone
            self._types = dict(zip(schema.names, schema.types, strict=True))
            # Refused where they are read (`_check_type`), as are columns that hold no numbers.
            self._repeated = {name for name in schema.names if schema.names.count(name) > 1}
            # A column of the file holds numbers, or lists of one length: its width. The table has a
            # column for each entry of the lists, and `_places` where it is in the file.
            self._places: list[_Place] = []  # by column of the table
            widths: dict[str, int] = {}  # by name, of the columns that can be read
            if self.num_rows:
                widths = self._widths(file)
                for name, width in widths.items():
                    self._places += [_Place(name, k) for k in range(width)]
        except (pa.ArrowException, OSError) as error:
            raise self._damaged("near row 1", error) from error
        finally:
            file.close()
        self._begin = 0  # row of the file, from 0, that is the table's first
        if part is not None:
            if part.stop > self.num_rows:
                problem = f"has {self.num_rows} rows, expected {part.stop} or more"
                raise InputError(path, "", problem, "write the file again")
            self._begin = part.start
            self.num_rows = len(part)
        if self.num_rows == 0:
            raise InputError(path, "", "has no rows", "record the log again")
        self.names: tuple[str, ...] | None = tuple(
            f"{place.name}.{place.entry + 1}" if widths[place.name] > 1 else place.name
            for place in self._places
        )
        self.num_columns = len(self._places)

    def row_words(self, columns: Sequence[int], in_all_rows: bool = True) -> Sequence[str]:
        """As the protocol; a column of lists of words is one column."""
        names = [self._places[column].name for column in columns]
        first: list[str] = []
        file = self._opened()
        begin = 1 - self._begin
        try:
            for batch in file.iter_batches(_BATCH_ROWS, columns=names):
                rows = batch.slice(max(0, 1 - begin)).slice(0, self.num_rows + 1 - max(begin, 1))
                begin += batch.num_rows
                for words, row in self._words(rows, names):
                    if words == ["None"]:  # a row of another topic
                        continue
                    first = first or words
                    if words != first:
                        place = f"row {begin - batch.num_rows + row}"
                        raise other_words(self.path, place, first, words)
                if first and not in_all_rows:
                    break
        except (pa.ArrowException, OSError) as error:
            raise self._damaged(f"near row {begin}", error) from error
        finally:
            file.close()
        return first

    def frame(self, num_rows: int | None = None) -> pd.DataFrame:
        """The rows, or the first ones, with their texts; one column for each of the table's names.

        Lists of one entry in all rows are that entry.

        Raises:
            InputError: the file is damaged.
        """
        file = self._opened()
        names = [place.name for place in self._places]
        try:
            batches = file.iter_batches(min(num_rows or _BATCH_ROWS, _BATCH_ROWS), columns=names)
            parts = list(islice(batches, 1)) if num_rows else list(batches)
            table = pa.Table.from_batches(parts, parts[0].schema if parts else None)
        except (pa.ArrowException, OSError) as error:
            raise self._damaged("near row 1", error) from error
        finally:
            file.close()
        rows = table.select(names).slice(self._begin, self.num_rows)
        return pa.table(
            [_single(rows.column(k)) for k in range(rows.num_columns)], names
        ).to_pandas()

    def _words(self, rows: pa.RecordBatch, names: list[str]) -> Iterator[tuple[list[str], int]]:
        """The words of the rows of a batch, each once, with the number of its first row in it."""
        columns = [rows.column(name) for name in names]
        if not all(pa.types.is_string(_entry_type(c.type)) or
                   pa.types.is_large_string(_entry_type(c.type)) or
                   pa.types.is_dictionary(_entry_type(c.type)) for c in columns):  # fmt: skip
            raise no_words(self.path)
        # A row whose words are those of the row before costs no more than a comparison.
        is_new = np.zeros(rows.num_rows, bool)
        is_new[:1] = True
        for column in columns:
            flat = column.flatten() if _is_list(column.type) else column
            codes = pc.dictionary_encode(flat).indices.to_numpy(zero_copy_only=False)
            if len(codes) % max(1, rows.num_rows):
                is_new[:] = True  # lists of different lengths
                continue
            codes = codes.reshape(rows.num_rows, -1)
            is_new[1:] |= (codes[1:] != codes[:-1]).any(axis=1)
        for row in np.flatnonzero(is_new).tolist():
            words: list[str] = []
            for column in columns:
                cell = column[row].as_py()
                words += [str(word) for word in (cell if isinstance(cell, list) else [cell])]
            yield words, row

    def blocks(
        self,
        columns: list[int],
        rows: tuple[int, int] | None = None,
        may_be_empty: Collection[int] = (),
    ) -> Iterator[tuple[Array, Lines]]:
        """As the protocol LogTable: blocks of (values (N, k), numbers (N,) of their rows).

        Args:
            columns: numbers of the k columns, from 0.
            rows: the first and the last row that is read, from 1 in this table; None: all.
            may_be_empty: columns of which a value may be missing: NaN.

        Raises:
            InputError: rows beyond the end, a value that is missing or not finite, a column that
                holds no numbers, or two of one name.
        """
        for column in columns:
            self._check_type(column)
        first, last = rows_within(self.path, rows, self.num_rows, "rows")
        file = self._opened()
        # Number, in this table, of the next batch's first row: 0 or less before the table's part of
        # the file. Batches are those of the row groups from the one of `first` on.
        begin = 1 - self._begin
        try:
            groups, skipped = self._groups(file, first)
            begin += skipped
            names = list(dict.fromkeys(self._places[column].name for column in columns))
            for batch in file.iter_batches(_BATCH_ROWS, groups, columns=names):
                end = begin + batch.num_rows  # of the row behind the batch
                self.progress = min(max(0.0, (end - 1) / self.num_rows), 1.0)
                if begin > last:
                    break
                if end > first:
                    start, stop = max(first - begin, 0), min(last + 1 - begin, batch.num_rows)
                    batch_rows = batch.slice(start, stop - start)
                    values = self._values(batch_rows, columns, begin + start)
                    numbers = np.arange(begin + start, begin + start + len(values))
                    refuse_missing(self, self.path, values, numbers, columns, may_be_empty)
                    yield values, numbers
                begin = end
        except (pa.ArrowException, OSError) as error:
            raise self._damaged(f"near row {begin}", error) from error
        finally:
            file.close()

    def _groups(self, file: pq.ParquetFile, first: int) -> tuple[list[int], int]:
        """The row groups from the one that holds row `first` on, and how many rows precede them."""
        skipped = 0
        for group in range(file.num_row_groups):
            count = file.metadata.row_group(group).num_rows
            if skipped + count >= first + self._begin:
                return list(range(group, file.num_row_groups)), skipped
            skipped += count
        return [], skipped

    def _values(self, batch: pa.RecordBatch, columns: list[int], row: int) -> Array:
        """(N, k) numbers of a batch whose first row has the number `row`."""
        values = np.empty((batch.num_rows, len(columns)))
        decoded: dict[str, Array] = {}
        for i, column in enumerate(columns):
            name, entry = self._places[column]
            if name not in decoded:
                width = 1 + max(place.entry for place in self._places if place.name == name)
                decoded[name] = self._numbers(batch.column(name), name, width, row)
            values[:, i] = decoded[name][:, entry]
        return values

    def _numbers(self, column: pa.Array, name: str, width: int, row: int) -> Array:
        """(N, width) numbers of a column of the file."""
        if _is_list(column.type) and column.null_count:  # rows of another topic
            numbers = np.full((len(column), width), np.nan)
            is_there = column.is_valid().to_numpy(zero_copy_only=False)
            if is_there.any():
                numbers[is_there] = self._numbers(column.drop_null(), name, width, row)
            return numbers
        size = len(column)
        while _is_list(column.type):
            counts = pc.fill_null(pc.list_value_length(column), -1).to_numpy(zero_copy_only=False)
            other_lengths = np.flatnonzero(counts != (counts[0] if len(counts) else 0))
            if counts.size and (counts.min() < 0 or len(other_lengths)):
                k = int(other_lengths[0] if len(other_lengths) else 0)
                place = f"row {row + k * size // max(1, len(column))}, column {name}"
                problem = f"a list of {counts[k]} numbers" if counts[k] >= 0 else "is empty"
                raise InputError(self.path, place, problem, "write lists of one length")
            column = column.flatten()
        numbers = self._numbers_of(column, name, row)
        if len(numbers) != size * width:
            place = f"row {row}, column {name}"
            problem = f"lists of {len(numbers) // max(1, size)} numbers, but {width} in row 1"
            raise InputError(self.path, place, problem, "write lists of one length")
        return np.asarray(numbers, float).reshape(size, width)

    def _numbers_of(self, column: pa.Array, name: str, row: int) -> Array:
        """The numbers of a column without lists: times in s, text as the numbers that it is."""
        types = pa.types
        if types.is_timestamp(column.type):
            column = column.cast(pa.timestamp("ns")).cast(pa.int64())
            return np.asarray(column.to_numpy(zero_copy_only=False) * 1e-9)
        if types.is_duration(column.type) or types.is_time(column.type):
            in_ns = pa.duration("ns") if types.is_duration(column.type) else pa.time64("ns")
            column = column.cast(in_ns).cast(pa.int64())
            return np.asarray(column.to_numpy(zero_copy_only=False) * 1e-9)
        try:
            if _is_text(column.type):
                column = _numbers_of_text(column)
            return np.asarray(column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False))
        except pa.ArrowInvalid as error:
            place = f"row {row} or below, column {name}"
            problem = f"holds text that is no number ({str(error)[:80]})"
            raise InputError(self.path, place, problem, "correct or remove the row") from error

    def _widths(self, file: pq.ParquetFile) -> dict[str, int]:
        """How many numbers a row of each column holds, by its type or its first row."""
        lists = [
            name
            for name, kind in self._types.items()
            if _is_list(kind) and _is_number(_entry_type(kind)) and name not in self._repeated
        ]
        widths = dict.fromkeys(self._types, 1)
        if lists:
            top_rows = next(file.iter_batches(_BATCH_ROWS, columns=lists))
            for name in lists:
                column = top_rows.column(name).drop_null().slice(0, 1)
                while _is_list(column.type):
                    column = column.flatten()
                widths[name] = len(column)
                if not 1 <= len(column) <= _MOST_ENTRIES:
                    self.notices.append(
                        f"the column {name} is left out: it holds lists of {len(column)} numbers, "
                        f"expected 1 to {_MOST_ENTRIES}"
                    )
                    del widths[name]
        return widths

    def _check_type(self, column: int) -> None:
        """Refuses a column that holds no numbers, or shares its name with another."""
        name = self._places[column].name
        if name in self._repeated:
            problem = f'names the column "{name}" more than once'
            raise InputError(self.path, "schema", problem, "give each column its own name")
        kind = self._types[name]
        if _is_text(kind) and self._first_text(name) is not None:
            return
        if not _is_number(_entry_type(kind)):
            remedy = "write one numeric column per joint, or lists of numbers"
            raise InputError(self.path, f"column {name}", f"holds {kind}, expected numbers", remedy)

    def _first_text(self, name: str) -> StampForm | float | None:
        """What the first text of a column is: how it writes a time, a number, or None."""
        file = self._opened()
        try:
            batch = next(file.iter_batches(_BATCH_ROWS, columns=[name]), None)
        finally:
            file.close()
        cells = [] if batch is None else batch.column(0).drop_null()
        if not len(cells):
            return None
        text = str(cells[0]).strip()
        with suppress(ValueError):
            return float(text)
        return stamp_form(text)

    def _damaged(self, place: str, error: Exception) -> InputError:
        return InputError(self.path, place, f"is damaged ({error})", "write the file again")

    def _opened(self) -> pq.ParquetFile:
        path = self.path
        with opened(self._source, "a log") as raw:
            head = raw.read(4)
        if not head:
            raise InputError(path, "", "is empty", "record the log again")
        if head != _MAGIC:
            raise InputError(path, "", "is no Parquet file", "name a CSV file .csv")
        try:
            # Without read-ahead and memory mapping the memory stays that of some pages.
            return pq.ParquetFile(
                self._source, buffer_size=1 << 20, pre_buffer=False, memory_map=False
            )
        except (pa.ArrowException, OSError) as error:
            problem = f"is a damaged Parquet file ({error})"
            raise InputError(path, "", problem, "write the file again") from error


def _is_list(kind: pa.DataType) -> bool:
    types = pa.types
    return bool(types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind))


def _single(column: pa.ChunkedArray) -> pa.ChunkedArray:
    """The entries of lists that have one each in all rows; any other column as it is."""
    is_single = _is_list(column.type) and pc.all(
        pc.equal(pc.fill_null(pc.list_value_length(column), 0), 1)
    )
    return pc.list_flatten(column) if is_single and is_single.as_py() else column


def _entry_type(kind: pa.DataType) -> pa.DataType:
    """The type of the entries of a list, or of a list of lists; any other type as it is."""
    while _is_list(kind):
        kind = kind.value_type
    return kind


def _is_number(kind: pa.DataType) -> bool:
    types = pa.types
    numeric = (types.is_integer, types.is_floating, types.is_boolean, types.is_timestamp,
               types.is_duration, types.is_time, types.is_decimal)  # fmt: skip
    return any(check(kind) for check in numeric)


def _is_text(kind: pa.DataType) -> bool:
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind))


def _numbers_of_text(column: pa.Array) -> pa.Array:
    """Numbers, or the seconds of dates with times, that are written as text.

    Raises:
        pa.ArrowInvalid: a cell is neither.
    """
    cells = pa.chunked_array([column.cast(pa.string())])
    texts = cells.drop_null()
    form = stamp_form(str(texts[0]).strip()) if len(texts) else None
    if form is not None:
        cells = stamp_seconds(cells, form)
    return pc.cast(cells, pa.float64()).combine_chunks()


class ConvertedTable(ParquetTable):
    """A log of another kind as a Parquet table of it, which lasts as long as this object.

    Args:
        path: of the log, for error lines.
        parts: successive rows of it.

    Raises:
        InputError: there is no part, or it has no rows.
        pa.ArrowException: a part has other types than the first one.
    """

    def __init__(self, path: Path, parts: Iterable[pa.Table]) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="wrenchsight", ignore_cleanup_errors=True)
        copy = Path(self._folder.name) / path.name
        writer: pq.ParquetWriter | None = None
        try:
            for part in parts:
                flat = flattened(part)
                writer = writer or pq.ParquetWriter(copy, flat.schema)
                try:
                    writer.write_table(flat.cast(writer.schema, safe=False))
                except (pa.ArrowInvalid, ValueError) as error:
                    problem = f"changes its columns ({str(error)[:200]})"
                    raise InputError(path, "", problem, _ONE_FORM) from error
        finally:
            if writer is not None:
                writer.close()
        if writer is None:
            raise InputError(path, "", "has no rows", "record the log again")
        super().__init__(path, source=copy)


def _as_table(batch: pa.RecordBatch) -> pa.Table:
    return pa.Table.from_batches([batch])


def _has_records(path: Path) -> bool:
    """Whether a column of a Parquet file holds records; False where it is none, or damaged."""
    try:
        return any(pa.types.is_struct(kind) for kind in pq.read_schema(path).types)
    except (pa.ArrowException, OSError):
        return False


def flattened(table: pa.Table) -> pa.Table:
    """A table whose records (objects within objects) are columns of their own."""
    for _ in range(_MOST_LEVELS):
        if any(pa.types.is_struct(kind) for kind in table.schema.types):
            table = table.flatten()
        elif any(_holds_records(kind) for kind in table.schema.types):
            table = _without_lists_of_records(table)
        else:
            break
    return table


def _holds_records(kind: pa.DataType) -> bool:
    """Whether a type is a list of records."""
    return _is_list(kind) and pa.types.is_struct(kind.value_type)


def _without_lists_of_records(table: pa.Table) -> pa.Table:
    """A table with a column of records for each entry of its lists of records, NAME.1..NAME.k.

    Lists of several lengths are left out.
    """
    columns: dict[str, Any] = {}
    for name in table.column_names:
        column = table.column(name).combine_chunks()
        if not _holds_records(column.type):
            columns[name] = column
            continue
        lengths = pc.unique(pc.list_value_length(column)).to_pylist()
        if len(lengths) != 1 or not lengths[0] or lengths[0] > _MOST_ENTRIES:
            continue
        entries = pc.list_flatten(column)
        for k in range(lengths[0]):
            places = pa.array(np.arange(k, len(entries), lengths[0]))
            columns[f"{name}.{k + 1}"] = entries.take(places)
    return pa.table(columns)
