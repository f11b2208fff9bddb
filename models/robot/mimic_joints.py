"""Joints that follow another one: URDF's <mimic>, q = multiplier q_leader + offset.

A follower of a joint that is locked stands still with it. A follower of a joint that moves has no
drive of its own: between base and flange such an arm has fewer motors than joints, and neither its
mass matrix by motor nor its friction by joint is what this package computes.
"""

import xml.etree.ElementTree as ET
from collections.abc import Mapping

_MAX_NUMBER = 1e6


def leader_of(joint: ET.Element) -> str:
    """The name of the joint that it follows; '' where it follows none."""
    mimic = joint.find("mimic")
    return "" if mimic is None else mimic.get("joint", "")


def followed_positions(
    joints: Mapping[str, ET.Element], locked: Mapping[str, float]
) -> dict[str, float]:
    """Positions in rad or m of the joints that follow a joint at rest, directly or by others.

    Args:
        joints: joints of the URDF, by name.
        locked: positions by name. A fixed joint stands at 0.

    Raises:
        ValueError: multiplier or offset is no number; the message names the joint.
    """
    positions = {name: 0.0 for name, joint in joints.items() if joint.get("type") == "fixed"}
    positions |= locked
    waiting = {
        name: joint for name, joint in joints.items() if leader_of(joint) and name not in positions
    }
    followed: dict[str, float] = {}
    while True:
        followers = [name for name, joint in waiting.items() if leader_of(joint) in positions]
        if not followers:
            return followed
        for name in followers:
            joint = waiting.pop(name)
            multiplier = _number(joint, "multiplier", 1.0)
            offset = _number(joint, "offset", 0.0)
            followed[name] = positions[name] = multiplier * positions[leader_of(joint)] + offset


def _number(joint: ET.Element, key: str, default: float) -> float:
    mimic = joint.find("mimic")
    text = None if mimic is None else mimic.get(key)
    try:
        value = default if text is None else float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) <= _MAX_NUMBER:
        raise ValueError(f'{key}="{text}" of <mimic>, expected a number')
    return value
