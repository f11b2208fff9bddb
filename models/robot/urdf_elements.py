"""Elements of a URDF: kinds of joints; numbers to the last bit, poses, inertias, fixed joints."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from wrenchsight.models.numerics.arrays import Array

INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
MOVING_JOINT_TYPES = ("revolute", "continuous", "prismatic")  # along or about one axis
MAX_NUMBER = 1e6  # of any number in a URDF, in SI units; a joint's limit beyond means no limit


def text_of(values: Array | Iterable[float]) -> str:
    """Numbers as an attribute holds them, read back bit for bit."""
    return " ".join(repr(float(value)) for value in values)


def set_pose(element: ET.Element, X: RigidTransform) -> None:
    """Writes the <origin> of an element, in the place of the one that it has."""
    origin = element.find("origin")
    if origin is None:
        origin = ET.SubElement(element, "origin")
    origin.set("xyz", text_of(X.translation()))
    origin.set("rpy", text_of(RollPitchYaw(X.rotation()).vector()))


def fixed_joint(name: str, parent: str, child: str, X_PC: RigidTransform | None) -> ET.Element:
    """A fixed joint between two links; without a pose it has no <origin>."""
    joint = ET.Element("joint", name=name, type="fixed")
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    if X_PC is not None:
        set_pose(joint, X_PC)
    return joint


def add_inertial(
    link: ET.Element, mass: float, X_LC: RigidTransform, inertia: Iterable[float]
) -> None:
    """Adds an <inertial>.

    Args:
        mass: kg.
        X_LC: pose of the frame at the centre of mass.
        inertia: about it, in that frame's axes: ixx, iyy, izz, ixy, ixz, iyz, kg m^2.
    """
    inertial = ET.SubElement(link, "inertial")
    set_pose(inertial, X_LC)
    ET.SubElement(inertial, "mass", value=repr(float(mass)))
    values = map(repr, np.asarray(list(inertia), float).tolist())
    ET.SubElement(inertial, "inertia", dict(zip(INERTIA, values, strict=True)))
