"""The kinds of log files, by the ending of their names."""

from pathlib import Path

from wrenchsight.models.recordings.json_lines import JsonLinesContainer
from wrenchsight.models.recordings.lerobot.data_set import root_of
from wrenchsight.models.recordings.lerobot.episode_table import DATA_SETS
from wrenchsight.models.recordings.log_container import LogContainer
from wrenchsight.models.recordings.mat_table import MatContainer
from wrenchsight.models.recordings.npz_table import NpzContainer
from wrenchsight.models.recordings.parquet_table import ParquetContainer
from wrenchsight.models.recordings.rosbag.table import RosbagContainer, is_bag
from wrenchsight.models.recordings.text_table import TextContainer

TEXT = TextContainer()
"""Also for a log with any other ending that has a description."""

BAG = RosbagContainer()
"""Also for a folder that holds a rosbag2."""

CONTAINERS: list[LogContainer] = [
    TEXT,
    ParquetContainer(),
    NpzContainer(),
    BAG,
    MatContainer(),
    JsonLinesContainer(),
]
"""A further kind is one line here, or one `CONTAINERS.append` in a user's program."""


def container_of(path: Path) -> LogContainer | None:
    """The kind of a log by its ending; None for an unknown ending."""
    if is_bag(path):
        return BAG
    if root_of(path) is not None:
        return DATA_SETS
    suffix = path.suffix.lower()
    return next((kind for kind in CONTAINERS if suffix in kind.suffixes), None)


def usual_suffixes() -> list[str]:
    """The usual ending of each kind."""
    return [kind.suffixes[0] for kind in CONTAINERS]
