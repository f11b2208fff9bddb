"""Logs of other programs are recognised by their columns; joints are put in the robot's order."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.recording_reader import read_recording

_ROWS = 30
_ROBOT = SimpleNamespace(
    has_inertias=False,
    is_coupled=False,
    name="two",
    num_joints=2,
    joint_names=("shoulder", "elbow"),
    torque_per_ampere=np.array([10.0, 4.0]),
    current_sign=np.ones(2),
    motor_current=lambda tau_J: tau_J / [10.0, 4.0],
    q_offset=np.zeros(2),
    velocity_limit=np.full(2, np.inf),
    position_lower=np.full(2, -np.inf),
    position_upper=np.full(2, np.inf),
    chain=SimpleNamespace(prismatic=np.zeros(2, bool)),
)


def _numbers(width: int) -> np.ndarray:
    return np.round(np.random.default_rng(4).normal(size=(_ROWS, width)), 6)


def _t() -> np.ndarray:
    return np.round(0.01 * np.arange(_ROWS), 6)


def _written(tmp_path: Path, header: str | None, rows: list[str]) -> Path:
    path = tmp_path / "log.csv"
    path.write_text("\n".join(([header] if header else []) + rows) + "\n")
    return path


def _rows(values: np.ndarray, separator: str = ",") -> list[str]:
    return [separator.join(f"{x:.6f}" for x in row) for row in values]


@pytest.mark.parametrize("separator", [",", " "])
def test_a_ur_rtde_record_is_recognised(tmp_path: Path, separator: str) -> None:
    values = _numbers(24)
    names = ["timestamp"]
    for kind in ("target_moment", "actual_q", "actual_qd", "actual_current"):
        names += [f"{kind}_{j}" for j in range(6)]
    rows = _rows(np.c_[_t(), values], separator)
    recording = read_recording(_written(tmp_path, separator.join(names), rows))
    np.testing.assert_array_equal(recording.t, _t())
    np.testing.assert_array_equal(recording.q, values[:, 6:12])
    np.testing.assert_array_equal(recording.v, values[:, 12:18])
    np.testing.assert_array_equal(recording.current, values[:, 18:])
    np.testing.assert_array_equal(recording.extra["target_moment"], values[:, :6])
    assert any("RTDE" in notice for notice in recording.notices)


_SERIES = (
    "__time,/joint_states/elbow/position,/joint_states/elbow/velocity,/joint_states/finger/position,"
    "/joint_states/shoulder/position,/joint_states/shoulder/velocity,/joint_states/elbow/effort,"
    "/joint_states/shoulder/effort"
)


def test_series_of_plotjuggler_are_read_in_the_robots_order(tmp_path: Path) -> None:
    values = _numbers(7)
    path = _written(tmp_path, _SERIES, _rows(np.c_[_t(), values]))
    recording = read_recording(path, robot=_ROBOT, check=False)  # type: ignore[arg-type]
    np.testing.assert_array_equal(recording.q, values[:, [3, 0]])
    np.testing.assert_array_equal(recording.v, values[:, [4, 1]])
    np.testing.assert_array_equal(recording.tau_J, values[:, [6, 5]])
    text = " ".join(recording.notices)
    assert "left out: finger" in text
    assert "effort is read as joint torque" in text
    other = SimpleNamespace(name="other", num_joints=1, joint_names=("wrist",))
    with pytest.raises(InputError, match=r"no topic holds the position.*wrist.*elbow"):
        read_recording(path, robot=other)  # type: ignore[arg-type]


def test_a_topic_named_for_its_effort_may_lack_a_velocity(tmp_path: Path) -> None:
    """What is missing is told by the quantity, not by a word in the topic's name."""
    topic = "/effort_controller"
    header = f"__time,{topic}/shoulder/position,{topic}/elbow/position,{topic}/elbow/velocity"
    values = _numbers(3)
    path = _written(tmp_path, header, _rows(np.c_[_t(), values]))
    recording = read_recording(path, robot=_ROBOT, check=False)  # type: ignore[arg-type]
    np.testing.assert_array_equal(recording.q, values[:, :2])
    assert any("holds no velocities" in notice for notice in recording.notices)


def test_samples_with_empty_cells_of_other_topics_are_left_out(tmp_path: Path) -> None:
    """PlotJuggler leaves cells empty where a topic has no message."""
    header = "__time,/js/shoulder/position,/js/elbow/position,/ft/wrench/force/x"
    rows = [f"{t:.3f},0.1,0.2," if k % 2 else f"{t:.3f},,,5" for k, t in enumerate(_t())]
    header = header.removesuffix(",/ft/wrench/force/x") + ",/ft/value"
    recording = read_recording(_written(tmp_path, header, rows))
    assert recording.num_samples == _ROWS // 2
    np.testing.assert_array_equal(recording.t, _t()[1::2])


def test_of_two_topics_with_positions_joint_states_is_read(tmp_path: Path) -> None:
    header = "__time,/a/shoulder/position,/a/elbow/position,/b/shoulder/position,/b/elbow/position"
    path = _written(tmp_path, header, _rows(np.c_[_t(), _numbers(4)]))
    with pytest.raises(InputError, match="2 topics hold the joints' position: /a, /b"):
        read_recording(path)
    header = header.replace("/b/", "/left/joint_states/")
    values = _numbers(4)
    path = _written(tmp_path, header, _rows(np.c_[_t(), values]))
    np.testing.assert_array_equal(read_recording(path).q, values[:, 2:])


@pytest.mark.parametrize("num_quantities", [1, 2, 3])
def test_rows_of_ros2_topic_echo_are_read(tmp_path: Path, num_quantities: int) -> None:
    values = _numbers(3 * num_quantities)
    stamps = np.round(_t() * 1e9).astype(int)
    rows = [
        f"{1_700_000_000 + s // 10**9},{s % 10**9},,elbow,finger,shoulder,{row}"
        for s, row in zip(stamps, _rows(values), strict=True)
    ]
    path = _written(tmp_path, None, rows)
    recording = read_recording(path, robot=_ROBOT, check=False)  # type: ignore[arg-type]
    np.testing.assert_array_equal(recording.t, 1_700_000_000 + _t())
    np.testing.assert_array_equal(recording.q, values[:, [2, 0]])
    if num_quantities > 1:
        np.testing.assert_array_equal(recording.v, values[:, [5, 3]])
    if num_quantities > 2:
        np.testing.assert_array_equal(recording.tau_J, values[:, [8, 6]])
    other = SimpleNamespace(name="other", num_joints=1, joint_names=("wrist",))
    with pytest.raises(InputError, match="lacks wrist; it has elbow, finger, shoulder"):
        read_recording(path, robot=other)  # type: ignore[arg-type]
