"""A robot's SDF as a URDF: frames, joints and inertias as Drake reads them.

A link's frame in the URDF is that of the joint that moves it, as a URDF has it; a base keeps its
own. Poses in SDF may be relative to any frame: Drake resolves them. Shapes are taken where their
pose is relative to their link; what is not counts as a shape that cannot be used.
"""

import copy
import math
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint, RevoluteJoint, WeldJoint

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.drake_parsing import add_model
from wrenchsight.models.robot.urdf_elements import add_inertial, fixed_joint, set_pose, text_of

_SHAPES = ("visual", "collision")


def urdf_of_sdf(root: ET.Element, path: Path) -> ET.Element:
    """The <robot> that an <sdf> means.

    Raises:
        InputError: Drake cannot read it, or it holds no model or several.
    """
    models = root.findall("model") or root.findall("world/model")
    if len(models) != 1:
        raise InputError(path, "", f"holds {len(models)} models, expected one", "split the file")
    bare = copy.deepcopy(root)
    for link in bare.iter("link"):
        for kind in _SHAPES:
            for element in link.findall(kind):
                link.remove(element)
    plant = MultibodyPlant(0.0)
    text = ET.tostring(bare, encoding="unicode")
    try:
        instance = add_model(plant, text, "sdf")
    except (RuntimeError, ValueError) as error:
        problem = " ".join(str(error).replace("<literal-string>.sdf", path.name).split())
        raise InputError(path, "", f"SDF: {problem[:300]}", "correct it, or give a URDF") from error
    robot = ET.Element("robot", name=models[0].get("name", path.stem))
    joints = [plant.get_joint(index) for index in plant.GetJointIndices(instance)]
    in_body = {joint.child_body().index(): _frame(joint.frame_on_child()) for joint in joints}
    shapes = {link.get("name"): link for link in models[0].findall("link")}
    for index in plant.GetBodyIndices(instance):
        body = plant.get_body(index)
        X_LB = in_body.get(index, RigidTransform()).inverse()
        link = ET.SubElement(robot, "link", name=body.name())
        _add_inertial(link, body, X_LB)
        _add_shapes(link, shapes.get(body.name()), X_LB)
    efforts = {}
    for index in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(index)
        efforts[actuator.joint().index()] = float(actuator.effort_limit())
    if any(joint.parent_body().index() == plant.world_body().index() for joint in joints):
        ET.SubElement(robot, "link", name="world")
    for joint in joints:
        X_LP = in_body.get(joint.parent_body().index(), RigidTransform()).inverse()
        _add_joint(robot, joint, X_LP, efforts.get(joint.index(), 0.0))
    return robot


def _frame(frame: Any) -> RigidTransform:
    return frame.GetFixedPoseInBodyFrame()


def _add_joint(robot: ET.Element, joint: Any, X_LP: RigidTransform, effort: float) -> None:
    kind, axis, X = "floating", None, X_LP @ _frame(joint.frame_on_parent())
    if isinstance(joint, WeldJoint):
        kind, X = "fixed", X @ joint.X_FM()
    elif isinstance(joint, RevoluteJoint):
        kind, axis = "revolute", joint.revolute_axis()
    elif isinstance(joint, PrismaticJoint):
        kind, axis = "prismatic", joint.translation_axis()
    element = fixed_joint(joint.name(), joint.parent_body().name(), joint.child_body().name(), X)
    robot.append(element)
    if axis is not None:
        ET.SubElement(element, "axis", xyz=text_of(axis))
        lower, upper = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
        if kind == "revolute" and not (math.isfinite(lower) and math.isfinite(upper)):
            kind = "continuous"
        limit = ET.SubElement(element, "limit")
        if kind != "continuous":
            limit.set("lower", repr(float(lower)))
            limit.set("upper", repr(float(upper)))
        velocity = float(joint.velocity_upper_limits()[0])
        limit.set("velocity", repr(velocity if math.isfinite(velocity) else 0.0))
        limit.set("effort", repr(effort if math.isfinite(effort) else 0.0))
    element.set("type", kind)


def _add_inertial(link: ET.Element, body: Any, X_LB: RigidTransform) -> None:
    inertia = body.default_spatial_inertia()
    mass, com = float(inertia.get_mass()), np.asarray(inertia.get_com())
    if mass == 0.0:
        return
    about_origin = inertia.CalcRotationalInertia().CopyToFullMatrix3()
    about_com = about_origin - mass * (com @ com * np.eye(3) - np.outer(com, com))
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = about_com
    add_inertial(link, mass, X_LB @ RigidTransform(com), (xx, yy, zz, xy, xz, yz))


def _add_shapes(link: ET.Element, sdf_link: ET.Element | None, X_LB: RigidTransform) -> None:
    if sdf_link is None:
        return
    for kind in _SHAPES:
        for number, shape in enumerate(sdf_link.findall(kind)):
            name = f"{sdf_link.get('name')}_{kind}_{number}"
            element = ET.SubElement(link, kind, name=name)
            pose = shape.find("pose")
            geometry = ET.SubElement(element, "geometry")
            if pose is not None and (pose.get("relative_to") or pose.get("degrees") == "true"):
                ET.SubElement(geometry, "sdf_pose")  # of no kind that is known: it is dropped
                continue
            values = [0.0] * 6
            if pose is not None and pose.text:
                values = [float(word) for word in pose.text.split()]
            set_pose(element, X_LB @ RigidTransform(RollPitchYaw(values[3:]), values[:3]))
            _add_geometry(geometry, shape.find("geometry"))


def _add_geometry(geometry: ET.Element, sdf_geometry: ET.Element | None) -> None:
    shape = None if sdf_geometry is None else next(iter(sdf_geometry), None)
    if shape is None:
        return

    def of(key: str) -> str:
        return (shape.findtext(key) or "").strip()

    if shape.tag == "box":
        ET.SubElement(geometry, "box", size=of("size"))
    elif shape.tag == "sphere":
        ET.SubElement(geometry, "sphere", radius=of("radius"))
    elif shape.tag in ("cylinder", "capsule"):
        ET.SubElement(geometry, shape.tag, radius=of("radius"), length=of("length"))
    elif shape.tag == "mesh":
        uri = of("uri").replace("model://", "package://")
        ET.SubElement(geometry, "mesh", filename=uri, scale=of("scale") or "1 1 1")
    else:
        ET.SubElement(geometry, shape.tag)
