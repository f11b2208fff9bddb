"""Joints that follow others: where what they follow stands still they do, too."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio
import pytest
import yaml

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.mimic_joints import followed_positions, leader_of
from wrenchsight.models.robot.robot import Robot

# A shoulder, and a gripper of two fingers beyond the flange: the second follows the first.
ARM = """<robot name="a">
<link name="base"/>{links}
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
<axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="3" effort="20"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="hand"/><origin xyz="0 0 .4"/>
<axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="3" effort="20"/></joint>
<joint name="finger" type="prismatic"><parent link="hand"/><child link="left"/>
<axis xyz="0 1 0"/><limit lower="0" upper=".04" velocity="1" effort="5"/></joint>
<joint name="other_finger" type="prismatic"><parent link="hand"/><child link="right"/>
<axis xyz="0 1 0"/><limit lower="-.09" upper="0" velocity="1" effort="5"/>
<mimic joint="finger" {how}/></joint>
</robot>"""
_INERTIAL = (
    '<inertial><mass value="1"/>'
    '<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>'
)
_LINKS = "".join(
    f'<link name="{name}">{_INERTIAL}</link>' for name in ("upper", "hand", "left", "right")
)


def _load(folder: Path, how: str = "", arm: str = ARM, **changes: object) -> Robot:
    (folder / "robot.urdf").write_text(arm.format(links=_LINKS, how=how))
    drive = {"torque_per_ampere": 1.0, "rotor_inertia": 0.0, "rotor_inertia_side": "joint"}
    config = {
        "name": "a",
        "urdf": "robot.urdf",
        "base_link": "base",
        "flange": "hand",
        "payload": 1.0,
        "home": [0.1, 0.2],
        "locked_joints": {"finger": 0.03},
        "drives": [{"joint": joint, **drive} for joint in ("shoulder", "elbow")],
    }
    (folder / "robot.yaml").write_text(yaml.safe_dump(config | changes))
    return Robot.load(folder / "robot.yaml")


def test_a_finger_that_follows_a_locked_one_is_locked_where_it_belongs(tmp_path: Path) -> None:
    robot = _load(tmp_path, 'multiplier="-2" offset="-.01"')
    # pinocchio, with both fingers put by hand where the URDF's relation has them.
    model = pinocchio.buildModelFromUrdf(str(tmp_path / "robot.urdf"))
    q = np.array([0.3, -0.5, 0.03, -2 * 0.03 - 0.01])
    tau = pinocchio.rnea(model, model.createData(), q, np.zeros(4), np.zeros(4))
    gravity_torque = robot.chain.inverse_dynamics(q[None, :2], np.zeros((1, 2)), np.zeros((1, 2)))[
        0
    ]
    np.testing.assert_allclose(gravity_torque, tau[:2], atol=1e-12)
    # What robot.yaml states itself counts.
    stated = _load(tmp_path, locked_joints={"finger": 0.03, "other_finger": 0.0})
    assert abs(stated.chain.inertial_parameters[-1, 2] - robot.chain.inertial_parameters[-1, 2]) > 0


def test_only_the_finger_that_leads_is_asked_for(tmp_path: Path) -> None:
    with pytest.raises(InputError, match='off the line from base to flange: "finger"; name'):
        _load(tmp_path, locked_joints={})
    # Without what it follows, nothing tells where it stands.
    with pytest.raises(InputError, match='off the line from base to flange: "finger"; name'):
        _load(tmp_path, locked_joints={"other_finger": 0.0})


def test_between_base_and_flange_each_joint_needs_its_motor(tmp_path: Path) -> None:
    arm = ARM.replace('<mimic joint="finger" {how}/>', "").replace(
        'effort="20"/></joint>\n<joint name="finger"',
        'effort="20"/><mimic joint="shoulder"/></joint>\n<joint name="finger"',
    )
    locked = {"finger": 0.0, "other_finger": 0.0}
    with pytest.raises(InputError) as error:
        _load(tmp_path, arm=arm, locked_joints=locked)
    assert 'joint "elbow" moves with "shoulder" (mimic): an arm needs a motor' in str(error.value)
    # Both locked, or their leader: the line loads without them.
    with pytest.raises(InputError, match="no moving joint carries"):
        _load(tmp_path, arm=arm, locked_joints=locked | {"shoulder": 0.5})


def test_chains_of_followers() -> None:
    text = """<a><joint name="a" type="revolute"/>
    <joint name="b" type="revolute"><mimic joint="a" multiplier="2"/></joint>
    <joint name="c" type="revolute"><mimic joint="b" offset="1"/></joint>
    <joint name="d" type="revolute"><mimic joint="e"/></joint>
    <joint name="e" type="revolute"><mimic joint="d"/></joint>
    <joint name="f" type="fixed"/>
    <joint name="g" type="revolute"><mimic joint="f" offset="-.5"/></joint></a>"""
    joints = {joint.get("name", ""): joint for joint in ET.fromstring(text)}
    assert leader_of(joints["a"]) == "" and leader_of(joints["c"]) == "b"
    assert followed_positions(joints, {"a": 0.25}) == {"b": 0.5, "c": 1.5, "g": -0.5}
    assert followed_positions(joints, {}) == {"g": -0.5}


def test_a_relation_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match='multiplier="often" of <mimic>, expected a number'):
        _load(tmp_path, 'multiplier="often"')
