"""A copy with more features keeps the rules of LeRobot's layout.

Copies of both versions were opened by LeRobot's loader (0.3.3 and 0.4.4), with these features.
"""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from lerobot_data_sets import write_data_set

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.lerobot.data_set import Episode, load_data_set
from wrenchsight.models.recordings.lerobot.data_set_copy import NewFeature, _hf_metadata, write_copy
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


def _frames(episode: Episode) -> tuple[tuple[str, ...], np.ndarray]:
    """The names of an episode's columns, and its frames (length, k)."""
    table = ParquetTable(episode.file, episode.rows)
    assert table.names is not None
    blocks = [values for values, _ in table.blocks(list(range(table.num_columns)))]
    return table.names, np.concatenate(blocks)


def test_every_frame_has_the_features(root: Path, features: list[NewFeature]) -> None:
    folder = root.parent / "copy"
    original = load_data_set(root)
    write_copy(original, folder, features)
    copied = load_data_set(folder)
    assert [episode.length for episode in copied.episodes] == list(_LENGTHS)
    for episode, original_episode in zip(copied.episodes, original.episodes, strict=True):
        names, values = _frames(episode)
        original_names, original_values = _frames(original_episode)
        width = len(original_names)
        assert names[:width] == original_names
        np.testing.assert_array_equal(values[:, :width], original_values)
        added = values[:, width:]
        np.testing.assert_array_equal(added[:, :6], features[0].frames[episode.index])
        np.testing.assert_array_equal(added[:, 6], features[1].frames[episode.index])


def test_numbers_are_described_in_a_file_without_a_list(features: list[NewFeature]) -> None:
    """Only a new list needs one of the file's as an example."""
    number = {"dtype": "float32", "_type": "Value"}
    metadata = {b"huggingface": json.dumps({"info": {"features": {"speed": number}}}).encode()}
    copied = _hf_metadata(metadata, features[1:])
    assert copied is not None
    described = json.loads(copied[b"huggingface"])["info"]["features"]
    assert described["observation.wrench_valid"] == {"dtype": "bool", "_type": "Value"}
    assert _hf_metadata(metadata, features) == {}  # a list, and no example: left to `datasets`


def test_the_copy_follows_the_rules_of_the_layout(
    root: Path, features: list[NewFeature], version: str
) -> None:
    """info.json, Arrow types, the metadata of `datasets` and statistics name the same features."""
    copied = root.parent / "copy"
    write_copy(load_data_set(root), copied, features)
    info = json.loads((copied / "meta/info.json").read_text())
    original_info = json.loads((root / "meta/info.json").read_text())
    assert {k: v for k, v in info.items() if k != "features"} == {
        k: v for k, v in original_info.items() if k != "features"
    }
    assert info["features"]["observation.wrench"] == {
        "dtype": "float32", "shape": [6], "names": list(_AXES)}  # fmt: skip
    assert info["features"]["observation.wrench_valid"] == {
        "dtype": "bool", "shape": [1], "names": ["valid"]}  # fmt: skip
    for path in sorted(copied.glob("data/*/*.parquet")):
        original_file = pq.ParquetFile(root / path.relative_to(copied))
        file = pq.ParquetFile(path)
        assert file.num_row_groups == original_file.num_row_groups
        assert set(file.schema_arrow.names) == info["features"].keys()
        described = json.loads(file.schema_arrow.metadata[b"huggingface"])["info"]["features"]
        assert described.keys() == info["features"].keys()
        assert described["observation.wrench"] == described["observation.state"] | {"length": 6}
        assert described["observation.wrench_valid"] == {"dtype": "bool", "_type": "Value"}
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
        total = json.loads((copied / "meta/stats.json").read_text())
        frames = np.concatenate(list(wrench.values()))
        np.testing.assert_allclose(total["observation.wrench"]["std"], frames.std(0), rtol=1e-5)
        assert total.keys() == info["features"].keys()
    assert len(stats) == 3
    for e, of_episode in enumerate(stats):
        assert of_episode.keys() == info["features"].keys()
        wrench_stats = of_episode["observation.wrench"]
        np.testing.assert_allclose(wrench_stats["mean"], wrench[e].mean(0), rtol=1e-4)
        np.testing.assert_allclose(wrench_stats["min"], wrench[e].min(0))
        assert wrench_stats["count"] == [_LENGTHS[e]]
        assert len(of_episode["observation.wrench_valid"]["max"]) == 1


def test_other_files_are_linked_or_copied(root: Path, features: list[NewFeature]) -> None:
    copied = root.parent / "copy"
    write_copy(load_data_set(root), copied, features)
    assert (copied / "videos/chunk-000/small.mp4").read_bytes() == b"small"
    large = copied / "videos/chunk-000/large.mp4"
    assert large.samefile(root / "videos/chunk-000/large.mp4")  # a link: the same disk
    assert not (copied / ".cache").exists()
    names = {p.relative_to(root) for p in root.rglob("*") if p.is_file()}
    assert {p.relative_to(copied) for p in copied.rglob("*") if p.is_file()} == names


def test_a_copy_of_a_copy_replaces_the_features(root: Path, features: list[NewFeature]) -> None:
    copied, copied_again = root.parent / "copy", root.parent / "again"
    write_copy(load_data_set(root), copied, features)
    doubled = {e: 2.0 * x for e, x in features[0].frames.items()}
    replaced = [NewFeature(features[0].name, _AXES, doubled)]
    write_copy(load_data_set(copied), copied_again, replaced)
    names, values = _frames(load_data_set(copied_again).episodes[1])
    assert names.count("observation.wrench.1") == 1
    column = names.index("observation.wrench.1")
    np.testing.assert_array_equal(values[:, column], doubled[1][:, 0])


def test_damaged_frames_are_no_fault_of_the_copy(root: Path, features: list[NewFeature]) -> None:
    data_set = load_data_set(root)
    file = data_set.episodes[0].file
    content = bytearray(file.read_bytes())
    content[4:84] = bytes([255] * 80)  # the first page's head; the description at the end stays
    file.write_bytes(content)
    with pytest.raises(InputError, match=f"{file.name}: is damaged"):
        write_copy(data_set, root.parent / "copy", features)
