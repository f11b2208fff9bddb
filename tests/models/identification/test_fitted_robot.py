"""A model that is not this robot's: which key differs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.fitted_robot import FittedRobot
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import PoseConfig, RobotConfig, ToolConfig


def changed(robot: Robot, config: RobotConfig) -> Robot:
    return Robot(config, robot.source, robot._urdf)


@pytest.fixture
def saved(sts: Robot, tmp_path: Path) -> Path:
    path = tmp_path / "model.yaml"
    replace(IdentifiedModel.nominal(sts), fitted_robot=FittedRobot.of(sts)).save(path)
    return path


def test_the_same_robot_gives_no_warning(sts: Robot, saved: Path) -> None:
    model = IdentifiedModel.load(saved, sts)
    assert model.fitted_robot == FittedRobot.of(sts)
    assert model.fitted_robot.warnings(sts) == []


def test_torque_per_ampere_doubled(sts: Robot, saved: Path) -> None:
    other = sts.with_torque_per_ampere((2.0 * sts.torque_per_ampere).tolist())
    with pytest.raises(InputError, match=r"fitted_robot\.torque_per_ampere"):
        IdentifiedModel.load(saved, other)


def test_another_robot_that_is_meant_is_read_and_its_differences_listed(
    sts: Robot, saved: Path
) -> None:
    other = sts.with_torque_per_ampere((2.0 * sts.torque_per_ampere).tolist())
    model = IdentifiedModel.load(saved, other, other_robot=True)
    differences = model.fitted_robot.differences(other)
    assert [key for key, _ in differences] == ["torque_per_ampere"] * sts.num_joints
    assert "47.47 (joint_1)" in differences[0][1] and "94.94" in differences[0][1]
    assert model.fitted_robot.differences(sts) == []


def test_current_sign_flipped(sts: Robot, saved: Path) -> None:
    drives = [replace(d, current_sign=-d.current_sign) for d in sts.config.drives]
    with pytest.raises(InputError, match=r"fitted_robot\.current_sign"):
        IdentifiedModel.load(saved, changed(sts, replace(sts.config, drives=drives)))


def test_gravity_changed(sts: Robot, saved: Path) -> None:
    other = changed(sts, replace(sts.config, gravity=[0.0, 0.0, 9.81]))
    with pytest.raises(InputError, match=r"identified with -9\.81 \(component 3\)"):
        IdentifiedModel.load(saved, other)


def test_another_tool_gives_a_warning_with_its_weight(sts: Robot, saved: Path) -> None:
    tool = ToolConfig(mass=2.0, com=[0.0, 0.0, 0.1], inertia=[0.01, 0.01, 0.01, 0.0, 0.0, 0.0])
    other = sts.with_tool(tool, PoseConfig())
    then = replace(FittedRobot.of(other), tool_mass=0.0, tool_com=[0.0, 0.0, 0.0])
    (sentence,) = then.warnings(other)
    assert "a tool of 0 kg" in sentence and "has one of 2 kg" in sentence
    assert f"{2.0 * np.linalg.norm(sts.gravity):.3g} N" in sentence
    then.check(other, saved)


def test_a_file_without_the_keys_loads_with_a_warning(sts: Robot, tmp_path: Path) -> None:
    path = tmp_path / "model.yaml"
    IdentifiedModel.nominal(sts).save(path)
    text = path.read_text()
    assert "fitted_robot" in text
    begin = text.index("fitted_robot")
    path.write_text(text[:begin] + text[text.index("complete") :])
    model = IdentifiedModel.load(path, sts)
    (sentence,) = model.fitted_robot.warnings(sts)
    assert "states no torque per ampere" in sentence
