"""Tables of numbers in text files (CSV): read block by block with constant memory, and written."""

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv
from numpy.typing import NDArray

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import opened
from wrenchsight.models.files.whole_file import whole_file, writing_to
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.date_stamps import (
    StampForm,
    is_clock,
    is_date,
    joined_seconds,
    stamp_form,
    stamp_seconds,
)
from wrenchsight.models.recordings.echo_text import lacks_arrays
from wrenchsight.models.recordings.list_cells import UnfoldedFile, has_lists
from wrenchsight.models.recordings.plain_text import PlainCopy, is_plain
from wrenchsight.models.recordings.recording_format import RecordingFormat
from wrenchsight.models.recordings.table_checks import other_words
from wrenchsight.models.recordings.text_head import (
    MOST_HEAD_LINES,
    NAN_CELLS,
    ends_in_quotes,
    is_number,
    split_cells,
    table_head,
)

Lines = NDArray[np.int64]

BLOCK_BYTES = 1 << 23  # small beside any memory, large enough that a block's overhead vanishes
_LONGEST_LINE = 1 << 17  # more than any number of joints needs
SEPARATOR_WORDS = {
    ",": "commas", ";": "semicolons", "\t": "tabs", " ": "spaces", "|": "vertical bars",
}  # fmt: skip
"""What separates the cells, in words, by the separators that are recognised."""
_HEAD_BYTES = 1 << 20  # of a file, in which its table begins
_MIN_COLUMNS = 3  # of a table, in which a line of one cell is a remark
_REMARK = re.compile(r"\W*[A-Za-z]{3}")
_MOST_LAST_LINES = 20  # below the table that are no rows, and
_LAST_BYTES = 1 << 12  # the end of the file in which they are looked for
_CAN_FRAME = re.compile(r"\(\d{1,12}\.\d{1,9}\) +\w{1,16} +[0-9A-Fa-f]{3,8}##?[0-9A-Fa-f]*")
_POSE_LINES = 3  # whose first ones show what all are
_POSE_ENTRY = re.compile(r"(?<![\w$.])([A-Za-z]\w{0,20})[ :=]{1,3}[-+]?\d[\d.eE+-]{0,20}(?!\w)")
_POSES = (frozenset("XYZABC"), frozenset(("X", "Y", "Z", "RX", "RY", "RZ")), frozenset("XYZWPR"))
_BLANK_LINE = re.compile(rb"(?m)^[ \t]+(?=\r?$)")
_PICKLES = tuple(bytes([0x80, protocol]) for protocol in range(2, 6))  # first bytes
_HDF5_REMEDY = (
    'write its arrays as npz: pip install h5py, then python -c "import h5py, numpy; d = {}; '
    "h5py.File('{name}').visititems(lambda n, x: d.update({n.replace('/', '.'): x[()]}) if "
    "isinstance(x, h5py.Dataset) else None); numpy.savez('{stem}.npz', **d)\""
)
_PANDAS_HDF5_REMEDY = (
    'write it as CSV: pip install pandas tables, then python -c "import pandas; '
    "pandas.read_hdf('{name}').rename_axis('time').to_csv('{stem}.csv')\""
)
_PANDAS_MARK = b"pandas_type"  # in the HDF5 files that pandas writes
_TDMS_REMEDY = (
    'write it as CSV: pip install npTDMS pandas, then python -c "import nptdms; '
    "nptdms.TdmsFile.read('{name}').as_dataframe(time_index=True).rename_axis('time')"
    ".to_csv('{stem}.csv')\""
)
_HDF5_MAGIC = b"\x89HDF"
_SHEET_REMEDY = (
    "save the sheet of the log as CSV in the spreadsheet program, or each sheet by: pip install "
    "openpyxl, then python -c \"import pandas; [sheet.to_csv(f'{stem}_{k}.csv', index=False, "
    "header=False) for k, sheet in enumerate(pandas.read_excel('{name}', sheet_name=None, "
    'header=None).values())]"'
)
_PICKLE_REMEDY = (
    'if you trust it and it holds a DataFrame: python -c "import pandas; '
    "pandas.read_pickle('{name}').reset_index().to_feather('{stem}.feather')\"; if it holds a "
    "dictionary of arrays: python -c \"import numpy, pickle; numpy.savez('{stem}.npz', "
    "**pickle.load(open('{name}', 'rb')))\""
)
_BINARY_KINDS = (  # first bytes, kind of file, remedy with the file's name and its stem
    (b"\x1f\x8b", "compressed by gzip", "name it .csv.gz"),
    (b"PK\x03\x04", "a zip archive or a spreadsheet", _SHEET_REMEDY),
    (_HDF5_MAGIC, "an HDF5 file", _HDF5_REMEDY),
    (b"TDSm", "a TDMS file of LabVIEW", _TDMS_REMEDY),
    (b"#ROSBAG", "a ROS 1 bag of another version than 2.0", "convert it: rosbag fix"),
    (b"\x89MCAP", "an MCAP file", "name it .mcap"),
    *((magic, "a pickle, which runs code when it is read", _PICKLE_REMEDY) for magic in _PICKLES),
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
        _refuse_left_out_arrays(path)
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
            table.notices.append(f"columns are separated by {SEPARATOR_WORDS[table.separator]}")
        return table

    def write(self, path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
        """As the protocol."""
        table = pa.table(dict(columns))
        with whole_file(path) as partial, writing_to(path), partial.open("wb") as file:
            write_csv_header(file, table.schema.names)
            options = pa_csv.WriteOptions(include_header=False)
            with pa_csv.CSVWriter(file, table.schema, write_options=options) as writer:
                writer.write_table(table, max_chunksize=1 << 16)


def _refuse_left_out_arrays(path: Path) -> None:
    """Refuses printed messages whose arrays were left out."""
    with opened(path, "a log") as file:
        head = file.read(_LAST_BYTES).decode("utf-8", "replace")
    if lacks_arrays(head):
        problem = (
            "holds the lengths of arrays alone, as echo --noarr prints them: no joint's values"
        )
        remedy = (
            "print them in full (`rostopic echo -p TOPIC`, `ros2 topic echo TOPIC`), or record "
        )
        raise InputError(path, "", problem, f"{remedy}a bag")


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
    copy = UnfoldedFile(source, table.separator, table.names, table.num_head_lines)
    return open_table(copy)


def _stamp_forms(first_cells: Sequence[str]) -> dict[int, StampForm]:
    """How the columns that hold dates with times write them, by their numbers from 0."""
    forms = {k: stamp_form(cell) for k, cell in enumerate(first_cells)}
    return {k: form for k, form in forms.items() if form is not None}


class _DatedClock(NamedTuple):
    """A column of times of a day, whose days another column has.

    Attributes:
        date: number of the column of the days.
        form: of the day, a blank and the time.
    """

    date: int
    form: StampForm


def _dated_clocks(first_cells: Sequence[str]) -> dict[int, _DatedClock]:
    """The columns of times of a day beside the only column of dates, by their numbers from 0."""
    dates = [k for k, cell in enumerate(first_cells) if is_date(cell)]
    clocks = [k for k, cell in enumerate(first_cells) if is_clock(cell)]
    if len(dates) != 1:
        return {}
    forms = {k: stamp_form(f"{first_cells[dates[0]]} {first_cells[k]}") for k in clocks}
    return {k: _DatedClock(dates[0], form) for k, form in forms.items() if form is not None}


def write_csv_header(file: BinaryIO, names: Sequence[str]) -> None:
    """Writes names without quotes, which pyarrow's own header has."""
    file.write((",".join(names) + "\n").encode())


def binary_remedy(path: Path, magic: bytes) -> str:
    """What to do about a file of a kind that is not read, by its first bytes."""
    remedy = next(text for first, _, text in _BINARY_KINDS if first == magic)
    if magic == _HDF5_MAGIC:
        with opened(path, "a log") as file:
            remedy = _PANDAS_HDF5_REMEDY if _PANDAS_MARK in file.read(_HEAD_BYTES) else remedy
    return remedy.replace("{name}", path.name).replace("{stem}", path.stem)


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
    (pandas' MultiIndex) are joined. A column of dates with times is read in seconds; so is one of
    times of a day, to which the only column of dates is added. Lines of text below the last row,
    and repetitions of the header, are left out with a notice.

    Attributes:
        first_cells: first cells of the first row.
        skip_lines: lines before the header or the first row.
        num_head_lines: lines before the first row.
        is_labelled: whether a description finds the columns by their numbers alone.
        rate_hz: rows a second by a step that is stated above them, where their time is empty; 0:
            none is.
        date_columns: the column of dates that is added to a column of times of a day, by the
            number of the latter.

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
            for _ in range(skip_lines):
                self._line(file)
            lines, begins = self._head_lines(file)
        if not any(line.strip() for line in lines):
            raise InputError(path, "", "is empty", "record the log again")
        if _CAN_FRAME.match(next(line for line in lines if line.strip())):
            problem = "holds raw frames of a CAN bus, as candump writes them"
            remedy = "decode them with the drives' DBC file, such as by cantools, into a table "
            remedy += "(CSV: t, q1.., v1.., i1..)"
            raise InputError(path, "", problem, remedy)
        first_lines = [line for line in lines if line.strip()][:_POSE_LINES]
        if header is None and all(map(_is_pose_alone, first_lines)):
            problem = (
                "holds poses of the tool alone (X Y Z A B C), no joint positions and no motor "
            )
            remedy = "log each joint's position and current (of a KUKA $AXIS_ACT and $CURR_ACT, or "
            remedy += "$TORQUE_AXIS_ACT)"
            raise InputError(path, "", f"{problem}currents", remedy)
        head = table_head(lines, separator, decimal_mark, header)
        self.notices += head.notices
        self.separator, self.decimal_mark = head.separator, head.decimal_mark
        self.names, self.num_columns = head.names, head.num_columns
        self.skip_lines = skip_lines + begins[head.skip_lines]
        # A copy may have a line of names more than the log, whose lines are counted.
        self._num_added = 0 if copy is None else copy.num_added_lines
        self.num_head_lines = skip_lines + begins[head.num_lines] - self._num_added
        self.is_labelled, self.rate_hz = head.is_labelled, head.rate_hz
        self._header = head.header.encode()
        self.first_cells = head.first_cells
        self._stamps = _stamp_forms(self.first_cells)
        self._dated_clocks = _dated_clocks(self.first_cells)
        self._padding = re.compile(rb" *" + re.escape(self.separator.encode()) + rb" *")
        self._end = self._end_of_rows()
        if self.names and all(is_number(name, self.decimal_mark) for name in self.names):
            problem = "holds numbers where the names of the columns are expected"
            remedy = "set header: false in the description, or add a first line t,q1,..."
            raise InputError(path, f"line {self.num_head_lines}", problem, remedy)

    @property
    def date_columns(self) -> Mapping[int, int]:
        """As the class has it."""
        return {clock: dated.date for clock, dated in self._dated_clocks.items()}

    def _head_lines(self, file: BinaryIO) -> tuple[list[str], list[int]]:
        """The lines from here on in which the table begins, and how many precede each of them.

        A line that ends within quotes goes on in the next one.
        """
        lines = [self._line(file).strip("\r\n")]
        begins = [0]
        num_read = 1
        while len(lines) < MOST_HEAD_LINES and file.tell() < _HEAD_BYTES:
            data = file.readline(_LONGEST_LINE)
            if not data:
                break
            line = data.decode("utf-8", "replace").strip("\r\n")
            if ends_in_quotes(lines[-1]) and len(lines[-1]) < _LONGEST_LINE:
                lines[-1] += f" {line}"
            else:
                lines.append(line)
                begins.append(num_read)
            num_read += 1
        return lines, [*begins, num_read]

    def _end_of_rows(self) -> int:
        """Where the lines of text below the last row begin, in bytes; the file's end without any.

        Such a line has fewer cells than the table and no number in the first one, or in none: EOF,
        words on the recording, a date with what ended it.
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
        """Whether the cells of a line are fewer than those of a row, and words, or no numbers."""
        if len(cells) >= self.num_columns:
            return False
        has_words = any(_REMARK.match(cell) for cell in cells)
        has_numbers = any(is_number(cell, self.decimal_mark) for cell in cells)
        return bool(_REMARK.match(" ".join(cells))) or (has_words and not has_numbers)

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
        first_line, last_line = self.num_head_lines + 1, np.iinfo(np.int64).max
        if rows is not None:
            first_row, last_row = rows
            first_line = self.num_head_lines + first_row
            last_line = self.num_head_lines + last_row
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
                f"ends at row {end - self.num_head_lines}, but the description selects rows "
                f"{first_row} to {last_row}"
            )
            raise InputError(self.path, "", problem, "correct the rows in the description")

    def text(self, most_bytes: int, num_lines: int | None = None) -> bytes:
        """The rows as they are written, or the first ones.

        Raises:
            InputError: they are more than `most_bytes`.
        """
        parts: list[bytes] = []
        for block, line in self._raw_blocks():
            parts.append(self._without_headers(block, line))
            if num_lines is not None:
                return b"\n".join(parts[0].split(b"\n")[:num_lines])
            if sum(map(len, parts)) > most_bytes:
                problem = f"has a row for each joint in more than {most_bytes >> 20} MB"
                raise InputError(self.path, "", problem, "write a row for each sample")
        return b"".join(parts)

    def _raw_blocks(self) -> Iterator[tuple[bytes, int]]:
        """Whole lines below the header, some MB at a time, with the first one's number."""
        line = self.num_head_lines + 1
        with opened(self._source, "a log") as file:
            file.seek(self._begin)
            for _ in range(self.num_head_lines + self._num_added):
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
        if len(cells) >= self.num_columns or line == self.num_head_lines + 1:
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
        header = self._header
        if not header or header not in block:
            return block
        lines = block.split(b"\n")
        for k, text in enumerate(lines):
            if text.strip() == header:
                self._note(f"line {line + k} repeats the header: left out")
                lines[k] = b""
        return b"\n".join(lines)

    def _without_remarks(self, block: bytes, line: int) -> bytes:
        """A block in which remarks are blank lines: comments, and lines of one cell of words.

        Args:
            block: bytes of some lines.
            line: number of the first one, for the notice.
        """
        if self.num_columns < _MIN_COLUMNS:
            return block
        lines = block.split(b"\n")
        for k, data in enumerate(lines):
            text = data.decode("utf-8", "replace").strip()
            is_comment = text.startswith(("#", "//"))
            if is_comment or (_REMARK.match(text) and len(self._cells(text)) == 1):
                self._note(f'line {line + k} is no row: left out (beginning "{text[:40]}")')
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
        dates = {self._dated_clocks[k].date for k in columns if k in self._dated_clocks}
        used = [str(k) for k in sorted({*columns, *dates})]
        block = self._without_headers(block, line)
        # A carriage return within a line: Arrow would take it for the end of the line.
        if block.count(b"\r") > block.count(b"\r\n") + block.endswith(b"\r"):
            self._refuse_fault(block, line, columns, may_be_empty)
        try:
            try:
                table = self._table(block, names, used)
            except pa.ArrowInvalid:
                # As over a line of blanks, which is as good as an empty one, or a remark. (As many
                # lines stay.)
                plain = self._without_remarks(_BLANK_LINE.sub(b"", block), line)
                if b'"' not in plain:  # nor is a blank beside a date a part of it
                    plain = self._padding.sub(self.separator.encode(), plain)
                if plain == block:
                    raise
                block = plain
                table = self._table(block, names, used)
            values = _numbers(table, columns, self._stamps, self._dated_clocks)
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
                null_values=["", *NAN_CELLS],
                decimal_point=self.decimal_mark,
            ),
        )

    def _arrow_type(self, column: int) -> pa.DataType:
        """The type as which Arrow reads a column."""
        if any(column in (clock, dated.date) for clock, dated in self._dated_clocks.items()):
            return pa.string()
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
                if column in may_be_empty and cells[column] in ("", *NAN_CELLS):
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
        if len(cells) > 1 and not any(is_number(cell.replace(",", ".")) for cell in cells):
            problem = f"begins another table ({', '.join(cells)[:60]})"
            return _Fault(problem, "cut the file before this line")
        if len(cells) > self.num_columns and self.separator == ",":
            remedy += "; decimal commas need another separator, such as ;"
        if re.search(r"[^\d\s.,;+\-eE]", text):
            remedy += f' (it begins with "{text[:30]}")'
        return _Fault(f"has {len(cells)} columns, expected {self.num_columns}", remedy)

    def _fault_of_cell(self, cell: str, line: int) -> _Fault | None:
        """What is wrong with a cell; None: it is a finite number."""
        if is_number(cell, self.decimal_mark):
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
        if self.names is None and line == self.num_head_lines + 1:
            remedy = "set header: true in the description if this line names the columns"
        elif is_date(cell):
            remedy = "this is a date: name the column of its time of day, to which it is added"
        elif self.decimal_mark == "." and is_number(cell, ","):
            remedy = 'set decimal_mark: "," in the description'
        elif self.decimal_mark == "," and is_number(cell, "."):
            remedy = "use one decimal mark in all lines"
        return _Fault(problem, remedy)

    def _endless(self, place: str) -> InputError:
        remedy = "expected text with one sample a line"
        return InputError(self.path, place, "does not end", remedy)

    def _cells(self, text: str) -> list[str]:
        return split_cells(text, self.separator)

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


def _is_pose_alone(line: str) -> bool:
    """Whether a line names a pose, number by number (X 691.8 Y -174.2 Z .. A .. B .. C ..),
    and no axis.
    """
    names = {name.upper() for name in _POSE_ENTRY.findall(line)}
    is_pose = any(pose <= names for pose in _POSES)
    return is_pose and not any(re.fullmatch(r"[AJE]\d", name) for name in names)


def _refuse_binary(path: Path, file: BinaryIO) -> None:
    """Refuses a file that is no text, by its first bytes."""
    head = file.read(1 << 12)
    if not head:
        raise InputError(path, "", "is empty", "record the log again")
    for magic, kind, _ in _BINARY_KINDS:
        if head.startswith(magic):
            raise InputError(
                path, "", f"is {kind}, expected text (CSV)", binary_remedy(path, magic)
            )
    if b"\0" in head.split(b"\n")[0]:
        raise InputError(path, "", "is a binary file, expected text (CSV)", "export it as CSV")
    file.seek(0)


def _after_byte_order_mark(file: BinaryIO) -> int:
    """The position after a byte order mark, to which the file is moved; 0 where it has none."""
    begin = 3 if file.read(3) == b"\xef\xbb\xbf" else 0
    file.seek(begin)
    return begin


def _numbers(
    table: pa.Table,
    columns: Sequence[int],
    stamps: Mapping[int, StampForm],
    dated_clocks: Mapping[int, _DatedClock],
) -> Array:
    """(N, k) of a table's columns: a stamp in s, an empty cell NaN.

    Args:
        table: its columns have their numbers as names.
        columns: (k,) numbers of those that are wanted.
        stamps: how the columns of dates with times write them, by their numbers.
        dated_clocks: the columns to which those of dates are added, by their numbers.

    Raises:
        pa.ArrowInvalid: a cell is no such date, or a date alone.
    """
    values = np.empty((table.num_rows, len(columns)))
    for k, number in enumerate(columns):
        column, form = table.column(str(number)), stamps.get(number)
        clock = dated_clocks.get(number)
        if clock is not None and table.num_rows:
            column = joined_seconds(table.column(str(clock.date)), column, clock.form)
        elif form is not None and table.num_rows:
            column = stamp_seconds(column, form)
        values[:, k] = pc.cast(column, pa.float64()).to_numpy()  # a date alone is none
    return values
