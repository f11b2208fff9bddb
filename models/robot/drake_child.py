"""The child process that turns SDF or MJCF into a URDF: FILE TAG, URDF to standard output.

Frames, joints and inertias are those of the plant that Drake makes of the file. A link's frame in
the URDF is that of the joint that moves it, as a URDF has it; a base keeps its own. Shapes of an
SDF are taken where their pose is relative to their link, those of an MJCF as Drake places them; all
of them are lost where one of its meshes is.
"""

import math
import sys
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.geometry import Box, Capsule, Convex, Cylinder, Ellipsoid, Mesh, Sphere
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, PrismaticJoint, RevoluteJoint, WeldJoint
from pydrake.systems.framework import DiagramBuilder

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.drake_document import LEFT_OUT
from wrenchsight.models.robot.drake_parsing import add_models
from wrenchsight.models.robot.limited_child import limit_process
from wrenchsight.models.robot.mjcf_efforts import effort_limits
from wrenchsight.models.robot.rotational_inertia import inertia_values, point_inertia
from wrenchsight.models.robot.rounded_angles import rounded_rpy
from wrenchsight.models.robot.urdf_document import parse_document
from wrenchsight.models.robot.urdf_elements import add_inertial, fixed_joint, set_pose, text_of

_MEMORY_LIMIT = 2 << 30  # bytes
_MAX_DEPTH = 100  # of nested elements
_SHAPES = ("visual", "collision")
_SDF_LINK_PARTS = ("pose", "frame", "inertial")  # others, also those that SDF has not, are no arm's
_NEGLIGIBLE_MASS = 1e-9  # kg, of a body without one
_NEGLIGIBLE_INERTIA = 1e-12  # kg m^2
_ENDLESS_SLIDE = 10.0  # m either way, of a slide without limits
_MAX_NUMBER = 1e6  # of a number of a pose, m or rad
_MAX_INCLUDES = 100  # files of an MJCF
_GENERATED_BODIES = ("replicate", "attach")  # elements that MuJoCo puts bodies in the place of
_FRAME_PARTS = ("body", "geom", "site", "light", "camera", "frame")
_LARGEST_RAD = 2.01 * np.pi  # of a range of an arm's joint that does not turn without end
_RIGHT_ANGLES = (0.5 * np.pi, np.pi, 1.5 * np.pi)  # rad
_RIGHT_ANGLE_DIGITS = 2e-3  # rad, within which one is written
_MIN_RANGES = 3  # of joints, whose unit is judged


def main(words: list[str]) -> int:
    """Converts FILE, whose root element is TAG; returns the exit code."""
    limit_process(_MEMORY_LIMIT)
    path, tag = Path(words[0]).resolve(), words[1]
    try:
        root, _ = parse_document(path.read_bytes(), path)
        _check_depth(root)
        robot = urdf_of_sdf(root, path) if tag == "sdf" else urdf_of_mjcf(root, path)
    except (RuntimeError, ValueError, MemoryError) as error:
        text = str(error).replace("<literal-string>.sdf", path.name) or type(error).__name__
        print(" ".join(text.replace(f"{path.parent}/", "").split()), file=sys.stderr)
        return 1
    sys.stdout.buffer.write(ET.tostring(robot))
    return 0


def _check_depth(root: ET.Element) -> None:
    """Refuses what overflows a parser's stack."""
    level = [root]
    for _ in range(_MAX_DEPTH):
        level = [child for element in level for child in element]
        if not level:
            return
    raise ValueError(f"its elements are nested more than {_MAX_DEPTH} deep")


def urdf_of_sdf(root: ET.Element, path: Path) -> ET.Element:
    """The <robot> that an <sdf> means; its shapes are taken out of `root`.

    Raises:
        RuntimeError, ValueError: Drake cannot read it, or it holds no model or several.
    """
    models, left_out = root.findall("model"), list[str]()
    if not models:
        models, left_out = _leave_scenery(root)
    if len(models) != 1:
        raise ValueError(f"holds {len(models)} models, expected one; split the file")
    shapes: dict[str, list[ET.Element]] = {}  # by the link's path of names
    for path_of_link, link in _links_of(models[0], ()):
        for element in list(link):
            if element.tag in _SHAPES:
                shapes.setdefault(path_of_link, []).append(element)
            if element.tag not in _SDF_LINK_PARTS:
                link.remove(element)
    plant = MultibodyPlant(0.0)
    instances = add_models(plant, ET.tostring(root, encoding="unicode"), "sdf")
    names = _Names(plant, instances)
    robot, frames = _urdf_of_plant(plant, names, models[0].get("name", path.stem))
    for index, name in names.bodies.items():
        (link,) = (element for element in robot.findall("link") if element.get("name") == name)
        for number, shape in enumerate(shapes.get(_path_in_model(plant.get_body(index)), ())):
            _add_sdf_shape(link, shape, f"{name}_{shape.tag}_{number}", frames[name])
    written = {frame.get("name", "") for frame in models[0].iter("frame")} - {""}
    _add_frames(robot, written, plant, instances, names, frames)
    _note_left_out(robot, left_out)
    return robot


def _note_left_out(robot: ET.Element, names: Sequence[str]) -> None:
    """Says in the <robot> which bodies or models of the document are none of the arm's."""
    if names:
        robot.set(LEFT_OUT, ", ".join(names))


def _links_of(model: ET.Element, path: tuple[str, ...]) -> Iterator[tuple[str, ET.Element]]:
    """The links of a model and of those within it, each with its names from the model on."""
    for link in model.findall("link"):
        yield "::".join((*path, link.get("name", ""))), link
    for within in model.findall("model"):
        yield from _links_of(within, (*path, within.get("name", "")))


def _path_in_model(element: Any) -> str:
    """The names of a body or joint from its file's model on: "gripper::palm" of one within."""
    within = str(element.GetParentPlant().GetModelInstanceName(element.model_instance()))
    return "::".join((*within.split("::")[1:], element.name()))


class _Names:
    """Names in the URDF of the bodies and joints of models, by their indices in the plant.

    A body or joint of a model within another has its own name where no other has it; else those of
    its models stand before it.
    """

    def __init__(self, plant: MultibodyPlant, instances: Sequence[ModelInstanceIndex]) -> None:
        """Takes all that the model instances hold; those of an SDF come outer ones first."""
        bodies = [plant.get_body(i) for k in instances for i in plant.GetBodyIndices(k)]
        joints = [plant.get_joint(i) for k in instances for i in plant.GetJointIndices(k)]
        self.bodies = {body.index(): _unlike(body, bodies) for body in bodies}
        self.joints = {joint.index(): _unlike(joint, joints) for joint in joints}
        self.bodies_and_world = {**self.bodies, plant.world_body().index(): "world"}


def _unlike(element: Any, elements: Sequence[Any]) -> str:
    """The name of one of the elements, with those of its models where another has the same."""
    alike = sum(other.name() == element.name() for other in elements) > 1
    return _path_in_model(element).replace("::", "_") if alike else str(element.name())


def _add_frames(
    robot: ET.Element,
    written: Collection[str],
    plant: MultibodyPlant,
    instances: Sequence[ModelInstanceIndex],
    names: _Names,
    frames: Mapping[str, RigidTransform],
) -> None:
    """Appends the <frame>s of an SDF as links without anything, as a URDF has a tool0.

    Args:
        written: names of the <frame>s; the plant has others of its own.
        frames: poses of the bodies in their links, by the body's name in the URDF.
    """
    taken = {element.get("name", "") for element in robot}
    for index in (k for instance in instances for k in plant.GetFrameIndices(instance)):
        frame = plant.get_frame(index)
        body = names.bodies.get(frame.body().index())
        name = str(frame.name())
        if body is None or name not in written or {name, f"{name}_frame"} & taken:
            continue
        taken.add(name)
        ET.SubElement(robot, "link", name=name)
        X_LF = frames[body] @ _frame(frame)
        robot.append(fixed_joint(f"{name}_frame", body, name, X_LF))


def _leave_scenery(root: ET.Element) -> tuple[list[ET.Element], list[str]]:
    """The models of the only world, and the names of those that are left out.

    These are those in which no joint moves, where one does in another.
    """
    worlds = root.findall("world")
    models = [(world, model) for world in worlds for model in world.findall("model")]
    moving = [
        model
        for _, model in models
        if any(joint.get("type") != "fixed" for joint in model.iter("joint"))
    ]
    if not moving:
        return [model for _, model in models], []
    scenery = [(world, model) for world, model in models if model not in moving]
    for world, model in scenery:
        world.remove(model)
    return moving, [model.get("name", "") for _, model in scenery]


def urdf_of_mjcf(root: ET.Element, path: Path) -> ET.Element:
    """The <robot> that a <mujoco> means, by way of a plant that Drake makes of it.

    Where a mesh cannot be read, the model is read without shapes; each link with shapes then gets a
    collision of no known kind, which is reported as dropped later on.

    Args:
        root: of the MJCF, changed.
        path: of its file; meshes are searched for beside it.

    Raises:
        RuntimeError, ValueError: Drake cannot read it, or it holds no model or several.
    """
    _include_files(root, path)
    _check_depth(root)
    _refuse_generated_bodies(root, path)
    _make_frames_bodies(root)
    _check_angles(root)
    left_out = _leave_objects(root)
    has_shapes = root.find("worldbody//geom") is not None
    name = root.get("model") or path.stem
    root.set("model", name)
    # Before `root` is changed for Drake, whose own efforts are not those of MuJoCo: it refuses
    # bodies without mass, and knows no folder of a file that it is given as a text.
    efforts = effort_limits(root)
    for joint in root.iter("joint"):
        joint.attrib.pop("damping", None)  # is not taken; Drake refuses a negative one
    _give_mass(root)
    _find_files(root, path.parent)
    builder = DiagramBuilder()
    try:
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        instance = _instance_of(Parser(plant), root)
    except RuntimeError as error:
        if "mesh" not in str(error).lower():
            raise
        # A mesh is missing, or of a kind that Drake does not read: only shapes need it.
        _drop_meshes(root)
        plant, scene_graph = MultibodyPlant(0.0), None
        instance = _instance_of(Parser(plant), root)
    robot, frames = _urdf_of_plant(
        plant, _Names(plant, [instance]), name, efforts
    )  # frames: X_LB by body
    for link in robot.findall("link"):
        body_name = link.get("name", "")
        if body_name not in frames:
            continue  # "world"
        if scene_graph is not None:
            body = plant.GetBodyByName(body_name, instance)
            _add_shapes(link, plant, body, scene_graph.model_inspector(), frames[body_name])
        elif has_shapes:
            shape = ET.SubElement(link, "collision", name=f"{body_name}_geoms")
            ET.SubElement(ET.SubElement(shape, "geometry"), "geom")  # of no kind that is known
    _note_left_out(robot, left_out)
    return robot


def _include_files(root: ET.Element, path: Path) -> None:
    """Puts the content of each <include> in its place, as MuJoCo does.

    Files are searched for beside the MJCF, whichever file includes them, then beside that.

    Raises:
        ValueError: a file is missing, is no XML, or too many are included.
    """
    count = 0

    def expand(parent: ET.Element, source: Path) -> None:
        """Expands all below an element of the file `source`."""
        nonlocal count
        for child in list(parent):
            if child.tag != "include":
                expand(child, source)
                continue
            name = child.get("file", "")
            places = (path.parent / name, source.parent / name)
            file = next((place for place in places if place.is_file()), None)
            if file is None:
                raise ValueError(f'<include file="{name}">: no such file beside {path.name}')
            count += 1
            if count > _MAX_INCLUDES:
                raise ValueError(f"includes more than {_MAX_INCLUDES} files, or a file itself")
            try:
                included, _ = parse_document(file.read_bytes(), file)
            except InputError as error:
                raise ValueError(str(error)) from error
            _check_depth(included)
            expand(included, file)
            place = list(parent).index(child)
            parent[place : place + 1] = list(included)

    expand(root, path)


def _refuse_generated_bodies(root: ET.Element, path: Path) -> None:
    """Refuses elements in the place of which MuJoCo puts bodies: Drake leaves them out in silence.

    Raises:
        ValueError: with the command that writes the bodies out.
    """
    for tag in _GENERATED_BODIES:
        if root.find(f"worldbody//{tag}") is not None:
            raise ValueError(
                f'has bodies by <{tag}>, which MuJoCo alone writes out: python -c "import mujoco; '
                f"mujoco.mj_saveLastXML('flat.xml', mujoco.MjModel.from_xml_path('{path.name}'))\" "
                "makes flat.xml; draft that"
            )


def _make_frames_bodies(root: ET.Element) -> None:
    """Makes each <frame> a body that is fixed to its parent: Drake leaves frames out in silence.

    Its geoms weigh nothing where the body that has the frame states its inertia.

    Raises:
        ValueError: a frame has parts that are a body's alone, such as a joint.
    """
    names = {body.get("name") for body in root.iter("body")}
    number = 0

    def convert(parent: ET.Element, has_inertia: bool) -> None:
        nonlocal number
        for child in parent:
            if child.tag == "body":
                convert(child, child.find("inertial") is not None)
            if child.tag != "frame":
                continue
            others = [part.tag for part in child if part.tag not in _FRAME_PARTS]
            if others:
                raise ValueError(f"a <frame> has a <{others[0]}>: write it into the <body>")
            convert(child, has_inertia)
            child.tag, name = "body", None
            while name is None or name in names:
                number += 1
                name = f"{child.get('name', 'frame')}_{number}"
            child.set("name", name)
            if has_inertia or child.find("geom") is None:
                zero = {"pos": "0 0 0", "mass": "0", "diaginertia": "0 0 0"}
                child.insert(0, ET.Element("inertial", zero))  # `_give_mass` makes it negligible

    for worldbody in root.findall("worldbody"):
        convert(worldbody, has_inertia=True)


def _leave_objects(root: ET.Element) -> list[str]:
    """Leaves out bodies that float by themselves beside an arm: a scene has things to grasp.

    Returns:
        Their names.
    """
    left_out: list[str] = []
    bodies = [
        (world, body) for world in root.findall("worldbody") for body in world.findall("body")
    ]

    def has_motors(body: ET.Element) -> bool:
        return any(joint.get("type", "hinge") in ("hinge", "slide") for joint in body.iter("joint"))

    if not any(has_motors(body) for _, body in bodies):
        return left_out
    for world, body in bodies:
        floats = body.find("freejoint") is not None or any(
            joint.get("type") == "free" for joint in body.findall("joint")
        )
        if floats and not has_motors(body):
            world.remove(body)
            left_out.append(body.get("name") or "a body without a name")
    return left_out


def _check_angles(root: ET.Element) -> None:
    """Refuses a file that has its angles in radians and does not say so.

    Fragments that a program puts under a <compiler angle="radian"> of its own are such files: 46 of
    631 public MJCFs, all of them with right angles in radians.

    Raises:
        ValueError: no joint turns by more than 6.3 degrees, of an arm that has some; or a body
            stands turned by right angles in radians.
    """
    if any(compiler.get("angle") for compiler in root.iter("compiler")):
        return
    largest = [
        max(map(abs, _floats(joint.get("range", ""))), default=0.0)
        for joint in root.iter("joint")
        if joint.get("type", "hinge") == "hinge"
    ]
    ranges = [angle for angle in largest if angle > 0.0]
    if len(ranges) >= _MIN_RANGES and max(ranges) < _LARGEST_RAD:
        raise ValueError(
            f"its joints turn by {max(ranges):.3g} degrees at most, as an MJCF has degrees where "
            'nothing else is stated; if they are radians, write <compiler angle="radian"/> into '
            "its <mujoco>"
        )
    for element in root.iter():
        for angle in _floats(element.get("euler", "")):
            if any(abs(abs(angle) - right) < _RIGHT_ANGLE_DIGITS for right in _RIGHT_ANGLES):
                raise ValueError(
                    f'<{element.tag}> stands turned by euler="{element.get("euler")}" degrees, as '
                    "an MJCF has degrees where nothing else is stated; if they are radians, write "
                    '<compiler angle="radian"/> into its <mujoco>'
                )


def _floats(text: str) -> list[float]:
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        return []  # Drake says what is wrong with it


def _give_mass(root: ET.Element) -> None:
    """Gives bodies without mass a negligible one, which Drake needs and MuJoCo does not.

    A base that the world carries, or a frame that is fixed to a link, often has mass="0".
    """
    for inertial in root.iter("inertial"):
        if _is_zero(inertial.get("mass", "1")):
            inertial.attrib.pop("fullinertia", None)
            inertial.set("mass", repr(_NEGLIGIBLE_MASS))
            inertial.set("diaginertia", text_of([_NEGLIGIBLE_INERTIA] * 3))


def _is_zero(text: str) -> bool:
    try:
        return float(text) == 0.0
    except ValueError:
        return False  # Drake says what is wrong with it


def _find_files(root: ET.Element, folder: Path) -> None:
    """Makes the paths of meshes absolute: what Drake reads as a text has no folder."""
    mesh_folder = folder
    for compiler in root.iter("compiler"):
        place = compiler.attrib.pop("meshdir", compiler.get("assetdir"))
        mesh_folder = mesh_folder if place is None else folder / place
    for mesh in root.iter("mesh"):
        if mesh.get("file"):
            mesh.set("file", str(mesh_folder / mesh.get("file", "")))


def _instance_of(parser: Parser, root: ET.Element) -> ModelInstanceIndex:
    """The one model of a <mujoco>."""
    instances = parser.AddModelsFromString(ET.tostring(root, encoding="unicode"), "xml")
    if len(instances) != 1:
        raise ValueError(f"holds {len(instances)} models, expected one; split the file")
    return instances[0]


def _add_shapes(
    link: ET.Element, plant: MultibodyPlant, body: Any, inspector: Any, X_LB: RigidTransform
) -> None:
    """Adds the shapes that Drake has of a body."""
    for kind, geometries in (
        ("visual", plant.GetVisualGeometriesForBody(body)),
        ("collision", plant.GetCollisionGeometriesForBody(body)),
    ):
        for number, geometry in enumerate(geometries):
            element = ET.SubElement(link, kind, name=f"{body.name()}_{kind}_{number}")
            set_pose(element, X_LB @ inspector.GetPoseInFrame(geometry))
            _add_shape(ET.SubElement(element, "geometry"), inspector.GetShape(geometry))


def _add_shape(geometry: ET.Element, shape: Any) -> None:
    name = type(shape).__name__.lower()
    if isinstance(shape, Box):
        ET.SubElement(geometry, name, size=text_of(shape.size()))
    elif isinstance(shape, Sphere):
        ET.SubElement(geometry, name, radius=repr(shape.radius()))
    elif isinstance(shape, (Capsule, Cylinder)):
        size = {"radius": repr(shape.radius()), "length": repr(shape.length())}
        ET.SubElement(geometry, name, size)
    elif isinstance(shape, Ellipsoid):
        sides = {"a": shape.a(), "b": shape.b(), "c": shape.c()}
        ET.SubElement(geometry, name, {key: repr(value) for key, value in sides.items()})
    elif isinstance(shape, (Convex, Mesh)) and shape.source().is_path():
        file = Path(shape.source().path()).as_uri()
        ET.SubElement(geometry, "mesh", filename=file, scale=text_of(shape.scale3()))
    else:
        ET.SubElement(geometry, name)  # of no kind that is known: it is dropped


def _drop_meshes(root: ET.Element) -> None:
    """Takes the meshes out of a <mujoco>; a body that states its inertia needs no shape at all."""
    for asset in root.findall("asset"):
        for mesh in asset.findall("mesh"):
            asset.remove(mesh)
    for body in root.iter("body"):
        has_inertia = body.find("inertial") is not None
        for geom in body.findall("geom"):
            if has_inertia or geom.get("mesh") is not None:
                body.remove(geom)


def _urdf_of_plant(
    plant: MultibodyPlant, names: _Names, name: str, efforts: Mapping[str, float] | None = None
) -> tuple[ET.Element, dict[str, RigidTransform]]:
    """The <robot> of a model without its shapes, and the poses of its bodies in their links.

    A URDF has the frame of a link where the joint that moves it is: a body keeps its own frame only
    where no joint moves it.

    Args:
        plant: with the model, not necessarily finalized.
        names: of the model's bodies and joints.
        name: of the <robot>.
        efforts: N m or N by the joint's name; None: the plant's actuators state them.
    """
    robot = ET.Element("robot", name=name)
    joints = [plant.get_joint(index) for index in names.joints]
    # Of each body that a joint moves, the joint's frame in it: X_BL.
    in_body = {joint.child_body().index(): _frame(joint.frame_on_child()) for joint in joints}
    frames: dict[str, RigidTransform] = {}
    for index, body_name in names.bodies.items():
        X_LB = frames[body_name] = in_body.get(index, RigidTransform()).inverse()
        link = ET.SubElement(robot, "link", name=body_name)
        _add_inertial(link, plant.get_body(index), X_LB)
    actuators = {
        names.joints[actuator.joint().index()]: actuator
        for actuator in map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
    }
    if efforts is None:
        efforts = {joint: actuator.effort_limit() for joint, actuator in actuators.items()}
    if any(joint.parent_body().index() == plant.world_body().index() for joint in joints):
        ET.SubElement(robot, "link", name="world")
    for joint in joints:
        X_LP = in_body.get(joint.parent_body().index(), RigidTransform()).inverse()
        _add_joint(robot, joint, names, X_LP, float(efforts.get(names.joints[joint.index()], 0.0)))
    for joint_name, actuator in actuators.items():
        _add_rotor(robot, joint_name, actuator.default_reflected_inertia())
    return robot, frames


def _frame(frame: Any) -> RigidTransform:
    return frame.GetFixedPoseInBodyFrame()


def _add_joint(
    robot: ET.Element, joint: Any, names: _Names, X_LP: RigidTransform, effort: float
) -> None:
    """Appends a joint of Drake's to the <robot> as URDF states it.

    Its frame F on the parent is the child link's, with the joint at zero; that of a weld lies
    where the weld holds it. Angles that the file has rounded are written as the exact ones.

    Args:
        names: of the model's bodies and joints.
        X_LP: the parent body's frame in the parent link's.
        effort: N m or N; inf where there is no limit.
    """
    axis = None
    X_LF = X_LP @ _frame(joint.frame_on_parent())
    if isinstance(joint, WeldJoint):
        kind = "fixed"
        X_LF = X_LF @ joint.X_FM()
    elif isinstance(joint, RevoluteJoint):
        kind, axis = "revolute", joint.revolute_axis()
    elif isinstance(joint, PrismaticJoint):
        kind, axis = "prismatic", joint.translation_axis()
    else:
        kind = "floating"  # or planar, ball ...: none is an arm's
    parent, child = (
        names.bodies_and_world[body.index()] for body in (joint.parent_body(), joint.child_body())
    )
    element = fixed_joint(names.joints[joint.index()], parent, child, X_LF)
    robot.append(element)
    if (rpy := rounded_rpy(X_LF.rotation())) is not None:
        for origin in element.findall("origin"):
            origin.set("rpy", rpy)
    if axis is not None:
        ET.SubElement(element, "axis", xyz=text_of(axis))
        lower, upper = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
        if kind == "revolute" and not (math.isfinite(lower) and math.isfinite(upper)):
            kind = "continuous"
        limit = ET.SubElement(element, "limit")
        if kind == "prismatic":  # as a URDF has no slide without an end
            lower, upper = max(lower, -_ENDLESS_SLIDE), min(upper, _ENDLESS_SLIDE)
        if kind != "continuous":
            limit.set("lower", repr(float(lower)))
            limit.set("upper", repr(float(upper)))
        # What is not stated is left out, so that a 0 is one of the file.
        velocity = float(joint.velocity_upper_limits()[0])
        if math.isfinite(velocity):
            limit.set("velocity", repr(velocity))
        if 0.0 < effort < math.inf:
            limit.set("effort", repr(effort))
    element.set("type", kind)


def _add_rotor(robot: ET.Element, joint: str, reflected_inertia: float) -> None:
    """Appends what a URDF for Drake has for a rotor, kg m^2 (kg) on the joint side, if any."""
    if not reflected_inertia > 0.0:
        return
    transmission = ET.SubElement(robot, "transmission", name=f"{joint}_transmission")
    ET.SubElement(transmission, "joint", name=joint)
    actuator = ET.SubElement(transmission, "actuator", name=joint)
    ET.SubElement(actuator, "drake:rotor_inertia", value=repr(float(reflected_inertia)))


def _add_inertial(link: ET.Element, body: Any, X_LB: RigidTransform) -> None:
    inertia = body.default_spatial_inertia()
    mass, com = float(inertia.get_mass()), np.asarray(inertia.get_com())
    if mass <= _NEGLIGIBLE_MASS:
        return
    about_origin = inertia.CalcRotationalInertia().CopyToFullMatrix3()
    about_com = about_origin - point_inertia(mass, com)
    add_inertial(link, mass, X_LB @ RigidTransform(com), inertia_values(about_com))


def _add_sdf_shape(link: ET.Element, shape: ET.Element, name: str, X_LB: RigidTransform) -> None:
    element = ET.SubElement(link, shape.tag, name=name)
    geometry = ET.SubElement(element, "geometry")
    X_BG = _sdf_pose(shape.find("pose"))
    if X_BG is None:
        ET.SubElement(geometry, "sdf_pose")  # of no kind that is known: it is dropped
        return
    set_pose(element, X_LB @ X_BG)
    _add_geometry(geometry, shape.find("geometry"))


def _sdf_pose(pose: ET.Element | None) -> RigidTransform | None:
    """The pose of a shape in its link; None where it is relative to another frame, or is none."""
    if pose is None:
        return RigidTransform()
    if pose.get("relative_to"):
        return None
    try:
        values = np.array([float(word) for word in (pose.text or "0 0 0 0 0 0").split()])
    except ValueError:
        return None
    if not np.all(np.abs(values) <= _MAX_NUMBER):
        return None
    is_quaternion = pose.get("rotation_format", "euler_rpy") == "quat_xyzw"
    if values.shape != ((7,) if is_quaternion else (6,)):
        return None
    if not is_quaternion:
        factor = math.pi / 180.0 if pose.get("degrees") in ("true", "1") else 1.0
        return RigidTransform(RollPitchYaw(factor * values[3:]), values[:3])
    length = float(np.linalg.norm(values[3:]))
    if not length > 1e-6:
        return None
    wxyz = np.roll(values[3:], 1) / length
    return RigidTransform(RotationMatrix(Quaternion(wxyz)), values[:3])


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


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
