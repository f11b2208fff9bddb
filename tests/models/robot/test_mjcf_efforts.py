"""Effort limits of an MJCF, beside the torques that MuJoCo applies at most."""

import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pytest

from wrenchsight.models.robot.mjcf_efforts import effort_limits

_MODEL = """<mujoco model="arm">
  <default>
    <joint actuatorfrcrange="-400 400"/>
    <motor gear="2"/>
    <default class="servo">
      <joint actuatorfrcrange="-300 300"/>
      <general biastype="affine" gainprm="2000" biasprm="0 -2000 -200" forcerange="-87 87"/>
      <default class="wrist">
        <general forcerange="-12 12"/>
        <joint actuatorfrcrange="-9 9"/>
      </default>
    </default>
  </default>
  <worldbody><body childclass="servo">{joints}</body></worldbody>
  <actuator>{actuators}</actuator>
</mujoco>"""

# Name of the joint, its attributes, its actuator, N m.
_JOINTS = [
    ("of_class", "", '<general class="servo" ctrlrange="-1.7 1.7"/>', 2 * 87.0),
    ("of_inner_class", "", '<general class="wrist" ctrlrange="-2 2"/>', 2 * 12.0),
    ("bounded_itself", 'class="wrist"', '<general class="servo"/>', 9.0),
    ("motor", "", '<motor ctrlrange="-3 3" gear="50"/>', 150.0),
    ("general_motor", "", '<general gainprm="7" ctrlrange="-2 2" gear="1"/>', 14.0),
    ("position", "", '<position kp="1000" ctrlrange="-1.9 1.9" forcerange="-3 3" gear="1"/>', 3.0),
    ("velocity", "", '<velocity kv="1000" ctrlrange="-9 9" gear="1" forcerange="-5 2"/>', 5.0),
    ("flag", "", '<motor ctrlrange="-3 3" forcerange="-1 1" forcelimited="false"/>', 6.0),
    ("by_the_joint_alone", "", '<position kp="1e6" gear="1"/>', 300.0),
]


def _text() -> str:
    joints, actuators = "", ""
    for name, attributes, actuator, _ in _JOINTS:
        joints += f'<body><joint name="{name}" {attributes}/><geom size=".1"/></body>'
        actuators += actuator.replace(" ", f' joint="{name}" ', 1)
    return _MODEL.format(joints=joints, actuators=actuators)


def test_the_limits_are_the_largest_torques_in_mujoco() -> None:
    """Controls far beyond any bound, at positions and speeds far from them: all saturates."""
    model = mujoco.MjModel.from_xml_string(_text())
    data, largest = mujoco.MjData(model), np.zeros(model.nv)
    for sign in (-1.0, 1.0):
        data.qpos[:], data.qvel[:] = -3.0 * sign, -20.0 * sign
        data.ctrl[:] = 1e9 * sign
        mujoco.mj_forward(model, data)
        largest = np.maximum(largest, np.abs(data.qfrc_actuator))
    limits = effort_limits(ET.fromstring(_text()))
    for k, (name, _, _, expected) in enumerate(_JOINTS):
        assert limits[name] == pytest.approx(expected), name
        assert largest[k] == pytest.approx(expected), name


def test_a_servo_without_a_limit_has_none() -> None:
    """Not the range of its positions, which Drake takes for a torque."""
    text = """<mujoco><worldbody><body><joint name="a"/><joint name="b"/></body></worldbody>
      <actuator><position joint="a" ctrlrange="-1.9 1.9"/><motor joint="b" gear="spoilt"/>
      <muscle joint="a"/></actuator></mujoco>"""
    assert effort_limits(ET.fromstring(text)) == {"a": np.inf, "b": np.inf}


def test_without_inferred_limits_the_flags_decide() -> None:
    """MuJoCo and Drake refuse a range without its flag there; with one it counts as it says."""
    text = """<mujoco model="arm"><compiler autolimits="false"/><worldbody>
      <body><joint name="a"/><geom size=".1"/></body>
      <body><joint name="b"/><geom size=".1"/></body></worldbody>
      <actuator><motor joint="a" ctrlrange="-3 3" ctrllimited="true"/>
      <motor joint="b" ctrlrange="-3 3" ctrllimited="false"/></actuator></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    assert model.actuator_ctrllimited.tolist() == [1, 0]
    assert effort_limits(ET.fromstring(text)) == {"a": 3.0, "b": np.inf}
    with pytest.raises(ValueError, match="ctrlrange"):
        mujoco.MjModel.from_xml_string(text.replace('ctrllimited="true"', ""))


def test_a_limit_of_a_joint_without_an_actuator_counts() -> None:
    """MuJoCo writes a URDF's effort so."""
    joints = '<body><joint name="driven" actuatorfrcrange="-28 28"/><joint name="free"/></body>'
    text = f"<mujoco><worldbody>{joints}</worldbody></mujoco>"
    assert effort_limits(ET.fromstring(text)) == {"driven": 28.0}
