"""A LeRobot data set on disk: its description and its table of episodes.

    ROOT/meta/info.json                         version, rate, features
    ROOT/meta/episodes.jsonl                    v2: index and length of each episode
    ROOT/data/chunk-000/episode_000000.parquet  v2: the frames of an episode
    ROOT/meta/episodes/chunk-000/*.parquet      v3: index, length, file and first row of each
    ROOT/data/chunk-000/file-000.parquet        v3: the frames of several episodes

As a log, an episode is ROOT/episode_000012 in either version; the file of v2 is the same log.
Source of the layout: LeRobot 0.3.3 (v2.1) and 0.4.4 (v3.0), `lerobot.datasets`.
"""

import json
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from wrenchsight.models.files.files_read import about_to_read
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import read_limited
from wrenchsight.models.numerics.arrays import Array

INFO = "meta/info.json"
MOST_EPISODES = 100_000
_LARGEST_META = 256 << 20  # bytes of a file of meta/
_MOST_FEATURES, _MOST_ENTRIES = 1000, 4096
_LARGEST_SIZE = 1 << 40  # numbers of a feature
_EXTREMES = ("min", "max")  # of a feature's statistics
_VERSIONS = {"v2.0": 2, "v2.1": 2, "v3.0": 3}
_EPISODE = re.compile(r"episode_(\d{1,9})(?:\.parquet)?")
_FIELD = re.compile(r"\{(\w+)(?::0?(\d)d)?\}")
_V3_COLUMNS = ["episode_index", "length", "data/chunk_index", "data/file_index",
               "dataset_from_index"]  # fmt: skip


@dataclass(frozen=True)
class Feature:
    """A feature that info.json describes.

    Attributes:
        dtype: type of its entries, as info.json names it.
        size: number of its entries in a frame.
        names: names of its entries; empty where info.json states none, or another number of them.
    """

    name: str
    dtype: str
    size: int
    names: tuple[str, ...]

    @property
    def is_number(self) -> bool:
        return bool(re.fullmatch(r"u?int\d+|float\d+|bool", self.dtype))


@dataclass(frozen=True)
class Episode:
    """The place of an episode.

    Attributes:
        length: number of frames.
        file: that holds its frames.
        begin: its first row in the file, from 0.
    """

    index: int
    length: int
    file: Path
    begin: int

    @property
    def rows(self) -> range:
        """Its rows in the file, from 0."""
        return range(self.begin, self.begin + self.length)


@dataclass(frozen=True, eq=False)
class DataSet:
    """The description of a data set.

    Attributes:
        root: its folder.
        version: 2 or 3.
        info: the content of info.json.
        fps: frames a second.
        features: by name.
    """

    root: Path
    version: int
    info: dict[str, Any]
    fps: float
    features: dict[str, Feature]
    episodes: tuple[Episode, ...] = field(repr=False)

    @property
    def robot_type(self) -> str:
        return str(self.info.get("robot_type") or "")

    def episode(self, index: int) -> Episode:
        """The episode of this index.

        Raises:
            InputError: there is none.
        """
        for episode in self.episodes:
            if episode.index == index:
                return episode
        problem = f"has the episodes {self.episodes[0].index} to {self.episodes[-1].index}"
        raise InputError(self.root, f"episode {index}", problem, "name one of them")

    def largest(self, feature: str) -> Array | None:
        """(k,) the largest absolute value of each entry of a feature, by the data set's statistics.

        None where the data set holds no statistics of it.
        """
        size = self.features[feature].size
        magnitudes: list[Array] = []
        for all_statistics in _statistics(self):
            statistics = all_statistics.get(feature)
            if not isinstance(statistics, dict):
                continue
            for extreme in _EXTREMES:
                numbers = _row(statistics.get(extreme), size)
                if numbers is None:
                    return None
                magnitudes.append(np.abs(numbers))
        if not magnitudes:
            return None
        largest = np.max(magnitudes, axis=0)
        return None if np.isnan(largest).any() else np.asarray(largest)


def root_of(path: Path) -> Path | None:
    """The folder of the data set to which a path belongs; None: it belongs to none.

    Args:
        path: path of the folder, of an episode (ROOT/episode_000012), of a file of frames or of
            info.json.
    """
    if path.is_dir():
        root = path
    elif not path.exists():
        if not _EPISODE.fullmatch(path.name):
            return None
        root = path.parent
    else:
        parents = path.resolve().parents
        if path.suffix == ".parquet" and len(parents) > 2:  # ROOT/data/chunk-000/file.parquet
            if parents[1].name != "data":
                return None
            root = parents[2]
        elif path.name == "info.json" and path.parent.name == "meta":  # ROOT/meta/info.json
            root = parents[1]
        else:
            return None
    return root if (root / INFO).is_file() else None


def episode_paths(path: Path) -> list[Path]:
    """The logs that a path names: each episode of a data set, else the path itself.

    Raises:
        InputError: the data set is damaged.
    """
    root = root_of(path)
    if root is None or episode_index(path) is not None:
        return [path]
    return [root / f"episode_{episode.index:06d}" for episode in load_data_set(root).episodes]


def episode_index(path: Path) -> int | None:
    """The index of the episode that a path names; None: the whole data set."""
    match = _EPISODE.fullmatch(path.name)
    return int(match[1]) if match and not path.is_dir() else None


def file_of(path: Path) -> Path:
    """The file that holds a log: that of an episode's frames, else the path itself."""
    root, index = root_of(path), episode_index(path)
    if root is None or index is None or path.is_file():
        return path
    return load_data_set(root).episode(index).file


def load_data_set(root: Path) -> DataSet:
    """Reads a data set's description.

    Raises:
        InputError: it is damaged, of an unknown version, or without episodes.
    """
    path = root / INFO
    info = _json(read_limited(path, _LARGEST_META, "an info.json"), path)
    version_name = str(info.get("codebase_version"))
    version = _VERSIONS.get(version_name)
    if version is None:
        problem = f"is {version_name[:20]!r}, expected {', '.join(_VERSIONS)}"
        raise InputError(path, "codebase_version", problem, "convert the data set with LeRobot")
    fps = info.get("fps")
    if not (isinstance(fps, int | float) and 1.0 <= fps <= 1e5):
        raise InputError(path, "fps", f"is {str(fps)[:20]}, expected frames a second")
    features = _features(info.get("features"), path)
    episodes = _episodes_v2(root, info) if version == 2 else _episodes_v3(root, info)
    if not episodes:
        total = info.get("total_episodes")
        if isinstance(total, int) and total > 0:
            listed = root / ("meta/episodes.jsonl" if version == 2 else "meta/episodes")
            problem = f"is missing or empty, but {INFO} has total_episodes: {total}"
            raise InputError(listed, "", problem, "copy the whole data set again, with meta/")
        raise InputError(root, "", "holds no episodes", "record one")
    return DataSet(root, version, info, float(fps), features, episodes)


def _features(value: object, path: Path) -> dict[str, Feature]:
    """The features of an info.json, by name."""
    if not isinstance(value, dict) or len(value) > _MOST_FEATURES:
        raise InputError(path, "features", "expected the data set's features by name")
    features: dict[str, Feature] = {}
    for name, entry in value.items():
        shape = entry.get("shape") if isinstance(entry, dict) else None
        if not isinstance(shape, list) or not all(isinstance(n, int) and n >= 0 for n in shape):
            raise InputError(path, f"features, {name[:60]}", "has no shape of whole numbers")
        size = 1
        for n in shape:
            size = min(size * n, _LARGEST_SIZE)
        names = _names(entry.get("names"))
        features[name] = Feature(
            name, str(entry.get("dtype")), size, names if len(names) == size else ()
        )
    return features


def _names(value: object) -> tuple[str, ...]:
    """The names of a feature's entries: of a list, a list in a list, or {"motors": a list}."""
    if isinstance(value, dict) and value:
        inner = list(value.values())
        return _names(inner[0]) if len(inner) == 1 else ()
    if not isinstance(value, list) or len(value) > _MOST_ENTRIES:
        return ()
    if len(value) == 1 and isinstance(value[0], list):
        return _names(value[0])
    return tuple(value) if all(isinstance(name, str) for name in value) else ()


def _episodes_v2(root: Path, info: dict[str, Any]) -> tuple[Episode, ...]:
    """The episodes of version 2: one line each in episodes.jsonl."""
    path = root / "meta" / "episodes.jsonl"
    template = info.get("data_path")
    size = info.get("chunks_size")
    if not isinstance(size, int) or size < 1:
        raise InputError(root / INFO, "chunks_size", "expected a whole number")
    episodes: list[Episode] = []
    for row in json_lines(path):
        index, length = row.get("episode_index"), row.get("length")
        if not (isinstance(index, int) and isinstance(length, int) and index >= 0 < length):
            raise InputError(path, f"line {len(episodes) + 1}", "lacks episode_index or length")
        values = {"episode_chunk": index // size, "episode_index": index}
        episodes.append(Episode(index, length, _file(root, template, values), 0))
    return tuple(sorted(episodes, key=lambda episode: episode.index))


def _episodes_v3(root: Path, info: dict[str, Any]) -> tuple[Episode, ...]:
    """The episodes of version 3: one row each in a table, many to a file of frames.

    Args:
        root: folder of the data set.
        info: content of its info.json, whose data_path names the files of frames.

    Returns:
        The episodes, sorted by index; `begin` is the row of the first frame in its file.

    Raises:
        InputError: a table is damaged, too long, or lacks a number.
    """
    rows: list[dict[str, Any]] = []
    for path in v3_episode_files(root):
        about_to_read(path)  # every reader calls it: it tells who lists the files that are read
        try:
            with pq.ParquetFile(path) as file:
                if file.metadata.num_rows > MOST_EPISODES:
                    raise InputError(path, "", f"has more than {MOST_EPISODES} episodes")
                rows += file.read(columns=_V3_COLUMNS).to_pylist()
        except (pa.ArrowException, OSError, KeyError, ValueError) as error:
            raise InputError(
                path, "", f"is damaged ({error})", "copy the data set again"
            ) from error
    for row in rows:
        if not all(isinstance(row.get(name), int) and row[name] >= 0 for name in _V3_COLUMNS):
            problem = f"an episode lacks one of {', '.join(_V3_COLUMNS)}"
            raise InputError(root / "meta/episodes", "", problem, "copy the data set again")
    rows.sort(key=lambda row: row["episode_index"])
    files: list[Path] = []  # file of frames of each row
    file_begins: dict[Path, int] = {}  # first frame of each file in the whole data set
    for row in rows:
        values = {"chunk_index": row["data/chunk_index"], "file_index": row["data/file_index"]}
        file = _file(root, info.get("data_path"), values)
        files.append(file)
        begin = row["dataset_from_index"]
        file_begins[file] = min(file_begins.get(file, begin), begin)
    return tuple(
        Episode(
            index=row["episode_index"],
            length=row["length"],
            file=file,
            begin=row["dataset_from_index"] - file_begins[file],
        )
        for row, file in zip(rows, files, strict=True)
    )


def v3_episode_files(root: Path) -> list[Path]:
    """The files of a v3 data set's table of episodes."""
    return sorted((root / "meta" / "episodes").glob("chunk-*/file-*.parquet"))


def json_lines(path: Path) -> list[dict[str, Any]]:
    """The rows of a file of JSON lines.

    Raises:
        InputError: it is missing or damaged.
    """
    text = read_limited(path, _LARGEST_META, "lines of JSON")
    lines = [line for line in text.splitlines() if line.strip()]
    if len(lines) > MOST_EPISODES:
        raise InputError(path, "", f"has more than {MOST_EPISODES} lines")
    return [_json(line, path, f"line {k + 1}") for k, line in enumerate(lines)]


def _file(root: Path, template: object, values: dict[str, int]) -> Path:
    """A data file by info.json's pattern, below the root; other than plain fields are refused."""

    def filled(field: re.Match[str]) -> str:
        name, width = field[1], field[2] or 1
        return f"{values[name]:0{width}d}" if name in values else field[0]

    text = _FIELD.sub(filled, str(template))
    if not isinstance(template, str) or "{" in text or ".." in Path(text).parts or text[:1] == "/":
        problem = f"is {str(template)[:80]!r}, expected a path below the data set's folder"
        raise InputError(root / INFO, "data_path", problem, "write the pattern that LeRobot writes")
    return root / text


def _json(text: bytes, path: Path, place: str = "") -> dict[str, Any]:
    """The JSON object that a text holds."""
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(path, place, f"is no JSON ({error})", "copy it again") from error
    if not isinstance(value, dict):
        raise InputError(path, place, "expected an object", "copy the data set again")
    return value


def _statistics(data_set: DataSet) -> list[dict[str, Any]]:
    """Statistics by feature, of the whole data set or of each episode."""
    of_data_set = data_set.root / "meta/stats.json"
    of_episodes = data_set.root / "meta/episodes_stats.jsonl"
    if of_data_set.is_file():
        return [_json(read_limited(of_data_set, _LARGEST_META, "statistics"), of_data_set)]
    if of_episodes.is_file():
        rows = [row.get("stats") for row in json_lines(of_episodes)]
        return [row for row in rows if isinstance(row, dict)]
    return []


def _row(value: object, size: int) -> Array | None:
    """(size,) the numbers of a value; None where it does not hold so many."""
    try:
        numbers = np.asarray(value, float).ravel()
    except (TypeError, ValueError):
        return None
    return numbers if len(numbers) == size else None
