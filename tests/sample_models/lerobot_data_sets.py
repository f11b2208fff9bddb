"""Data sets as LeRobot 0.3.3 (v2.1) and 0.4.4 (v3.0) write them, out of arrays."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

INDICES = ("timestamp", "frame_index", "episode_index", "index", "task_index")
_EPISODES_A_FILE = 20  # of v3, which ends a file by its size


def write_data_set(
    root: Path,
    version: str,
    episodes: Sequence[Mapping[str, np.ndarray]],
    fps: float,
    names: Mapping[str, Any] | None = None,
    with_statistics: bool = True,
    robot_type: str = "arm",
) -> Path:
    """Writes a data set and returns its folder.

    Args:
        version: v2.1 or v3.0.
        episodes: features (T, k) or (T,) of each.
        names: of the entries of a feature, as info.json has them.
    """
    features: dict[str, Any] = {}
    for name, values in episodes[0].items():
        shape = [values.shape[1] if values.ndim > 1 else 1]
        entry_names = (names or {}).get(name)
        features[name] = {"dtype": "float32", "shape": shape, "names": entry_names}
    features["timestamp"] = {"dtype": "float32", "shape": [1], "names": None}
    for name in INDICES[1:]:
        features[name] = {"dtype": "int64", "shape": [1], "names": None}
    tables, rows, statistics = [], [], []
    begin = 0
    for e, frames in enumerate(episodes):
        count = len(next(iter(frames.values())))
        k = np.arange(count)
        columns = {n: np.asarray(x, np.float32) for n, x in frames.items()} | {
            "timestamp": (k / fps).astype(np.float32),
            "frame_index": k,
            "episode_index": np.full(count, e),
            "index": begin + k,
            "task_index": np.zeros(count, int),
        }
        tables.append(_table(columns, "Sequence" if version == "v2.1" else "List"))
        statistics.append({n: _statistics(x) for n, x in columns.items()})
        rows.append({"episode_index": e, "tasks": ["move"], "length": count})
        begin += count
    info = {
        "codebase_version": version,
        "robot_type": robot_type,
        "total_episodes": len(episodes),
        "total_frames": begin,
        "total_tasks": 1,
        "chunks_size": 1000,
        "fps": fps,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
        if version == "v2.1"
        else "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": features,
    }
    (root / "meta").mkdir(parents=True)
    (root / "data" / "chunk-000").mkdir(parents=True)
    write = _write_v2 if version == "v2.1" else _write_v3
    write(root, info, tables, rows, statistics if with_statistics else [])
    (root / "meta" / "info.json").write_text(json.dumps(info, indent=4))
    return root


def _write_v2(root: Path, info: Any, tables: Any, rows: Any, statistics: Any) -> None:
    info |= {"total_videos": 0, "total_chunks": 1}
    for e, table in enumerate(tables):
        pq.write_table(table, root / f"data/chunk-000/episode_{e:06d}.parquet")
    _lines(root / "meta/episodes.jsonl", rows)
    _lines(root / "meta/tasks.jsonl", [{"task_index": 0, "task": "move"}])
    if statistics:
        each = [{"episode_index": e, "stats": s} for e, s in enumerate(statistics)]
        _lines(root / "meta/episodes_stats.jsonl", each)


def _write_v3(root: Path, info: Any, tables: Any, rows: Any, statistics: Any) -> None:
    info |= {"data_files_size_in_mb": 100, "video_files_size_in_mb": 200}
    begin = 0
    for e, row in enumerate(rows):
        place = {"data/chunk_index": 0, "data/file_index": e // _EPISODES_A_FILE}
        row |= place | {"dataset_from_index": begin, "dataset_to_index": begin + row["length"]}
        begin += row["length"]
        if statistics:
            row |= {f"stats/{n}/{k}": v for n, s in statistics[e].items() for k, v in s.items()}
        row |= {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
    for first in range(0, len(tables), _EPISODES_A_FILE):
        path = root / f"data/chunk-000/file-{first // _EPISODES_A_FILE:03d}.parquet"
        with pq.ParquetWriter(path, tables[0].schema) as writer:
            for table in tables[first : first + _EPISODES_A_FILE]:
                writer.write_table(table)
    (root / "meta/episodes/chunk-000").mkdir(parents=True)
    pq.write_table(pa.Table.from_pylist(rows), root / "meta/episodes/chunk-000/file-000.parquet")
    numbers = {"name": "task_index", "field_name": "task_index", "pandas_type": "int64",
               "numpy_type": "int64", "metadata": None}  # fmt: skip
    words = {"name": None, "field_name": "__index_level_0__", "pandas_type": "unicode",
             "numpy_type": "object", "metadata": None}  # fmt: skip
    index = {"index_columns": ["__index_level_0__"], "columns": [numbers, words],
             "column_indexes": [{"name": None, "field_name": None, "pandas_type": "unicode",
                                 "numpy_type": "object", "metadata": None}],
             "pandas_version": "2.3.3"}  # fmt: skip
    tasks = pa.table({"task_index": [0], "__index_level_0__": ["move"]})
    tasks = tasks.replace_schema_metadata({"pandas": json.dumps(index)})
    pq.write_table(tasks, root / "meta/tasks.parquet")
    if statistics:
        whole = {}
        for name in statistics[0]:
            low = np.min([s[name]["min"] for s in statistics], axis=0)
            high = np.max([s[name]["max"] for s in statistics], axis=0)
            mean = np.mean([s[name]["mean"] for s in statistics], axis=0)
            whole[name] = {"min": low.tolist(), "max": high.tolist(), "mean": mean.tolist(),
                           "std": np.ones_like(mean).tolist(), "count": [begin]}  # fmt: skip
        (root / "meta/stats.json").write_text(json.dumps(whole, indent=4))


def _table(columns: Mapping[str, np.ndarray], kept_as: str) -> pa.Table:
    arrays, shapes = {}, {}
    for name, values in columns.items():
        kind = pa.from_numpy_dtype(values.dtype)
        value = {"dtype": str(values.dtype), "_type": "Value"}
        if values.ndim > 1:
            listed = pa.list_(kind, values.shape[1])
            flat = pa.array(values.ravel())
            arrays[name] = pa.FixedSizeListArray.from_arrays(flat, type=listed)
            shapes[name] = {"feature": value, "length": values.shape[1], "_type": kept_as}
        else:
            arrays[name] = pa.array(values)
            shapes[name] = value
    metadata = {"huggingface": json.dumps({"info": {"features": shapes}})}
    return pa.table(arrays).replace_schema_metadata(metadata)


def _statistics(values: np.ndarray) -> dict[str, Any]:
    flat = values.reshape(len(values), -1)
    statistics = {"min": flat.min(axis=0), "max": flat.max(axis=0), "mean": flat.mean(axis=0)}
    statistics["std"] = flat.std(axis=0)
    return {name: x.tolist() for name, x in statistics.items()} | {"count": [len(flat)]}


def _lines(path: Path, rows: Any) -> None:
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
