"""Protocols of a kind of log file: a table of numbers, read block by block, and written.

A container is one file of this sub-package (`text_table`, `parquet_table`) and one entry of
`log_containers.CONTAINERS`. It does not know what the columns mean: `recording_format` does.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording_format import RecordingFormat

RowNumbers = NDArray[np.int64]


class RowWords(Protocol):
    """Reads the text in columns of a log; see `LogTable.row_words`."""

    def __call__(self, columns: Sequence[int], in_all_rows: bool = True) -> Sequence[str]: ...


class LogTable(Protocol):
    """An opened log: a table of numbers, one sample a row."""

    row_word: str
    """Name of a row in error lines: "row", or "line" in a text file."""
    names: tuple[str, ...] | None
    """Of the columns; None where the log has no header."""
    num_columns: int
    notices: list[str]
    """What the reader assumed or left out, one sentence each; complete after the last block."""
    progress: float
    """Share of the file that the current pass has read."""

    def row_words(self, columns: Sequence[int], in_all_rows: bool = True) -> Sequence[str]:
        """The words in these columns of the first row; of lists of words all words.

        Args:
            in_all_rows: whether all rows must hold the same words.

        Raises:
            InputError: another row holds other words, or the columns hold no words.
        """

    def blocks(
        self,
        columns: list[int],
        rows: tuple[int, int] | None = None,
        may_be_empty: Collection[int] = (),
    ) -> Iterator[tuple[Array, RowNumbers]]:
        """Reads columns block by block, with memory that does not grow with the log.

        Args:
            columns: their numbers, from 0.
            rows: first and last row, counted from 1; None for all.
            may_be_empty: columns in which a value may be missing; it is then NaN.

        Yields:
            (N, k) values, finite unless missing, and (N,) their rows as a person counts them.

        Raises:
            InputError: a value is missing or no finite number, or the file is damaged or ends
                before the last row. The error names row and column.
        """


class TableOfTable:
    """A `LogTable` made of another one, but for `blocks`, which a kind of such tables has.

    Args:
        table: the other one.
        notice: what is made of it.

    Attributes:
        table: this.
    """

    def __init__(self, table: LogTable, notice: str) -> None:
        self.table = table
        self.row_word = table.row_word
        self.names = table.names
        self.num_columns = table.num_columns
        self.notices = table.notices
        self.notices.append(notice)
        self.progress = 0.0

    def row_words(self, columns: Sequence[int], in_all_rows: bool = True) -> Sequence[str]:
        """As the protocol."""
        return self.table.row_words(columns, in_all_rows)


class LogContainer(Protocol):
    """A kind of log file."""

    suffixes: tuple[str, ...]
    """Endings of its files, in lower case with the dot; the usual one first."""

    def open(self, path: Path, form: RecordingFormat | None) -> LogTable:
        """Opens a log.

        Args:
            path: path of the log.
            form: the user's description of the log, or None; a container may need it for what the
                file itself does not state.

        Raises:
            InputError: no such file, no file of this kind, damaged, or empty.
        """

    def write(self, path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
        """Writes columns (T,) by name, whole or not at all; `open` reads them back bit for bit.

        Raises:
            InputError: the file cannot be written.
        """


@dataclass(eq=False)
class ReadOnlyContainer:
    """A kind of log that describes itself and is not written; implements `LogContainer`.

    Attributes:
        kind: of it, in words, for the error line.
        table_of: opens a log; raises as the protocol's `open`.
        suffixes: as the protocol.
    """

    kind: str
    table_of: Callable[[Path], LogTable]
    suffixes: tuple[str, ...] = ()

    def open(self, path: Path, form: RecordingFormat | None) -> LogTable:
        """As the protocol; `form` is not used."""
        return self.table_of(path)

    def write(self, path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
        """Not for this kind.

        Raises:
            InputError: always.
        """
        remedy = "give the log another name, with an ending such as .csv"
        raise InputError(path, "", f"is not written as {self.kind}", remedy)
