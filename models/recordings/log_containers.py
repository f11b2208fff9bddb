"""The kinds of log files that there are, by the ending of their names."""

from pathlib import Path

from models.recordings.log_container import LogContainer
from models.recordings.parquet_table import ParquetContainer
from models.recordings.text_table import TextContainer

TEXT = TextContainer()
"""Also of a log with any other ending, where a description says how to read it."""

CONTAINERS: list[LogContainer] = [TEXT, ParquetContainer()]
"""A further kind is one line here, or one `CONTAINERS.append` in a program of one's own."""


def container_of(path: Path) -> LogContainer | None:
    """Returns the kind of a log by its ending; None for an ending that nobody knows."""
    suffix = path.suffix.lower()
    return next((kind for kind in CONTAINERS if suffix in kind.suffixes), None)


def usual_suffixes() -> list[str]:
    """The ending of each kind that is written by default."""
    return [kind.suffixes[0] for kind in CONTAINERS]
