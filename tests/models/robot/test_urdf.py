"""What stands around an arm, and what hangs on it without an inertia of its own."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from wrenchsight.diagrams.distances.clearance import Clearance
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.urdf_pictures import resolved_mesh

_INERTIAL = """<inertial><mass value="{m}"/><origin xyz="0 0 -.2"/>
<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial>"""


def _machine(
    tmp_path: Path, finger: str = "", base: str = "torso", column: float = 0.0, **config: object
) -> Robot:
    """A cart with a column, a torso that the column lifts, and a hanging arm of two links."""
    whole = _INERTIAL.format(m=1, i=0.01)
    ball = (
        '<collision><origin xyz="0 0 -.4"/><geometry><sphere radius=".05"/></geometry></collision>'
    )
    limit = '<limit lower="-3" upper="3" velocity="2" effort="50"/>'

    def joint(name: str, kind: str, parent: str, child: str, xyz: str, axis: str) -> str:
        return (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}" rpy="0 0 0"/><axis xyz="{axis}"/>{limit}</joint>'
        )

    urdf = f"""<robot name="machine">
    <link name="cart"><collision><origin xyz=".6 0 0"/><geometry><box size=".4 .4 .4"/></geometry>
    </collision></link><link name="column"/><link name="torso"/>
    <link name="l1">{whole}</link><link name="l2">{whole}{ball}</link>
    <link name="hand"/><link name="finger">{finger}</link>
    {joint("turn", "revolute", "cart", "column", "0 0 0.1", "0 0 1")}
    {joint("lift", "prismatic", "column", "torso", "0 0 0.7", "0 0 1")}
    {joint("shoulder", "revolute", "torso", "l1", "0 0 0", "0 1 0")}
    {joint("elbow", "revolute", "l1", "l2", "0 0 -.4", "1 0 0")}
    {joint("wrist", "fixed", "l2", "hand", "0 0 -.4", "1 0 0")}
    {joint("grip", "revolute", "hand", "finger", "0 0 0", "1 0 0")}</robot>"""
    (tmp_path / "machine.urdf").write_text(urdf)
    drives = [{"joint": name, "torque_per_ampere": 1.0, "rotor_inertia": 0.0}
              for name in ("shoulder", "elbow")]  # fmt: skip
    settings = {
        "name": "machine",
        "urdf": "machine.urdf",
        "base_link": base,
        "flange": "hand",
        "payload": 1.0,
        "home": [0.0, 0.0],
        "drives": drives,
        "locked_joints": {"grip": 0.0, "lift": column},
    } | config
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(settings))
    return Robot.load(tmp_path / "robot.yaml")


def _hits(robot: Robot) -> bool:
    """Whether the ball at the arm's end, .8 m from the shoulder, meets the cart's box."""
    return Clearance(robot, floor=None).slack([-np.arctan2(0.6, 0.8), 0.0]) < 0.0


def test_the_machine_around_the_arm_is_an_obstacle(tmp_path: Path) -> None:
    """Where its joints stand: the box is 0.8 m below the torso, or 1.8 m."""
    robot = _machine(tmp_path)
    assert _hits(robot)
    assert any("obstacles at rest" in text and "cart" in text for text in robot.notices)
    assert "cart" not in robot.urdf_text  # of a simulation or a picture it is no part
    assert not _hits(_machine(tmp_path, column=1.0))
    turned = _machine(tmp_path, locked_joints={"grip": 0.0, "lift": 0.0, "turn": np.pi})
    assert not _hits(turned)


def test_the_obstacle_stands_where_the_urdf_has_it(tmp_path: Path) -> None:
    """The distance straight down, by hand: from the hanging ball to the box."""
    robot = _machine(tmp_path)
    pairs = Clearance(robot, floor=None).slacks([0.0, 0.0], 2.0)
    (pair,) = (pair for pair in pairs if "cart" in (pair.first, pair.second))
    ball = np.array([0.0, 0.0, -0.8])
    box = np.array([0.6, 0.0, -0.8])
    outside = np.maximum(np.abs(ball - box) - 0.2, 0.0)
    assert pair.distance == pytest.approx(np.linalg.norm(outside) - 0.05, abs=1e-6)


def test_a_locked_finger_without_inertia_does_not_stop_the_arm(tmp_path: Path) -> None:
    bad = _INERTIAL.format(m=0.1, i="1e-7").replace('izz="1e-7"', 'izz="1"')
    robot = _machine(tmp_path, bad)
    assert robot.has_inertias
    (notice,) = (text for text in robot.notices if "point mass" in text)
    assert 'link "finger"' in notice
    with_mass = robot.chain.inertial_parameters[:, 0].sum()
    assert with_mass == pytest.approx(2.1)


def test_a_mass_that_is_no_number_spares_kinematics(tmp_path: Path) -> None:
    robot = _machine(tmp_path, _INERTIAL.format(m="heavy", i="1e-7"))
    assert robot.num_joints == 2
    with pytest.raises(InputError, match='value="heavy" of <mass>, expected a number'):
        robot.require_inertias("simulate")


def test_the_moving_link_itself_needs_one(tmp_path: Path) -> None:
    robot = _machine(tmp_path)
    text = (tmp_path / "machine.urdf").read_text().replace('izz="0.01"', 'izz="1"', 1)
    (tmp_path / "machine.urdf").write_text(text)
    robot = Robot.load(tmp_path / "robot.yaml")
    with pytest.raises(InputError, match=r"l1.*correct the link's <inertial>"):
        robot.require_inertias("simulate")


def test_a_file_of_one_line_has_its_elements_named(tmp_path: Path) -> None:
    _machine(tmp_path)
    path = tmp_path / "machine.urdf"
    text = path.read_text().replace('izz="0.01"', 'izz="1"', 1).replace("\n", " ")
    path.write_text(text)
    with pytest.raises(InputError, match=r'machine\.urdf: <inertial>: link "l1" has') as error:
        Robot.load(tmp_path / "robot.yaml").require_inertias("simulate")
    assert "line 1:" not in str(error.value)


def test_a_rounded_inertia_is_mended_by_what_the_message_states(tmp_path: Path) -> None:
    _machine(tmp_path)
    path = tmp_path / "machine.urdf"
    stated = '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
    rounded = '<inertia ixx="0.011" iyy="0.003" izz="0.0079" ixy="0.0005" ixz="0" iyz="0"/>'
    turned = path.read_text().replace('<origin xyz="0 0 -.2"/>', '<origin rpy=".3 0 1"/>', 1)
    path.write_text(turned.replace(stated, rounded, 1))
    with pytest.raises(InputError, match="the nearest possible ones are") as error:
        Robot.load(tmp_path / "robot.yaml").require_inertias("simulate")
    match = re.search(r"<inertia [^>]*/>", str(error.value))
    assert match is not None
    path.write_text(path.read_text().replace(rounded, match[0]))
    Robot.load(tmp_path / "robot.yaml").require_inertias("simulate")
    # Values of the file's own axes: no digit changes by more than the correction.
    old, new = (
        np.array([float(x) for x in re.findall(r'"([^"]*)"', text)]) for text in (rounded, match[0])
    )
    assert np.abs(new - old).max() < 2e-4


def test_impossible_inertias_are_replaced_where_the_file_asks_for_it(tmp_path: Path) -> None:
    _machine(tmp_path)
    path = tmp_path / "machine.urdf"
    stated = '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
    # Far from any body's; and none at all.
    text = path.read_text().replace(stated, stated.replace('izz="0.01"', 'izz="0.05"'), 1)
    path.write_text(text.replace(stated, stated.replace("0.01", "0")))
    with pytest.raises(InputError, match=r"set possible_inertias: true in robot\.yaml"):
        Robot.load(tmp_path / "robot.yaml").require_inertias("simulate")
    config = yaml.safe_load((tmp_path / "robot.yaml").read_text())
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(config | {"possible_inertias": True}))
    robot = Robot.load(tmp_path / "robot.yaml")
    robot.require_inertias("simulate")
    assert any("(possible_inertias): l1, l2" in notice for notice in robot.notices)
    q = np.zeros(2)
    # The flat body's two small moments grow to hold the large one; about the joint it lies at .2 m.
    assert robot.chain.terms(q, q).M[1, 1] == pytest.approx(0.4 * 0.062**2 + 0.2**2, rel=1e-3)
    # A link without a mass has nothing that an inertia could be made of.
    path.write_text(path.read_text().replace('<mass value="1"/>', '<mass value="0"/>'))
    with pytest.raises(InputError, match="no mass") as error:
        Robot.load(tmp_path / "robot.yaml").require_inertias("simulate")
    assert "possible_inertias: true" not in str(error.value)


def test_commas_between_numbers_are_read_with_a_note(tmp_path: Path) -> None:
    plain = _machine(tmp_path)
    path = tmp_path / "machine.urdf"
    path.write_text(path.read_text().replace('xyz="0 0 -.4"', 'xyz="0, 0 -.4"'))
    robot = Robot.load(tmp_path / "robot.yaml")
    q = np.array([0.3, 0.2])
    np.testing.assert_array_equal(robot.chain.jacobian(q), plain.chain.jacobian(q))
    (notice,) = [text for text in robot.notices if "commas" in text]
    assert notice.startswith("line ")
    assert "in 3 places" in notice


def test_the_world_need_not_be_declared(tmp_path: Path) -> None:
    """Drake knows a link "world" in every URDF."""
    _machine(tmp_path)
    joint = '<joint name="w" type="fixed"><parent link="world"/><child link="cart"/></joint>'
    path = tmp_path / "machine.urdf"
    path.write_text(path.read_text().replace("</robot>", joint + "</robot>"))
    assert _hits(Robot.load(tmp_path / "robot.yaml"))


@pytest.mark.parametrize("slashes", ["package://", "package:///"])
def test_a_mesh_of_a_package_is_found_however_it_is_written(tmp_path: Path, slashes: str) -> None:
    folder = tmp_path / "arm_description"
    (folder / "urdf").mkdir(parents=True)
    (folder / "a.stl").write_text("")
    mesh = resolved_mesh(f"{slashes}arm_description/a.stl", folder / "urdf" / "arm.urdf")
    assert mesh == folder / "a.stl"


def _num_shapes(robot: Robot, hulls: bool) -> int:
    plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.0)
    robot.add_to_plant(plant, hulls=hulls)
    return int(plant.num_collision_geometries())


def test_moved_joints_keep_the_hulls(wheel_robot: Callable[[str], Robot]) -> None:
    robot = wheel_robot("ur5")
    moved = robot.with_moved_joints(np.full((6, 3), 1e-6), np.full((6, 3), 1e-6))
    assert _num_shapes(moved, True) == _num_shapes(robot, True)
    # One shape is no mesh; the others are there only where hulls are asked for.
    assert _num_shapes(robot, True) - _num_shapes(robot, False) == 7
