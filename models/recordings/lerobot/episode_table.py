"""An episode of a LeRobot data set as a table of numbers."""

from functools import lru_cache
from pathlib import Path

from wrenchsight.models.files.files_read import about_to_read
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.layouts.header_layouts import KnownLayout
from wrenchsight.models.recordings.lerobot.data_set import (
    INFO,
    DataSet,
    episode_index,
    load_data_set,
    root_of,
)
from wrenchsight.models.recordings.lerobot.feature_layout import feature_layout
from wrenchsight.models.recordings.log_container import ReadOnlyContainer
from wrenchsight.models.recordings.parquet_table import ParquetTable
from wrenchsight.models.robot.robot import Robot


class EpisodeTable(ParquetTable):
    """The frames of one episode; implements `log_container.LogTable`.

    Attributes:
        data_set: whose episode it is.
    """

    row_word = "frame"

    def __init__(self, data_set: DataSet, index: int) -> None:
        episode = data_set.episode(index)
        about_to_read(episode.file)
        super().__init__(episode.file, episode.rows)
        self.data_set = data_set

    def layout(self, robot: Robot | None, angle: str) -> KnownLayout:
        """The columns of the robot's joints; as `feature_layout`."""
        assert self.names is not None
        if robot is None:
            return feature_layout(self.data_set, self.names, None, None, angle)
        prismatic = [bool(slides) for slides in robot.chain.prismatic]
        return feature_layout(self.data_set, self.names, robot.joint_names, prismatic, angle)


def open_episode(path: Path) -> EpisodeTable:
    """An episode; the path of a data set with a single episode opens this episode.

    Raises:
        InputError: a data set of several, no such episode, or a damaged file.
    """
    root = root_of(path)
    assert root is not None
    data_set = loaded(root)
    index = episode_index(path)
    if index is None:
        if len(data_set.episodes) > 1:
            example = root / f"episode_{data_set.episodes[0].index:06d}"
            count = len(data_set.episodes)
            problem = f"is a data set of {count} episodes, expected a single episode"
            raise InputError(path, "", problem, f"name one, such as {example}")
        index = data_set.episodes[0].index
    return EpisodeTable(data_set, index)


DATA_SETS = ReadOnlyContainer("an episode of a LeRobot data set", open_episode)


def loaded(root: Path) -> DataSet:
    """`load_data_set`, cached for all episodes as long as info.json does not change."""
    about_to_read(root / INFO)
    return _loaded(root, (root / INFO).stat().st_mtime_ns)


@lru_cache(maxsize=4)
def _loaded(root: Path, modification_time: int) -> DataSet:
    return load_data_set(root)
