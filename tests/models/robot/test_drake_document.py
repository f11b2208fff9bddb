"""SDF and MJCF against the plant that Drake makes of them: frames, limits, inertias, shapes."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.drake_document import LEFT_OUT
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.urdf_document import read_document

INERTIAL = """<inertial><pose>.02 .01 .1 .3 0 .2</pose><mass>{mass}</mass><inertia><ixx>.02</ixx>
<iyy>.025</iyy><izz>.015</izz><ixy>.001</ixy></inertia></inertial>"""
SDF = f"""<sdf version="1.9"><model name="arm">
  <link name="base"/>
  <joint name="bolted" type="fixed"><parent>world</parent><child>base</child></joint>
  <link name="upper"><pose>.1 0 .4 0 .2 .5</pose>{INERTIAL.format(mass=3)}
    <collision name="c"><pose>0 0 .1 0 0 0</pose>
      <geometry><box><size>.1 .1 .3</size></box></geometry></collision></link>
  <joint name="shoulder" type="revolute">
    <pose relative_to="upper">0 0 -.1 .3 0 0</pose>
    <parent>base</parent><child>upper</child>
    <axis><xyz expressed_in="__model__">0 1 0</xyz>
      <limit><lower>-2</lower><upper>2</upper><velocity>3</velocity><effort>50</effort></limit></axis>
  </joint>
  <link name="lower"><pose relative_to="upper">0 .1 .5 0 0 .7</pose>{INERTIAL.format(mass=1)}</link>
  <joint name="slide" type="prismatic">
    <parent>upper</parent><child>lower</child>
    <axis><xyz>.6 0 .8</xyz>
      <limit><lower>-.1</lower><upper>.3</upper><velocity>1</velocity><effort>20</effort></limit></axis>
  </joint>
</model></sdf>"""
CONFIG = """
name: arm
urdf: arm.sdf
base_link: base
flange: lower
payload: 1.0
home: [0.0, 0.0]
drives:
  - {joint: shoulder, torque_per_ampere: 1.0, rotor_inertia: 0.0}
  - {joint: slide, torque_per_ampere: 1.0, rotor_inertia: 0.0}
"""


def test_the_arm_is_the_plant_that_drake_reads(tmp_path):
    (tmp_path / "arm.sdf").write_text(SDF, encoding="utf-8")
    (tmp_path / "robot.yaml").write_text(CONFIG, encoding="utf-8")
    robot = Robot.load(tmp_path / "robot.yaml")
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModelsFromString(SDF, "sdf")
    plant.Finalize()
    context = plant.CreateDefaultContext()
    q = np.array([0.7, 0.2])
    plant.SetPositions(context, q)
    terms = robot.chain.terms(q, np.zeros(2))
    np.testing.assert_allclose(terms.M, plant.CalcMassMatrix(context), atol=1e-12)
    np.testing.assert_allclose(terms.G, -plant.CalcGravityGeneralizedForces(context), atol=1e-12)
    # E is the flange's frame, which is that of the joint "slide".
    frame = plant.GetJointByName("slide").frame_on_child()
    expected = frame.CalcPoseInWorld(context)
    np.testing.assert_allclose(terms.p_WE, expected.translation(), atol=1e-12)
    np.testing.assert_allclose(terms.R_WE, expected.rotation().matrix(), atol=1e-12)
    world = plant.world_frame()
    J = plant.CalcJacobianSpatialVelocity(
        context, JacobianWrtVariable.kV, frame, np.zeros(3), world, world
    )
    np.testing.assert_allclose(terms.J, J, atol=1e-12)
    np.testing.assert_array_equal(robot.position_lower, [-2.0, -0.1])
    np.testing.assert_array_equal(robot.position_upper, [2.0, 0.3])
    np.testing.assert_array_equal(robot.velocity_limit, [3.0, 1.0])
    np.testing.assert_array_equal(robot.effort_limit, [50.0, 20.0])
    assert robot.urdf_text.count("<collision") == 1


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("<sdf version='1.9'/>", "holds 0 models"),
        ("<sdf version='1.9'><model name='a'/><model name='b'/></sdf>", "holds 2 models"),
        ("<sdf version='1.9'><model name='a'><link name='l'/><joint name='j' type='fixed'>"
         "<parent>world</parent><child>nobody</child></joint></model></sdf>", "nobody"),
    ],
)  # fmt: skip
def test_an_sdf_that_drake_cannot_read_is_one_line(tmp_path, text, expected):
    path = tmp_path / "arm.sdf"
    path.write_text(text)
    with pytest.raises(InputError, match=expected) as error:
        read_document(path)
    assert "\n" not in str(error.value)


def test_parts_of_a_link_that_sdf_has_not_are_passed_over(tmp_path):
    """PyBullet's files state contact properties there, which Drake's parser refuses."""
    path = tmp_path / "arm.sdf"
    path.write_text(SDF.replace('<link name="base"/>', '<link name="base"><contact/></link>'))
    root, _ = read_document(path)
    assert [link.get("name") for link in root.iter("link")][:2] == ["base", "upper"]


def test_a_slide_without_an_end_gets_one(tmp_path):
    path = tmp_path / "arm.sdf"
    path.write_text(SDF.replace("<lower>-.1</lower><upper>.3</upper>", ""))
    root, _ = read_document(path)
    (slide,) = [joint for joint in root.iter("joint") if joint.get("name") == "slide"]
    assert slide.find("limit").get("lower") == "-10.0"
    assert slide.find("limit").get("upper") == "10.0"


def test_an_sdf_that_breaks_the_parser_is_one_line(tmp_path):
    """It includes the folder that holds it: Drake's parser goes round until its stack ends."""
    (tmp_path / "model.config").write_text(
        "<model><name>m</name><sdf version='1.9'>model.sdf</sdf></model>"
    )
    path = tmp_path / "model.sdf"
    path.write_text(
        f"<sdf version='1.9'><model name='m'><link name='l'/><include><uri>{tmp_path}</uri>"
        "</include></model></sdf>"
    )
    with pytest.raises(InputError, match=r"breaks the parser.*includes itself") as error:
        read_document(path)
    assert "\n" not in str(error.value)


def test_elements_that_are_nested_deep_are_one_line(tmp_path):
    path = tmp_path / "arm.sdf"
    deep = "<a>" * 600 + "</a>" * 600
    path.write_text(
        f"<sdf version='1.9'><model name='m'><link name='l'>{deep}</link></model></sdf>"
    )
    with pytest.raises(InputError, match="nested more than 100 deep"):
        read_document(path)


_ROLL = np.deg2rad(30.0)


@pytest.mark.parametrize(
    ("pose", "expected"),
    [
        ("<pose>1 2 3 .5235987755982988 0 0</pose>", (1, 2, 3, _ROLL)),
        ("<pose degrees='true'>1 2 3 30 0 0</pose>", (1, 2, 3, _ROLL)),
        (
            "<pose rotation_format='quat_xyzw'>1 2 3 .25881904510252074 0 0 .9659258262890683"
            "</pose>",
            (1, 2, 3, _ROLL),
        ),
        ("<pose/>", (0, 0, 0, 0)),
        ("", (0, 0, 0, 0)),
        ("<pose>1 2 3</pose>", None),
        ("<pose>1 2 3 0 0 0 1</pose>", None),
        ("<pose>1 2 3 0 0 1e30</pose>", None),
        ("<pose>1 2 three 0 0 0</pose>", None),
        ("<pose rotation_format='quat_xyzw'>1 2 3 0 0 0 0</pose>", None),
        ("<pose relative_to='upper'>1 2 3 0 0 0</pose>", None),
    ],
)
def test_the_pose_of_a_shape_is_read_in_every_form_or_the_shape_is_lost(tmp_path, pose, expected):
    text = SDF.replace("<pose>0 0 .1 0 0 0</pose>", pose).replace(
        '<pose relative_to="upper">0 0 -.1 .3 0 0</pose>', ""
    )
    path = tmp_path / "arm.sdf"
    path.write_text(text)
    root, lines = read_document(path)
    assert not lines
    (shape,) = root.findall("link[@name='upper']/collision")
    assert (shape.find("geometry/box") is None) == (expected is None)
    if expected is not None:
        origin = shape.find("origin")
        position = [float(x) for x in origin.get("xyz").split()]
        np.testing.assert_allclose(position, expected[:3], atol=1e-15)
        roll = [float(x) for x in origin.get("rpy").split()]
        np.testing.assert_allclose(roll, [expected[3], 0.0, 0.0], atol=1e-15)


MJCF = """<mujoco model="arm"><compiler angle="radian"/><worldbody>
  <body name="base"><geom type="cylinder" size=".05 .05" mass="2"/>
    <body name="upper" pos="0 0 .3" euler=".1 0 .2">
      <joint name="shoulder" type="hinge" axis="0 1 0" pos="0 0 .05" range="-2 2"/>
      <inertial pos="0 .01 .1" mass="3" fullinertia=".02 .025 .015 .001 0 0"/>
      <body name="lower" pos="0 .1 .5">
        <joint name="slide" type="slide" axis=".6 0 .8" range="-.1 .3"/>
        <inertial pos=".01 0 0" mass="1" diaginertia=".01 .01 .01"/>
      </body></body></body></worldbody>
  <actuator><motor name="a" joint="shoulder" forcerange="-50 50"/></actuator></mujoco>"""


def test_an_mjcf_is_the_plant_that_drake_reads(tmp_path):
    (tmp_path / "arm.xml").write_text(MJCF, encoding="utf-8")
    text = CONFIG.replace("arm.sdf", "arm.xml").replace("0.0}\n", "0.0, effort_limit: 50.0}\n")
    (tmp_path / "robot.yaml").write_text(text, encoding="utf-8")
    robot = Robot.load(tmp_path / "robot.yaml")
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(tmp_path / "arm.xml"))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    q = np.array([0.7, 0.2])
    plant.SetPositions(context, q)
    terms = robot.chain.terms(q, np.zeros(2))
    np.testing.assert_allclose(terms.M, plant.CalcMassMatrix(context), atol=1e-12)
    np.testing.assert_allclose(terms.G, -plant.CalcGravityGeneralizedForces(context), atol=1e-12)
    expected = plant.GetJointByName("slide").frame_on_child().CalcPoseInWorld(context)
    np.testing.assert_allclose(terms.p_WE, expected.translation(), atol=1e-12)
    np.testing.assert_array_equal(robot.position_lower, [-2.0, -0.1])
    assert robot.urdf_text.count("<collision") == 1
    assert 'cylinder radius="0.05" length="0.1"' in robot.urdf_text


def test_the_effort_of_a_servo_is_its_force_not_the_range_of_its_positions(tmp_path):
    servo = '<position name="a" joint="shoulder" ctrlrange="-1.9 1.9" forcerange="-30 30"/>'
    start, end = MJCF.index("<motor"), MJCF.index("</actuator>")
    (tmp_path / "arm.xml").write_text(MJCF[:start] + servo + MJCF[end:], encoding="utf-8")
    text = CONFIG.replace("arm.sdf", "arm.xml").replace("0.0}\n", "0.0, effort_limit: 50.0}\n")
    (tmp_path / "robot.yaml").write_text(text, encoding="utf-8")
    robot = Robot.load(tmp_path / "robot.yaml")
    limit = ET.fromstring(robot.urdf_text).find("joint[@name='shoulder']/limit")
    assert limit is not None
    assert float(limit.get("effort")) == 30.0


def test_an_mjcf_without_its_meshes_keeps_its_inertias(tmp_path):
    text = MJCF.replace("<worldbody>", "<asset><mesh name='m' file='none.obj'/></asset><worldbody>")
    text = text.replace('<body name="lower"', "<geom type='mesh' mesh='m'/><body name=\"lower\"")
    (tmp_path / "bare.xml").write_text(MJCF, encoding="utf-8")
    (tmp_path / "arm.xml").write_text(text, encoding="utf-8")
    expected, _ = read_document(tmp_path / "bare.xml")
    root, _ = read_document(tmp_path / "arm.xml")
    for kind in ("inertial", "joint"):
        pairs = zip(root.iter(kind), expected.iter(kind), strict=True)
        assert all(ET.tostring(a) == ET.tostring(b) for a, b in pairs)
    shapes = [shape.tag for shape in root.iterfind("link/collision/geometry/*")]
    assert set(shapes) == {"geom"}  # which are lost, and said to be


def test_an_mjcf_without_a_name_and_with_massless_bodies_is_read(tmp_path):
    """MuJoCo asks neither for a name, nor for a mass of what a body carries without a joint."""
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes/plate.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n")
    text = MJCF.replace(' model="arm"', "").replace("radian", 'radian" meshdir="meshes')
    text = text.replace(
        "<worldbody>", "<asset><mesh name='m' file='plate.obj'/></asset><worldbody>"
    )
    massless = "<inertial pos='0 0 0' mass='0' diaginertia='0 0 0'/>"
    text = text.replace('<geom type="cylinder"', f'{massless}<geom type="cylinder"')
    frame = f"<body name='frame' pos='0 0 1'>{massless}<geom type='mesh' mesh='m'/></body>"
    text = text.replace("</body></body></body>", f"{frame}</body></body></body>")
    (tmp_path / "bare.xml").write_text(MJCF, encoding="utf-8")
    (tmp_path / "arm.xml").write_text(text, encoding="utf-8")
    expected, _ = read_document(tmp_path / "bare.xml")
    root, _ = read_document(tmp_path / "arm.xml")
    assert root.get("name") == "arm"
    for link in ("upper", "lower"):
        inertias = [r.find(f"link[@name='{link}']/inertial") for r in (root, expected)]
        assert ET.tostring(inertias[0]) == ET.tostring(inertias[1])
    for link in ("base", "frame"):
        assert root.find(f"link[@name='{link}']/inertial") is None
    mesh = root.find("link[@name='frame']/collision/geometry/mesh")
    assert mesh.get("filename") == (tmp_path / "meshes/plate.obj").as_uri()


def test_rounded_quaternions_of_an_mjcf_are_right_angles(tmp_path):
    text = MJCF.replace('pos="0 0 .3" euler=".1 0 .2"', 'pos="0 0 .3" quat="0.707105 0.707108 0 0"')
    (tmp_path / "arm.xml").write_text(text, encoding="utf-8")
    config = CONFIG.replace("arm.sdf", "arm.xml").replace("0.0}\n", "0.0, effort_limit: 50.0}\n")
    (tmp_path / "robot.yaml").write_text(config, encoding="utf-8")
    robot = Robot.load(tmp_path / "robot.yaml")
    expected = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]
    np.testing.assert_allclose(robot.chain.R_PJ[0], expected, atol=1e-15)
    assert any("taken as exact: shoulder" in notice for notice in robot.notices)


_LINKS = """<body name="upper" pos="0 0 .3"><joint name="shoulder" axis="0 1 0" range="-2 2"/>
<inertial pos="0 0 .1" mass="2" diaginertia=".02 .02 .01"/>
<body name="lower" pos="0 0 .4"><joint name="elbow" axis="0 1 0" range="-1 1.5"/>
<inertial pos="0 0 .1" mass="1" diaginertia=".01 .01 .005"/>
<body name="hand" pos="0 0 .3"><joint name="wrist" axis="0 0 1" range="-3.1 3.1"/>
<inertial pos="0 0 .05" mass=".5" diaginertia=".001 .001 .001"/></body></body></body>"""


def test_the_files_that_an_mjcf_includes_are_read_beside_it(tmp_path, monkeypatch):
    """Whichever folder the command runs in; their one outer element is left out."""
    monkeypatch.chdir("/")
    (tmp_path / "parts").mkdir()
    arm = tmp_path / "arm.xml"
    arm.write_text(
        '<mujoco model="arm"><include file="parts/common.xml"/><worldbody><body name="base">'
        '<include file="parts/links.xml"/></body></worldbody></mujoco>'
    )
    common = '<mujoco><compiler angle="radian"/><include file="options.xml"/></mujoco>'
    (tmp_path / "parts" / "common.xml").write_text(common)
    (tmp_path / "parts" / "options.xml").write_text('<mujoco><size njmax="500"/></mujoco>')
    (tmp_path / "parts" / "links.xml").write_text(f"<mujocoinclude>{_LINKS}</mujocoinclude>")
    root, _ = read_document(arm)
    limits = {
        j.get("name"): j.find("limit").attrib
        for j in root.iter("joint")
        if j.find("limit") is not None
    }
    assert float(limits["elbow"]["upper"]) == 1.5
    assert list(limits) == ["shoulder", "elbow", "wrist"]
    (tmp_path / "parts" / "links.xml").unlink()
    with pytest.raises(InputError, match=r'include file="parts/links.xml">: no such file'):
        read_document(arm.rename(tmp_path / "other.xml"))  # the first is remembered
    (tmp_path / "parts" / "links.xml").write_text('<m><include file="parts/links.xml"/></m>')
    with pytest.raises(InputError, match="or a file itself"):
        read_document(tmp_path / "other.xml")


def test_an_mjcf_with_radians_that_it_does_not_state_is_refused(tmp_path):
    arm = tmp_path / "arm.xml"
    text = (
        f'<mujoco model="arm">{{}}<worldbody><body name="base">{_LINKS}</body></worldbody></mujoco>'
    )
    arm.write_text(text.format(""))
    with pytest.raises(
        InputError, match=r'turn by 3.1 degrees at most.*<compiler angle="radian"/>'
    ):
        read_document(arm)
    arm.write_text(text.format('<compiler angle="radian"/>'))
    read_document(arm)
    arm.write_text(text.format("").replace("-2 2", "-115 115"))  # degrees
    read_document(arm)


def test_damping_of_an_mjcf_does_not_count(tmp_path):
    """Fitted to measurements, it may be negative."""
    arm = tmp_path / "arm.xml"
    links = _LINKS.replace('name="elbow"', 'name="elbow" damping="-.01"')
    arm.write_text(
        '<mujoco model="arm"><compiler angle="radian"/><worldbody><body name="base">'
        f"{links}</body></worldbody></mujoco>"
    )
    root, _ = read_document(arm)
    assert sum(joint.find("limit") is not None for joint in root.iter("joint")) == 3


_HAND = '<body name="{}" pos=".1 0 .2"><inertial pos="0 0 0" mass=".5" diaginertia="1 1 1"/></body>'


def test_a_frame_of_an_mjcf_places_what_is_in_it(tmp_path):
    """Drake alone leaves it out in silence, with the mass of the bodies in it."""
    inner = f'<frame quat=".8 0 0 .6" pos="0 .1 0">{_HAND.format("left")}</frame>'
    links = _LINKS.replace('<joint name="wrist"', f'{inner}<joint name="wrist"')
    assert inner in links
    text = (
        '<mujoco model="arm"><compiler angle="radian"/><worldbody><body name="base">'
        f"{links}</body></worldbody></mujoco>"
    )
    (tmp_path / "arm.xml").write_text(text)
    root, _ = read_document(tmp_path / "arm.xml")
    import mujoco

    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModelsFromString(ET.tostring(root, encoding="unicode"), "urdf")
    plant.Finalize()
    context = plant.CreateDefaultContext()
    hand, left = (plant.GetFrameByName(name) for name in ("hand", "left"))
    X = left.CalcPose(context, hand)
    R_WH = np.array(data.body("hand").xmat).reshape(3, 3)
    p_WL = np.array(data.body("left").xpos - data.body("hand").xpos)
    np.testing.assert_allclose(X.translation(), R_WH.T @ p_WL, atol=1e-12)
    masses = [float(mass.get("value")) for mass in root.iter("mass")]
    # The frame itself has a negligible mass, which is left out.
    assert sum(masses) == pytest.approx(float(model.body_mass.sum()))


@pytest.mark.parametrize("tag", ["replicate", "attach"])
def test_bodies_that_mujoco_alone_writes_out_are_refused_with_its_command(tmp_path, tag):
    links = _LINKS.replace('<joint name="wrist"', f'<{tag} count="3"/><joint name="wrist"')
    arm = tmp_path / "arm.xml"
    arm.write_text(
        '<mujoco model="arm"><compiler angle="radian"/><worldbody><body name="base">'
        f"{links}</body></worldbody></mujoco>"
    )
    with pytest.raises(InputError, match=f"<{tag}>.*mj_saveLastXML.*'arm.xml'.* draft that"):
        read_document(arm)


_PALM = f"""<model name="{{}}"><pose relative_to="lower">0 0 .1 0 0 0</pose>
  <link name="palm">{INERTIAL.format(mass=0.8)}
    <collision name="c"><geometry><sphere><radius>.05</radius></sphere></geometry></collision>
  </link></model>
<joint name="{{}}" type="fixed"><parent>lower</parent><child>{{}}::palm</child></joint>"""


def test_models_within_a_model_of_an_sdf_are_part_of_it(tmp_path):
    """Links of the same name get those of their models."""
    palms = "".join(_PALM.format(name, f"{name}_joint", name) for name in ("left", "right"))
    text = SDF.replace("</model></sdf>", f"{palms}</model></sdf>")
    (tmp_path / "arm.sdf").write_text(text, encoding="utf-8")
    root, _ = read_document(tmp_path / "arm.sdf")
    links = {link.get("name"): link for link in root.findall("link")}
    assert {"left_palm", "right_palm"} <= links.keys()
    assert links["left_palm"].find("collision/geometry/sphere") is not None
    (tmp_path / "robot.yaml").write_text(CONFIG, encoding="utf-8")
    robot = Robot.load(tmp_path / "robot.yaml")
    assert robot.chain.inertial_parameters[1, 0] == pytest.approx(1.0 + 2 * 0.8)


def test_of_a_world_the_model_that_moves_is_read(tmp_path):
    ground = '<model name="ground"><static>1</static><link name="plane"/></model>'
    text = SDF.replace('<model name="arm">', f'<world name="w">{ground}<model name="arm">')
    (tmp_path / "arm.sdf").write_text(text.replace("</sdf>", "</world></sdf>"), encoding="utf-8")
    root, _ = read_document(tmp_path / "arm.sdf")
    assert [link.get("name") for link in root.findall("link")][:2] == ["base", "upper"]
    assert root.get(LEFT_OUT) == "ground"


def test_an_mjcf_that_is_turned_by_right_angles_in_radians_is_refused(tmp_path):
    """As fragments are that a program puts under a compiler of its own."""
    links = _LINKS.replace("-2 2", "-115 115").replace('"0 0 .4"', '"0 0 .4" euler="0 1.57 0"')
    arm = tmp_path / "arm.xml"
    text = (
        f'<mujoco model="arm">{{}}<worldbody><body name="base">{links}</body></worldbody></mujoco>'
    )
    arm.write_text(text.format(""))
    with pytest.raises(InputError, match=r'euler="0 1.57 0" degrees.*<compiler angle="radian"/>'):
        read_document(arm)
    arm.write_text(text.format('<compiler angle="degree"/>'))
    read_document(arm)


def test_things_that_float_beside_an_arm_of_an_mjcf_are_left_out(tmp_path):
    thing = '<body name="cube"><freejoint/><geom type="box" size=".1 .1 .1"/></body>'
    arm = tmp_path / "scene.xml"
    arm.write_text(
        '<mujoco model="arm"><compiler angle="radian"/><worldbody>'
        f'<body name="base">{_LINKS}</body>{thing}</worldbody></mujoco>'
    )
    root, _ = read_document(arm)
    names = [link.get("name") for link in root.findall("link")]
    assert "base" in names and "cube" not in names
    assert root.get(LEFT_OUT) == "cube"


def test_frames_of_an_sdf_are_links(tmp_path):
    frame = '<frame name="tool0" attached_to="lower"><pose>0 0 .1 0 .3 0</pose></frame>'
    text = SDF.replace("</model></sdf>", f"{frame}</model></sdf>")
    (tmp_path / "arm.sdf").write_text(text)
    root, _ = read_document(tmp_path / "arm.sdf")
    links = [link.get("name") for link in root.findall("link")]
    assert links[-1] == "tool0" and len(links) == len({*links})
    (tmp_path / "robot.yaml").write_text(CONFIG.replace("flange: lower", "flange: tool0"))
    robot = Robot.load(tmp_path / "robot.yaml")
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModelsFromString(text, "sdf")
    plant.Finalize()
    context = plant.CreateDefaultContext()
    q = np.array([0.7, 0.2])
    plant.SetPositions(context, q)
    expected = plant.GetFrameByName("tool0").CalcPoseInWorld(context)
    terms = robot.chain.terms(q, np.zeros(2))
    np.testing.assert_allclose(terms.p_WE, expected.translation(), atol=1e-12)
    np.testing.assert_allclose(terms.R_WE, expected.rotation().matrix(), atol=1e-12)
