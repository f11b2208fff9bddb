"""A LeRobot data set read as one log, and its copy with the wrench of every frame."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.episodes_reader import EpisodesReader
from wrenchsight.models.recordings.lerobot.data_set import (
    DataSet,
    episode_index,
    episode_paths,
    root_of,
)
from wrenchsight.models.recordings.lerobot.data_set_copy import NewFeature, write_copy
from wrenchsight.models.recordings.lerobot.episode_table import loaded
from wrenchsight.models.recordings.parquet_table import ParquetTable
from wrenchsight.models.recordings.recording_reader import RecordingReader
from wrenchsight.models.rigid_body.spatial_vectors import WRENCH_AXES

if TYPE_CHECKING:
    from wrenchsight.analyses.output.outputs import OutputFolder

FOLDER = "data_set"
WRENCH, SD, VALID = "observation.wrench", "observation.wrench_sd", "observation.wrench_valid"
# Steps of the table that a frame may be later than its reading: one row may be missing between; of
# an episode's end the next reading is another episode's.
_MAX_FRAME_DELAY = 1.5
_MAX_FRAME_LEAD = 0.25  # steps that it may be earlier: stamps of one instant differ by rounding
# Columns of `_WrenchRows.numbers`.
_WRENCH_COLUMNS, _SD_COLUMNS, _VALID_COLUMN = slice(0, 6), slice(6, 12), 12


def data_set_of(log: Path) -> DataSet | None:
    """The data set that a log names as a whole; None: it names none, or one episode."""
    root = root_of(log)
    return None if root is None or episode_index(log) is not None else loaded(root)


def episodes_reader(log: Path, open_file: Callable[[Path], RecordingReader]) -> EpisodesReader:
    """Reads all episodes of the data set that a log names.

    Args:
        open_file: opens one episode by its path.
    """
    return EpisodesReader([lambda path=path: open_file(path) for path in episode_paths(log)])  # type: ignore[misc]


def write_data_set(
    data_set: DataSet, out: "OutputFolder", table: Path, begins: list[float], prior: dict[str, Any]
) -> None:
    """Writes FOLDER in `out`: the data set with wrench, sd and `valid` of each frame.

    A frame without a reading has a wrench of zero, the prior's sd, and is not valid.

    Args:
        table: table of wrenches, over the time of `EpisodesReader`, which puts all episodes one
            after another.
        begins: s, of each episode in that time.
        prior: sds of force and moment, as in metrics.json.
    """
    rows = _WrenchRows.read(table)
    step = float(np.median(np.diff(rows.t)))
    prior_sd = np.repeat([prior["force_sd_n"], prior["moment_sd_nm"]], 3)
    no_reading = np.concatenate([np.zeros(6), prior_sd, [0.0]])  # as _WRENCH_COLUMNS and so on
    values_of_episode: dict[int, np.ndarray[Any, Any]] = {}
    for episode, begin in zip(data_set.episodes, begins, strict=True):
        frames = ParquetTable(episode.file, episode.rows)
        column = (frames.names or ()).index("timestamp")
        stamps = np.concatenate([values[:, 0] for values, _ in frames.blocks([column])]) + begin
        # Of each frame the last row that is not later than it, but for the lead; of a frame before
        # all rows the first, which is near enough or counts as none.
        rows_before = np.searchsorted(rows.t, stamps + _MAX_FRAME_LEAD * step, side="right")
        row = np.maximum(rows_before - 1, 0)
        values = rows.numbers[row]  # (frames, 13), a copy
        is_near = np.abs(stamps - rows.t[row]) < _MAX_FRAME_DELAY * step
        values[~(np.isfinite(values).all(axis=1) & is_near)] = no_reading
        values_of_episode[episode.index] = values
    is_valid = {
        index: values[:, _VALID_COLUMN] > 0.5 for index, values in values_of_episode.items()
    }
    features = [
        _feature(WRENCH, WRENCH_AXES, values_of_episode, _WRENCH_COLUMNS),
        _feature(SD, WRENCH_AXES, values_of_episode, _SD_COLUMNS),
        NewFeature(VALID, ("valid",), is_valid),
    ]
    write_copy(data_set, out / FOLDER, features)


class _WrenchRows(NamedTuple):
    """Rows of a table of wrenches.

    Attributes:
        t: (R,) s.
        numbers: (R, 13) wrench and its sds in N and N m, force first, and `valid`.
    """

    t: Array
    numbers: Array

    @classmethod
    def read(cls, table: Path) -> "_WrenchRows":
        """Reads the columns of wrench.csv or wrench.parquet."""
        names = ("t", *WRENCH_AXES, *(f"sd_{axis}" for axis in WRENCH_AXES), "valid")
        if table.suffix == ".parquet":
            columns = pq.read_table(table, columns=[*names])
        else:
            options = pa_csv.ConvertOptions(include_columns=[*names])
            columns = pa_csv.read_csv(table, convert_options=options)
        values = {name: columns.column(name).to_numpy().astype(float) for name in names}
        return cls(values["t"], np.stack([values[name] for name in names[1:]], axis=1))


def _feature(
    name: str,
    axes: tuple[str, ...],
    values_of_episode: dict[int, np.ndarray[Any, Any]],
    columns: slice,
) -> NewFeature:
    """A feature of some columns of the values, episode by episode."""
    values = {index: rows[:, columns].astype("f4") for index, rows in values_of_episode.items()}
    return NewFeature(name, axes, values)
