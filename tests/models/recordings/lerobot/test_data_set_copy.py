"""A copy with more features keeps the rules of LeRobot's layout.

Both versions' copies were opened in LeRobot's own loader (0.3.3 and 0.4.4), with these features.
"""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from lerobot_data_sets import write_data_set

from wrenchsight.models.recordings.lerobot.data_set import load_data_set
from wrenchsight.models.recordings.lerobot.data_set_copy import NewFeature, write_copy
from wrenchsight.models.recordings.parquet_table import ParquetTable

_LENGTHS = (12, 15, 9)
_AXES = ("fx", "fy", "fz", "mx", "my", "mz")


@pytest.fixture(params=["v2.1", "v3.0"])
def version(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def root(tmp_path: Path, version: str) -> Path:
    rng = np.random.default_rng(4)
    episodes = [{"observation.state": rng.normal(size=(n, 3))} for n in _LENGTHS]
    root = write_data_set(tmp_path / "set", version, episodes, 30)
    (root / "videos/chunk-000").mkdir(parents=True)
    (root / "videos/chunk-000/small.mp4").write_bytes(b"small")
    (root / "videos/chunk-000/large.mp4").write_bytes(bytes(1 << 20))
    (root / ".cache").mkdir()
    return root


@pytest.fixture
def features() -> list[NewFeature]:
    rng = np.random.default_rng(5)
    wrench = {e: rng.normal(size=(n, 6)).astype("f4") for e, n in enumerate(_LENGTHS)}
    valid = {e: rng.uniform(size=n) > 0.5 for e, n in enumerate(_LENGTHS)}
    return [
        NewFeature("observation.wrench", _AXES, wrench),
        NewFeature("observation.wrench_valid", ("valid",), valid),
    ]


def test_every_frame_has_the_features(root: Path, features: list[NewFeature]) -> None:
    copied = root.parent / "copy"
    before = load_data_set(root)
    write_copy(before, copied, features)
    again = load_data_set(copied)
    assert [one.length for one in again.episodes] == list(_LENGTHS)
    for one, old in zip(again.episodes, before.episodes, strict=True):
        table = ParquetTable(one.file, one.rows)
        was = ParquetTable(old.file, old.rows)
        assert table.names is not None
        assert was.names is not None
        assert table.names[: len(was.names)] == was.names
        values = np.concatenate([x for x, _ in table.blocks(list(range(table.num_columns)))])
        kept = np.concatenate([x for x, _ in was.blocks(list(range(was.num_columns)))])
        np.testing.assert_array_equal(values[:, : kept.shape[1]], kept)
        added = values[:, kept.shape[1] :]
        np.testing.assert_array_equal(added[:, :6], features[0].frames[one.index])
        np.testing.assert_array_equal(added[:, 6], features[1].frames[one.index])


def test_the_layouts_rules(root: Path, features: list[NewFeature], version: str) -> None:
    """info.json, Arrow types, what `datasets` keeps, and statistics name the same features."""
    copied = root.parent / "copy"
    write_copy(load_data_set(root), copied, features)
    info = json.loads((copied / "meta/info.json").read_text())
    was = json.loads((root / "meta/info.json").read_text())
    assert {k: v for k, v in info.items() if k != "features"} == {
        k: v for k, v in was.items() if k != "features"
    }
    assert info["features"]["observation.wrench"] == {
        "dtype": "float32", "shape": [6], "names": list(_AXES)}  # fmt: skip
    assert info["features"]["observation.wrench_valid"] == {
        "dtype": "bool", "shape": [1], "names": ["valid"]}  # fmt: skip
    for path in sorted(copied.glob("data/*/*.parquet")):
        old = pq.ParquetFile(root / path.relative_to(copied))
        file = pq.ParquetFile(path)
        assert file.num_row_groups == old.num_row_groups
        assert set(file.schema_arrow.names) == info["features"].keys()
        kept = json.loads(file.schema_arrow.metadata[b"huggingface"])["info"]["features"]
        assert kept.keys() == info["features"].keys()
        assert kept["observation.wrench"] == kept["observation.state"] | {"length": 6}
        assert kept["observation.wrench_valid"] == {"dtype": "bool", "_type": "Value"}
        assert str(file.schema_arrow.field("observation.wrench").type).startswith(
            "fixed_size_list<element: float>[6]"
        )
    wrench = features[0].frames
    if version == "v2.1":
        lines = (copied / "meta/episodes_stats.jsonl").read_text().splitlines()
        stats = [json.loads(line)["stats"] for line in lines if line]
    else:
        rows = pq.ParquetFile(copied / "meta/episodes/chunk-000/file-000.parquet").read()
        keys = ("min", "max", "mean", "std", "count")
        stats = [
            {f: {k: row[f"stats/{f}/{k}"] for k in keys} for f in info["features"]}
            for row in rows.to_pylist()
        ]
        whole = json.loads((copied / "meta/stats.json").read_text())
        together = np.concatenate(list(wrench.values()))
        np.testing.assert_allclose(whole["observation.wrench"]["std"], together.std(0), rtol=1e-5)
        assert whole.keys() == info["features"].keys()
    assert len(stats) == 3
    for e, one in enumerate(stats):
        assert one.keys() == info["features"].keys()
        np.testing.assert_allclose(one["observation.wrench"]["mean"], wrench[e].mean(0), rtol=1e-4)
        np.testing.assert_allclose(one["observation.wrench"]["min"], wrench[e].min(0))
        assert one["observation.wrench"]["count"] == [_LENGTHS[e]]
        assert len(one["observation.wrench_valid"]["max"]) == 1


def test_other_files_come_along(root: Path, features: list[NewFeature]) -> None:
    copied = root.parent / "copy"
    write_copy(load_data_set(root), copied, features)
    assert (copied / "videos/chunk-000/small.mp4").read_bytes() == b"small"
    large = copied / "videos/chunk-000/large.mp4"
    assert large.samefile(root / "videos/chunk-000/large.mp4")  # a link: the same disk
    assert not (copied / ".cache").exists()
    names = {p.relative_to(root) for p in root.rglob("*") if p.is_file()}
    assert {p.relative_to(copied) for p in copied.rglob("*") if p.is_file()} == names


def test_a_copy_of_a_copy_replaces_the_features(root: Path, features: list[NewFeature]) -> None:
    first, second = root.parent / "copy", root.parent / "again"
    write_copy(load_data_set(root), first, features)
    doubled = {e: 2.0 * x for e, x in features[0].frames.items()}
    write_copy(load_data_set(first), second, [NewFeature(features[0].name, _AXES, doubled)])
    one = load_data_set(second).episodes[1]
    table = ParquetTable(one.file, one.rows)
    assert table.names is not None
    assert table.names.count("observation.wrench.1") == 1
    column = table.names.index("observation.wrench.1")
    values = np.concatenate([x[:, 0] for x, _ in table.blocks([column])])
    np.testing.assert_array_equal(values, doubled[1][:, 0])
