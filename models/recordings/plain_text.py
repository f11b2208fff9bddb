"""Text tables that are written in another way than a line of names and rows, as plain ones.

- Text in UTF-16, as spreadsheets save "Unicode text".
- Exports of TwinCAT Scope (Beckhoff TE13xx): a block of lines with label and value of each channel
  (Name;Position;Name;Current, then SymbolName, Data-Type, ..), and rows with a time in ms and a
  value of each channel.

The lines keep their numbers: blank ones stand for those of a block.
"""

import codecs
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Final

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import opened

_UTF_16: Final = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}
_BLOCK_BYTES: Final = 1 << 20
_HEAD_BYTES: Final = 1 << 18  # of a file, in which the block of a Scope's export ends
_MOST_HEAD_LINES: Final = 100
_LEAST_CHANNELS: Final = 3
_CHANNEL_LABEL: Final = "name"
_SCOPE_TIME: Final = "Time [ms]"  # since the first sample


class PlainCopy:
    """A text table as a plain one in UTF-8 on the disk; it is removed with this object.

    Args:
        path: of a table that is not plain, `is_plain`.

    Attributes:
        path: of the plain one.
        notices: what was written anew, one sentence each.

    Raises:
        InputError: the file cannot be read, or its bytes are no text.
    """

    def __init__(self, path: Path) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="wrenchsight", ignore_cleanup_errors=True)
        self.path = Path(self._folder.name) / path.name
        self.notices: list[str] = []
        with opened(path, "a log") as source, self.path.open("wb") as target:
            encoding = _encoding(source)
            if encoding:
                self.notices.append("text in UTF-16 is read")
            text = _decoded(path, source, encoding)
            head = next(text, "")
            while len(head) < _HEAD_BYTES and (more := next(text, "")):
                head += more
            scope_head = _plain_scope_head(head)
            if scope_head is not None:
                self.notices.append(
                    "read as an export of TwinCAT Scope: a time in ms and a value of each channel; "
                    "the time of the first channel is that of all"
                )
            target.write((scope_head or head).encode())
            for part in text:
                target.write(part.encode())


def is_plain(path: Path) -> bool:
    """Whether a text table has a line of names and rows, in UTF-8 or ASCII.

    Raises:
        InputError: the file cannot be read.
    """
    with opened(path, "a log") as file:
        if _encoding(file):
            return False
        head = file.read(_HEAD_BYTES).decode("utf-8", "replace")
    return _plain_scope_head(head.removeprefix("\ufeff")) is None


def _encoding(file: BinaryIO) -> str:
    """The kind of UTF-16 by the first two bytes, behind which the file is left; '' for another."""
    encoding = _UTF_16.get(file.read(2), "")
    if not encoding:
        file.seek(0)
    return encoding


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
            above = [(_SCOPE_TIME if k == 0 else "", name) for k, name in enumerate(names)]
            header = separator.join(cell for pair in above for cell in pair)
            return "\n" * (number - 1) + header + "\n" + "".join(lines[number:])
    return None


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
