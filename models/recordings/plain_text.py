"""Text tables that are written in another way than a line of names and rows, as plain ones.

- Text in UTF-16, as spreadsheets save "Unicode text", in Windows' code page 1252 (Latin-1), and in
  Chinese and Japanese code pages.
- Cells in aligned columns, with runs of blanks between them.
- Quoted cells behind a blank: `"time", "q1"`; numbers with their unit in the cell: `13.7 deg`.
- Lines that end with two carriage returns, as Python's csv writes them on Windows, or with one
  alone.
- What is no table, line by line: `_FORMS`. Messages as `ros2 topic echo` prints them
  (`echo_text`), lines that name each number (`key_values`), lines of lists (`list_lines`).
- Exports of TwinCAT Scope (Beckhoff TE13xx): a block of lines with label and value of each channel
  (Name;Position;Name;Current, then SymbolName, Data-Type, ..), and rows with a time in ms and a
  value of each channel.

The lines keep their numbers: blank ones stand for those of a block.
"""

import codecs
import re
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import opened
from wrenchsight.models.recordings.echo_text import is_echo, table_of_echo
from wrenchsight.models.recordings.key_values import are_key_values, table_of_pairs
from wrenchsight.models.recordings.layouts.signal_words import EASTERN_WORDS
from wrenchsight.models.recordings.list_lines import are_list_lines, table_of_list_lines
from wrenchsight.models.recordings.text_head import ends_in_quotes, table_head

_UTF_16: Final = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}
_WESTERN: Final = "cp1252"  # in which five bytes stand for nothing: most binary files are none
_EASTERN: Final = {"gb18030": "GB 18030 (GBK)", "shift_jis": "Shift JIS"}  # and their names
_BLOCK_BYTES: Final = 1 << 20
_LONGEST_LINE: Final = 1 << 17  # characters: a line without an end is left to who reads the table
_HEAD_BYTES: Final = 1 << 18  # of a file, in which the block of a Scope's export ends
_MOST_HEAD_LINES: Final = 100
_LEAST_CHANNELS: Final = 3
_CHANNEL_LABEL: Final = "name"
_QUOTE_BEHIND_BLANK: Final = re.compile(r'([,;\t]) {1,4}"')
_RUN_OF_BLANKS: Final = re.compile(r"(?<=\S) {2,}(?=\S)")
_DOUBLE_RETURN: Final = "\r\r\n"
_UNITS: Final = (  # of time, position, velocity, current and torque; the longer ones first
    r"deg/s|°/s|rad/s|rev/s|1/min|N[ *.]?m|sec|rpm|deg|rad|rev|mA|mm|ms|us|µs|ns|°|%|A|s|m"
)
_UNIT_IN_CELL: Final = re.compile(
    rf"(^|[,;\t]) *([+-]?[\d.]{{1,30}}(?:[eE][+-]?\d{{1,4}})?) ?({_UNITS}) *(?=[,;\t\r\n]|$)",
    re.MULTILINE,
)
_SCOPE_TIME: Final = "Time [ms]"  # since the first sample
_SCOPE_TIMES: Final = "Time_{} [ms]"  # of a further channel, by its number


class PlainCopy:
    """A text table as a plain one in UTF-8 on the disk; it is removed with this object.

    Args:
        path: of a table that is not plain, `is_plain`.

    Attributes:
        path: of the plain one.
        notices: what was written anew, one sentence each.
        num_added_lines: lines before the first that the log does not have: 1 of names, or 0.

    Raises:
        InputError: the file cannot be read, or its bytes are no text.
    """

    def __init__(self, path: Path) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="wrenchsight", ignore_cleanup_errors=True)
        self.path = Path(self._folder.name) / path.name
        self.notices: list[str] = []
        self.num_added_lines = 0
        with opened(path, "a log") as source, self.path.open("wb") as target:
            encoding = _encoding(source)
            if encoding == _WESTERN:
                self.notices.append("text in Windows' code page 1252 is read")
            elif encoding in _EASTERN:
                self.notices.append(f"text in {_EASTERN[encoding]} is read")
            elif encoding:
                self.notices.append("text in UTF-16 is read")
            text = _decoded(path, source, encoding)
            head = next(text, "")
            while len(head) < _HEAD_BYTES and (more := next(text, "")):
                head += more
            scope_head = _plain_scope_head(head)
            if scope_head is not None:
                self.notices.append(
                    "read as an export of TwinCAT Scope: a time in ms and a value of each channel"
                )
            parts: Iterable[str] = chain([scope_head or head], text)
            form = _form_of(head) if scope_head is None else None
            if form is not None:
                self.notices.append(form.notice)
                self.num_added_lines = int(form.adds_names)
                parts = form.table_of(_whole_lines(parts))
            change = _change_of_lines(head) if form is None and scope_head is None else None
            for part in parts if change is None else map(change, _whole_lines(parts)):
                target.write(part.encode())


def is_plain(path: Path) -> bool:
    """Whether a text table has a line of names and rows with single separators, in UTF-8 or ASCII.

    Raises:
        InputError: the file cannot be read.
    """
    with opened(path, "a log") as file:
        if _encoding(file):
            return False
        head = file.read(_HEAD_BYTES).decode("utf-8", "replace")
    head = head.removeprefix("\ufeff")
    is_changed = _change_of_lines(head) is not None or _form_of(head) is not None
    return _plain_scope_head(head) is None and not is_changed


class _TextForm(NamedTuple):
    """A form of text that is no table, line by line.

    Attributes:
        is_form: whether a text begins so; the last line may be cut off.
        table_of: parts of the text, each of whole lines, as those of a table.
        notice: what it is read as.
        adds_names: whether a line of names precedes the table's lines, which are as many as the
            text's; else it is one of them.
    """

    is_form: Callable[[str], bool]
    table_of: Callable[[Iterable[str]], Iterator[str]]
    notice: str
    adds_names: bool = True


def _first_lines(head: str) -> list[str]:
    """The first lines of a text, without the last one, which may be cut off."""
    return head.splitlines()[:_MOST_HEAD_LINES][:-1]


_FORMS: Final = (  # the first that fits counts; a further form is one entry
    _TextForm(
        is_echo,
        table_of_echo,
        "read as messages that `ros2 topic echo` has printed",
        adds_names=False,
    ),
    _TextForm(
        lambda head: are_key_values(_first_lines(head)),
        table_of_pairs,
        "read as lines that name each number",
    ),
    _TextForm(
        lambda head: are_list_lines(_first_lines(head)),
        table_of_list_lines,
        "read as lines of lists without a header",
    ),
)


def _form_of(head: str) -> _TextForm | None:
    """The form of a text that is no table; None: it is one."""
    return next((form for form in _FORMS if form.is_form(head)), None)


def _encoding(file: BinaryIO) -> str:
    """How a file's text is written, if it is not in UTF-8; '' where it is, or is no text.

    Args:
        file: at its begin; it is left behind a mark of UTF-16, else at its begin.
    """
    encoding = _UTF_16.get(file.read(2), "")
    if encoding:
        return encoding
    file.seek(0)
    head = file.read(_HEAD_BYTES)
    file.seek(0)
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        for eastern in _EASTERN:  # in which most bytes are some sign or other: words decide
            with suppress(UnicodeDecodeError):
                text = codecs.getincrementaldecoder(eastern)().decode(head)
                if any(word in text for word in EASTERN_WORDS):
                    return eastern
        with suppress(UnicodeDecodeError):
            head.decode(_WESTERN)
            return "" if b"\0" in head else _WESTERN
    return ""


def _decoded(path: Path, file: BinaryIO, encoding: str) -> Iterator[str]:
    """The text of a file, some part after another.

    Args:
        path: for the error line.
        file: behind its byte order mark.
        encoding: '' for UTF-8.
    """
    decoder = codecs.getincrementaldecoder(encoding or "utf-8-sig")()
    try:
        while data := file.read(_BLOCK_BYTES):
            yield decoder.decode(data)
        yield decoder.decode(b"", final=True)
    except UnicodeDecodeError as error:
        problem = f"is no text ({encoding or 'UTF-8'})"
        raise InputError(path, "", problem, "expected numbers in CSV") from error


def _plain_scope_head(head: str) -> str | None:
    """The head of a Scope's export with one line of names above the rows; None: it is another."""
    lines = head.splitlines(keepends=True)
    names: list[str] = []
    separator = ""
    for number, line in enumerate(lines[:_MOST_HEAD_LINES]):
        if not names:
            separator = next((mark for mark in ";\t," if mark in line), "")
            cells = _cells(line, separator)
            labels = {cell.lower() for cell in cells[::2]}
            if len(cells) >= 2 * _LEAST_CHANNELS and labels == {_CHANNEL_LABEL}:
                names = cells[1::2]
            continue
        if _is_row(_cells(line, separator), 2 * len(names)):
            times = [_SCOPE_TIME, *(_SCOPE_TIMES.format(k + 2) for k in range(len(names) - 1))]
            pairs = zip(times, names, strict=True)
            header = separator.join(cell for pair in pairs for cell in pair)
            return "\n" * (number - 1) + header + "\n" + "".join(lines[number:])
    return None


def _change_of_lines(head: str) -> Callable[[str], str] | None:
    """What makes whole lines of a table plain; None: they are, or are no table.

    Args:
        head: the first lines.
    """
    if "\r" in head and "\n" not in head:
        return lambda text: text.replace("\r", "\n")
    lines = _rows_of_lines(head.splitlines()[:_MOST_HEAD_LINES])[:-1]
    if len(lines) > 1 and all(_QUOTE_BEHIND_BLANK.search(line) for line in lines[-2:]):
        return lambda text: _QUOTE_BEHIND_BLANK.sub(r'\1"', text)
    if _DOUBLE_RETURN in head:
        return lambda text: text.replace(_DOUBLE_RETURN, "\r\n")
    if len(lines) > 2 and all(_UNIT_IN_CELL.search(line) for line in lines[-2:]):
        return _without_units(lines)
    table = table_head(lines) if lines else None
    if table is not None and table.separator == " ":
        rows = lines[table.num_lines :]
        if any(line != line.strip() or _RUN_OF_BLANKS.search(line) for line in rows):
            return lambda text: re.sub(r"(?m)^ +| +(?=\r?$)", "", re.sub(r" {2,}", " ", text))
    return None


def _rows_of_lines(lines: Sequence[str]) -> list[str]:
    """The lines that are not blank; those of one quoted cell, such as NumPy breaks, as one."""
    rows: list[str] = []
    for line in lines:
        if rows and ends_in_quotes(rows[-1]) and len(rows[-1]) < _LONGEST_LINE:
            rows[-1] += f" {line}"
        elif line.strip():
            rows.append(line)
    return rows


def _without_units(lines: list[str]) -> Callable[[str], str]:
    """What takes the units out of cells and adds those of the first row to the names above it.

    Args:
        lines: the first ones that are not blank.
    """
    row = next(line for line in lines if _UNIT_IN_CELL.search(line))
    separator = next((mark for mark in ";\t," if mark in row), ",")
    header = lines[max(lines.index(row) - 1, 0)]
    matches = [_UNIT_IN_CELL.fullmatch(cell.strip()) for cell in row.split(separator)]
    names = header.split(separator)
    if len(names) == len(matches) and header != row:
        pairs = zip(names, matches, strict=True)
        names = [f"{name.strip()} [{match[3]}]" if match else name for name, match in pairs]
    new_header = separator.join(names)

    def change(text: str) -> str:
        return _UNIT_IN_CELL.sub(r"\1\2", text).replace(header, new_header, 1)

    return change


def _whole_lines(parts: Iterable[str]) -> Iterator[str]:
    """The same text in parts that end with a line."""
    rest = ""
    for part in parts:
        rest += part
        cut = rest.rfind("\n") + 1
        if cut or len(rest) > _LONGEST_LINE:
            yield rest[: cut or len(rest)]
            rest = rest[cut or len(rest) :]
    yield rest


def _cells(line: str, separator: str) -> list[str]:
    """The cells of a line, without one behind a last separator."""
    cells = [cell.strip().strip('"') for cell in line.split(separator or ";")]
    return cells[:-1] if len(cells) % 2 and not cells[-1] else cells


def _is_row(cells: list[str], count: int) -> bool:
    """Whether cells are those of a row of numbers."""
    try:
        [float(cell.replace(",", ".")) for cell in cells if cell]
    except ValueError:
        return False
    return len(cells) == count and bool(cells[0])
