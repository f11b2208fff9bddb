"""Which joints are the arm's, in robots of many shapes."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.arm_structure import ArmStructure

BODY = "<inertial><mass value='1'/></inertial>"


def robot(*joints, frames=(), origins=None, body=BODY):
    """A structure of joints "name kind parent child [leader]"; `frames` have no body."""
    parts, links = [], []
    for words in map(str.split, joints):
        name, kind, parent, child, *leader = words
        links += [link for link in (parent, child) if link not in links]
        origin = (origins or {}).get(name, "")
        follows = f"<mimic joint='{leader[0]}'/>" if leader else ""
        parts.append(
            f"<joint name='{name}' type='{kind}'><parent link='{parent}'/><child link='{child}'/>"
            f"{origin}<limit lower='-1' upper='1' velocity='1' effort='1'/>{follows}</joint>"
        )
    bodies = [f"<link name='{x}'>{'' if x in frames else body}</link>" for x in links]
    root = ET.fromstring(f"<robot name='r'>{''.join(bodies + parts)}</robot>")
    return ArmStructure(root, Path("r.urdf"), {})


def line(count, first="base", prefix="l"):
    """Revolute joints, one after another."""
    names = [first, *(f"{prefix}{k}" for k in range(1, count + 1))]
    return [f"{prefix}_j{k + 1} revolute {names[k]} {names[k + 1]}" for k in range(count)]


def found(structure, flange=None):
    base = structure.base(flange)
    flange = flange or structure.flange(base)
    arm = structure.joints_between(base, flange)
    return base, flange, len(arm), [joint.name for joint in structure.at_rest(arm)]


@pytest.mark.parametrize(
    ("more", "frames", "flange", "count", "rest"),
    [
        # A gripper of two carriages of which one leads; the tool's frame is fixed to the wrist.
        (
            ["left prismatic l6 c1", "right prismatic l6 c2 left", "ee fixed l6 ee_gripper"],
            ("ee_gripper",), "ee_gripper", 6, ["left"],
        ),
        # Two carriages without mimic.
        (["left prismatic l6 c1", "right prismatic l6 c2"], (), "l6", 6, ["left", "right"]),
        # Three fingers of two phalanges each, on a palm that is fixed to the wrist.
        (
            ["p fixed l6 palm", *[f"f{k}{i} revolute {'palm' if i == 1 else f'x{k}1'} x{k}{i}"
                                  for k in (1, 2, 3) for i in (1, 2)]],
            (), "l6", 6, ["f11", "f12", "f21", "f22", "f31", "f32"],
        ),
        # A hand whose fingers have more joints than many an arm.
        (
            ["p fixed l6 palm", *(joint for f in "tim" for joint in line(5, "palm", f))],
            (), "l6", 6, [f"{finger}_j{k}" for finger in "tim" for k in range(1, 6)],
        ),
        # A link called thumb is moved by the arm; beyond it a jaw that is called one.
        (["roll revolute l6 hand_thumb", "gripper revolute hand_thumb finger"], (), "hand_thumb", 7,
         ["gripper"]),
        # A jaw of no name beyond the frame that is made for the tool.
        (["t fixed l6 tool0", "m revolute l6 mover"], ("tool0",), "tool0", 6, ["m"]),
        # The last joint carries the tool's frame: whatever it is called, it is the arm's.
        (["gripper_roll revolute l6 g", "t fixed g tcp"], ("tcp",), "tcp", 7, []),
        # Frames of the tool before a jaw and at its tip.
        (["t fixed l6 gripper_tcp", "j revolute l6 gripper", "s fixed gripper gripper_tcp2"],
         ("gripper_tcp", "gripper_tcp2"), "gripper_tcp", 6, ["j"]),
        # A flange before the last joint of an arm that ends in a tool's frame.
        (["t fixed l6 flange", "j7 revolute l6 l7", "s fixed l7 tool0"], ("flange", "tool0"),
         "tool0", 7, []),
        # A propeller beside a pair of fingers on a bar.
        (["prop continuous l6 pl", "b fixed l6 bar", "lf prismatic bar a", "rf prismatic bar c lf"],
         (), "l6", 6, ["prop", "lf"]),
        # A sensor's frame is not the tool's.
        (["c fixed l6 camera_optical"], ("camera_optical",), "l6", 6, []),
    ],
)  # fmt: skip
def test_an_arm_ends_where_its_gripper_begins(more, frames, flange, count, rest):
    structure = robot(*line(6), *more, frames=frames)
    assert found(structure) == ("base", flange, count, rest)


def test_a_scara_keeps_its_last_slide():
    joints = ["j1 revolute base a", "j2 revolute a b", "j3 revolute b c", "z prismatic c d"]
    assert found(robot(*joints)) == ("base", "d", 4, [])


def test_a_column_whose_stages_follow_each_other_is_part_of_the_way():
    """It is refused later, in a sentence on mimic joints; it is no gripper."""
    structure = robot("c1 prismatic base s1", "c2 prismatic s1 s2 c1", *line(6, "s2"))
    assert found(structure)[2] == 8


def test_world_carries_an_arm_and_a_table():
    joints = ["w fixed world base", "t fixed world table", *line(6)]
    assert found(robot(*joints, frames=("world",)))[0] == "base"
    # Two arms: the flange says which.
    two = robot("w fixed world base", "v fixed world other", *line(6), *line(6, "other", "r"))
    with pytest.raises(InputError, match=r"several arms or legs; .*: --flange l6 or --flange r6$"):
        found(two)
    assert found(two, "r6")[:3] == ("other", "r6", 6)


def test_world_carries_an_arm_and_a_conveyor_that_moves():
    structure = robot("w fixed world base", "c prismatic world belt", *line(6), frames=("world",))
    flange = structure.flange(structure.base(None))
    assert (structure.base(flange), flange) == ("base", "l6")


PLANE = ["x prismatic world tx", "y prismatic tx ty", "turn continuous ty base"]
ACROSS = {"y": "<axis xyz='0 1 0'/>", "turn": "<axis xyz='0 0 1'/>"}
UP = ACROSS | {"y": "<axis xyz='0 0 1'/>"}


@pytest.mark.parametrize(
    ("joints", "frames", "origins", "base", "count", "rest"),
    [
        # x, y and a turn on links without mass.
        (PLANE, ("world", "tx", "ty"), ACROSS, "base", 6, ["x", "y", "turn"]),
        # A turn and a way forward; the lift beyond is the arm's.
        (["turn continuous root a", "x prismatic a car", "lift prismatic car base"],
         ("root", "a"), ACROSS, "car", 7, ["turn", "x"]),
        # A column that turns and rises is the arm's, and so is a rail of a link with a shape.
        (PLANE, ("world", "tx", "ty"), UP, "world", 9, []),
        (["x prismatic world base"], ("world",), {}, "world", 7, []),
    ],
)  # fmt: skip
def test_a_vehicle_that_carries_the_arm_is_held_still(joints, frames, origins, base, count, rest):
    shape = "<collision><geometry><sphere radius='.1'/></geometry></collision>"
    structure = robot(*joints, *line(6), frames=frames, origins=origins, body=BODY + shape)
    found_base, _, found_count, found_rest = found(structure)
    assert (found_base, found_count, found_rest) == (base, count, rest)
    # Where nothing is drawn, nothing tells a vehicle.
    assert found(robot(*joints, *line(6), frames=frames, origins=origins))[0] in ("world", "root")


def test_the_mounting_is_that_of_the_joints_at_rest():
    origins = {
        "w": "<origin xyz='0 0 1' rpy='3.1416 0 0'/>",
        "t": "<origin xyz='0.2 0 0' rpy='0 1.5708 0'/>",
    }
    structure = robot("w fixed world a", "t fixed a base", *line(6), origins=origins)
    root, X = structure.mounting("base")
    assert root == "world"
    np.testing.assert_allclose(X.translation(), [0.2, 0.0, 1.0], atol=1e-15)
    np.testing.assert_allclose(X.rotation().matrix()[2], [1.0, 0.0, 0.0], atol=1e-15)


@pytest.mark.parametrize(
    ("joints", "words"),
    [
        (["a revolute x y", "b revolute z y"], '"y" is the child of two joints'),
        (["a revolute base x", "b revolute y z", "c revolute z y"], "loop of joints"),
        (["a revolute x y", "b revolute z w"], "links without a parent: x, z"),
    ],
)
def test_what_is_no_tree_is_one_line(joints, words):
    with pytest.raises(InputError, match=words):
        robot(*joints).base(None)


def test_a_line_of_thousands_of_joints_ends():
    assert found(robot(*line(3000)))[2] == 3000
