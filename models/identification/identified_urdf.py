"""A robot's URDF with identified inertias, for other programs."""

import xml.etree.ElementTree as ET

from wrenchsight.models.identification.physical_consistency import unphysical_links
from wrenchsight.models.identification.simulator_friction import SimulatorFriction
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.rotational_inertia import BodyInertia


def identified_urdf(
    robot: Robot,
    inertial: Array,
    reflected_inertia: Array,
    friction: SimulatorFriction | None = None,
) -> str:
    """Returns the robot's effective URDF with these inertias.

    Bodies that are fixed to a link (flange, tool) are part of that link's inertia: they keep their
    shapes and lose their inertias. Rotor inertia goes into a transmission with a gear ratio of
    one, which Drake reads; URDF itself has no place for it, and other programs leave it out.
    Neither has a place for a rotor that turns with several joints: the caller says what is left out
    of such an arm (`robot export` does).

    Args:
        robot: whose effective URDF.
        inertial: (n, 10) per moving link about its joint frame, as
            `models.rigid_body.serial_chain.SerialChain.inertial_parameters`.
        reflected_inertia: (n,) kg m^2 (kg if prismatic), of what turns with each joint alone.
        friction: friction of the joints; None: the file states none. Drake reads `damping` and
            leaves `friction` (Coulomb) out.

    Raises:
        ValueError: a link whose inertia is not physical, which URDF readers refuse.
    """
    unphysical = unphysical_links(inertial, robot.joint_names)
    if unphysical:
        raise ValueError(
            f"the inertia of the link behind {', '.join(unphysical)} is not physical: identify "
            "with --consistent"
        )
    # A copy, to be changed. It has neither friction of joints nor transmissions: the reader of
    # robot files leaves them out.
    root = robot.urdf_element
    links = {link.get("name", ""): link for link in root.findall("link")}
    joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
    for joint in joints.values():
        if joint.get("type") == "fixed":
            child = links[_end(joint, "child")]
            for element in child.findall("inertial"):
                child.remove(element)
    for i, name in enumerate(robot.joint_names):
        link = links[_end(joints[name], "child")]
        for element in link.findall("inertial"):
            link.remove(element)
        link.insert(0, _inertial(inertial[i]))
        if friction is not None:
            coefficients = {
                "damping": repr(float(friction.viscous[i])),
                "friction": repr(float(friction.coulomb[i])),
            }
            ET.SubElement(joints[name], "dynamics", coefficients)
        transmission = ET.SubElement(root, "transmission", name=f"{name}_transmission")
        ET.SubElement(transmission, "type").text = "transmission_interface/SimpleTransmission"
        ET.SubElement(transmission, "joint", name=name)
        actuator = ET.SubElement(transmission, "actuator", name=name)
        ET.SubElement(actuator, "drake:rotor_inertia", value=repr(float(reflected_inertia[i])))
        ET.SubElement(actuator, "drake:gear_ratio", value="1")
    root.set("xmlns:drake", "http://drake.mit.edu")
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def links_behind(robot: Robot) -> tuple[str, ...]:
    """Names of the links that the joints move, base to tool."""
    root = robot.urdf_element
    joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
    return tuple(_end(joints[name], "child") for name in robot.joint_names)


def _end(joint: ET.Element, tag: str) -> str:
    element = joint.find(tag)
    assert element is not None  # the effective URDF was read by Drake
    return element.get("link", "")


def _inertial(parameters: Array) -> ET.Element:
    body = BodyInertia.of(parameters)
    out = ET.Element("inertial")
    ET.SubElement(out, "origin", xyz=" ".join(repr(float(x)) for x in body.com), rpy="0 0 0")
    ET.SubElement(out, "mass", value=repr(body.mass))
    entries = {
        f"i{'xyz'[i]}{'xyz'[j]}": repr(float(body.inertia[i, j]))
        for i in range(3)
        for j in range(i, 3)
    }
    ET.SubElement(out, "inertia", entries)
    return out
