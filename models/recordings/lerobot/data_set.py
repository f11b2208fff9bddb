"""A LeRobot data set on disk: what meta/info.json and the table of episodes say.

    ROOT/meta/info.json                        version, rate, features
    ROOT/meta/episodes.jsonl                   v2: index and length of each episode
    ROOT/data/chunk-000/episode_000000.parquet
    ROOT/meta/episodes/chunk-000/*.parquet     v3: and the file of each, of which many share one
    ROOT/data/chunk-000/file-000.parquet

As a log an episode is ROOT/episode_000012, whichever version it is; v2's own file is the same.
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

from wrenchsight.models.arrays import Array
from wrenchsight.models.files.files_read import about_to_read
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import read_limited

INFO = "meta/info.json"
MOST_EPISODES = 100_000
_LARGEST_META = 256 << 20  # bytes of a file of meta/
_MOST_FEATURES, _MOST_ENTRIES = 1000, 4096
_ENDS = ("min", "max")  # of a feature's statistics
_EPISODE = re.compile(r"episode_(\d{1,9})(?:\.parquet)?")
_FIELD = re.compile(r"\{(\w+)(?::0?(\d)d)?\}")
_V3_COLUMNS = ["episode_index", "length", "data/chunk_index", "data/file_index",
               "dataset_from_index"]  # fmt: skip


@dataclass(frozen=True)
class Feature:
    """One of info.json's features.

    Attributes:
        names: of its entries; empty where it states none, or another number of them.
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
    """Where an episode lies.

    Attributes:
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
    """A data set's description.

    Attributes:
        version: 2 or 3.
        info: info.json as it is.
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
        found = next((one for one in self.episodes if one.index == index), None)
        if found is None:
            have = f"has the episodes {self.episodes[0].index} to {self.episodes[-1].index}"
            raise InputError(self.root, f"episode {index}", have, "name one of them")
        return found

    def largest(self, feature: str) -> Array | None:
        """(k,) the largest absolute value of each entry of a feature, as its statistics say.

        None where the data set holds no statistics of it.
        """
        size = self.features[feature].size
        rows = [one.get(feature) for one in _statistics(self)]
        ends = [_row(row.get(end), size) for row in rows if isinstance(row, dict) for end in _ENDS]
        told = [np.abs(end) for end in ends if end is not None]
        if not told or len(told) < len(ends):
            return None
        found = np.max(told, axis=0)
        return None if np.isnan(found).any() else np.asarray(found)


def root_of(path: Path) -> Path | None:
    """The folder of the data set that a path names, or an episode of it; None: it names none."""
    if path.is_dir():
        return path if (path / INFO).is_file() else None
    if not path.exists():
        named = _EPISODE.fullmatch(path.name) and (path.parent / INFO).is_file()
        return path.parent if named else None
    # ROOT/data/chunk-000/file.parquet, or ROOT/meta/info.json
    at = 3 if path.suffix == ".parquet" and len(path.resolve().parents) > 2 else 2
    if at == 2 and not (path.name == "info.json" and path.parent.name == "meta"):
        return None
    root = path.resolve().parents[at - 1]
    if at == 3 and path.resolve().parents[1].name != "data":
        return None
    return root if (root / INFO).is_file() else None


def episode_paths(path: Path) -> list[Path]:
    """The logs that a path stands for: each episode of a data set, else the path alone.

    Raises:
        InputError: the data set is damaged.
    """
    root = root_of(path)
    if root is None or episode_index(path) is not None:
        return [path]
    return [root / f"episode_{one.index:06d}" for one in load_data_set(root).episodes]


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
    known = {"v2.0": 2, "v2.1": 2, "v3.0": 3}
    version = known.get(str(info.get("codebase_version")))
    if version is None:
        problem = f"is {str(info.get('codebase_version'))[:20]!r}, expected {', '.join(known)}"
        raise InputError(path, "codebase_version", problem, "convert the data set with LeRobot")
    fps = info.get("fps")
    if not (isinstance(fps, int | float) and 1.0 <= fps <= 1e5):
        raise InputError(path, "fps", f"is {str(fps)[:20]}, expected frames a second")
    features = _features(info.get("features"), path)
    episodes = _episodes_v2(root, info) if version == 2 else _episodes_v3(root, info)
    if not episodes:
        raise InputError(root, "", "holds no episodes", "record one")
    return DataSet(root, version, info, float(fps), features, episodes)


def _features(value: object, path: Path) -> dict[str, Feature]:
    if not isinstance(value, dict) or len(value) > _MOST_FEATURES:
        raise InputError(path, "features", "expected the data set's features by name")
    found: dict[str, Feature] = {}
    for name, entry in value.items():
        shape = entry.get("shape") if isinstance(entry, dict) else None
        if not isinstance(shape, list) or not all(isinstance(n, int) and n >= 0 for n in shape):
            raise InputError(path, f"features, {name[:60]}", "has no shape of whole numbers")
        size = 1
        for n in shape:
            size = min(size * n, 1 << 40)
        names = _names(entry.get("names"))
        found[name] = Feature(
            name, str(entry.get("dtype")), size, names if len(names) == size else ()
        )
    return found


def _names(value: object) -> tuple[str, ...]:
    """Of a feature's entries: a list, a list in a list, or {"motors": a list}."""
    if isinstance(value, dict) and value:
        inner = list(value.values())
        return _names(inner[0]) if len(inner) == 1 else ()
    if not isinstance(value, list) or len(value) > _MOST_ENTRIES:
        return ()
    if len(value) == 1 and isinstance(value[0], list):
        return _names(value[0])
    return tuple(str(one) for one in value) if all(isinstance(x, str) for x in value) else ()


def _episodes_v2(root: Path, info: dict[str, Any]) -> tuple[Episode, ...]:
    path = root / "meta" / "episodes.jsonl"
    template = info.get("data_path")
    size = info.get("chunks_size")
    if not isinstance(size, int) or size < 1:
        raise InputError(root / INFO, "chunks_size", "expected a whole number")
    found: list[Episode] = []
    for row in json_lines(path):
        index, length = row.get("episode_index"), row.get("length")
        if not (isinstance(index, int) and isinstance(length, int) and index >= 0 < length):
            raise InputError(path, f"line {len(found) + 1}", "lacks episode_index or length")
        values = {"episode_chunk": index // size, "episode_index": index}
        found.append(Episode(index, length, _file(root, template, values), 0))
    return tuple(sorted(found, key=lambda one: one.index))


def _episodes_v3(root: Path, info: dict[str, Any]) -> tuple[Episode, ...]:
    rows: list[dict[str, Any]] = []
    for path in v3_episode_files(root):
        about_to_read(path)
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
            lacks = f"an episode lacks one of {', '.join(_V3_COLUMNS)}"
            raise InputError(root / "meta/episodes", "", lacks, "copy the data set again")
    rows.sort(key=lambda row: row["episode_index"])
    first: dict[tuple[int, int], int] = {}
    found = []
    for row in rows:
        place = (row["data/chunk_index"], row["data/file_index"])
        begin = row["dataset_from_index"]
        first[place] = min(first.get(place, begin), begin)
    for row in rows:
        place = (row["data/chunk_index"], row["data/file_index"])
        values = {"chunk_index": place[0], "file_index": place[1]}
        file = _file(root, info.get("data_path"), values)
        begin = row["dataset_from_index"] - first[place]
        found.append(Episode(row["episode_index"], row["length"], file, begin))
    return tuple(found)


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
    """A data file by info.json's pattern, below the root; only plain fields count."""
    text = _FIELD.sub(
        lambda m: f"{values[m[1]]:0{m[2] or 1}d}" if m[1] in values else m[0], str(template)
    )
    if not isinstance(template, str) or "{" in text or ".." in Path(text).parts or text[:1] == "/":
        problem = f"is {str(template)[:80]!r}, expected a path below the data set's folder"
        raise InputError(root / INFO, "data_path", problem, "write LeRobot's own")
    return root / text


def _json(text: bytes, path: Path, place: str = "") -> dict[str, Any]:
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(path, place, f"is no JSON ({error})", "copy it again") from error
    if not isinstance(value, dict):
        raise InputError(path, place, "expected an object", "copy the data set again")
    return value


def _statistics(data_set: DataSet) -> list[dict[str, Any]]:
    """Statistics by feature, of the whole data set or of each episode."""
    whole, each = (data_set.root / "meta" / name for name in ("stats.json", "episodes_stats.jsonl"))
    if whole.is_file():
        return [_json(read_limited(whole, _LARGEST_META, "statistics"), whole)]
    if each.is_file():
        rows = [row.get("stats") for row in json_lines(each)]
        return [row for row in rows if isinstance(row, dict)]
    return []


def _row(value: object, size: int) -> Array | None:
    """(size,); None where it is no row of so many numbers."""
    try:
        numbers = np.asarray(value, float).ravel()
    except (TypeError, ValueError):
        return None
    return numbers if len(numbers) == size else None
