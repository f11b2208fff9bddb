"""xacro without ROS: macros, includes, packages beside the file, and what is missing."""

import sys

import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.urdf_document import read_document

ARM = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="length" default="0.3"/>
  <xacro:include filename="$(find my_arm)/urdf/links.xacro"/>
  <link name="base"/>
  <xacro:segment name="upper" length="$(arg length)"/>
</robot>"""
LINKS = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:macro name="segment" params="name length">
    <link name="${name}"><collision><geometry><box size="1 1 ${2 * length}"/></geometry></collision>
    </link>
  </xacro:macro>
</robot>"""


@pytest.fixture
def arm(tmp_path):
    folder = tmp_path / "my_arm" / "urdf"
    folder.mkdir(parents=True)
    (folder / "arm.urdf.xacro").write_text(ARM, encoding="utf-8")
    (folder / "links.xacro").write_text(LINKS, encoding="utf-8")
    return folder / "arm.urdf.xacro"


def test_macros_includes_and_packages(arm):
    pytest.importorskip("xacro", reason="the package xacro is not installed")
    root, lines = read_document(arm)
    assert [link.get("name") for link in root.findall("link")] == ["base", "upper"]
    box = root.find("link[@name='upper']/collision/geometry/box")
    assert box is not None
    assert box.get("size") == "1 1 0.6"
    assert not lines


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("find my_arm", "find your_arm", "'your_arm' is not found"),
        (' default="0.3"', "", "missing attribute 'default'"),
        ("xacro:segment", "xacro:part", "part"),
    ],
)
def test_what_xacro_refuses_is_one_line(arm, old, new, expected):
    pytest.importorskip("xacro", reason="the package xacro is not installed")
    arm.write_text(ARM.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=expected) as error:
        read_document(arm)
    assert "> robot.urdf" in str(error.value)


def test_without_the_package_the_remedy_is_told(arm, monkeypatch):
    monkeypatch.setitem(sys.modules, "xacro", None)
    with pytest.raises(InputError, match="pip install xacro"):
        read_document(arm)
