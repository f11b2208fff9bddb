"""xacro without ROS: macros, includes, packages beside the file, and what is missing."""

import importlib.util
import os
import time
from xml.dom import minidom

import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.urdf_document import read_document
from wrenchsight.models.robot.xacro_document import urdf_of_xacro

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


def test_an_argument_takes_the_place_of_its_default(arm):
    pytest.importorskip("xacro", reason="the package xacro is not installed")
    root, _ = read_document(arm, arguments={"length": "0.5"})
    box = root.find("link[@name='upper']/collision/geometry/box")
    assert box is not None
    assert box.get("size") == "1 1 1.0"


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("find my_arm", "find your_arm", "'your_arm' is not found"),
        (' default="0.3"', "", "missing attribute 'default'"),
        ("xacro:segment", "xacro:part", "part"),
    ],
)
def test_a_file_that_xacro_refuses_is_one_line(arm, old, new, expected):
    pytest.importorskip("xacro", reason="the package xacro is not installed")
    arm.write_text(ARM.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=expected) as error:
        read_document(arm)
    assert "> robot.urdf" in str(error.value)


def test_without_the_package_the_remedy_is_told(arm, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match="pip install xacro"):
        read_document(arm)


# As the descriptions of well-known arms are written: YAML by dots and brackets, blocks, conditions,
# forwarded parameters, namespaces, units, substitutions inside expressions.
SPEC = """
inertial: {mass: 2.5, origin: {xyz: 0 0 0.1}, inertia: {xx: 0.1, yy: 0.2, zz: 0.3}}
limits: {lower: !degrees -170, upper: !radians 2.9, names: [a, b, c]}
"""
TOOLS = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:property name="width" value="0.07"/>
  <xacro:macro name="finger" params="side"><link name="${side}_${width}"/></xacro:macro>
</robot>"""
FULL = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="side" default="left"/>
  <xacro:arg name="hand" default="true"/>
  <xacro:include filename="tools.xacro" ns="tools"/>
  <xacro:include filename="nothing_*.xacro"/>
  <xacro:include filename="absent.xacro" optional="true"/>
  <xacro:property name="spec" value="${xacro.load_yaml('$(find my_arm)/config/spec.yaml')}"/>
  <xacro:property name="prefix" value="$(arg side)_"/>
  <xacro:property name="text" value="1 2 -3"/>
  <xacro:property name="d" value="${dict(a=1, b=2)}"/>
  <xacro:macro name="inertia" params="mass r:=0.1 spec:=^ **extra">
    <inertial><mass value="${mass}"/>
      <inertia ixx="${1./12 * mass * (3 * r**2 + 2 // 1 % 3)}" iyy="${spec.inertial.inertia.yy}"/>
    </inertial><xacro:insert_block name="extra"/>
  </xacro:macro>
  <xacro:macro name="segment" params="name n"><xacro:if value="${n > 0}"><link name="${name}${n}"/>
    <xacro:segment name="${name}" n="${n - 1}"/></xacro:if></xacro:macro>
  <link name="${prefix}base">
    <xacro:inertia mass="${spec['inertial']['mass']}">
      <visual><origin xyz="${text.split(' ')[2]} ${text[0]} ${[1, 2][-1]}"/></visual>
    </xacro:inertia>
  </link>
  <xacro:if value="${'$(arg side)' == 'left' and not 'x' in spec.limits.names}">
    <link name="${'l' if '$(arg side)' == 'left' else 'r'}"/></xacro:if>
  <xacro:unless value="$(arg hand)"><link name="none"/></xacro:unless>
  <xacro:segment name="part_" n="3"/>
  <tools.finger/><xacro:tools.finger side="$(arg side)"/>
  <limit lower="${spec.limits.lower}" upper="${radians(170)}" velocity="${-pi / 2 + math.pi}"
    effort="${max(1, 7.5) ** 0.5}" n="${len(spec.limits.names)}" d="${d['b'] << 0 or 1}"/>
  <range of="${python.sorted(range(3))}" text="${str(0.1) + 'x' * 3}" money="$${a}" none="${None}"/>
  <call f="$(eval 1 + 2)" o="$(optenv NOT_SET_AT_ALL some words)" r="${round(1.23456, 3)}"/>
</robot>""".replace(" << 0", "")


def test_a_full_description_is_what_xacro_itself_makes_of_it(tmp_path, monkeypatch):
    xacro = pytest.importorskip("xacro", reason="the package xacro is not installed")
    folder = tmp_path / "my_arm"
    (folder / "config").mkdir(parents=True)
    (folder / "package.xml").write_text("<package><name>my_arm</name></package>")
    (folder / "config" / "spec.yaml").write_text(SPEC)
    (folder / "tools.xacro").write_text(TOOLS)
    path = folder / "arm.xacro"
    path.write_text(FULL)
    substitution_args = pytest.importorskip("xacro.substitution_args")
    monkeypatch.setattr(substitution_args, "_eval_find", lambda package: str(folder))
    expected = xacro.process_file(str(path)).toxml(encoding="utf-8")
    assert urdf_of_xacro(path) == expected
    assert b"left_0.07" in expected
    assert b"part_1" in expected


def test_a_cloned_package_goes_by_the_name_that_it_states(tmp_path):
    folder = tmp_path / "clone"
    folder.mkdir()
    (folder / "package.xml").write_text("<package><name> my_arm </name></package>")
    (folder / "links.xacro").write_text(LINKS)
    (folder / "arm.xacro").write_text(ARM.replace("/urdf", ""))
    root, _ = read_document(folder / "arm.xacro")
    assert len(root.findall("link")) == 2


ESCAPE = (
    "(lambda: [c for c in ().__class__.__base__.__subclasses__() if c.__name__=="
    "'catch_warnings'][0]()._module.__builtins__['__import__']('os').system('touch PWNED'))()"
)


@pytest.mark.parametrize(
    "expression",
    [
        ESCAPE,
        ESCAPE.replace("lambda: ", "").replace("()()", "()"),
        "().__class__",
        "''.format",
        "sin.__self__",
        "xacro.load_yaml.__globals__",
        "[x for x in (1,)]",
        "(lambda: 1)()",
        "'{0.__class__}'.format(1)",
        "math.__dict__",
        "python.vars()",
        "python.type(1)",
        "open",
        "(x := 1)",
        "f'{sin}'",
        "__builtins__",
        "__import__('os')",
        "dict.fromkeys",
        "'a'.encode()",
        "eval('1')",
        "{}.setdefault",
        "spec.__class__",
        "str.join",
        "[].append(1)",
        "sin",
        "b'a'",
    ],
)
def test_no_expression_reaches_python(arm, tmp_path, monkeypatch, expression):
    monkeypatch.chdir(tmp_path)
    arm.write_text(ARM.replace('length="$(arg length)"', f'length="${{{expression}}}"'))
    with pytest.raises(InputError, match=r"> robot\.urdf"):
        read_document(arm)
    arm.write_text(ARM.replace("$(arg length)", f"$(eval {expression.replace('(', '[')})"))
    with pytest.raises(InputError):
        read_document(arm)
    assert not (tmp_path / "PWNED").exists()


DOUBLED = "".join(
    f'<xacro:property name="a{n}" value="{{}}"/>'.format(f"${{a{n - 1}}}${{a{n - 1}}}")
    for n in range(1, 60)
)
LISTS = "".join(
    f'<xacro:property name="a{n}" value="${{[a{n - 1}, a{n - 1}]}}"/>' for n in range(1, 60)
)
MACROS = "".join(
    f'<xacro:macro name="m{n}" params=""><xacro:m{n - 1}/><xacro:m{n - 1}/></xacro:macro>'
    for n in range(1, 60)
)


@pytest.mark.parametrize(
    "content",
    [
        '<a b="${9**9**9}"/>',
        "<a b=\"${'x' * 10**10}\"/>",
        '<a b="${10**10 * [1]}"/>',
        '<a b="${pow(9, 9**9)}"/>',
        '<a b="${range(10**9)}"/>',
        '<a b="${round(1, -10**9)}"/>',
        '<a b="${[[[[0] * 999] * 999] * 999] * 999}"/>',
        '<a b="${9**300 * 9**300}"/>',
        '<a b="${str([[[0] * 999] * 999] * 999)}"/>',
        f'<a b="{"$x" * 200_000}"/>',
        f'<a b="${{{"-" * 3000}1}}"/>',
        '<a b="${' + "9" * 9000 + '}"/>',
        '<xacro:property name="a0" value="ab"/>' + DOUBLED + '<a b="${a59}"/>',
        '<xacro:property name="a0" value="1"/>' + LISTS + '<a b="${a59}"/>',
        '<xacro:macro name="m0" params=""/>' + MACROS + "<xacro:m59/>",
        '<xacro:macro name="m" params=""><xacro:m/></xacro:macro><xacro:m/>',
        '<xacro:macro name="m" params="a:=' + "x" * 60 + "'\"/><xacro:stop/>",
        '<xacro:include filename="arm.urdf.xacro"/>',
        "<a b=\"${xacro.load_yaml('bomb.yaml')}\"/>",
        '<xacro:property name="p" value="1"/>' * 100_000 + "<xacro:stop/>",
    ],
    ids=lambda content: content[:40],
)
def test_no_document_is_without_end(arm, content):
    bomb = "a0: &a0 [1]\n" + "".join(f"a{n}: &a{n} [*a{n - 1}, *a{n - 1}]\n" for n in range(1, 60))
    (arm.parent / "bomb.yaml").write_text(bomb)
    arm.write_text(ARM.replace("</robot>", content + "</robot>"))
    start = time.process_time()
    with pytest.raises(InputError, match=r"> robot\.urdf"):
        read_document(arm)
    assert time.process_time() - start < 20  # s, on a slow machine; 1e7 units of work


OUTSIDE = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="secret"/></robot>'


@pytest.mark.parametrize(
    "content",
    [
        '<xacro:include filename="../../outside.xacro"/>',
        '<xacro:include filename="link.xacro"/>',
        '<xacro:include filename="{}/outside.xacro"/>',
        '<xacro:include filename="{}/out*.xacro"/>',
        '<xacro:include filename="/*/*/*/*/*/*"/>',
        '<xacro:include filename="pipe.xacro"/>',
        '<xacro:include filename="/dev/zero"/>',
        "<a b=\"${{xacro.load_yaml('{}/outside.xacro')}}\"/>",
        '<a b="$(find other)/x"/>',
        "<a b=\"${{xacro.load_yaml('/dev/zero')}}\"/>",
        '<a b="$(env HOME)"/>',
        "<a b=\"${{xacro.load_yaml('pipe.xacro')}}\"/>",
    ],
)
def test_nothing_is_read_outside_the_robots_folders(arm, tmp_path, content):
    (tmp_path / "outside.xacro").write_text(OUTSIDE)
    (tmp_path / "other").mkdir()  # a folder, and no package
    (arm.parent / "link.xacro").symlink_to(tmp_path / "outside.xacro")
    (arm.parent / "folder").mkdir()
    os.mkfifo(arm.parent / "pipe.xacro")
    text = ARM.replace("</robot>", content.format(tmp_path, tmp_path) + "</robot>")
    minidom.parseString(text)
    arm.write_text(text)
    with pytest.raises(InputError, match=r"> robot\.urdf") as error:
        read_document(arm)
    assert "secret" not in str(error.value)
