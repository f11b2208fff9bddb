"""A copy of a LeRobot data set with further features, valid for LeRobot's own loader.

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
    json_lines,
    v3_episode_files,
)

_LINKED = 1 << 20  # bytes, from which on a file is linked rather than copied
_STATS, _EACH_STATS = "meta/stats.json", "meta/episodes_stats.jsonl"
_HF = b"huggingface"  # key of a Parquet schema's metadata under which `datasets` keeps its own
_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
_LARGEST_META = 256 << 20


@dataclass(frozen=True, eq=False)
class NewFeature:
    """A feature that the copy has besides.

    Attributes:
        frames: by episode index, (length, k) or (length,) values.
    """

    name: str
    names: tuple[str, ...]  # of the k entries
    frames: Mapping[int, NDArray[Any]]

    @property
    def dtype(self) -> str:
        return str(next(iter(self.frames.values())).dtype)


def write_copy(
    data_set: DataSet,
    folder: Path,
    features: list[NewFeature],
) -> None:
    """Writes the copy.

    Args:
        folder: that becomes the copy's root; made.
        features: of all episodes; names that the data set has are replaced.

    Raises:
        InputError: a file of the data set is damaged, or the copy cannot be written.
    """
    root = data_set.root
    data_files = {one.file for one in data_set.episodes}
    tables = set(v3_episode_files(root)) if data_set.version == 3 else set()
    ours = data_files | tables | {root / name for name in (INFO, _STATS, _EACH_STATS)}
    with writing_to(folder):
        for path in _files(root):
            if path not in ours:
                _put(path, folder / path.relative_to(root))
    for path in sorted(data_files):
        _write_data(data_set, path, folder / path.relative_to(root), features)
    info = dict(data_set.info)
    info["features"] = {**info["features"], **{one.name: _description(one) for one in features}}
    _write_text(folder / INFO, json.dumps(info, indent=4, ensure_ascii=False))
    _write_statistics(data_set, folder, features, tables)


def statistics(values: NDArray[Any], quantiles: bool = False) -> dict[str, list[Any]]:
    """LeRobot's statistics of a feature, (length, k) or (length,): lists of k."""
    flat = values.reshape(len(values), -1)
    numbers = flat.astype(np.float64)
    found: dict[str, list[Any]] = {
        "min": flat.min(axis=0).tolist(),
        "max": flat.max(axis=0).tolist(),
        "mean": numbers.mean(axis=0).tolist(),
        "std": numbers.std(axis=0).tolist(),
        "count": [len(flat)],
    }
    if quantiles:
        for name, share in _QUANTILES.items():
            found[name] = np.quantile(numbers, share, axis=0).tolist()
    return found


def _files(folder: Path) -> Iterator[Path]:
    """All files below a folder that are not hidden."""
    for entry in sorted(os.scandir(folder), key=lambda entry: entry.name):
        if entry.name.startswith("."):
            continue
        if entry.is_dir(follow_symlinks=False):
            yield from _files(folder / entry.name)
        elif entry.is_file():
            yield folder / entry.name


def _put(source: Path, target: Path) -> None:
    about_to_read(source)
    target.parent.mkdir(parents=True, exist_ok=True)
    if source.stat().st_size >= _LINKED:
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
    return {"dtype": feature.dtype, "shape": [len(feature.names)], "names": [*feature.names]}


def _write_data(data_set: DataSet, source: Path, target: Path, features: list[NewFeature]) -> None:
    episodes = [one for one in data_set.episodes if one.file == source]
    about_to_read(source)
    try:
        with pq.ParquetFile(source) as file:
            schema = _with_features(file.schema_arrow, features)
            count = file.metadata.num_rows
            columns = []
            for feature in features:
                first = next(iter(feature.frames.values()))
                whole = np.zeros((count, *first.shape[1:]), first.dtype)
                for one in episodes:
                    part = feature.frames[one.index][: max(0, count - one.begin)]
                    whole[one.begin : one.begin + len(part)] = part
                columns.append(whole)
            with writing_to(target):
                target.parent.mkdir(parents=True, exist_ok=True)
                begin = 0
                with pq.ParquetWriter(target, schema, compression="snappy") as writer:
                    for group in range(file.num_row_groups):
                        table = file.read_row_group(group)
                        rows = slice(begin, begin + table.num_rows)
                        for feature, values in zip(features, columns, strict=True):
                            kind = schema.field(feature.name).type
                            table = _appended(table, feature.name, values[rows], kind)
                        writer.write_table(table.select(schema.names).cast(schema))
                        begin += table.num_rows
    except (pa.ArrowException, OSError) as error:
        problem = f"is damaged ({error})"
        raise InputError(source, "", problem, "copy the data set again") from error


def _appended(table: pa.Table, name: str, values: NDArray[Any], kind: pa.DataType) -> pa.Table:
    if name in table.column_names:
        table = table.drop_columns([name])
    return table.append_column(pa.field(name, kind), pa.array(list(values), kind))


def _with_features(schema: pa.Schema, features: list[NewFeature]) -> pa.Schema:
    """The schema of a data file with the features, as the file has its own lists."""
    lists = [field for field in schema if pa.types.is_fixed_size_list(field.type)]
    plain = [field for field in schema if pa.types.is_list(field.type)]
    for feature in features:
        first = next(iter(feature.frames.values()))
        kind: pa.DataType = pa.from_numpy_dtype(first.dtype)
        if first.ndim > 1:
            kind = pa.list_(kind) if plain and not lists else pa.list_(kind, first.shape[1])
        if feature.name in schema.names:
            schema = schema.remove(schema.names.index(feature.name))
        schema = schema.append(pa.field(feature.name, kind))
    return schema.with_metadata(_hf_metadata(schema.metadata, features))


def _hf_metadata(
    metadata: Mapping[bytes, bytes] | None, features: list[NewFeature]
) -> dict[bytes, bytes] | None:
    """What `datasets` keeps of a file's features, with the new ones; without it, it reads types."""
    if not metadata:
        return None
    kept = dict(metadata)
    try:
        held = json.loads(kept.pop(_HF))
        known = held["info"]["features"]
        example = next(one for one in known.values() if isinstance(one.get("feature"), dict))
        for feature in features:
            value = {"dtype": feature.dtype, "_type": "Value"}
            entry: dict[str, Any] = value
            if next(iter(feature.frames.values())).ndim > 1:
                entry = copy.deepcopy(example) | {"feature": value}
                if "length" in example:
                    entry["length"] = len(feature.names)
            known[feature.name] = entry
    except (KeyError, ValueError, TypeError, AttributeError, StopIteration):
        return kept
    return kept | {_HF: json.dumps(held).encode()}


def _write_statistics(
    data_set: DataSet, folder: Path, features: list[NewFeature], tables: set[Path]
) -> None:
    root = data_set.root
    path = root / _STATS
    if path.is_file():
        try:
            held = json.loads(read_limited(path, _LARGEST_META, "statistics"))
        except ValueError as error:
            raise InputError(path, "", f"is no JSON ({error})", "copy it again") from error
        more = any(isinstance(one, dict) and "q50" in one for one in held.values())
        for feature in features:
            values = np.concatenate([feature.frames[one.index] for one in data_set.episodes])
            held[feature.name] = statistics(values, more)
        _write_text(folder / _STATS, json.dumps(held, indent=4))
    path = root / _EACH_STATS
    if path.is_file():
        rows = json_lines(path)
        for row in rows:
            for feature in features:
                frames = feature.frames.get(row.get("episode_index", -1))
                if frames is not None and isinstance(row.get("stats"), dict):
                    row["stats"][feature.name] = statistics(frames)
        _write_text(folder / _EACH_STATS, "\n".join(json.dumps(row) for row in rows))
    for path in sorted(tables):
        _write_episodes(path, folder / path.relative_to(root), features)


def _write_episodes(source: Path, target: Path, features: list[NewFeature]) -> None:
    """A file of v3's table of episodes, with the statistics of each."""
    about_to_read(source)
    try:
        with pq.ParquetFile(source) as file:
            table = file.read()
        with_statistics = any(name.startswith("stats/") for name in table.column_names)
        more = any(name.endswith("/q50") for name in table.column_names)
        indices = table.column("episode_index").to_pylist()
        for feature in features if with_statistics else ():
            rows = [statistics(feature.frames[index], more) for index in indices]
            for key in rows[0] if rows else ():
                name = f"stats/{feature.name}/{key}"
                if name in table.column_names:
                    table = table.drop_columns([name])
                table = table.append_column(name, pa.array([row[key] for row in rows]))
        with writing_to(target):
            target.parent.mkdir(parents=True, exist_ok=True)
            pq.write_table(table, target, compression="snappy")
    except (pa.ArrowException, OSError, KeyError) as error:
        problem = f"is damaged ({error})"
        raise InputError(source, "", problem, "copy the data set again") from error
