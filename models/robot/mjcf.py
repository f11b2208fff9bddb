"""An arm as MJCF, the file format of MuJoCo: the chain that every other part computes with.

World is W, the frame of the arm's base link. What is fixed to a link (flange, tool) is part of that
link's inertia. Friction at rest and in motion is MuJoCo's `frictionloss` (Coulomb) and `damping`
(viscous), the rotors' inertia behind the gears is `armature`, each joint has a motor whose control
is the torque on the joint in N m (N). The site "E" is the tool centre point. Capsules between the
joints are pictures alone: they have no mass and touch nothing. Numbers are written so
that they read back bit for bit.

See https://mujoco.readthedocs.io/en/stable/XMLreference.html.
"""

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np
from pydrake.math import RotationMatrix

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.rotational_inertia import BodyInertia, inertia_values

TIME_STEP = 0.001  # s
INTEGRATOR = "implicitfast"  # damping implicitly: a wrist's is large beside its inertia
CAPSULE_ATTRIBUTES = {
    "type": "capsule",
    "contype": "0",
    "conaffinity": "0",
    "group": "2",
    "mass": "0",
}
CAPSULE_RADIUS_SHARE = 0.025  # radius of the capsules, of the arm's length


@dataclass(frozen=True, eq=False)
class JointProperties:
    """Friction and limits of the joints, n each.

    Attributes:
        coulomb: N m (N).
        viscous: N m s/rad (N s/m).
        lower, upper: rad (m); infinite where the joint turns without end.
        effort: N m (N), limit of the motor on the joint side; infinite: none.
    """

    coulomb: Array
    viscous: Array
    lower: Array
    upper: Array
    effort: Array

    @classmethod
    def unlimited(cls, coulomb: Array, viscous: Array) -> "JointProperties":
        """Friction alone, in joints and motors without limits."""
        infinite = np.full(len(coulomb), math.inf)
        return cls(coulomb, viscous, -infinite, infinite, infinite)


def chain_mjcf(
    name: str, chain: SerialChain, joints: JointProperties, link_names: tuple[str, ...] = ()
) -> str:
    """Returns a chain as MJCF.

    Each body is nested in the one before; a motor is controlled by the torque on its joint.

    Args:
        name: name of the model.
        chain: kinematics, inertias and gravity; each link's inertia must be physical.
        joints: friction and limits.
        link_names: n, of the moving bodies; without them, body_1 to body_n.

    Raises:
        ValueError: motors that move more than their own joint, which MJCF has no element for.
    """
    if chain.motor_rates.size:
        raise ValueError("MJCF has no rotor that turns with several joints: the motors are coupled")
    root = ET.Element("mujoco", model=name)
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    option = {"timestep": repr(TIME_STEP), "integrator": INTEGRATOR}
    ET.SubElement(root, "option", option, gravity=_numbers(chain.gravity))
    parent = ET.SubElement(root, "worldbody")
    thickness = CAPSULE_RADIUS_SHARE * float(np.linalg.norm(chain.p_PJ, axis=1).sum())
    actuators = ET.SubElement(root, "actuator")
    for i, joint_name in enumerate(chain.joint_names):
        link = link_names[i] if link_names else f"body_{i + 1}"
        parent = ET.SubElement(parent, "body", _pose(chain.R_PJ[i], chain.p_PJ[i]), name=link)
        parent.append(_inertial(chain.inertial_parameters[i]))
        joint = {
            "name": joint_name,
            "type": "slide" if chain.prismatic[i] else "hinge",
            "axis": _numbers(chain.axis[i]),
            "armature": repr(float(chain.reflected_inertia[i])),
            "damping": repr(float(joints.viscous[i])),
            "frictionloss": repr(float(joints.coulomb[i])),
        }
        if np.isfinite([joints.lower[i], joints.upper[i]]).all():
            joint["range"] = _numbers([joints.lower[i], joints.upper[i]])
        ET.SubElement(parent, "joint", joint)
        end = chain.p_PJ[i + 1] if i + 1 < len(chain.joint_names) else chain.p_LE
        if np.linalg.norm(end) > thickness:  # a shorter one would be a ball inside its neighbours
            ends = _numbers([0.0, 0.0, 0.0, *end])
            ET.SubElement(parent, "geom", CAPSULE_ATTRIBUTES, fromto=ends, size=repr(thickness))
        motor = {"name": joint_name, "joint": joint_name}
        if math.isfinite(joints.effort[i]):
            motor["ctrlrange"] = _numbers([-joints.effort[i], joints.effort[i]])
        ET.SubElement(actuators, "motor", motor)
    ET.SubElement(parent, "site", _pose(chain.R_LE, chain.p_LE), name="E")
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _numbers(values: "Array | list[float]") -> str:
    return " ".join(repr(float(value)) for value in values)


def _pose(R: Array, p: Array) -> dict[str, str]:
    quaternion = RotationMatrix.ProjectToRotationMatrix(R).ToQuaternion()
    return {"pos": _numbers(p), "quat": _numbers(quaternion.wxyz())}


def _inertial(parameters: Array) -> ET.Element:
    """A link's inertia about its centre of mass, from that about its joint frame."""
    body = BodyInertia.of(parameters)
    entries = _numbers(inertia_values(body.inertia))
    return ET.Element("inertial", pos=_numbers(body.com), mass=repr(body.mass), fullinertia=entries)
