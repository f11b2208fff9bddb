"""The kinds of log files, by their first bytes or else by the ending of their names."""

import re
import zipfile
from pathlib import Path
from typing import Final

from wrenchsight.models.files.limited_file import opened
from wrenchsight.models.recordings.arrow_table import (
    ARROW_MAGIC,
    FEATHER_1_MAGIC,
    ArrowContainer,
)
from wrenchsight.models.recordings.echo_text import is_echo, lacks_arrays
from wrenchsight.models.recordings.json_lines import has_text_before_objects
from wrenchsight.models.recordings.json_table import (
    JsonTable,
    YamlTable,
    is_yaml,
    is_yaml_log,
)
from wrenchsight.models.recordings.lerobot.data_set import root_of
from wrenchsight.models.recordings.lerobot.episode_table import DATA_SETS
from wrenchsight.models.recordings.log_container import LogContainer, ReadOnlyContainer
from wrenchsight.models.recordings.log_folders import is_recording_folder, open_folder
from wrenchsight.models.recordings.mat_table import MatContainer
from wrenchsight.models.recordings.npz_table import NpzContainer
from wrenchsight.models.recordings.parquet_table import ParquetContainer
from wrenchsight.models.recordings.rosbag.bounded_bag import ROS1_MAGIC
from wrenchsight.models.recordings.rosbag.table import RosbagContainer, is_bag
from wrenchsight.models.recordings.sqlite_table import SQLITE_MAGIC, SQLITE_SUFFIXES, open_database
from wrenchsight.models.recordings.text_table import TextContainer

TEXT = TextContainer()
"""Also for a log with any other ending that has a description."""

BAG = RosbagContainer()
"""Also for a folder that holds a rosbag2."""

FOLDER = ReadOnlyContainer("a folder", open_folder)
"""For a folder that holds the quantities or joints of a recording in a file each."""

_PARQUET, _NPZ, _MAT = ParquetContainer(), NpzContainer(), MatContainer()
_JSON = ReadOnlyContainer("JSON", JsonTable, (".jsonl", ".ndjson", ".json"))
# Its endings are those of a description, too: its documents show that it is a log.
_YAML = ReadOnlyContainer("YAML", YamlTable)
_ARROW = ArrowContainer()
_SQLITE = ReadOnlyContainer("a database", open_database, SQLITE_SUFFIXES)

_BUILT_IN: Final = (TEXT, _PARQUET, _NPZ, BAG, _MAT, _JSON, _ARROW, _SQLITE)
CONTAINERS: list[LogContainer] = [*_BUILT_IN]
"""A further kind is one line here, or one `CONTAINERS.append` in a user's program.

A file with the ending of a user's kind is of that kind, whatever its first bytes are.
"""

_HEAD_BYTES: Final = 1 << 16
_KINDS_BY_MAGIC: Final[tuple[tuple[bytes, LogContainer], ...]] = (
    (b"PAR1", _PARQUET),
    (ARROW_MAGIC, _ARROW),
    (FEATHER_1_MAGIC, _ARROW),
    (b"\x93NUMPY", _NPZ),
    (b"MATLAB", _MAT),
    (SQLITE_MAGIC, _SQLITE),
    (ROS1_MAGIC, BAG),
)
_TEXT_SUFFIXES: Final = (*TEXT.suffixes, *_JSON.suffixes)
_YAML_SUFFIXES: Final = (".yaml", ".yml")
_JSON_BEGIN: Final = re.compile(r"\s*(\{\s*[\"}]|\[\s*[\[{])")  # {' is Python's


def container_of(path: Path) -> LogContainer | None:
    """The kind of a log by its first bytes, else by its ending; None where neither is known.

    A bag in a database (.db3) is known by its ending.
    """
    if is_bag(path):
        return BAG
    if root_of(path) is not None:
        return DATA_SETS
    if is_recording_folder(path):
        return FOLDER
    suffix = path.suffix.lower()
    by_suffix = next((kind for kind in CONTAINERS if suffix in kind.suffixes), None)
    is_users = by_suffix is not None and by_suffix not in _BUILT_IN
    if is_users or by_suffix is BAG or not path.is_file():
        return by_suffix
    with opened(path, "a log") as file:
        head = file.read(_HEAD_BYTES)
    for magic, kind in _KINDS_BY_MAGIC:
        if head.startswith(magic):
            return kind
    if head.startswith(b"PK") and _is_npz(path):
        return _NPZ
    text = head.decode("utf-8", "replace").removeprefix("\ufeff")
    if suffix in (*_TEXT_SUFFIXES, *_YAML_SUFFIXES) and lacks_arrays(text):
        return TEXT  # which says so
    if suffix in _TEXT_SUFFIXES and head and is_echo(text):
        return TEXT
    if suffix in _YAML_SUFFIXES:
        return TEXT if is_echo(text) else _YAML
    if suffix in _TEXT_SUFFIXES and _JSON_BEGIN.match(text):
        return _JSON
    if suffix in _TEXT_SUFFIXES and has_text_before_objects(text):
        return _JSON
    if suffix in _TEXT_SUFFIXES and is_yaml(text):
        return _YAML
    return by_suffix


def is_described(path: Path) -> bool:
    """Whether a file is a description of a log rather than a log in YAML."""
    return path.suffix.lower() in _YAML_SUFFIXES and not is_yaml_log(path)


def _is_npz(path: Path) -> bool:
    """Whether an archive holds arrays of NumPy."""
    try:
        with zipfile.ZipFile(path) as archive:
            return any(name.endswith(".npy") for name in archive.namelist())
    except Exception:  # of many kinds where an archive is damaged; whoever reads it says so
        return False


def usual_suffixes() -> list[str]:
    """The usual ending of each kind."""
    return [kind.suffixes[0] for kind in CONTAINERS]
