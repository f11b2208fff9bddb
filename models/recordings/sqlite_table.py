"""Logs in a table of an SQLite database, such as a logger or a historian keeps."""

import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pyarrow as pa

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import opened
from wrenchsight.models.recordings.parquet_table import ConvertedTable

SQLITE_SUFFIXES: Final = (".sqlite", ".sqlite3", ".db")
SQLITE_MAGIC: Final = b"SQLite format 3"
_BLOCK_ROWS: Final = 1 << 15
_MIN_COLUMNS: Final = 3  # of a table of samples, or of a signal a row


def open_database(path: Path) -> ConvertedTable:
    """The only table of samples in an SQLite database.

    Raises:
        InputError: no such file, no database or a damaged one, no such table or several.
    """
    with opened(path, "a log"):
        pass  # raises where it cannot be read
    try:
        connection = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)
        try:
            return ConvertedTable(path, _parts(connection, _table_name(connection, path)))
        finally:
            connection.close()
    except (sqlite3.Error, pa.ArrowException) as error:
        problem = f"is no SQLite database, or a damaged one ({str(error)[:200]})"
        raise InputError(path, "", problem, "write the file again") from error


def _table_name(connection: sqlite3.Connection, path: Path) -> str:
    """The only table of samples.

    Raises:
        InputError: there is none, or there are several.
    """
    rows = connection.execute("SELECT name FROM sqlite_master WHERE type IN ('table', 'view')")
    names = [
        str(name)
        for (name,) in rows.fetchall()
        if len(connection.execute(f"SELECT * FROM {_quoted(name)} LIMIT 0").description or ())
        >= _MIN_COLUMNS
    ]
    if len(names) != 1:
        listed = ", ".join(names[:6]) or "none"
        problem = f"holds {len(names)} tables of {_MIN_COLUMNS} columns or more: {listed}"
        problem += "; expected one"
        name = names[0] if names else "TABLE"
        remedy = f"export that of the samples, such as by sqlite3 -csv -header {path.name} "
        remedy += f"'SELECT * FROM {_quoted(name)}' > log.csv"
        raise InputError(path, "", problem, remedy)
    return names[0]


def _parts(connection: sqlite3.Connection, name: str) -> Iterator[pa.Table]:
    """The rows of a table, some thousand at a time."""
    cursor = connection.execute(f"SELECT * FROM {_quoted(name)}")
    columns = [description[0] for description in cursor.description]
    while rows := cursor.fetchmany(_BLOCK_ROWS):
        yield pa.table({
            column: pa.array([row[k] for row in rows]) for k, column in enumerate(columns)
        })  # fmt: skip


def _quoted(name: str) -> str:
    """The name of a table in a statement."""
    doubled = name.replace('"', '""')
    return f'"{doubled}"'
