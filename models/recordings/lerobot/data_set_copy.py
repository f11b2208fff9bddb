"""A copy of a LeRobot data set with further features, which LeRobot's loader accepts.

Frames, videos and images stay as they are (large files are hard links where the disk can). Data
files, info.json, the statistics and, in v3, the table of episodes gain the features.
"""

import copy
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from wrenchsight.models.files.files_read import about_to_read
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import read_limited
from wrenchsight.models.files.whole_file import writing_to
from wrenchsight.models.recordings.lerobot.data_set import (
    INFO,
    DataSet,
    Episode,
    json_lines,
    v3_episode_files,
)

_MIN_LINKED_BYTES = 1 << 20  # bytes, from which on a file is linked rather than copied
_STATS, _EPISODE_STATS = "meta/stats.json", "meta/episodes_stats.jsonl"
_HF = b"huggingface"  # key of a Parquet schema's metadata that `datasets` writes
_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
_LARGEST_META = 256 << 20


@dataclass(frozen=True, eq=False)
class NewFeature:
    """A feature that the copy has in addition.

    Attributes:
        names: names of its k entries.
        frames: by episode index, (length, k) or (length,) values.
    """

    name: str
    names: tuple[str, ...]
    frames: Mapping[int, NDArray[Any]]

    @property
    def example(self) -> NDArray[Any]:
        """The frames of an episode; those of all have the same type and number of entries."""
        return next(iter(self.frames.values()))

    @property
    def dtype(self) -> str:
        return str(self.example.dtype)


def write_copy(
    data_set: DataSet,
    folder: Path,
    features: list[NewFeature],
) -> None:
    """Writes the copy: the data set with further features, in its tables and its descriptions.

    Files of frames, info.json and statistics are rewritten; all others are linked or copied.

    Args:
        data_set: the original, which stays as it is.
        folder: the root of the copy, which is created.
        features: features of all episodes; they replace features of the same name.

    Raises:
        InputError: a file of the data set is damaged, or the copy cannot be written.
    """
    root = data_set.root
    data_files = {episode.file for episode in data_set.episodes}
    tables = set(v3_episode_files(root)) if data_set.version == 3 else set()
    rewritten = data_files | tables | {root / name for name in (INFO, _STATS, _EPISODE_STATS)}
    with writing_to(folder):
        for path in _files(root):
            if path not in rewritten:
                _link_or_copy(path, folder / path.relative_to(root))
    for path in sorted(data_files):
        _write_data(data_set, path, folder / path.relative_to(root), features)
    info = dict(data_set.info)
    descriptions = {feature.name: _description(feature) for feature in features}
    info["features"] = {**info["features"], **descriptions}
    _write_text(folder / INFO, json.dumps(info, indent=4, ensure_ascii=False))
    _write_statistics(data_set, folder, features, tables)


def statistics(values: NDArray[Any], quantiles: bool = False) -> dict[str, list[Any]]:
    """LeRobot's statistics of a feature, (length, k) or (length,): lists of k numbers."""
    flat = values.reshape(len(values), -1)
    numbers = flat.astype(np.float64)
    computed: dict[str, list[Any]] = {
        "min": flat.min(axis=0).tolist(),
        "max": flat.max(axis=0).tolist(),
        "mean": numbers.mean(axis=0).tolist(),
        "std": numbers.std(axis=0).tolist(),
        "count": [len(flat)],
    }
    if quantiles:
        for name, share in _QUANTILES.items():
            computed[name] = np.quantile(numbers, share, axis=0).tolist()
    return computed


def _files(folder: Path) -> Iterator[Path]:
    """All files below a folder that are not hidden."""
    for entry in sorted(os.scandir(folder), key=lambda entry: entry.name):
        if entry.name.startswith("."):
            continue
        if entry.is_dir(follow_symlinks=False):
            yield from _files(folder / entry.name)
        elif entry.is_file():
            yield folder / entry.name


def _link_or_copy(source: Path, target: Path) -> None:
    """A hard link to a large file where the disk allows it, else a copy."""
    about_to_read(source)
    target.parent.mkdir(parents=True, exist_ok=True)
    if source.stat().st_size >= _MIN_LINKED_BYTES:
        try:
            os.link(source.resolve(), target)
        except OSError:  # another disk, or one without links
            pass
        else:
            return
    shutil.copyfile(source, target)


def _write_text(path: Path, text: str) -> None:
    with writing_to(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n", encoding="utf-8", newline="\n")


def _description(feature: NewFeature) -> dict[str, Any]:
    """A feature as info.json describes it."""
    return {"dtype": feature.dtype, "shape": [len(feature.names)], "names": [*feature.names]}


def _write_data(data_set: DataSet, source: Path, target: Path, features: list[NewFeature]) -> None:
    """Copies a Parquet file of frames, group by group, and appends the features.

    Args:
        data_set: the original, whose episodes say which frames the file holds.
        source, target: the file and its copy.
        features: of all episodes.

    Raises:
        InputError: the file is damaged.
    """
    episodes = [episode for episode in data_set.episodes if episode.file == source]
    about_to_read(source)
    try:
        with pq.ParquetFile(source) as file:
            schema = _with_features(file.schema_arrow, features)
            columns = {  # of each feature one value for every row of the file
                feature.name: _file_column(feature, episodes, file.metadata.num_rows)
                for feature in features
            }
            with writing_to(target):
                target.parent.mkdir(parents=True, exist_ok=True)
                begin = 0
                with pq.ParquetWriter(target, schema, compression="snappy") as writer:
                    for group in range(file.num_row_groups):
                        table = _row_group(file, source, group)
                        rows = slice(begin, begin + table.num_rows)
                        for name, values in columns.items():
                            kind = schema.field(name).type
                            table = _appended(table, name, values[rows], kind)
                        writer.write_table(table.select(schema.names).cast(schema))
                        begin += table.num_rows
    except (pa.ArrowException, OSError) as error:
        raise _damaged(source, error) from error


def _row_group(file: pq.ParquetFile, source: Path, group: int) -> pa.Table:
    """Rows of a file; what is wrong with them is named here, as no fault of what is written.

    Raises:
        InputError: they are damaged.
    """
    try:
        return file.read_row_group(group)
    except (pa.ArrowException, OSError) as error:
        raise _damaged(source, error) from error


def _damaged(source: Path, error: Exception) -> InputError:
    """The error of a file of the data set that cannot be read."""
    return InputError(source, "", f"is damaged ({error})", "copy the data set again")


def _file_column(feature: NewFeature, episodes: list[Episode], num_rows: int) -> NDArray[Any]:
    """(num_rows, k) or (num_rows,) a feature of the episodes of a file; 0 in other rows."""
    column = np.zeros((num_rows, *feature.example.shape[1:]), feature.example.dtype)
    for episode in episodes:
        frames = feature.frames[episode.index][: max(0, num_rows - episode.begin)]
        column[episode.begin : episode.begin + len(frames)] = frames
    return column


def _appended(table: pa.Table, name: str, values: NDArray[Any], kind: pa.DataType) -> pa.Table:
    if name in table.column_names:
        table = table.drop_columns([name])
    return table.append_column(pa.field(name, kind), pa.array(list(values), kind))


def _with_features(schema: pa.Schema, features: list[NewFeature]) -> pa.Schema:
    """The schema of a data file with the features, whose lists are of the file's kind."""
    has_fixed_lists = any(pa.types.is_fixed_size_list(field.type) for field in schema)
    has_plain_lists = any(pa.types.is_list(field.type) for field in schema)
    for feature in features:
        example = feature.example
        kind: pa.DataType = pa.from_numpy_dtype(example.dtype)
        if example.ndim > 1 and has_plain_lists and not has_fixed_lists:
            kind = pa.list_(kind)
        elif example.ndim > 1:
            kind = pa.list_(kind, example.shape[1])
        if feature.name in schema.names:
            schema = schema.remove(schema.names.index(feature.name))
        schema = schema.append(pa.field(feature.name, kind))
    return schema.with_metadata(_hf_metadata(schema.metadata, features))


def _hf_metadata(
    metadata: Mapping[bytes, bytes] | None, features: list[NewFeature]
) -> dict[bytes, bytes] | None:
    """The metadata of a file, in which the entry of `datasets` has the new features.

    `datasets` (of Hugging Face) describes features under b"huggingface", in JSON: a number as
    {"dtype", "_type": "Value"}, a list as an entry around that, of which an example is copied from
    the features that are there. An entry that cannot be read is left out; `datasets` then reads the
    types of the columns. None or empty stays None.
    """
    if not metadata:
        return None
    other_entries = dict(metadata)
    try:
        description = json.loads(other_entries.pop(_HF))
        described = description["info"]["features"]
        list_entries = [
            entry for entry in described.values() if isinstance(entry.get("feature"), dict)
        ]
        for feature in features:
            value = {"dtype": feature.dtype, "_type": "Value"}
            entry: dict[str, Any] = value
            if feature.example.ndim > 1:  # a row of numbers a frame: a list
                entry = copy.deepcopy(list_entries[0]) | {"feature": value}
                if "length" in entry:  # a list of a stated length
                    entry["length"] = len(feature.names)
            described[feature.name] = entry
    except (KeyError, ValueError, TypeError, AttributeError, IndexError):
        return other_entries
    return other_entries | {_HF: json.dumps(description).encode()}


def _write_statistics(
    data_set: DataSet, folder: Path, features: list[NewFeature], tables: set[Path]
) -> None:
    """Writes the statistics of the data set and of its episodes, where it has them.

    Version 2 has a file of all and a JSON line for each episode, version 3 instead of the latter
    the tables of the episodes.

    Args:
        data_set: the original.
        folder: root of the copy.
        features: of which the statistics are added.
        tables: files of version 3's table of episodes; empty for version 2.

    Raises:
        InputError: a file of statistics is damaged.
    """
    root = data_set.root
    of_all_file, of_episodes_file = root / _STATS, root / _EPISODE_STATS
    if of_all_file.is_file():
        try:
            by_feature = json.loads(read_limited(of_all_file, _LARGEST_META, "statistics"))
        except ValueError as error:
            raise InputError(of_all_file, "", f"is no JSON ({error})", "copy it again") from error
        has_quantiles = any(isinstance(s, dict) and "q50" in s for s in by_feature.values())
        for feature in features:
            values = np.concatenate([feature.frames[e.index] for e in data_set.episodes])
            by_feature[feature.name] = statistics(values, has_quantiles)
        _write_text(folder / _STATS, json.dumps(by_feature, indent=4))
    if of_episodes_file.is_file():
        rows = json_lines(of_episodes_file)
        for row in rows:
            for feature in features:
                frames = feature.frames.get(row.get("episode_index", -1))  # -1: of no episode
                if frames is not None and isinstance(row.get("stats"), dict):
                    row["stats"][feature.name] = statistics(frames)
        _write_text(folder / _EPISODE_STATS, "\n".join(json.dumps(row) for row in rows))
    for path in sorted(tables):
        _write_episodes(path, folder / path.relative_to(root), features)


def _write_episodes(source: Path, target: Path, features: list[NewFeature]) -> None:
    """A file of v3's table of episodes, with the statistics of each."""
    about_to_read(source)
    try:
        with pq.ParquetFile(source) as file:
            table = file.read()
        has_statistics = any(name.startswith("stats/") for name in table.column_names)
        has_quantiles = any(name.endswith("/q50") for name in table.column_names)
        indices = table.column("episode_index").to_pylist()
        for feature in features if has_statistics else ():
            rows = [statistics(feature.frames[index], has_quantiles) for index in indices]
            for key in rows[0] if rows else ():
                name = f"stats/{feature.name}/{key}"
                if name in table.column_names:
                    table = table.drop_columns([name])
                table = table.append_column(name, pa.array([row[key] for row in rows]))
        with writing_to(target):
            target.parent.mkdir(parents=True, exist_ok=True)
            pq.write_table(table, target, compression="snappy")
    except (pa.ArrowException, OSError, KeyError) as error:
        raise _damaged(source, error) from error
