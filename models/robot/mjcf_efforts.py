"""Effort limits of the joints of an MJCF, as MuJoCo applies them.

Drake's parser takes the `ctrlrange` of any actuator for its effort limit. That is the torque of a
motor, but the *position* that a position servo is asked for, in rad. What bounds the torque of a
joint in MuJoCo (XML reference, "actuator" and "joint"; each limit counts where its *limited flag is
not "false"):

    actuatorfrcrange of the joint                       N m at the joint
    |gear_1| forcerange of the actuator                 of any actuator
    |gear_1| |gainprm_1| ctrlrange of the actuator      of one without feedback (biastype none)
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from typing import Final

_WITHOUT_FEEDBACK: Final = ("motor", "general")  # what the actuator's force is: gain times control
_ACTUATORS: Final = (*_WITHOUT_FEEDBACK, "position", "velocity", "intvelocity", "damper")
_MAIN_CLASS: Final = "main"
_BIAS, _JOINT = "biastype", "joint"


def effort_limits(root: ET.Element) -> dict[str, float]:
    """The largest torque (N m) or force (N) of each joint that has a drive, or a limit for one.

    Args:
        root: of the MJCF; its defaults and classes count.

    Returns:
        By the joint's name; inf where an actuator drives it and nothing bounds that. A joint of
        several actuators has their sum.
    """
    joint_defaults, actuator_defaults = _defaults(root)
    limits: dict[str, float] = {}
    for section in root.findall("actuator"):
        for actuator in section:
            joint_name = actuator.get(_JOINT)
            if actuator.tag in _ACTUATORS and joint_name is not None:
                class_name = actuator.get("class", _MAIN_CLASS)
                merged = {**actuator_defaults.get(class_name, {}), **_stated(actuator)}
                limits[joint_name] = limits.get(joint_name, 0.0) + _actuator_limit(merged)
    for joint, class_name in _joints_with_classes(root):
        name = joint.get("name", "")
        merged = {**joint_defaults.get(class_name, {}), **joint.attrib}
        own_limit = _largest(merged, "actuatorfrcrange", "actuatorfrclimited")
        # An MJCF that MuJoCo has made of a URDF has the URDF's effort here, and no actuator.
        if name in limits or math.isfinite(own_limit):
            limits[name] = min(limits.get(name, math.inf), own_limit)
    return limits


def _stated(actuator: ET.Element) -> dict[str, str]:
    """What an actuator's element states; whether it has feedback is part of it."""
    stated = dict(actuator.attrib)
    if actuator.tag == "motor":
        stated |= {_BIAS: "none", "gainprm": "1"}
    elif actuator.tag not in _WITHOUT_FEEDBACK:
        stated[_BIAS] = "affine"
    return stated


def _actuator_limit(attributes: Mapping[str, str]) -> float:
    """N m at the joint, of an actuator with the attributes of its class and its own; inf: none."""
    limit = _largest(attributes, "forcerange", "forcelimited")
    if attributes.get(_BIAS, "none") == "none":
        gain = abs(_first_number(attributes.get("gainprm"), 1.0))
        limit = min(limit, gain * _largest(attributes, "ctrlrange", "ctrllimited"))
    gear = abs(_first_number(attributes.get("gear"), 1.0))
    return gear * limit if gear > 0.0 else 0.0


def _largest(attributes: Mapping[str, str], range_name: str, flag_name: str) -> float:
    """The largest magnitude of a range; inf where there is none or it does not count."""
    words = attributes.get(range_name, "").split()
    if len(words) != 2 or attributes.get(flag_name) == "false":
        return math.inf
    magnitudes = [abs(_first_number(word, math.inf)) for word in words]
    return max(magnitudes) or math.inf  # "0 0" is MuJoCo's default: no range


def _first_number(text: str | None, missing: float) -> float:
    """The first number of a text; `missing` where there is none, or none that is finite."""
    try:
        number = float((text or "").split()[0])
    except (IndexError, ValueError):
        return missing
    return number if math.isfinite(number) else missing


def _defaults(root: ET.Element) -> tuple[dict[str, dict[str, str]], dict[str, dict[str, str]]]:
    """Attributes that each class gives to joints and to actuators, with those of outer classes."""
    joints: dict[str, dict[str, str]] = {}
    actuators: dict[str, dict[str, str]] = {}

    def take(element: ET.Element, outer_class: str | None) -> None:
        class_name = element.get("class", _MAIN_CLASS)
        of_joints = dict(joints.get(outer_class or class_name, {}))
        of_actuators = dict(actuators.get(outer_class or class_name, {}))
        for child in element:
            if child.tag == _JOINT:
                of_joints |= child.attrib
            elif child.tag in _ACTUATORS:
                of_actuators |= _stated(child)
        joints[class_name], actuators[class_name] = of_joints, of_actuators
        for child in element.findall("default"):
            take(child, class_name)

    for default in root.findall("default"):
        take(default, None)
    return joints, actuators


def _joints_with_classes(root: ET.Element) -> Iterator[tuple[ET.Element, str]]:
    """Each joint of the bodies with the name of its class; an outer body's `childclass` counts."""
    open_bodies = [(body, _MAIN_CLASS) for body in root.findall("worldbody")]
    while open_bodies:
        body, outer_class = open_bodies.pop()
        class_name = body.get("childclass", outer_class)
        for joint in body.findall(_JOINT):
            yield joint, joint.get("class", class_name)
        open_bodies += [(child, class_name) for child in body.findall("body")]
