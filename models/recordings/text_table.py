"""Tables of numbers in text files (CSV): read block by block with constant memory, and written."""

import csv
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
from numpy.typing import NDArray

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import opened
from wrenchsight.models.files.whole_file import whole_file, writing_to
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.date_stamps import StampForm, stamp_form, stamp_seconds
from wrenchsight.models.recordings.list_cells import UnfoldedFile, has_lists
from wrenchsight.models.recordings.plain_text import PlainCopy, is_plain
from wrenchsight.models.recordings.recording_format import RecordingFormat
from wrenchsight.models.recordings.table_checks import other_words

Lines = NDArray[np.int64]

BLOCK_BYTES = 1 << 23  # small beside any memory, large enough that a block's overhead vanishes
_LONGEST_LINE = 1 << 17  # more than any number of joints needs
_SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", " ": "spaces"}
# Unambiguous, so that it does not backtrack: a cell may have a hundred thousand digits.
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
# What stands for a missing number, also in pandas and in databases.
_NAN_CELLS = ("nan", "NaN", "NAN", "-nan", "-nan(ind)", "null", "NULL", "None", "N/A", "n/a", "NA",
              "#N/A", "<NA>", "-")  # fmt: skip
_UNIT_CELL = re.compile(r"\W*[a-zA-Zµ°%‰]{0,5}([ */·^_][a-zA-Z0-9°]{1,5}){0,2}\W*")
_UNIT_LENGTH = 20  # characters
_HEAD_LINES = 100  # in which the table's first row is looked for
_MIN_CELLS = 4  # of a table
_MOST_LEVELS = 4  # lines of names above each other
_MOST_LAST_LINES = 20  # below the table that are no rows, and
_LAST_BYTES = 1 << 12  # the end of the file in which they are looked for
_CAN_FRAME = re.compile(r"\(\d{1,12}\.\d{1,9}\) +\w{1,16} +[0-9A-Fa-f]{3,8}##?[0-9A-Fa-f]*")
_BLANK_LINE = re.compile(rb"(?m)^[ \t]+(?=\r?$)")
_BINARY_KINDS = (  # first bytes, kind of file, remedy
    (b"PAR1", "a Parquet file", "name it .parquet"),
    (b"\x1f\x8b", "compressed by gzip", "name it .csv.gz"),
    (b"\x28\xb5\x2f\xfd", "compressed by zstd", "name it .csv.zst"),
    (b"PK\x03\x04", "a zip archive or a spreadsheet", "unpack it, or export it as CSV"),
    (
        b"\x89HDF",
        "an HDF5 file",
        "save its arrays as npz, such as by h5py and numpy.savez('log.npz', t=.., q=.., v=.., "
        "i=..), samples in rows",
    ),
    (b"MATLAB", "a MATLAB file", "name it .mat"),
    (b"#ROSBAG", "a ROS 1 bag", "name it .bag"),
    (b"\x89MCAP", "an MCAP file", "name it .mcap"),
    (b"SQLite format 3", "an SQLite database", "name it .db3 if it is a rosbag2"),
)


class _Fault(NamedTuple):
    """What is wrong with a line or a cell, and what to do."""

    problem: str
    remedy: str


class TextContainer:
    """Logs in text files; implements `log_container.LogContainer`."""

    suffixes: tuple[str, ...] = (".csv", ".txt", ".tsv", ".dat", ".log")

    def open(self, path: Path, form: RecordingFormat | None) -> "TextTable":
        """As the protocol; without a description, the file's first lines show how it is written."""
        plain = None if is_plain(path) else PlainCopy(path)
        if form is not None:
            return _without_lists(
                lambda copy: TextTable(
                    path, form.separator, form.decimal_mark, form.skip_lines, form.header, copy
                ),
                plain,
            )
        table = _without_lists(lambda copy: TextTable(path, copy=copy), plain)
        if table.names is not None and table.separator != ",":
            table.notices.append(f"columns are separated by {_SEPARATORS[table.separator]}")
        return table

    def write(self, path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
        """As the protocol."""
        table = pa.table(dict(columns))
        with whole_file(path) as partial, writing_to(path), partial.open("wb") as file:
            write_csv_header(file, table.schema.names)
            options = pa_csv.WriteOptions(include_header=False)
            with pa_csv.CSVWriter(file, table.schema, write_options=options) as writer:
                writer.write_table(table, max_chunksize=1 << 16)


def _without_lists(
    open_table: "Callable[[PlainCopy | UnfoldedFile | None], TextTable]", plain: PlainCopy | None
) -> "TextTable":
    """The table, or one with a column for each entry where its cells hold lists.

    Args:
        open_table: opens the log, or a copy of it.
        plain: a copy of a log that is not written plainly; None: it is.
    """
    table = open_table(plain)
    if plain is not None:
        table.notices += plain.notices
    if table.names is None or not has_lists(table.first_cells):
        return table
    source = table.path if plain is None else plain.path
    return open_table(UnfoldedFile(source, table.separator, table.skip_lines))


def _with_units(names: Sequence[str], units: Sequence[str]) -> tuple[str, ...]:
    """The names of columns with their units behind, as "q1 [rad]"; without where there is none."""
    return tuple(
        f"{name} [{unit.strip('[]() ')}]" if unit.strip("[]()- ") else name
        for name, unit in zip(names, units, strict=True)
    )


def _stamp_forms(first_cells: Sequence[str]) -> dict[int, StampForm]:
    """How the columns that hold dates with times write them, by their numbers from 0."""
    forms = {k: stamp_form(cell) for k, cell in enumerate(first_cells)}
    return {k: form for k, form in forms.items() if form is not None}


def _joined_levels(levels: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """A name for each column from lines of names above each other, as pandas writes MultiIndexes.

    The first column is the index, whose name is the last one: those above name the levels.
    """
    names = [" ".join(name for name in column if name) for column in zip(*levels, strict=True)]
    names[0] = next((level[0] for level in reversed(levels) if level[0]), "")
    return tuple(names)


def write_csv_header(file: BinaryIO, names: Sequence[str]) -> None:
    """Writes names without quotes, which pyarrow's own header has."""
    file.write((",".join(names) + "\n").encode())


class TextTable:
    """A text file of numbers, one sample a line; the rows are numbered as lines of the file.

    Args:
        path: the file; UTF-8, with or without a byte order mark, any line ends.
        separator: one character; None: taken from the first line.
        decimal_mark: "." or ","; None: taken from the first line of numbers.
        skip_lines: lines before the header or the first row.
        header: whether the first line after these names the columns; None: it does if one of its
            cells is no number.
        copy: the file's content as a plain table, or without lists in its cells; None: the file is
            such a table itself.

    A line of units below the header is added to the names, as "q1 [rad]"; further lines of names
    (pandas' MultiIndex) are joined. A column of dates with times is read in seconds. Lines of text
    below the last row, and repetitions of the header, are left out with a notice.

    Attributes:
        first_cells: first cells of the first row.
        skip_lines: lines before the header or the first row.

    Raises:
        InputError: no such file, a directory, a binary file, no line of numbers.
    """

    row_word = "line"

    def __init__(
        self,
        path: Path,
        separator: str | None = None,
        decimal_mark: str | None = None,
        skip_lines: int = 0,
        header: bool | None = None,
        copy: PlainCopy | UnfoldedFile | None = None,
    ) -> None:
        """Reads the head of the file: where the table begins, its separator, names and units.

        Args:
            path: of the log, for error lines.
            separator, decimal_mark, header: None: recognised from the first lines.
            skip_lines: lines before the header or the first row.
            copy: read instead of the log; None: the log is read.

        Raises:
            InputError: an empty or binary file, or numbers in place of names.
        """
        self.path = path
        self._copy = copy  # which is removed with the table
        self._source = path if copy is None else copy.path
        self.notices: list[str] = []
        self.progress = 0.0  # share of the file that has been read
        with opened(self._source, "a log") as file:
            _refuse_binary(path, file)
            self._begin = _after_byte_order_mark(file)
            # The table's top line, and how many lines precede it. From here on each `_line` reads
            # the one below the last.
            may_be_blank = header is not False
            top_line, self.skip_lines = self._top_line_from(file, skip_lines, may_be_blank)
            if separator is None and header is None:
                top_line, self.skip_lines = self._below_words(file, top_line, self.skip_lines)
            if not top_line:
                raise InputError(path, "", "is empty", "record the log again")
            if _CAN_FRAME.match(top_line):
                problem = "holds raw frames of a CAN bus, as candump writes them"
                remedy = "decode them with the drives' DBC file, such as by cantools, into a table "
                remedy += "(CSV: t, q1.., v1.., i1..)"
                raise InputError(path, "", problem, remedy)
            self.separator = separator or _separator_of(top_line)  # by which `_cells` splits
            top_cells = self._cells(top_line)
            has_header = header
            if has_header is None:
                has_header = not all(_is_number(cell.replace(",", ".")) for cell in top_cells)
            # The header, the units below it, and the first row of numbers.
            self.names: tuple[str, ...] | None = tuple(top_cells) if has_header else None
            self._num_head_lines = self.skip_lines + (1 if has_header else 0)
            line_of_numbers = self._line(file).strip() if has_header else top_line
            if self.names is not None:
                line_of_numbers = self._with_further_levels(file, line_of_numbers)
            if self.names is not None and self._is_of_units(self._cells(line_of_numbers)):
                self.names = _with_units(self.names, self._cells(line_of_numbers))
                self.notices.append("units are read from the line below the header")
                self._num_head_lines += 1
                line_of_numbers = self._line(file).strip()
            self.first_cells = tuple(self._cells(line_of_numbers))
        if self.names and self.first_cells[len(self.names) :] == ("",):
            self.names = (*self.names, "")  # a separator at the end of the rows alone
            top_cells = [*top_cells, ""]
        self._stamps = _stamp_forms(self.first_cells)
        self.num_columns = len(top_cells)
        self._top_line = top_line
        self._end = self._end_of_rows()
        self.decimal_mark = decimal_mark or self._decimal_mark_of(line_of_numbers)
        if has_header and all(_is_number(cell, self.decimal_mark) for cell in top_cells):
            problem = "holds numbers where the names of the columns are expected"
            remedy = "set header: false in the description, or add a first line t,q1,..."
            raise InputError(path, f"line {self._num_head_lines}", problem, remedy)

    def _top_line_from(
        self, file: BinaryIO, skip_lines: int, may_be_blank: bool
    ) -> tuple[str, int]:
        """The first line of the table, behind which the file is left, and how many precede it.

        Args:
            file: at its begin, behind a byte order mark.
            skip_lines: lines that are no part of the table.
            may_be_blank: whether blank lines below these are passed over, too.
        """
        for _ in range(skip_lines):
            self._line(file)
        num_skipped, size = skip_lines, self._source.stat().st_size
        top_line = self._line(file).lstrip("#").strip()  # numpy.savetxt writes "# " and names
        while not top_line and may_be_blank and file.tell() < size:
            num_skipped += 1
            top_line = self._line(file).lstrip("#").strip()
        return top_line, num_skipped

    def _below_words(self, file: BinaryIO, top_line: str, skip_lines: int) -> tuple[str, int]:
        """As `_top_line_from`, below words on the recording that stand above the table."""
        num_words = self._num_words_above(file, top_line)
        if not num_words:
            return top_line, skip_lines
        file.seek(self._begin)
        num_skipped = skip_lines + num_words
        self.notices.append(f"the first {num_skipped} lines are no table: left out")
        return self._top_line_from(file, num_skipped, may_be_blank=False)

    def _num_words_above(self, file: BinaryIO, top_line: str) -> int:
        """Lines above a table that are no part of it, such as words on the recording."""
        here, lines = file.tell(), [top_line]
        size = self._source.stat().st_size
        while len(lines) < _HEAD_LINES and file.tell() < size:
            lines.append(self._line(file).strip())
        file.seek(here)
        shown = [(k, text) for k, text in enumerate(lines) if text]
        counts = [len(_split(text, _separator_of(text))) for _, text in shown]
        if len(shown) < 2 or counts[0] == counts[1] >= _MIN_CELLS:
            return 0
        for i in range(1, len(shown) - 1):
            cells = _split(shown[i][1], _separator_of(shown[i][1]))
            is_row = sum(_is_number(cell.replace(",", ".")) for cell in cells) > 0.5 * len(cells)
            if not (is_row and counts[i] >= _MIN_CELLS and counts[i] == counts[i + 1]):
                continue
            first = i
            while first > 0 and i - first < 2 and counts[first - 1] == counts[i]:
                first -= 1
            return shown[first][0] if first < i else 0
        return 0

    def _with_further_levels(self, file: BinaryIO, line: str) -> str:
        """Joins lines of names below the header to the names, where these repeat.

        Args:
            file: behind the line.
            line: below the header.

        Returns:
            The first line that is none of names.
        """
        assert self.names is not None
        levels: list[Sequence[str]] = [self.names]
        repeats = len(self.names) - len(set(self.names))
        # Half of the names or more repeat (but for the time's): quantities, over those of joints.
        while repeats * 2 >= len(self.names) - 1 > 0 and len(levels) < _MOST_LEVELS:
            cells = self._cells(line)
            is_named = any(cells) and not any(_is_number(cell.replace(",", ".")) for cell in cells)
            if len(cells) != len(self.names) or not is_named or has_lists(cells):
                break
            levels.append(cells)
            line = self._line(file).strip()
        if len(levels) > 1:
            self.names = _joined_levels(levels)
            self.notices.append(f"the names stand in {len(levels)} lines, which are joined")
            self._num_head_lines += len(levels) - 1
        return line

    def _end_of_rows(self) -> int:
        """Where the lines of text below the last row begin, in bytes; the file's end without any.

        Such a line has fewer cells than the table and no number in the first one: EOF, or words on
        the recording.
        """
        with opened(self._source, "a log") as file:
            size = file.seek(0, 2)
            file.seek(max(self._begin, size - _LAST_BYTES))
            last_bytes = file.read()
        end = begin = size  # of the line that is looked at
        left_out: list[str] = []
        # The first of these may be a part of a line.
        for line in reversed(last_bytes.splitlines(keepends=True)[1:][-_MOST_LAST_LINES:]):
            begin -= len(line)
            text = line.decode("utf-8", "replace").strip()
            if not text:
                continue
            if not self._is_remark(self._cells(text)):
                break
            end = begin
            left_out.append(text)
        if left_out:
            notice = "the last line is no row"
            if len(left_out) > 1:
                notice = f"the last {len(left_out)} lines are no rows"
            self.notices.append(f'{notice}: left out (beginning "{left_out[-1][:40]}")')
        return end

    def _is_remark(self, cells: Sequence[str]) -> bool:
        """Whether the cells of a line are fewer than those of a row, and words."""
        words = " ".join(cells)
        return len(cells) < self.num_columns and bool(re.match(r"\W*[A-Za-z]{3}", words))

    def _is_of_units(self, cells: Sequence[str]) -> bool:
        """Whether cells are the units of the columns."""
        return (
            len(cells) == len(self.names or ())
            and not any(_is_number(cell.replace(",", ".")) for cell in cells)
            and all(len(cell) < _UNIT_LENGTH and _UNIT_CELL.fullmatch(cell) for cell in cells)
            and any(cell.strip("[]() ").lower() in ("s", "ms", "rad", "deg", "°") for cell in cells)
        )

    def row_words(self, columns: Sequence[int], in_all_rows: bool = True) -> Sequence[str]:
        """As the protocol."""
        first: list[str] = []
        for block, line in self._raw_blocks():
            for number, data in enumerate(block.split(b"\n"), start=line):
                if not data.strip():
                    continue
                cells = self._cells(data.decode("utf-8", "replace").strip("\r"))
                if len(cells) != self.num_columns:  # `blocks` reports the line
                    continue
                words = [cells[column] for column in columns]
                first = first or words
                if words != first:
                    raise other_words(self.path, f"line {number}", first, words)
                if not in_all_rows:
                    return first
        return first

    def blocks(
        self,
        columns: list[int],
        rows: tuple[int, int] | None = None,
        may_be_empty: Collection[int] = (),
    ) -> Iterator[tuple[Array, Lines]]:
        """As the protocol LogTable: blocks of (values (N, k), numbers (N,) of their lines).

        Args:
            columns: numbers of the k columns, from 0.
            rows: the first and the last that is read, from 1 at the first line after the header;
                None: all.
            may_be_empty: columns of which a value may be missing: NaN.

        Raises:
            InputError: also where a line has missing or extra cells.
        """
        first_line, last_line = self._num_head_lines + 1, np.iinfo(np.int64).max
        if rows is not None:
            first_row, last_row = rows
            first_line = self._num_head_lines + first_row
            last_line = self._num_head_lines + last_row
        end = 0  # number of the last line that was looked at, for the check below
        for block, line in self._raw_blocks():  # `line`: number of its first one
            num_lines = block.count(b"\n") + (not block.endswith(b"\n"))
            end = line + num_lines - 1
            if line > last_line:
                break
            if end < first_line:
                continue
            start, stop = 0, len(block)  # bytes of the block's selected lines
            if line < first_line or end > last_line:
                # begins[k] is where line + k + 1 begins: begins[number - line - 1] where `number`
                # does. What follows the last selected line begins where its number + 1 does.
                begins = np.flatnonzero(np.frombuffer(block, np.uint8) == ord("\n")) + 1
                if line < first_line:
                    start = int(begins[first_line - line - 1])
                if end > last_line:
                    stop = int(begins[(last_line + 1) - line - 1])
            values, lines = self._parsed(
                block[start:stop], max(line, first_line), columns, may_be_empty
            )
            if len(lines):
                yield values, lines
        if rows is not None and end < last_line:
            problem = (
                f"ends at row {end - self._num_head_lines}, but the description selects rows "
                f"{first_row} to {last_row}"
            )
            raise InputError(self.path, "", problem, "correct the rows in the description")

    def _raw_blocks(self) -> Iterator[tuple[bytes, int]]:
        """Whole lines below the header, some MB at a time, with the first one's number."""
        line = self._num_head_lines + 1
        with opened(self._source, "a log") as file:
            file.seek(self._begin)
            for _ in range(self._num_head_lines):
                file.readline()
            incomplete_line = b""
            size = max(1, self._source.stat().st_size)
            while data := file.read(min(BLOCK_BYTES, max(0, self._end - file.tell()))):
                self.progress = min(1.0, file.tell() / size)
                cut = data.rfind(b"\n") + 1
                if not cut:
                    incomplete_line += data
                    if len(incomplete_line) > _LONGEST_LINE:
                        raise self._endless(f"line {line}")
                    continue
                block = incomplete_line + data[:cut]
                incomplete_line = data[cut:]
                yield block, line
                line += block.count(b"\n")
            if incomplete_line.strip() and not self._is_truncated(incomplete_line, line):
                yield incomplete_line, line

    def _is_truncated(self, last_line: bytes, line: int) -> bool:
        """Whether a last line was cut off while it was written: a crash, a full disk."""
        cells = self._cells(last_line.decode("utf-8", "replace"))
        if len(cells) >= self.num_columns or line == self._num_head_lines + 1:
            return False
        self._note(
            f"line {line}, the last one, is left out: it is cut off after {len(cells)} of "
            f"{self.num_columns} columns"
        )
        return True

    def _note(self, notice: str) -> None:
        """Adds a notice, once in all passes over the log."""
        if notice not in self.notices:
            self.notices.append(notice)

    def _without_headers(self, block: bytes, line: int) -> bytes:
        """A block in which repetitions of the header are blank lines.

        Args:
            block: bytes of some lines.
            line: number of the first one, for the notice.
        """
        header = self._top_line.encode()
        if self.names is None or header not in block:
            return block
        lines = block.split(b"\n")
        for k, text in enumerate(lines):
            if text.strip() == header:
                self._note(f"line {line + k} repeats the header: left out")
                lines[k] = b""
        return b"\n".join(lines)

    def _parsed(
        self, block: bytes, line: int, columns: list[int], may_be_empty: Collection[int]
    ) -> tuple[Array, Lines]:
        """The numbers (N, k) of a block of whole lines, and the numbers (N,) of their lines.

        Arrow parses it; what it refuses is looked at line by line for an error that names the cell:
        `_refuse_fault` raises that, or returns where it finds nothing wrong.

        Args:
            block: bytes of some lines.
            line: number of its first line in the file, from 1.
            columns: (k,) numbers of the columns, from 0.
            may_be_empty: columns of which a value may be missing: NaN.

        Raises:
            InputError: a line or a cell is wrong.
        """
        names = [str(k) for k in range(self.num_columns)]
        used = [str(k) for k in columns]
        block = self._without_headers(block, line)
        # A carriage return within a line: Arrow would take it for the end of the line.
        if block.count(b"\r") > block.count(b"\r\n") + block.endswith(b"\r"):
            self._refuse_fault(block, line, columns, may_be_empty)
        try:
            try:
                table = self._table(block, names, used)
            except pa.ArrowInvalid:
                # As over a line of blanks, which is as good as an empty one. (As many lines stay.)
                without_blanks = _BLANK_LINE.sub(b"", block)
                if without_blanks == block:
                    raise
                table = self._table(without_blanks, names, used)
            values = _numbers(table, self._stamps)
        except pa.ArrowInvalid as error:
            self._refuse_fault(block, line, columns, may_be_empty)
            raise InputError(
                self.path, f"line {line} or below", f"cannot be read: {error}", "correct it"
            ) from error
        is_optional = np.array([column in may_be_empty for column in columns])
        if not (np.isfinite(values) | (np.isnan(values) & is_optional)).all():
            self._refuse_fault(block, line, columns, may_be_empty)
        # Arrow passes over blank lines, which count in the numbers of the lines.
        num_lines = block.count(b"\n") + (not block.endswith(b"\n"))
        if table.num_rows == num_lines:
            return values, np.arange(line, line + num_lines)
        not_blank = [k for k, text in enumerate(block.split(b"\n")) if text.strip()]
        return values, line + np.array(not_blank, dtype=np.int64)

    def _table(self, block: bytes, names: list[str], used: list[str]) -> pa.Table:
        """The used columns of a block.

        Raises:
            pa.ArrowInvalid: a line or a cell is wrong.
        """
        if not block.strip():
            return pa.table({name: np.empty(0) for name in used})
        return pa_csv.read_csv(
            pa.BufferReader(block),
            # One thread: a block of this size is parsed no sooner by several.
            read_options=pa_csv.ReadOptions(column_names=names, use_threads=False),
            parse_options=pa_csv.ParseOptions(delimiter=self.separator),
            convert_options=pa_csv.ConvertOptions(
                column_types={name: self._arrow_type(int(name)) for name in used},
                include_columns=used,
                null_values=["", *_NAN_CELLS],
                decimal_point=self.decimal_mark,
            ),
        )

    def _arrow_type(self, column: int) -> pa.DataType:
        """The type as which Arrow reads a column."""
        form = self._stamps.get(column)
        return pa.float64() if form is None else form.arrow_type()

    def _refuse_fault(
        self, block: bytes, line: int, columns: list[int], may_be_empty: Collection[int]
    ) -> None:
        """Raises an InputError for the first line of a block that is wrong, if there is one."""
        for number, data in enumerate(block.split(b"\n"), start=line):
            if not data.strip(b" \t\r"):
                continue
            text = data.decode("utf-8", "replace").strip("\r")
            cells = self._cells(text)
            fault = self._fault_of_line(data, text, cells)
            if fault is not None:
                raise InputError(self.path, f"line {number}", fault.problem, fault.remedy)
            for column in columns:
                if column in may_be_empty and cells[column] in ("", *_NAN_CELLS):
                    continue
                if column in self._stamps and self._stamps[column].fits(cells[column]):
                    continue
                fault = self._fault_of_cell(cells[column], number)
                if fault is not None:
                    name = f" ({self.names[column]})" if self.names and self.names[column] else ""
                    place = f"line {number}, column {column + 1}{name}"
                    raise InputError(self.path, place, fault.problem, fault.remedy)

    def _fault_of_line(self, data: bytes, text: str, cells: list[str]) -> _Fault | None:
        """What is wrong with a line as a whole; None: it has as many cells as columns."""
        if b"\0" in data:
            problem = "holds zero bytes instead of text, as after a power failure"
            return _Fault(problem, "cut the file before this line")
        if b"\r" in data.removesuffix(b"\r"):
            return _Fault("holds a carriage return in the middle", "correct or remove the line")
        if len(cells) == self.num_columns:
            return None
        remedy = "correct or remove the line"
        if len(cells) > 1 and not any(_is_number(cell.replace(",", ".")) for cell in cells):
            problem = f"begins another table ({', '.join(cells)[:60]})"
            return _Fault(problem, "cut the file before this line")
        if len(cells) > self.num_columns and self.separator == ",":
            remedy += "; decimal commas need another separator, such as ;"
        if re.search(r"[^\d\s.,;+\-eE]", text):
            remedy += f' (it begins with "{text[:30]}")'
        return _Fault(f"has {len(cells)} columns, expected {self.num_columns}", remedy)

    def _fault_of_cell(self, cell: str, line: int) -> _Fault | None:
        """What is wrong with a cell; None: it is a finite number."""
        if _is_number(cell, self.decimal_mark):
            if np.isfinite(float(cell.replace(self.decimal_mark, "."))):
                return None
            return _Fault(f"{cell} is too large a number", "correct or remove the line")
        if not cell:
            problem = "is empty, expected a number"
        elif re.fullmatch(r"[+-]?(nan|inf|infinity)(\(.*\))?", cell, re.IGNORECASE):
            problem = f"holds {cell}, expected a finite number"
        else:
            problem = f'holds "{cell[:40]}", expected a number'
        remedy = "correct or remove the line; a short gap is bridged"
        if self.names is None and line == self._num_head_lines + 1:
            remedy = "set header: true in the description if this line names the columns"
        elif self.decimal_mark == "." and _is_number(cell, ","):
            remedy = 'set decimal_mark: "," in the description'
        elif self.decimal_mark == "," and _is_number(cell, "."):
            remedy = "use one decimal mark in all lines"
        return _Fault(problem, remedy)

    def _endless(self, place: str) -> InputError:
        remedy = "expected text with one sample a line"
        return InputError(self.path, place, "does not end", remedy)

    def _cells(self, text: str) -> list[str]:
        return _split(text, self.separator)

    def _decimal_mark_of(self, line: str) -> str:
        """The decimal mark of a line of numbers."""
        if "," not in line:
            return "."
        if any(_is_number(cell, ",") and "," in cell for cell in self._cells(line)):
            self.notices.append("numbers are read with decimal commas")
            return ","
        return "."

    def _line(self, file: BinaryIO) -> str:
        """The next line of the head of a file, as text."""
        line = file.readline(_LONGEST_LINE)
        if len(line) == _LONGEST_LINE and b"\r" not in line:
            raise self._endless("the first line or the header")
        if b"\r" in line.rstrip(b"\r\n"):
            problem = "lines end with carriage returns alone"
            raise InputError(
                self.path, "line 1", problem, "convert the line ends (dos2unix -c mac)"
            )
        try:
            return line.decode("utf-8")
        except UnicodeDecodeError as error:
            raise InputError(
                self.path, "", "is no text (UTF-8)", "expected numbers in CSV"
            ) from error


def _split(text: str, separator: str) -> list[str]:
    """The cells of a line."""
    try:
        cells = next(csv.reader([text], delimiter=separator), [""])
    except csv.Error:
        cells = text.split(separator)
    return [cell.strip() for cell in cells]


def _is_number(text: str, decimal_mark: str = ".") -> bool:
    if decimal_mark == ",":
        text = text.replace(".", "x").replace(",", ".")
    return _NUMBER.fullmatch(text) is not None


def _separator_of(line: str) -> str:
    """The most likely separator of a line of names or numbers."""
    for separator in (";", "\t", ","):
        if separator in line:
            return separator
    return " " if " " in line else ","


def _refuse_binary(path: Path, file: BinaryIO) -> None:
    """Refuses a file that is no text, by its first bytes."""
    head = file.read(1 << 12)
    if not head:
        raise InputError(path, "", "is empty", "record the log again")
    for magic, kind, remedy in _BINARY_KINDS:
        if head.startswith(magic):
            raise InputError(path, "", f"is {kind}, expected text (CSV)", remedy)
    if b"\0" in head.split(b"\n")[0]:
        raise InputError(path, "", "is a binary file, expected text (CSV)", "export it as CSV")
    file.seek(0)


def _after_byte_order_mark(file: BinaryIO) -> int:
    """The position after a byte order mark, to which the file is moved; 0 where it has none."""
    begin = 3 if file.read(3) == b"\xef\xbb\xbf" else 0
    file.seek(begin)
    return begin


def _numbers(table: pa.Table, stamps: Mapping[int, StampForm]) -> Array:
    """(N, k) of a table's columns: a stamp in s, an empty cell NaN.

    Args:
        table: its columns have their numbers as names.
        stamps: how the columns of dates with times write them, by their numbers.

    Raises:
        pa.ArrowInvalid: a cell is no such date.
    """
    values = np.empty((table.num_rows, table.num_columns))
    for k, name in enumerate(table.column_names):
        column, form = table.column(k), stamps.get(int(name))
        if form is not None and table.num_rows:
            column = stamp_seconds(column, form)
        values[:, k] = column.to_numpy()
    return values
