"""A robot.yaml from a URDF alone, of robots that nobody here wrote."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from wrenchsight.analyses.__main__ import app
from wrenchsight.analyses.methods.robot.draft_text import FILL_IN
from wrenchsight.analyses.methods.robot.robot_draft import XacroTrust, draft_robot
from wrenchsight.diagrams.distances.clearance import Clearance
from wrenchsight.models.files.configuration import load_configuration
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import RobotConfig


@pytest.mark.parametrize(
    ("urdf", "base", "flange", "num_joints"),
    [
        ("ur_description/urdf/ur5_robot.urdf", "base_link", "tool0", 6),
        ("panda_description/urdf/panda.urdf", "panda_link0", "panda_hand_tcp", 7),
        ("z1_description/urdf/z1.urdf", "link00", "link06", 6),
        ("xarm_description/urdf/xarm7.urdf", "link_base", "link_eef", 7),
        ("kinova_description/robots/kinova.urdf", "base", "j2s6s200_link_6", 6),
        (
            "talos_data/robots/talos_left_arm.urdf",
            "arm_left_1_link",
            "wrist_left_ft_tool_link",
            6,
        ),
    ],
)
def test_the_arm_is_found_and_loads(
    wheel_robots: Path, tmp_path: Path, urdf: str, base: str, flange: str, num_joints: int
) -> None:
    out = tmp_path / "robot.yaml"
    robot, places, _ = draft_robot(wheel_robots / urdf, out)
    assert (robot.config.base_link, robot.config.flange) == (base, flange)
    assert robot.num_joints == num_joints
    assert places == ("tool_frame", "payload", "drives")
    assert [file.name for file in tmp_path.iterdir()] == ["robot.yaml"]
    text = out.read_text()
    assert text.count(FILL_IN) >= 3 + num_joints  # the head, frame, payload and every drive
    load_configuration(out, RobotConfig)  # every required key is there
    # A posture to start from: within limits, free of contact, far from singular.
    again = Robot.load(out)
    np.testing.assert_array_equal(again.home, robot.home)
    assert float(again.chain.condition_number(again.home)) < 30.0
    floor = None if "talos" in urdf else 0.0  # its arm alone hangs below its base link
    # The hulls of Talos' concave wrist always overlap; excite says that it does not check them.
    wrist = {"arm_left_5_link and arm_left_7_link"}
    assert set(Clearance(again, floor=floor).overlapping) <= (wrist if "talos" in urdf else set())


def test_base_and_flange_may_be_named(wheel_robots: Path, tmp_path: Path) -> None:
    urdf = wheel_robots / "z1_description/urdf/z1.urdf"
    out = tmp_path / "robot.yaml"
    robot, *_ = draft_robot(urdf, out, base="link01", flange="gripperMover")
    assert robot.joint_names == ("joint2", "joint3", "joint4", "joint5", "joint6", "jointGripper")
    with pytest.raises(InputError, match="exists already"):
        draft_robot(urdf, out)
    other = tmp_path / "other.yaml"
    with pytest.raises(InputError, match="linc: is no link of it; links: gripperMover"):
        draft_robot(urdf, other, flange="linc")
    with pytest.raises(InputError, match='is not connected to "link05"'):
        draft_robot(urdf, other, base="link05", flange="link02")
    assert not other.exists()


def test_the_urdf_beside_it_is_named_relatively(tmp_path: Path, wheel_robots: Path) -> None:
    urdf = tmp_path / "my arm.urdf"
    urdf.write_text((wheel_robots / "ur_description/urdf/ur5_robot.urdf").read_text())
    robot, *_ = draft_robot(urdf, tmp_path / "robot.yaml")
    assert yaml.safe_load((tmp_path / "robot.yaml").read_text())["urdf"] == "my arm.urdf"
    # Its meshes are elsewhere now: the links are named, and clearance is not checked.
    assert len(robot.unusable_collisions) == 7


def test_several_arms_need_a_flange(wheel_robots: Path, tmp_path: Path) -> None:
    urdf = wheel_robots / "talos_data/robots/talos_reduced.urdf"
    with pytest.raises(InputError, match=r"carries several arms or legs.*--flange"):
        draft_robot(urdf, tmp_path / "robot.yaml", base="torso_2_link")


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.sdf", "<sdf/>", "holds 0 models, expected one"),
        ("a.xml", "<mujoco/>", "a.xml: "),
        ("a.urdf", "<robot>", "no valid XML"),
        ("robot.yaml", "name: a", "expected a URDF.*wrenchsight robot show .*robot.yaml$"),
        ("a.urdf", "<robot name='a'><link name='b'/></robot>", "holds no <joint>"),
    ],
)
def test_a_description_without_an_arm_is_refused(
    tmp_path: Path, name: str, text: str, words: str
) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=words):
        draft_robot(tmp_path / name, tmp_path / "robot.yaml")
    with pytest.raises(InputError, match="no such file"):
        draft_robot(tmp_path / "none.urdf", tmp_path / "robot.yaml")


def arm_with_gripper(path: Path) -> Path:
    """Writes a URDF as SO-101's: the wrist carries a link "gripper_link", which carries a jaw."""
    names = ["base", "shoulder", "upper", "lower", "wrist", "gripper_link", "moving_jaw"]
    joints = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]
    mass = (
        "<inertial><mass value='0.3'/><inertia ixx='1e-3' iyy='1e-3' izz='1e-3' "
        "ixy='0' ixz='0' iyz='0'/></inertial>"
    )
    parts = [f"<link name='{name}'>{mass}</link>" for name in names]
    for k, name in enumerate(joints):
        axis = "0 1 0" if name in ("shoulder_lift", "elbow_flex", "wrist_flex") else "0 0 1"
        parts.append(
            f"<joint name='{name}' type='revolute'><parent link='{names[k]}'/>"
            f"<child link='{names[k + 1]}'/><origin xyz='0.02 0 0.1'/><axis xyz='{axis}'/>"
            "<limit lower='-1.9' upper='1.9' velocity='3' effort='10'/></joint>"
        )
    path.write_text(f"<robot name='arm'>{''.join(parts)}</robot>")
    return path


def test_a_home_posture_keeps_limits_that_are_narrower_than_its_digits(tmp_path: Path) -> None:
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    urdf.write_text(
        urdf.read_text().replace("lower='-1.9' upper='1.9'", "lower='.101' upper='.104'", 1)
    )
    robot, *_ = draft_robot(urdf, tmp_path / "robot.yaml")
    assert 0.101 <= robot.home[0] <= 0.104


def test_a_joint_that_carries_the_gripper_is_the_arms(tmp_path: Path) -> None:
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    robot, *_ = draft_robot(urdf, tmp_path / "robot.yaml")
    assert robot.joint_names[-1] == "wrist_roll"
    assert robot.num_joints == 5
    assert robot.config.flange == "gripper_link"


def test_no_joint_is_held_still_without_a_line(tmp_path: Path) -> None:
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    result = CliRunner().invoke(app, ["robot", str(urdf), "--out", str(tmp_path / "robot.yaml")])
    message = " ".join(result.output.split())
    assert "note: gripper is held still at 0 rad (locked_joints)" in message
    assert "--flange moving_jaw" in message


def test_a_trusted_xacro_becomes_a_urdf_beside_the_file(tmp_path: Path) -> None:
    pytest.importorskip("xacro", reason="the package xacro is not installed")
    urdf = arm_with_gripper(tmp_path / "arm.xacro")
    text = urdf.read_text().replace("<mass value='0.3'/>", "<mass value='${mass}'/>")
    head = (
        "<robot name='arm' xmlns:xacro='http://www.ros.org/wiki/xacro'>"
        "<xacro:arg name='mass' default='0.3'/><xacro:property name='mass' value='$(arg mass)'/>"
    )
    urdf.write_text(text.replace("<robot name='arm'>", head))
    out = tmp_path / "robot.yaml"
    words = ["robot", str(urdf), "--xacro-arg", "mass:=0.6", "--out", str(out)]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 2
    assert "--trust-xacro" in result.stderr
    assert not out.exists()
    result = CliRunner().invoke(app, [*words, "--trust-xacro"])
    assert result.exit_code == 0, result.output
    urdf.unlink()  # it is not read again
    masses = Robot.load(out).chain.inertial_parameters[:, 0]
    np.testing.assert_allclose(masses[:-1], 0.6)  # the last one carries the jaw
    result = CliRunner().invoke(app, [*words[:3], "mass=1"])
    assert result.exit_code == 2
    assert "write NAME:=VALUE" in result.stderr


def test_an_expanded_file_without_an_arm_leaves_nothing(tmp_path: Path) -> None:
    pytest.importorskip("xacro", reason="the package xacro is not installed")
    path = tmp_path / "a.xacro"
    path.write_text(
        "<robot name='a' xmlns:xacro='http://www.ros.org/wiki/xacro'>"
        "<xacro:property name='b' value='1'/><link name='c'/></robot>"
    )
    with pytest.raises(InputError, match="holds no <joint>"):
        draft_robot(path, tmp_path / "out.yaml", xacro=XacroTrust(is_trusted=True))
    assert [file.name for file in tmp_path.iterdir()] == ["a.xacro"]


def mounted(path: Path, origin: str) -> Path:
    """The arm with a gripper on a fixed joint from `world`."""
    urdf = arm_with_gripper(path)
    bolted = (
        "<link name='world'/><joint name='bolts' type='fixed'><parent link='world'/>"
        f"<child link='base'/><origin {origin}/></joint></robot>"
    )
    urdf.write_text(urdf.read_text().replace("</robot>", bolted))
    return urdf


@pytest.mark.parametrize(
    ("origin", "gravity", "floor"),
    [
        ("xyz='0 0 0.8'", [0.0, 0.0, -9.81], -0.8),
        ("xyz='0 0 2' rpy='3.14159265 0 0'", [0.0, 0.0, 9.81], None),
        ("rpy='0 1.5708 0'", [9.81, 0.0, 0.0], None),
        ("rpy='0 0 1'", [0.0, 0.0, -9.81], 0.0),
    ],
)
def test_gravity_and_floor_follow_the_mounting(
    tmp_path: Path, origin: str, gravity: list[float], floor: float | None
) -> None:
    urdf = mounted(tmp_path / "arm.urdf", origin)
    robot, _, notes = draft_robot(urdf, tmp_path / "robot.yaml")
    np.testing.assert_allclose(robot.gravity, gravity, atol=1e-4)
    assert robot.floor == floor
    assert "floor: -0 " not in (tmp_path / "robot.yaml").read_text()
    turned = [note for note in notes if "turned by" in note]
    assert len(turned) == (floor is None)
    assert not any("gravity" in notice for notice in robot.notices)
    # A robot.yaml that says otherwise is told so.
    lines = (tmp_path / "robot.yaml").read_text().splitlines()
    lines = ["gravity: [0, 9.81, 0]" if "gravity:" in line else line for line in lines]
    (tmp_path / "other.yaml").write_text("\n".join(lines))
    assert any("states gravity" in n for n in Robot.load(tmp_path / "other.yaml").notices)


@pytest.mark.parametrize(("foot", "floor"), [(-0.9, -0.9), (-0.03, 0.0)])
def test_the_floor_is_no_higher_than_what_the_machine_stands_on(
    tmp_path: Path, foot: float, floor: float
) -> None:
    """A leg that a joint moves, held still, ends at `foot` in W; a base plate may be sunk."""
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    leg = (
        "<link name='leg'><collision><geometry><box size='0.1 0.1 0.02'/></geometry></collision>"
        "</link><joint name='knee' type='revolute'><parent link='base'/><child link='leg'/>"
        f"<origin xyz='0 0 {foot + 0.01}'/><axis xyz='0 0 1'/>"
        "<limit lower='-1' upper='1' velocity='3' effort='10'/></joint></robot>"
    )
    urdf.write_text(urdf.read_text().replace("</robot>", leg))
    robot, _, notes = draft_robot(urdf, tmp_path / "robot.yaml", flange="gripper_link")
    assert robot.floor == pytest.approx(floor, abs=1e-9)
    said = [note for note in notes if "floor is assumed at -0.9 m in W: leg, " in note]
    assert len(said) == (floor < 0.0)


def test_placeholder_efforts_are_filled_in_with_what_gravity_needs(tmp_path: Path) -> None:
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    text = urdf.read_text().replace("effort='10'", "effort='1'")
    urdf.write_text(
        text.replace(
            "effort='1'/></joint><joint name='gripper'", "effort='8'/></joint><joint name='gripper'"
        )
    )
    robot, places, notes = draft_robot(urdf, tmp_path / "robot.yaml")
    assert "effort_limit" in places
    (note,) = [note for note in notes if "cannot hold or move the arm" in note]
    assert "shoulder_lift states 1 N m" in note
    q = np.random.default_rng(2).uniform(-1.9, 1.9, (500, 5))
    holding = np.abs(robot.chain.gravity_torque(q)).max(axis=0)
    assert (robot.effort_limit[:4] > 1.2 * holding[:4]).all()
    assert robot.effort_limit[4] == 8.0  # which holds its link
    assert robot.effort_limit[0] >= 1.0  # the same placeholder, where gravity asks nothing


def test_efforts_that_no_drive_of_the_arm_has_are_filled_in(tmp_path: Path) -> None:
    """1000 N m where the shoulder carries 2; a rotor that fits them is not assumed either."""
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    urdf.write_text(urdf.read_text().replace("effort='10'", "effort='1000'"))
    robot, places, notes = draft_robot(urdf, tmp_path / "robot.yaml")
    assert "effort_limit" in places
    (note,) = [note for note in notes if "more than 20 times" in note]
    assert "shoulder_lift states 1000 N m" in note
    q = np.random.default_rng(2).uniform(-1.9, 1.9, (500, 5))
    holding = np.abs(robot.chain.gravity_torque(q)).max(axis=0)
    assert (robot.effort_limit > 1.2 * holding).all()
    assert (robot.effort_limit < 10.0 * holding.max()).all()
    assert (robot.reflected_inertia < robot.effort_limit / 290.0).all()


@pytest.mark.parametrize("stated", ["0", "1e9"])  # none; none either, as exporters write it
def test_an_unknown_effort_limit_holds_a_push_across_gravity(tmp_path: Path, stated: str) -> None:
    """A joint about the vertical and a wrist through E carry no weight of the payload."""
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    urdf.write_text(urdf.read_text().replace("effort='10'", f"effort='{stated}'"))
    robot, *_ = draft_robot(urdf, tmp_path / "robot.yaml")
    weight = robot.payload * 9.81
    q = np.random.default_rng(2).uniform(-1.9, 1.9, (500, 5))
    J = robot.chain.jacobian(q)
    reach = np.linalg.norm(J[:, 3:], axis=1).max(axis=0)
    assert (robot.effort_limit > 1.2 * weight * reach).all()
    assert (robot.effort_limit > 1.4 * weight * 0.05).all()  # of a load 5 cm beside E


def test_limits_of_an_arm_without_masses_follow_its_size(tmp_path: Path) -> None:
    """100 N m on each joint declared each sample of an IRB2400's log impossible."""
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    text = re.sub(r"<inertial>.*?</inertial>", "", urdf.read_text())
    limits = []
    for folder, scale in (("small", 1.0), ("large", 10.0)):
        (tmp_path / folder).mkdir()
        larger = text.replace("effort='10'", "effort='0'")
        for xyz in set(re.findall(r"<origin xyz='[^']*'", larger)):
            scaled = " ".join(f"{scale * float(x):g}" for x in re.findall(r"-?[.\d]+", xyz))
            larger = larger.replace(xyz, f"<origin xyz='{scaled}'")
        (tmp_path / folder / "arm.urdf").write_text(larger)
        robot, places, _ = draft_robot(tmp_path / folder / "arm.urdf", tmp_path / folder / "r.yaml")
        assert "effort_limit" in places
        q = np.random.default_rng(2).uniform(-1.9, 1.9, (500, 5))
        reach = np.linalg.norm(robot.chain.pose(q)[1] - robot.chain.p_PJ[0], axis=1).max()
        assert (robot.effort_limit > 6.0 * robot.payload * 9.81 * reach).all()
        limits.append(robot.effort_limit[0])
    assert limits[1] > 500.0 * limits[0]  # the cube of the size


@pytest.mark.parametrize("kept", [0, 4])
def test_an_arm_without_masses_is_simulated_with_assumed_ones(tmp_path: Path, kept: int) -> None:
    """Of files that ROS-Industrial has, none of the links; of a Gen3 lite's, the last one."""
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    head, *links = re.split(r"(?=<link )", urdf.read_text())
    bare = [re.sub("<inertial>.*?</inertial>", "", link) for link in links]
    urdf.write_text(head + "".join(links[:kept] + bare[kept:]))
    robot, _, _ = draft_robot(urdf, tmp_path / "robot.yaml")
    assert not robot.has_inertias  # of real logs no command takes them for the arm's
    simulated = robot.with_assumed_masses()
    masses = simulated.chain.inertial_parameters[:, 0]
    assert (masses > 0.0).all()
    assert (np.diff(masses[kept:]) <= 0.0).all()  # the nearer the tool, the lighter
    if not kept:
        assert masses.sum() == pytest.approx(robot.payload / 0.3, rel=0.05)
    assert (robot.truth.coulomb > 0.0).all()
    assert (robot.reflected_inertia > 0.0).all()


def test_a_strong_drive_is_no_placeholder(tmp_path: Path) -> None:
    urdf = arm_with_gripper(tmp_path / "arm.urdf")  # 10 N m: some five times what is needed
    robot, places, _ = draft_robot(urdf, tmp_path / "robot.yaml")
    assert "effort_limit" not in places
    np.testing.assert_array_equal(robot.effort_limit, 10.0)


def test_a_drafted_arm_has_friction_noise_and_steps_and_says_so(tmp_path: Path) -> None:
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    result = CliRunner().invoke(app, ["robot", str(urdf), "--out", str(tmp_path / "robot.yaml")])
    message = " ".join(result.output.split())
    assert "friction, rotors, noise and resolution of the simulated arm are assumed" in message
    robot = Robot.load(tmp_path / "robot.yaml")
    # Shoulder and lift carry .3 kg links .1 m apart: at most sum m g r, and no less than half.
    truth = robot.config.simulated_truth.friction
    reach = np.hypot(0.1, 0.02) * np.arange(1, 5)
    assert 0.5 < truth.coulomb[1] / (0.05 * 0.3 * 9.81 * reach.sum()) < 1.5
    assert (truth.stiction > truth.coulomb).all()
    for drive in robot.config.drives:
        assert drive.current_noise_sd > drive.current_resolution > 0.0
    assert truth.coulomb.min() >= 0.099 * truth.coulomb.max()


def test_a_collision_mesh_that_is_missing_is_named_with_the_place_it_was_looked_for(
    tmp_path: Path,
) -> None:
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    mesh = "<collision><geometry><mesh filename='package://arm/upper.stl'/></geometry></collision>"
    text = urdf.read_text().replace("<link name='upper'>", "<link name='upper'>" + mesh)
    urdf.write_text(text)
    robot, *_ = draft_robot(urdf, tmp_path / "robot.yaml")
    [lost] = robot.unusable_collisions
    place = tmp_path / "arm" / "upper.stl"
    assert lost == f"upper (package://arm/upper.stl not found, searched for at {place} and above)"


def test_a_rail_that_cannot_move_what_it_carries_has_a_placeholder(tmp_path: Path) -> None:
    """Gravity asks nothing of it; 1 N for 2.1 kg does."""
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    rail = (
        "<link name='floor'/><joint name='rail' type='prismatic'><parent link='floor'/>"
        "<child link='base'/><axis xyz='0 1 0'/>"
        "<limit lower='-1' upper='1' velocity='1' effort='0.5'/></joint></robot>"
    )
    urdf.write_text(urdf.read_text().replace("</robot>", rail))
    robot, places, notes = draft_robot(urdf, tmp_path / "robot.yaml")
    assert "effort_limit" in places
    assert any("rail states 0.5 N" in note for note in notes)
    assert robot.effort_limit[0] > 5.0 * 2.1  # a brisk start
    # The rail's newtons are no measure of a wrist's newton metres.
    coulomb = robot.config.simulated_truth.friction.coulomb
    assert coulomb[-1] < 0.1 * coulomb[0]


def test_what_leaves_the_arm_no_room_at_home_is_named(tmp_path: Path) -> None:
    """A cage about the arm that another joint moves."""
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    ball = "<collision><geometry><sphere radius='0.02'/></geometry></collision>"
    text = urdf.read_text().replace("<link name='wrist'>", f"<link name='wrist'>{ball}")
    plates = "".join(
        f"<collision><origin xyz='0 0 {0.05 * k:.2f}'/><geometry><box size='2 2 0.005'/></geometry>"
        "</collision>"
        for k in range(-10, 15)
    )
    cage = (
        f"<link name='cage'>{plates}</link><joint name='door' type='prismatic'>"
        "<parent link='base'/><child link='cage'/><axis xyz='0 1 0'/>"
        "<limit lower='0' upper='9' velocity='1' effort='1'/></joint></robot>"
    )
    urdf.write_text(text.replace("</robot>", cage))
    _, _, notes = draft_robot(urdf, tmp_path / "robot.yaml", flange="gripper_link")
    (note,) = [note for note in notes if "no posture with more room" in note]
    assert "wrist" in note and "cage" in note
    assert "locked_joints" in note


def test_impossible_inertias_are_mended_in_the_draft(tmp_path: Path) -> None:
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    urdf.write_text(urdf.read_text().replace("izz='1e-3'", "izz='3e-3'", 4))
    robot, _, _ = draft_robot(urdf, tmp_path / "robot.yaml")
    assert robot.has_inertias
    assert any("(possible_inertias): base, shoulder" in text for text in robot.notices)
    assert "possible_inertias: true" in (tmp_path / "robot.yaml").read_text()
    assert robot.config.simulated_truth.friction.coulomb.min() > 0.0  # as of any arm with masses


def test_joints_without_a_stated_rotor_have_one_of_their_drives_size(tmp_path: Path) -> None:
    """Without it a drive would turn the wrist at 1e4 rad/s^2: logs leave its inertia open."""
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    robot, *_ = draft_robot(urdf, tmp_path / "robot.yaml")
    text = (tmp_path / "robot.yaml").read_text()
    assert "at 300 rad/s^2" in text
    acceleration = robot.effort_limit / robot.reflected_inertia
    # The file's 10 N m, or what such a joint needs where that is less: an exporter's 10 N m on
    # every joint makes no wrist's rotor large.
    assert (acceleration > 0.97 * 300.0).all()
    assert (acceleration[:3] < 3e3).all()


def test_rotors_that_the_description_states_are_kept(tmp_path: Path) -> None:
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    name = draft_robot(urdf, tmp_path / "robot.yaml").robot.joint_names[1]
    transmission = (
        f"<transmission name='t'><joint name='{name}'/><actuator name='m'><drake:rotor_inertia "
        "value='1e-5'/><drake:gear_ratio value='100'/></actuator></transmission></robot>"
    )
    urdf.write_text(urdf.read_text().replace("</robot>", transmission))
    robot, *_ = draft_robot(urdf, tmp_path / "with_rotor.yaml")
    np.testing.assert_allclose(robot.reflected_inertia[1], 0.1, rtol=1e-9)


def test_the_armature_of_an_mjcf_is_the_rotor(tmp_path: Path) -> None:
    body = "<body pos='0 0 .3'><inertial pos='0 0 .1' mass='1' diaginertia='.01 .01 .01'/>"
    (tmp_path / "arm.xml").write_text(
        "<mujoco><compiler angle='radian'/><default><joint armature='.03'/></default><worldbody>"
        + "".join(
            f"{body}<joint name='j{i}' axis='{axis}' range='-2 2' {armature}/>"
            for i, (axis, armature) in enumerate(
                [("0 0 1", ""), ("0 1 0", "armature='.05'"), ("0 1 0", "armature='0'")]
            )
        )
        + 3 * "</body>"
        + "</worldbody><actuator>"
        + "".join(f"<motor joint='j{i}' ctrlrange='-60 60'/>" for i in range(3))
        + "</actuator></mujoco>"
    )
    robot, *_ = draft_robot(tmp_path / "arm.xml", tmp_path / "robot.yaml")
    np.testing.assert_allclose(robot.reflected_inertia[:2], [0.03, 0.05], rtol=1e-9)
    assert robot.reflected_inertia[2] > 0.0  # assumed


def test_a_xacro_of_a_renamed_package_keeps_its_meshes(tmp_path: Path) -> None:
    pytest.importorskip("xacro", reason="the package xacro is not installed")
    folder = tmp_path / "copied"
    folder.mkdir()
    urdf = arm_with_gripper(folder / "arm.urdf")
    mesh = "<visual><geometry><mesh filename='package://old_arm/base.obj'/></geometry></visual>"
    macro = urdf.read_text().replace("</link>", f"{mesh}</link>", 1)
    (folder / "macro.xacro").write_text(macro)
    urdf.unlink()
    (folder / "base.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (folder / "arm.xacro").write_text(
        "<robot name='arm' xmlns:xacro='http://www.ros.org/wiki/xacro'>"
        "<xacro:include filename='$(find old_arm)/macro.xacro'/></robot>"
    )
    _, _, notes = draft_robot(
        folder / "arm.xacro", tmp_path / "robot.yaml", xacro=XacroTrust(is_trusted=True)
    )
    assert f'asks for the package "old_arm", which is not found: {folder}' in notes[0]
    assert (folder / "base.obj").as_uri() in (tmp_path / "robot.urdf").read_text()


@pytest.mark.parametrize("kind", ["planar", "floating"])
def test_an_arm_on_a_body_that_no_motor_holds_stands_on_that_body(
    tmp_path: Path, kind: str
) -> None:
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    footprint = (
        f"<link name='footprint'/><joint name='drives' type='{kind}'><parent link='footprint'/>"
        "<child link='base'/><axis xyz='0 0 1'/></joint></robot>"
    )
    urdf.write_text(urdf.read_text().replace("</robot>", footprint))
    robot, _, _ = draft_robot(urdf, tmp_path / "robot.yaml")
    assert robot.config.base_link == "base"
    assert robot.num_joints == 5


def test_joints_of_the_arm_that_move_with_one_motor_are_held_still(tmp_path: Path) -> None:
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    head, elbow, rest = urdf.read_text().partition("<joint name='elbow_flex' type='revolute'>")
    urdf.write_text(f"{head}{elbow}<mimic joint='shoulder_lift'/>{rest}")
    robot, _, notes = draft_robot(urdf, tmp_path / "robot.yaml", flange="gripper_link")
    assert robot.joint_names == ("shoulder_pan", "wrist_flex", "wrist_roll")
    assert robot.config.locked_joints == {"shoulder_lift": 0.0, "gripper": 0.0}
    assert any("shoulder_lift and the joints that follow it (mimic)" in note for note in notes)


def test_of_a_folder_the_robot_files_in_it_are_named(tmp_path: Path) -> None:
    (tmp_path / "urdf").mkdir()
    arm_with_gripper(tmp_path / "urdf" / "arm.urdf")
    (tmp_path / "package.xml").write_text("<package/>")
    with pytest.raises(InputError, match=r"is a directory.*robot files: [^ ]*urdf/arm.urdf$"):
        draft_robot(tmp_path, tmp_path / "robot.yaml")
    (tmp_path / "none").mkdir()
    with pytest.raises(InputError, match="name a robot file in it"):
        draft_robot(tmp_path / "none", tmp_path / "robot.yaml")


def test_ranges_in_degrees_are_refused(tmp_path: Path) -> None:
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    text = urdf.read_text()
    urdf.write_text(text.replace("lower='-1.9' upper='1.9'", "lower='-110' upper='110'"))
    with pytest.raises(InputError, match=r"5 joints turn by 110 to 110 rad.* would be 1.92 rad"):
        draft_robot(urdf, tmp_path / "robot.yaml")
    # Exporters write a large number where a joint has no end.
    urdf.write_text(text.replace("lower='-1.9' upper='1.9'", "lower='-1e5' upper='1e5'"))
    draft_robot(urdf, tmp_path / "robot.yaml")


def test_a_joint_that_states_no_range_is_named(tmp_path: Path) -> None:
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    text = urdf.read_text()
    limit = "<limit lower='-1.9' upper='1.9' velocity='3' effort='10'/>"
    urdf.write_text(text.replace(limit, "", 1))
    robot, *_ = draft_robot(urdf, tmp_path / "robot.yaml")
    assert any("no range of shoulder_pan: a motion may turn" in note for note in robot.notices)
    assert np.isinf(robot.position_upper[0])


def test_meshes_in_millimetres_are_refused_with_their_scale(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    trimesh.creation.box((40.0, 40.0, 90.0)).export(tmp_path / "link.stl")
    mesh = "<collision><geometry><mesh filename='link.stl'{}/></geometry></collision><inertial>"
    text = urdf.read_text()
    urdf.write_text(text.replace("<inertial>", mesh.format("")))
    expected = (
        r'about 90 m long.*in millimetres it would be 0.09 m; write scale="0.001 0.001 0.001"'
    )
    with pytest.raises(InputError, match=expected):
        draft_robot(urdf, tmp_path / "robot.yaml")
    urdf.write_text(text.replace("<inertial>", mesh.format(" scale='0.001 0.001 0.001'")))
    robot, *_ = draft_robot(urdf, tmp_path / "robot.yaml")
    assert max(robot.collision_mesh_lengths.values()) == pytest.approx(0.09)


def test_a_xacro_that_only_defines_a_macro_is_told_how_it_is_called(tmp_path: Path) -> None:
    pytest.importorskip("xacro", reason="the package xacro is not installed")
    path = tmp_path / "arm.xacro"
    path.write_text(
        "<robot xmlns:xacro='http://www.ros.org/wiki/xacro' name='arm'>"
        "<xacro:macro name='arm' params='prefix *origin mass:=1'><link name='${prefix}base'/>"
        "</xacro:macro></robot>"
    )
    with pytest.raises(
        InputError, match=r'calls it nowhere.* <xacro:arm prefix="..." mass="..."/>'
    ):
        draft_robot(path, tmp_path / "out.yaml", xacro=XacroTrust(is_trusted=True))
    assert [file.name for file in tmp_path.iterdir()] == ["arm.xacro"]


def test_two_robots_of_the_same_names_in_a_file_are_told_to_take_prefixes(tmp_path: Path) -> None:
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    body = urdf.read_text().removeprefix("<robot name='arm'>").removesuffix("</robot>")
    urdf.write_text(f"<robot name='arm'>\n{body}\n{body}</robot>")
    expected = r'line 3: a second link "base", as line 2 has it; .* a prefix'
    with pytest.raises(InputError, match=expected):
        draft_robot(urdf, tmp_path / "robot.yaml")


def test_a_palletiser_is_refused_with_the_flange_before_its_parallelogram(tmp_path: Path) -> None:
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    text = urdf.read_text().replace("'gripper'", "'turn'").replace("moving_jaw", "plate")
    level = "<joint name='wrist_flex' type='revolute'>"
    urdf.write_text(text.replace(level, f"{level}<mimic joint='elbow_flex' multiplier='-1'/>"))
    expected = r'"wrist_flex" follows "elbow_flex" .* carries "wrist_roll".*--flange lower$'
    with pytest.raises(InputError, match=expected):
        draft_robot(urdf, tmp_path / "robot.yaml")
    robot, _, notes = draft_robot(urdf, tmp_path / "robot.yaml", flange="lower")
    assert robot.joint_names == ("shoulder_pan", "shoulder_lift", "elbow_flex")
    assert any("wrist_flex" in note and "counts as rigid" in note for note in notes)
    assert not any("--flange" in note for note in notes)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            "<origin xyz='0.02 0 0.1'/>",
            "<origin xyz='0.02 0 0.1' rpy='90 0 -45'/>",
            r'turned by 90 0 -45 rad, more than a whole turn.* write rpy="1.5708 0 -0.785398"',
        ),
        (
            "<child link='upper'/>",
            "<child link='uper'/>",
            'child link "uper" does not exist; .*"upper"',
        ),
        (
            "<axis xyz='0 1 0'/>",
            "<axis xyz='0 1 0'/><mimic joint='motor'/>",
            '"shoulder_lift" follows "motor" .mimic., which is no joint',
        ),
        ("lower='-1.9'", "lower='${-pi}'", r"expected a number; it is xacro, not yet expanded"),
    ],
)
def test_a_slip_in_a_joint_is_named(tmp_path: Path, old: str, new: str, expected: str) -> None:
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    urdf.write_text(urdf.read_text().replace(old, new, 1))
    with pytest.raises(InputError, match=expected):
        draft_robot(urdf, tmp_path / "robot.yaml")


def test_an_infinite_effort_limit_is_none(tmp_path: Path) -> None:
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    urdf.write_text(urdf.read_text().replace("effort='10'", "effort='inf'"))
    _, places, _ = draft_robot(urdf, tmp_path / "robot.yaml")
    assert "effort_limit" in places


def test_limits_of_0_are_told_as_what_the_file_wrote(tmp_path: Path) -> None:
    urdf = arm_with_gripper(tmp_path / "arm.urdf")
    text = urdf.read_text()
    assert "effort='10'" in text and "velocity='" in text
    text = text.replace("effort='10'", "effort='0'")
    text = re.sub(r"velocity='[^']*'", "velocity='0'", text, count=1)
    urdf.write_text(text)
    draft_robot(urdf, tmp_path / "robot.yaml")
    drives = [
        line for line in (tmp_path / "robot.yaml").read_text().splitlines() if "joint:" in line
    ]
    assert "also effort_limit, for which the file wrote 0" in drives[0]
    assert "speed 0 in the file: taken for none" in drives[0]
    assert "speed 0" not in drives[1]


def test_what_a_scene_holds_beside_the_arm_is_named(tmp_path: Path) -> None:
    body = "<body pos='0 0 .3'><inertial pos='0 0 .1' mass='1' diaginertia='.01 .01 .01'/>"
    cube = "<body name='cube'><freejoint/><geom type='box' size='.1 .1 .1'/></body>"
    (tmp_path / "arm.xml").write_text(
        "<mujoco><compiler angle='radian'/><worldbody>"
        + "".join(
            f"{body}<joint name='j{i}' axis='{axis}' range='-2 2'/>"
            for i, axis in enumerate(["0 0 1", "0 1 0", "0 1 0"])
        )
        + f"{3 * '</body>'}{cube}</worldbody></mujoco>"
    )
    draft = draft_robot(tmp_path / "arm.xml", tmp_path / "robot.yaml")
    assert "left out, as no joint moves it and it is none of the arm's: cube" in draft.notes
