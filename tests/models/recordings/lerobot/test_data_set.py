"""LeRobot's data sets as logs: layout, names, units, episodes."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lerobot_data_sets import write_data_set

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.episodes_reader import EpisodesReader
from wrenchsight.models.recordings.lerobot.data_set import (
    episode_paths,
    file_of,
    load_data_set,
    root_of,
)
from wrenchsight.models.recordings.recording_reader import RecordingReader, read_recording
from wrenchsight.models.recordings.resampling import resample_chunks
from wrenchsight.models.robot.robot import Robot

VERSIONS = ("v2.1", "v3.0")
FPS = 50


def _episode(robot: Robot, seed: int, rows: int = 60) -> dict[str, np.ndarray]:
    t = np.arange(rows) / FPS
    rng = np.random.default_rng(seed)
    phase = np.outer(t, rng.uniform(0.5, 1.5, robot.num_joints)) + seed
    q = robot.home + 0.2 * np.sin(phase)
    tau = np.asarray(robot.chain.gravity_torque(q))
    return {"observation.state": q, "observation.effort": tau}


@pytest.fixture
def episodes(ur10e: Robot) -> list[dict[str, np.ndarray]]:
    return [_episode(ur10e, seed, 60 + seed) for seed in range(3)]


@pytest.mark.parametrize("version", VERSIONS)
def test_episodes_are_logs(
    tmp_path: Path, ur10e: Robot, version: str, episodes: list[dict[str, np.ndarray]]
) -> None:
    root = write_data_set(tmp_path / "set", version, episodes, FPS)
    paths = episode_paths(root)
    assert [path.name for path in paths] == [f"episode_{e:06d}" for e in range(3)]
    for path, frames in zip(paths, episodes, strict=True):
        log = read_recording(path, robot=ur10e)
        np.testing.assert_allclose(log.q, frames["observation.state"], atol=1e-6)
        assert log.tau_J is not None
        np.testing.assert_allclose(log.tau_J, frames["observation.effort"], rtol=1e-6, atol=1e-5)
        np.testing.assert_allclose(np.diff(log.t), 1 / FPS, atol=1e-5)
        assert file_of(path).is_file()
        inner = slice(10, -10)
        rate = np.gradient(frames["observation.state"], log.t, axis=0)
        np.testing.assert_allclose(log.v[inner], rate[inner], atol=2e-3)
    if version == "v2.1":  # the file of an episode is the same log, with the names of info.json
        episode_file = root / "data/chunk-000/episode_000002.parquet"
        assert root_of(episode_file) == root.resolve()
        assert read_recording(episode_file, robot=ur10e).num_samples == 62
    with pytest.raises(InputError, match=r"data set of 3 episodes.*name one, such as .*episode_0"):
        read_recording(root, robot=ur10e)
    with pytest.raises(InputError, match="episode 7: has the episodes 0 to 2"):
        read_recording(root / "episode_000007", robot=ur10e)


@pytest.mark.parametrize("version", VERSIONS)
def test_all_episodes_are_one_log_with_breaks(
    tmp_path: Path, ur10e: Robot, version: str, episodes: list[dict[str, np.ndarray]]
) -> None:
    root = write_data_set(tmp_path / "set", version, episodes, FPS)
    reader = EpisodesReader(
        [lambda path=path: RecordingReader(path, robot=ur10e) for path in episode_paths(root)]
    )
    chunks = list(resample_chunks(reader.chunks()))
    t = np.concatenate([chunk.t for chunk in chunks])
    rows = np.concatenate([chunk.row for chunk in chunks])  # type: ignore[misc]
    q = np.concatenate([chunk.q for chunk in chunks])
    np.testing.assert_allclose(np.diff(t), 1 / FPS, rtol=1e-2)
    is_measured = rows > 0
    assert rows[is_measured].tolist() == list(range(1, 60 + 61 + 62 + 1))
    all_positions = np.concatenate([frames["observation.state"] for frames in episodes])
    np.testing.assert_allclose(q[is_measured], all_positions, atol=1e-5)
    assert np.isnan(q[~is_measured]).all()
    borders = np.flatnonzero(np.diff(is_measured.astype(int)))
    assert len(borders) == 4  # two breaks of half a second
    assert (~is_measured).sum() == pytest.approx(2 * 0.5 * FPS, abs=4)
    assert len([text for text in reader.notices if "effort is read" in text]) == 1


_NAMES: dict[str, tuple[dict[str, Any], str]] = {
    "a list of joints": ({"observation.state": ["{}.pos"], "observation.effort": ["{}"]}, ""),
    "motors": ({"observation.state": {"motors": ["{}"]}, "observation.effort": None}, ""),
    "other words": ({"observation.state": ["joint{k}"], "observation.effort": None}, "order"),
    "no names": ({}, "order"),
}


@pytest.mark.parametrize("case", _NAMES)
def test_joints_are_matched_by_name_else_by_order(
    tmp_path: Path, ur10e: Robot, case: str, episodes: list[dict[str, np.ndarray]]
) -> None:
    """Joints with names stand in another order than the robot's."""
    patterns, note = _NAMES[case]
    order = list(range(6)) if note else [5, 3, 4, 1, 2, 0]
    names: dict[str, Any] = {}
    frames = dict(episodes[0])
    for feature, pattern in patterns.items():
        words = next(iter(pattern.values())) if isinstance(pattern, dict) else pattern
        if words is None:
            continue
        entry_names = [words[0].format(ur10e.joint_names[j], k=j + 1) for j in order]
        names[feature] = {"motors": entry_names} if isinstance(pattern, dict) else entry_names
    for feature in frames:
        if feature in names:
            frames[feature] = frames[feature][:, order]
    root = write_data_set(tmp_path / "set", "v2.1", [frames], FPS, names)
    log = read_recording(root, robot=ur10e)
    np.testing.assert_allclose(log.q, episodes[0]["observation.state"], atol=1e-6)
    order = "joints are taken in the data set's order"  # of the positions
    assert any(text.startswith(order) for text in log.notices) == bool(note)


@pytest.mark.parametrize("name", ["joint{}.effort", "joint_efforts.{}", "observation.effort.j{}"])
def test_each_joint_may_be_a_feature(
    tmp_path: Path, ur10e: Robot, name: str, episodes: list[dict[str, np.ndarray]]
) -> None:
    frames = dict(episodes[0])
    effort = frames.pop("observation.effort")
    frames |= {name.format(j): effort[:, j] for j in range(6)}
    frames["gripper.effort"] = effort[:, 0]
    frames["action.joint_effort"] = effort
    root = write_data_set(tmp_path / "set", "v3.0", [frames], FPS)
    log = read_recording(root, robot=ur10e)
    assert log.tau_J is not None
    np.testing.assert_allclose(log.tau_J, effort, rtol=1e-5, atol=1e-5)


def test_the_gripper_is_left_out(
    tmp_path: Path, ur10e: Robot, episodes: list[dict[str, np.ndarray]]
) -> None:
    frames = {name: np.c_[x, 0.5 * x[:, 0]] for name, x in episodes[0].items()}
    words = [f"j{k}" for k in range(6)] + ["gripper"]
    for names, note in ((dict.fromkeys(frames, words), "order: j_0, j_1"), ({}, "as the gripper")):
        root = write_data_set(tmp_path / f"set{len(names)}", "v2.1", [frames], FPS, names)
        log = read_recording(root, robot=ur10e)
        np.testing.assert_allclose(log.q, episodes[0]["observation.state"], atol=1e-6)
        assert note in " ".join(log.notices)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"observation.state": "gone"}, "no feature holds the joints' positions"),
        ({"observation.state": "tcp"}, "no feature holds the joints' positions"),
        ({"observation.state": "eight"}, "hold 8 joints, the robot has 6"),
        ({"observation.effort": "gone"}, "holds no motor currents"),
        (
            {"observation.effort": "load"},
            "present_load is not read: a servo's duty cycle",
        ),
        (
            {"observation.effort": "goal"},
            "goal_current.1 is not read: a commanded value",
        ),
    ],
)
def test_a_data_set_without_positions_or_torque_is_refused(
    tmp_path: Path,
    ur10e: Robot,
    episodes: list[dict[str, np.ndarray]],
    changed: dict[str, str],
    words: str,
) -> None:
    frames = dict(episodes[0])
    names: dict[str, Any] = {}
    for feature, change in changed.items():
        x = frames.pop(feature)
        if change == "load":
            frames["observation.present_load"] = x
        if change == "goal":
            frames["observation.goal_current"] = x
        if change == "eight":
            frames[feature] = np.c_[x, x[:, :2]]
        if change == "tcp":
            frames[feature] = x
            names[feature] = ["x", "y", "z", "roll", "pitch", "yaw"]
    root = write_data_set(tmp_path / "set", "v3.0", [frames], FPS, names)
    with pytest.raises(InputError, match=words):
        read_recording(root, robot=ur10e, joint_signals=True)


def test_the_unit_of_positions_is_decided_by_their_size(
    tmp_path: Path, ur10e: Robot, episodes: list[dict[str, np.ndarray]]
) -> None:
    """Up to 4 pi they are radians, beyond 100 degrees; in between the user must state it."""
    q = episodes[0]["observation.state"]
    q = q * 1.9 / np.abs(q).max()
    degrees = episodes[0] | {"observation.state": np.degrees(q)}
    root = write_data_set(tmp_path / "deg", "v3.0", [degrees], FPS)
    log = read_recording(root, robot=ur10e)
    np.testing.assert_allclose(log.q, q, atol=1e-5)
    assert any("read in degrees" in text for text in log.notices)
    small = episodes[0] | {"observation.state": np.degrees(q) * 0.9}
    root = write_data_set(tmp_path / "set", "v2.1", [small], FPS, robot_type="so101_follower")
    with pytest.raises(InputError, match=r"reach 98: degrees, or .*normalised .*\(so101_follower"):
        read_recording(root, robot=ur10e)
    log = read_recording(root, "positions-in-degrees", ur10e, check=False)
    np.testing.assert_allclose(log.q, np.radians(small["observation.state"]), atol=1e-5)


@pytest.mark.parametrize(
    ("file", "change", "words"),
    [
        ("meta/info.json", b"{", "is no JSON"),
        ("meta/info.json", b'{"codebase_version": "v9.0"}', "codebase_version: is 'v9.0', expec"),
        ("meta/info.json", b'{"codebase_version": "v2.1", "fps": -3}', "fps: is -3"),
        ("meta/episodes.jsonl", b"[]", "expected an object"),
        ("meta/episodes.jsonl", b"", "is missing or empty, but meta/info.json has"),
        ("data/chunk-000/episode_000000.parquet", b"PAR1", "damaged Parquet"),
    ],
)
def test_damage_is_refused_in_one_line(
    tmp_path: Path,
    episodes: list[dict[str, np.ndarray]],
    file: str,
    change: bytes,
    words: str,
) -> None:
    root = write_data_set(tmp_path / "set", "v2.1", episodes[:1], FPS)
    (root / file).write_bytes(change)
    with pytest.raises(InputError, match=words) as caught:
        read_recording(root / "episode_000000")
    assert "\n" not in str(caught.value)


def test_a_huge_stated_shape_allocates_nothing(
    tmp_path: Path, ur10e: Robot, episodes: list[dict[str, np.ndarray]]
) -> None:
    """The columns are those of the tables, whatever the shape in info.json."""
    root = write_data_set(tmp_path / "set", "v2.1", episodes[:1], FPS)
    info = json.loads((root / "meta/info.json").read_text())
    info["features"]["observation.state"]["shape"] = [1 << 63]
    (root / "meta/info.json").write_text(json.dumps(info))
    log = read_recording(root, robot=ur10e)
    np.testing.assert_allclose(log.q, episodes[0]["observation.state"], atol=1e-6)


@pytest.mark.parametrize(
    "pattern",
    ["/etc/passwd", "../{episode_index}", "{0.__class__}", "{episode_index:09999999999d}", 7],
)
def test_a_data_path_outside_the_data_set_is_refused(
    tmp_path: Path, episodes: list[dict[str, np.ndarray]], pattern: object
) -> None:
    root = write_data_set(tmp_path / "set", "v2.1", episodes[:1], FPS)
    info = json.loads((root / "meta/info.json").read_text())
    (root / "meta/info.json").write_text(json.dumps(info | {"data_path": pattern}))
    with pytest.raises(InputError, match="expected a path below the data set's folder"):
        load_data_set(root)


def test_a_data_path_with_a_zero_byte_is_refused(
    tmp_path: Path, episodes: list[dict[str, np.ndarray]]
) -> None:
    root = write_data_set(tmp_path / "set", "v2.1", episodes[:1], FPS)
    info = json.loads((root / "meta/info.json").read_text())
    (root / "meta/info.json").write_text(json.dumps(info | {"data_path": "a\0b.parquet"}))
    with pytest.raises(InputError, match="cannot be read"):
        read_recording(root / "episode_000000")
