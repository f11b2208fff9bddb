"""xacro in its child process: macros, packages, arguments, and what a file can do wrong."""

import importlib.util
import resource

import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.limited_child import CPU_TIME
from wrenchsight.models.robot.urdf_document import is_xacro_file, parse_document, read_document
from wrenchsight.models.robot.xacro_document import renamed_packages, urdf_of_xacro

pytest.importorskip("xacro", reason="the package xacro is not installed")

HEAD = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'
ARM = f"""{HEAD}
  <xacro:arg name="length" default="0.3"/>
  <xacro:include filename="$(find my_arm)/urdf/links.xacro"/>
  <link name="base"/>
  <xacro:segment name="upper" length="$(arg length)"/>
</robot>"""
LINKS = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:macro name="segment" params="name length">
    <link name="${name}"><collision><geometry>
      <box size="1 ${list(map(float, '1 2'.split()))[1]} ${2 * length}"/></geometry></collision>
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


def test_macros_packages_and_arguments(arm):
    assert b'<box size="1 2.0 0.6"/>' in urdf_of_xacro(arm, {})
    assert b'<box size="1 2.0 1.0"/>' in urdf_of_xacro(arm, {"length": "0.5"})


def test_each_element_has_a_line_of_its_own(arm):
    """Messages about the expanded file send their reader to lines."""
    _, lines = parse_document(urdf_of_xacro(arm, {}), arm.with_name("robot.urdf"))
    assert len(set(lines.values())) == len(lines) > 4


def test_a_package_whose_folder_was_renamed_is_found_by_what_it_holds(arm):
    # Not "my_arm": folders of other tests lie around.
    arm.write_text(ARM.replace("find my_arm", "find old_arm"), encoding="utf-8")
    package = arm.parent.parent
    assert renamed_packages(arm) == {"old_arm": package}
    assert b'<box size="1 2.0 0.6"/>' in urdf_of_xacro(arm, {})
    (arm.parent / "links.xacro").unlink()
    with pytest.raises(InputError, match='package "old_arm" is found neither'):
        urdf_of_xacro(arm, {})


def test_it_is_never_expanded_unasked(arm):
    assert is_xacro_file(arm)
    with pytest.raises(InputError, match=r"runs code of its author.*--trust-xacro"):
        read_document(arm)


def test_expressions_alone_make_a_xacro_of_a_file_of_that_name(tmp_path):
    for name, expected in (("a.xacro", True), ("a.urdf", False)):
        (tmp_path / name).write_text('<robot name="a"><link name="${1 + 1}"/></robot>')
        assert is_xacro_file(tmp_path / name) is expected


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            "find my_arm)/urdf/links.xacro",
            "find your_arm)/urdf/your_links.xacro",
            'xacro: package "your_arm" is found neither[^;]*; put the package.*holds it$',
        ),
        (' default="0.3"', "", "missing attribute 'default'|[Uu]ndefined substitution argument"),
        ("xacro:segment", "xacro:part", "part"),
        ("$(arg length)", "${1 / 0}", "division by zero.*; correct the file$"),
        ("links.xacro", "none.xacro", "none.xacro"),
    ],
)
def test_a_file_that_xacro_refuses_is_one_line(arm, old, new, expected):
    arm.write_text(ARM.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=expected) as error:
        urdf_of_xacro(arm, {})
    assert "\n" not in str(error.value)
    assert "Traceback" not in str(error.value)


@pytest.mark.parametrize(
    "expression",
    [
        pytest.param("${9**9**9}", marks=pytest.mark.long, id="time"),
        pytest.param("${'x' * 10**11}", id="text"),
        pytest.param("${[0] * 10**10}", id="list"),
    ],
)
def test_time_and_memory_are_limited(arm, expression):
    arm.write_text(ARM.replace("$(arg length)", expression), encoding="utf-8")
    begin = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    with pytest.raises(InputError, match=r"stopped|memory|too many digits|Memory"):
        urdf_of_xacro(arm, {})
    taken = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - begin
    assert taken < CPU_TIME + 1.0  # the system looks at a limit once a second


def test_without_the_package_the_remedy_is_told(arm, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match="pip install xacro"):
        urdf_of_xacro(arm, {})
