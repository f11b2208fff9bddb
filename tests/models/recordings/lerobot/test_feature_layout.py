"""Which features of a LeRobot data set hold the joints' signals, and what is said of them."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from lerobot_data_sets import write_data_set

from wrenchsight.models.recordings.layouts.header_layouts import KnownLayout
from wrenchsight.models.recordings.lerobot.data_set import load_data_set
from wrenchsight.models.recordings.lerobot.feature_layout import feature_layout
from wrenchsight.models.recordings.recording_format import LogHeader, resolve_layout

FPS = 50
JOINTS = ("shoulder", "elbow", "wrist")
NAMED = {"observation.state": ["wrist", "shoulder", "elbow"]}


def layout(
    root: Path,
    frames: Mapping[str, np.ndarray],
    names: Mapping[str, Sequence[str]],
    prismatic: Sequence[bool] | None = None,
    angle: str = "",
) -> tuple[KnownLayout, list[str]]:
    """The layout of a data set with these features, and the names of its columns."""
    write_data_set(root, "v3.0", [frames], FPS, names)
    columns = [f"{name}.{k + 1}" for name, x in frames.items() for k in range(x.shape[1])]
    columns.append("timestamp")
    return feature_layout(load_data_set(root), columns, JOINTS, prismatic, angle), columns


def numbers(count: int = 3, largest: float = 1.0) -> np.ndarray:
    return np.linspace(-largest, largest, 20 * count).reshape(20, count)


def test_an_order_that_is_assumed_of_one_quantity_alone_is_said(tmp_path: Path) -> None:
    frames = {"observation.state": numbers(), "observation.effort": numbers()}
    found, _ = layout(tmp_path / "set", frames, NAMED)
    assert found.form.position is not None
    assert found.form.position.columns == "2, 3, 1"
    order = "motor torque: joints are taken in the data set's order: 1, 2, 3"
    assert order in found.notices


def test_an_order_that_is_assumed_of_all_quantities_is_said_once(tmp_path: Path) -> None:
    frames = {"observation.state": numbers(), "observation.effort": numbers()}
    found, _ = layout(tmp_path / "set", frames, {})
    assert len([text for text in found.notices if "order" in text]) == 1


def test_entries_of_a_sensor_beside_numbered_joints_are_no_joints(tmp_path: Path) -> None:
    names = [f"joint_{word}.{k}" for word in ("positions", "efforts") for k in range(3)]
    names += [f"sensor_offset.torque.{axis}" for axis in "xyz"]
    found, _ = layout(
        tmp_path / "set", {"observation.state": numbers(9)}, {"observation.state": names}
    )
    assert found.form.motor_torque is not None
    assert found.form.motor_torque.columns == "4, 5, 6"


def test_a_current_beside_a_torque_is_neither_read_nor_said_to_be(tmp_path: Path) -> None:
    frames = {f"observation.{name}": numbers() for name in ("state", "effort", "current")}
    found, _ = layout(tmp_path / "set", frames, {})
    assert found.form.current is None
    assert found.notices[0].endswith("motor torque from observation.effort")


@pytest.mark.parametrize(
    ("feature", "names", "is_effort"),
    [
        ("observation.effort", None, True),
        ("joint_efforts", None, True),
        ("observation.torque", ["shoulder.effort", "elbow.effort", "wrist.effort"], True),
        ("observation.torque", None, False),
        ("observation.coefficient.torque", None, False),
        ("observation.torque", ["jeff_1", "jeff_2", "jeff_3"], False),
    ],
)
def test_an_effort_is_told_from_a_torque_by_whole_words(
    tmp_path: Path, feature: str, names: list[str] | None, is_effort: bool
) -> None:
    frames = {"observation.state": numbers(), feature: numbers()}
    found, _ = layout(tmp_path / "set", frames, {feature: names} if names else {})
    assert found.form.motor_torque is not None
    assert found.torque_is_effort == is_effort


@pytest.mark.parametrize("angle", ["", "deg"])
def test_joints_that_slide_stay_in_metres_beside_degrees(tmp_path: Path, angle: str) -> None:
    frames = {
        "observation.state": numbers(largest=150.0),
        "observation.velocity": numbers(),
        "observation.effort": numbers(),
    }
    prismatic = [False, True, False]
    found, columns = layout(tmp_path / "set", frames, {}, prismatic, angle)
    signals = resolve_layout(found.form, "set", LogHeader(tmp_path, columns, len(columns)))
    for name in ("q", "v"):
        signal = signals.signal(name)
        assert signal is not None
        scale = [np.pi / 180.0, 1.0, np.pi / 180.0]
        np.testing.assert_allclose(signal.scale, scale, rtol=1e-15)  # some roundings
    assert any("in degrees" in text or "in deg," in text for text in found.notices)
    assert any("of joints that slide in m" in text for text in found.notices)
