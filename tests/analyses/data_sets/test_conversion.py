"""Files made of published ones are those that the experiments have been run on."""

import hashlib

import numpy as np
import pytest

from wrenchsight.analyses.data_sets.conversion import CONVERSIONS, convert_lara8, convert_pushes
from wrenchsight.analyses.data_sets.registry import DATA_SETS
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.robot.robot import Robot

T_0 = 200.533  # s, of the published recording's first row


@pytest.fixture
def published_pushes(data, tmp_path):
    """The published recording, written again from the converted one."""
    rows = np.genfromtxt(data("ur10e_pushes/push_pose_1.csv"), delimiter=",", skip_header=1)
    lines = (
        ",".join(f"{value:.4f}" for value in (T_0 + row[0], *row[1:31])) + "\n" for row in rows
    )
    path = tmp_path / "ur-20_01_22-push_pose_1.csv"
    path.write_text("".join(lines))
    (file,) = DATA_SETS["ur10e_pushes"].published
    assert hashlib.sha256(path.read_bytes()).hexdigest() == file.sha256
    return path


def test_pushes_are_those_known(published_pushes, data, ur10e, tmp_path):
    made = convert_pushes(published_pushes.parent)
    assert made["push_pose_1.csv"] == data("ur10e_pushes/push_pose_1.csv").read_text()
    spans = np.genfromtxt(made["pushes.csv"].splitlines(), delimiter=",", names=True)
    published = np.genfromtxt(data("ur10e_pushes/pushes.csv"), delimiter=",", names=True)
    for name in spans.dtype.names:
        np.testing.assert_array_equal(spans[name], published[name])
    assert made["recording.yaml"] == data("ur10e_pushes/recording.yaml").read_text()
    folder = written(made, tmp_path)
    log = read_recording(folder / "push_pose_1.csv", folder / "recording.yaml", ur10e)
    assert log.extra["push"].max() == 4
    for file in DATA_SETS["ur10e_pushes"].converted:
        content = made[file.name].encode()
        assert (len(content), hashlib.sha256(content).hexdigest()) == (file.num_bytes, file.sha256)


def written(texts, folder):
    """Writes files by their names."""
    for name, text in texts.items():
        (folder / name).write_text(text)
    return folder


PUBLISHED = """<?xml version="1.0" ?>
<robot name="lara8">
  <material name="white"><color rgba="1 1 1 1"/></material>
  <link name="root_link"/>
  <joint name="root_joint" type="fixed">
    <origin rpy="0 -1.57079632679 0" xyz="0 0 0"/>
    <parent link="root_link"/><child link="link0"/>
  </joint>
  <link name="link0">
    <inertial>
      <mass value="2"/><origin rpy="0 0 0" xyz="0.0 0.0 0.0"/>
      <inertia ixx="0.0" ixy="0.0" ixz="0.0" iyy="0.0" iyz="0.0" izz="0.0"/>
    </inertial>
    <visual><geometry><mesh filename="package://a.stl"/></geometry></visual>
    <collision><geometry><mesh filename="package://a.stl"/></geometry></collision>
  </link>
  <joint name="joint1" type="revolute">
    <origin rpy="0 0 -4.8965276278067904e-12" xyz="0 -0.26249999999999996 0"/>
    <axis xyz="0 -1 0"/>
    <limit effort="204" lower="-3.14159" upper="3.14159" velocity="3"/>
    <parent link="link0"/><child link="lara8_flange"/>
  </joint>
  <link name="lara8_flange"/>
  <joint name="measurement_tool_joint" type="fixed">
    <parent link="lara8_flange"/><child link="measurement_tool"/>
  </joint>
  <link name="measurement_tool"/>
  <joint name="tcp_joint" type="fixed">
    <parent link="measurement_tool"/><child link="tcp"/>
  </joint>
  <link name="tcp"/>
</robot>"""


def test_a_description_is_without_meshes_and_its_angles_are_right(tmp_path):
    (tmp_path / "lara8.urdf").write_text(PUBLISHED)
    text = convert_lara8(tmp_path)["robot.urdf"]
    for word in ("mesh", "material", "tool", "tcp", "lara8_flange", "e-12"):
        assert word not in text
    assert f'rpy="0.0 {-np.pi / 2!r} 0.0"' in text
    assert 'xyz="0.0 -0.2625 0.0"' in text
    assert 'izz="0.01"' in text
    assert '<link name="flange"' in text


def test_the_robot_beside_a_description_is_the_one_known(data, tmp_path):
    (tmp_path / "lara8.urdf").write_text(PUBLISHED)
    made = convert_lara8(tmp_path)["robot.yaml"]
    assert made == data("neura_lara8/robot.yaml").read_text()
    assert Robot.load(data("neura_lara8/robot.yaml")).num_joints == 6


def test_every_converted_set_has_a_conversion():
    assert set(CONVERSIONS) == {name for name, one in DATA_SETS.items() if one.converted}
