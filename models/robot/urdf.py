"""The reader of a URDF: checks it, and turns it into the effective URDF of a serial arm.

Drake's own messages about a broken URDF name neither line nor remedy, and some faults pass in
silence (no effort limit, a mesh that cannot be drawn). So the file is checked here first.
"""

import math
import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import NoReturn

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RollPitchYaw

from wrenchsight.models.files.configuration import nearest
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.arm_structure import SECOND_NAME
from wrenchsight.models.robot.collision_meshes import CollisionMeshes
from wrenchsight.models.robot.effective_urdf import EffectiveUrdf, JointLimits
from wrenchsight.models.robot.mimic_joints import followed_positions, leader_of
from wrenchsight.models.robot.robot_config import RobotConfig, ShapeConfig, ToolConfig
from wrenchsight.models.robot.rotational_inertia import (
    inertia_matrix,
    inertia_values,
    nearest_physical,
    point_inertia,
    possible_inertia,
    unphysical,
)
from wrenchsight.models.robot.rounded_angles import exact_angle
from wrenchsight.models.robot.urdf_document import drop_commas, place_of, read_document
from wrenchsight.models.robot.urdf_elements import (
    INERTIA,
    MAX_NUMBER,
    MOVING_JOINT_TYPES,
    add_inertial,
    fixed_joint,
    set_pose,
    text_of,
)
from wrenchsight.models.robot.urdf_pictures import drop_pictures
from wrenchsight.models.robot.urdf_shapes import settle_colours, settle_filters

_UNEXPANDED = "it is xacro, not yet expanded: name the file .xacro and pass --trust-xacro"
_KNOWN_TYPES = (*MOVING_JOINT_TYPES, "fixed", "floating", "planar")
_KEPT_TAGS = ("link", "joint", "material", "drake:collision_filter_group")
_MAX_TILT = math.radians(1.0)  # between two directions of gravity that agree
_LARGEST_INERTIA = 1e12  # kg m^2, of a number that is one: a heavy link's in g mm^2
_ENDLESS = re.compile(r"\s*[-+]?inf(inity)?\s*", re.IGNORECASE)
_MIN_AXIS = 1e-9  # of an axis that has a direction
_MIN_SPEED = 1e-6  # rad/s (m/s), of a joint that moves; a limit below is a slip, or negative


def read_urdf(path: Path, config: RobotConfig, config_source: Path) -> EffectiveUrdf:
    """Reads and checks `path` as the arm that `config` (from `config_source`) describes.

    Inertias that are missing or that no body can have are left out and reported
    (`EffectiveUrdf.inertia_fault`): kinematics need none.

    Raises:
        InputError: the file is no URDF; its tree is broken; a joint has an unknown type; the arm
            branches; a link or joint that `config` names is not there.
    """
    return _Reader(path, config, config_source).read()


class _Reader:
    def __init__(self, path: Path, config: RobotConfig, config_source: Path) -> None:
        """Holds the document while `read` changes it step by step; nothing is checked yet."""
        self.path = path
        self.config = config
        self.config_source = config_source
        self.base = config.base_link  # a base named "world" gets another name in `_collect`
        self.notices: list[str] = []  # of all steps
        # What `_check_inertias` finds: faults of what moves; whether and where possible_inertias
        # mends them.
        self.inertia_faults: list[InputError] = []
        self.may_be_mended = False
        self.massless: tuple[str, ...] = ()  # links that move without a mass
        self.mended: list[str] = []  # links whose impossible inertia a possible one replaces
        self.rounded: list[str] = []  # joints whose angles were written with few digits
        self.meshes = CollisionMeshes()  # those that `drop_pictures` drops, for their hulls
        self.root, self.lines = read_document(path, config_source)
        if with_commas := drop_commas(self.root):
            first = place_of(with_commas[0], self.lines)
            self.notices.append(
                f"{first}: commas between numbers are read as blanks, as PyBullet does, in "
                f"{len(with_commas)} places; other programs refuse the file, or misread it"
            )
        # By name, of `_collect`; later those of the arm alone.
        self.links: dict[str, ET.Element] = {}
        self.joints: dict[str, ET.Element] = {}
        # Of `_check_tree`.
        self.parent_joint: dict[str, ET.Element] = {}  # by child link
        self.child_joints: dict[str, list[ET.Element]] = {}  # by parent link
        # Of `_keep_below_base`.
        self.standing: dict[str, tuple[ET.Element, ET.Element]] = {}
        """Links around the arm that its base does not carry, and the joints that place them, by
        name: a torso's arm may hit its own machine."""

    def read(self) -> EffectiveUrdf:
        """The document: checked, locked, cut to the arm, with its tool.

        The steps change `root`, `links` and `joints` in place and rely on this order: only a
        checked tree can be locked, only a locked one cut, and what is dropped needs no check. The
        tool comes last: it is checked as robot.yaml states it, and its shapes need no settling.

        Raises:
            InputError: what makes the file no arm of moving joints from base to flange.
        """
        self._collect()
        if self.rounded:
            joints = ", ".join(self.rounded)
            self.notices.append(f"angles rounded to few digits are taken as exact: {joints}")
        self._check_tree()
        self._lock_joints()
        self._keep_below_base()
        moving = self._serial_chain()
        self._check_inertias(moving)
        settle_colours(self.root, self.links.values())
        shown = {**self.links, **{name: link for name, (link, _) in self.standing.items()}}
        self.notices += drop_pictures(shown, self.path, self.meshes)
        self._tidy_joints(moving)
        self._add_tool()
        limits = tuple(self._limits(joint) for joint in moving)  # removes those that Drake refuses
        endless = [
            limit.name
            for joint, limit in zip(moving, limits, strict=True)
            if joint.get("type") != "continuous" and not math.isfinite(limit.upper - limit.lower)
        ]
        if endless:
            self.notices.append(
                f"the file states no range of {', '.join(endless)}: a motion may turn or slide "
                'without end; write lower and upper into the <limit>, or type="continuous"'
            )
        standing = tuple(self.standing.values())
        return EffectiveUrdf(
            root=self.root,
            joints=limits,
            notices=tuple(self.notices),
            source=self.path,
            meshes=self.meshes,
            inertia_fault=self.inertia_faults[0] if self.inertia_faults else None,
            inertias_may_be_mended=self.may_be_mended,
            # Where that is the only fault: masses alone then make dynamics possible.
            massless=self.massless if len(self.inertia_faults) == 1 else (),
            standing=standing,
            base_link=self.base,
        )

    # Reading ----------------------------------------------------------------------------------

    def _collect(self) -> None:
        """Registers links and joints by name, and checks what each joint states of itself.

        Raises:
            InputError: a name that is taken, an unknown type, a link that does not exist, or an
                axis of length zero.
        """
        if self.base == "world":
            self.base = self._renamed_world()
        for link in self.root.findall("link"):
            self._register(link, self.links)
        parents = {self._parent(joint) for joint in self.root.findall("joint")}
        if "world" in parents and "world" not in self.links:  # as Drake has it
            self._register(ET.SubElement(self.root, "link", name="world"), self.links)
        for joint in self.root.findall("joint"):
            name = self._register(joint, self.joints)
            kind = joint.get("type", "")
            if kind not in _KNOWN_TYPES:
                remedy = nearest(kind, _KNOWN_TYPES) or "known types: " + ", ".join(_KNOWN_TYPES)
                self._fail(joint, f'joint "{name}" has the unknown type "{kind}"', remedy)
            for role in ("parent", "child"):
                end = joint.find(role)
                link_name = end.get("link", "") if end is not None else ""
                if link_name not in self.links:
                    problem = f'joint "{name}": its {role} link "{link_name}" does not exist'
                    self._fail(
                        end if end is not None else joint, problem, self._near_link(link_name)
                    )
            self._origin(joint)  # refuses what is no pose; rounded angles are then written out
            self._snap_angles(joint)
            if kind in MOVING_JOINT_TYPES and np.linalg.norm(self._axis(joint)) < _MIN_AXIS:
                self._fail(joint, f'joint "{name}" has an axis of length zero')

    def _renamed_world(self) -> str:
        """Gives the link "world" a name of the robot's own: an arm may stand on it by a rail, and
        Drake has a link of that name in every URDF. Returns the name; "world" where there is none.
        """
        ends = [end for joint in self.root.findall("joint") for end in joint.findall("parent")]
        joined = [end for end in ends if end.get("link") == "world"]
        links = [link for link in self.root.findall("link") if link.get("name") == "world"]
        if not joined:
            return "world"
        if not links:
            links = [ET.SubElement(self.root, "link")]
        name = "world_link"
        while any(link.get("name") == name for link in self.root.findall("link")):
            name += "_"
        for link in links:
            link.set("name", name)
        for end in joined:
            end.set("link", name)
        return name

    def _snap_angles(self, joint: ET.Element) -> None:
        """Writes rounded right angles of a joint's origin out."""
        origin = joint.find("origin")
        if origin is None:
            return
        words = origin.get("rpy", "0 0 0").split()
        exact = [exact_angle(word) for word in words]
        # Digits beyond a millionth of a radian were meant to be exact, and nearly are.
        if any(abs(value - float(word)) > 1e-7 for value, word in zip(exact, words, strict=True)):
            self.rounded.append(joint.get("name", ""))
        if exact != [float(word) for word in words]:
            origin.set("rpy", text_of(exact))

    def _register(self, element: ET.Element, elements: dict[str, ET.Element]) -> str:
        name = element.get("name", "")
        if not name:
            self._fail(element, f"a <{element.tag}> without a name")
        if name in elements:
            self._fail(element, f'a second {element.tag} "{name}"', SECOND_NAME)
        elements[name] = element
        return name

    def _check_tree(self) -> None:
        for joint in self.joints.values():
            child = self._child(joint)
            if child in self.parent_joint:
                first = self.parent_joint[child].get("name")
                problem = f'link "{child}" is the child of two joints, "{first}" and '
                self._fail(joint, problem + f'"{joint.get("name")}"', "a URDF is a tree")
            self.parent_joint[child] = joint
            self.child_joints.setdefault(self._parent(joint), []).append(joint)
        roots = [name for name in self.links if name not in self.parent_joint]
        if len(roots) > 1:
            listed = ", ".join(f'"{name}"' for name in roots)
            self._fail(
                self.links[roots[1]],
                f"the tree has {len(roots)} roots: {listed}",
                "join them with a fixed joint",
            )
        connected = set(self._below(roots[0])) if roots else set()
        for name, link in self.links.items():
            if name not in connected:
                self._fail(link, f'link "{name}" is part of a loop of joints', "a URDF is a tree")
        if not self.links:
            self._fail(self.root, "holds no <link>")

    # Reshaping --------------------------------------------------------------------------------

    def _lock_joints(self) -> None:
        """Makes the locked joints, and those that follow them, fixed at their positions."""
        locked = self.config.locked_joints
        for name in locked:
            if name not in self.joints:
                remedy = nearest(name, self.joints)
                problem = f'"{name}" is no joint of {self.path.name}'
                raise InputError(self.config_source, "locked_joints", problem, remedy)
        try:
            following = followed_positions(self.joints, locked)
        except ValueError as error:
            raise InputError(self.path, "", str(error)) from None
        for name, position in {**following, **locked}.items():
            joint = self.joints[name]
            kind = joint.get("type", "")
            if kind == "fixed":
                continue
            if kind not in MOVING_JOINT_TYPES:
                self._fail(joint, f'joint "{name}" of type "{kind}" cannot be locked')
            if position != 0.0:
                axis = self._axis(joint)
                axis /= np.linalg.norm(axis)
                motion = (
                    RigidTransform(position * axis)
                    if kind == "prismatic"
                    else RigidTransform(AngleAxis(position, axis), np.zeros(3))
                )
                set_pose(joint, self._origin(joint) @ motion)
            joint.set("type", "fixed")

    def _keep_below_base(self) -> None:
        """Drops all links that the base link does not carry: W is the base link's frame.

        Those with collision shapes go to `standing`: as obstacles at rest, each with a fixed joint
        to the base, where it stands with all joints at zero (locked joints are fixed by now).
        `root`, `links`, `joints` and `parent_joint` are cut; `child_joints` stays, as nothing asks
        for what links beside the arm carry.

        Raises:
            InputError: there is no base link of this name.
        """
        base = self.base
        if base not in self.links:
            problem = f'"{base}" is no link of the robot in {self.path.name}'
            raise InputError(self.config_source, "base_link", problem, self._near_link(base))
        (file_root,) = (name for name in self.links if name not in self.parent_joint)
        poses = self._below(file_root)  # of all links, in that one's frame
        self._compare_gravity(poses[base])  # a notice alone
        arm_links = set(self._below(base))
        dropped = [name for name in self.links if name not in arm_links]
        for name in dropped:
            link = self.links.pop(name)
            self.root.remove(link)
            if shapes := link.findall("collision"):
                self._let_stand(name, shapes, poses[base].inverse() @ poses[name])
        for name, element in list(self.joints.items()):
            if self._child(element) not in arm_links or self._parent(element) not in arm_links:
                self.root.remove(self.joints.pop(name))
        self.parent_joint.pop(base, None)
        if self.standing:
            self.notices.append(
                f'links not carried by "{base}" count as obstacles at rest in clearance checks: '
                f"{', '.join(self.standing)}"
            )
        lost = [name for name in dropped if name not in self.standing and name != "world"]
        if lost:
            self.notices.append(f'links not carried by "{base}" dropped: {", ".join(lost)}')
        for element in list(self.root):
            if element.tag not in _KEPT_TAGS:
                self.root.remove(element)
        settle_filters(self.root, arm_links)

    def _let_stand(self, name: str, shapes: list[ET.Element], X_BL: RigidTransform) -> None:
        """Adds a link's collision shapes to `standing`, at the link's pose in the base."""
        standing_name = "shapes of world" if name == "world" else name  # "world" is Drake's own
        obstacle = ET.Element("link", name=standing_name)
        obstacle.extend(shapes)
        joint = fixed_joint(f"{standing_name} stands", self.base, standing_name, X_BL)
        self.standing[standing_name] = (obstacle, joint)

    def _compare_gravity(self, X_RB: RigidTransform) -> None:
        """Notes where robot.yaml's gravity is not that of the mounting in the URDF."""
        down_B = -X_RB.rotation().matrix()[2]
        gravity = np.array(self.config.gravity)
        length = float(np.linalg.norm(gravity))
        if length > 0.0 and gravity @ down_B < math.cos(_MAX_TILT) * length:
            stated, mounted = (
                "[" + ", ".join(f"{x:.3g}" for x in np.round(g, 3) + 0.0) + "]"
                for g in (gravity, length * down_B)
            )
            self.notices.append(
                f'robot.yaml states gravity {stated}; as the URDF mounts "{self.base}" '
                f"it is {mounted} in W: robot.yaml's counts"
            )

    def _serial_chain(self) -> list[ET.Element]:
        """The moving joints from base to flange, in this order.

        Raises:
            InputError: no such flange or no joint to it, one of another type or that follows
                another (mimic), or a moving joint off the line, which has to be locked.
        """
        flange = self.config.flange
        if flange not in self.links:
            problem = f'"{flange}" is no link below "{self.base}"'
            raise InputError(self.config_source, "flange", problem, self._near_link(flange))
        chain: list[ET.Element] = []
        joint = self.parent_joint.get(flange)
        while joint is not None:
            if joint.get("type") != "fixed":
                chain.insert(0, joint)
            joint = self.parent_joint.get(self._parent(joint))
        if not chain:
            raise InputError(self.config_source, "flange", f'no moving joint carries "{flange}"')
        for joint in chain:
            kind, name = joint.get("type"), joint.get("name")
            if kind not in MOVING_JOINT_TYPES:
                self._fail(joint, f'joint "{name}": type "{kind}" is not supported in an arm')
            if leader_of(joint):
                self._fail(
                    joint,
                    f'joint "{name}" moves with "{leader_of(joint)}" (mimic): an arm needs a motor '
                    "for every joint from base to flange",
                    "choose a base or a flange that leaves it out, or lock both in robot.yaml",
                )
        off_chain = [j for j in self.joints.values() if j.get("type") != "fixed" and j not in chain]
        # A follower of one of these is at rest as soon as its leader is locked.
        leaders = {joint.get("name", "") for joint in off_chain}
        branches = [joint for joint in off_chain if leader_of(joint) not in leaders] or off_chain
        if branches:
            names = ", ".join(f'"{joint.get("name")}"' for joint in branches)
            self._fail(
                branches[0],
                f"moving joints off the line from base to flange: {names}",
                f"name them under locked_joints in {self.config_source.name}",
            )
        return chain

    def _tidy_joints(self, moving: list[ET.Element]) -> None:
        damped = []
        for joint in self.joints.values():
            dynamics = joint.find("dynamics")
            if dynamics is not None and joint in moving:
                values = (self._number(dynamics, key, 0.0) for key in ("damping", "friction"))
                if any(values):
                    damped.append(joint.get("name", ""))
            for child in list(joint):
                standard_tags = ("parent", "child", "origin", "axis", "limit")
                if child.tag not in standard_tags or (child.tag == "limit" and joint not in moving):
                    joint.remove(child)
        if damped:
            self.notices.append(
                f"joint friction of the URDF ignored ({', '.join(damped)}): "
                "robot.yaml states the friction"
            )

    def _add_tool(self) -> None:
        config = self.config
        for name in ("E", config.tool.name if config.tool else "E"):
            if name in self.links:
                self._fail(self.links[name], f'the link name "{name}" is taken', "rename the link")
        for name in ("tool_mount", "tool_frame"):
            if name in self.joints:
                self._fail(self.joints[name], f'the joint name "{name}" is taken', "rename it")
        carrier = config.flange
        if config.tool is not None:
            tool = config.tool
            link = ET.SubElement(self.root, "link", name=tool.name)
            add_inertial(link, tool.mass, RigidTransform(tool.com), tool.inertia)
            for kind, shapes in (("visual", tool.visual), ("collision", tool.collision)):
                for index, shape in enumerate(shapes):
                    self._add_shape(link, kind, f"{tool.name}_{kind}_{index}", shape)
            self.root.append(fixed_joint("tool_mount", carrier, tool.name, RigidTransform()))
            carrier = tool.name
        ET.SubElement(self.root, "link", name="E")
        frame = fixed_joint("tool_frame", carrier, "E", None)
        self.root.append(frame)
        pose = ET.SubElement(frame, "origin")  # as robot.yaml has it: no rounding
        pose.set("xyz", text_of(config.tool_frame.xyz))
        pose.set("rpy", text_of(config.tool_frame.rpy))

    def _add_shape(self, link: ET.Element, kind: str, name: str, shape: ShapeConfig) -> None:
        element = ET.SubElement(link, kind, name=name)
        ET.SubElement(element, "origin", xyz=text_of(shape.pose.xyz), rpy=text_of(shape.pose.rpy))
        geometry = ET.SubElement(element, "geometry")
        if shape.sphere is not None:
            ET.SubElement(geometry, "sphere", radius=repr(shape.sphere))
        elif shape.cylinder is not None:
            radius, length = shape.cylinder
            ET.SubElement(geometry, "cylinder", radius=repr(radius), length=repr(length))
        elif shape.box is not None:
            ET.SubElement(geometry, "box", size=text_of(shape.box))
        if kind == "visual":
            material = ET.SubElement(element, "material", name=f"{name}_colour")
            ET.SubElement(material, "color", rgba=text_of(shape.rgba))

    # Inertia ----------------------------------------------------------------------------------

    def _check_inertias(self, moving: list[ET.Element]) -> None:
        """Checks inertias of links, and of what moves as one; notes those that forbid dynamics.

        First each link for itself, and what is wrong is settled: only then are the moving links
        judged with what is fixed to them. Each fault of a link that moves goes to `inertia_faults`,
        and commands that need inertias will refuse the robot.

        Args:
            moving: joints from base to flange.

        Raises:
            InputError: of the tool, which robot.yaml states: its mass or inertia is none.
        """
        if self.config.tool is not None:
            self._check_tool(self.config.tool)
        self.may_be_mended = self._has_masses(moving)
        bodies = [self._child(joint) for joint in moving]
        carried = {name for body in bodies for name in self._below(body, True)}
        for name, link in self.links.items():
            try:
                self._check_inertia(name, link)
            except InputError as fault:
                is_fixed = name in carried and name not in bodies
                self._settle_fault(link, fault, moves=name in carried, is_fixed=is_fixed)
        if without_mass := [body for body in bodies if not self._mass_with_fixed(body) > 0.0]:
            self.inertia_faults.append(self._fault_without_mass(without_mass))
            self.massless = tuple(without_mass)
        for body in bodies:
            if body in without_mass:
                continue
            try:
                self._check_composite(body)
            except InputError as fault:
                if not self._mend(self.links[body]):
                    self.inertia_faults.append(fault)
        if self.mended:
            self.notices.append(
                "rotational inertias that no body has are replaced by the nearest possible ones "
                f"(possible_inertias): {', '.join(self.mended)}"
            )
        if self.inertia_faults:
            refusing = "commands that need inertias"
            if self.massless and self.config.simulated_truth.link_masses:
                refusing += ", except `simulate`,"
            self.notices.append(
                f"{refusing} will refuse this robot, all others work: {self.inertia_faults[0]}"
            )

    def _settle_fault(
        self, link: ET.Element, fault: InputError, *, moves: bool, is_fixed: bool
    ) -> None:
        """Changes a link whose inertia is not physical, so that Drake takes the file.

        Args:
            link: becomes a point mass where it is fixed to a moving one (a locked finger, a sensor:
                what moves is judged with all that is fixed to it); else it is mended where that is
                asked for; else it loses its inertia.
            fault: of its inertia.
            moves: whether the arm moves it: dynamics need its inertia.
            is_fixed: whether it is fixed to a moving link.
        """
        try:
            mass = self._inertia(link)[0]
        except InputError:  # something in it is no number: nothing of it can be kept
            mass = -math.inf
        if is_fixed and mass >= 0.0:
            for inertia in link.findall("inertial/inertia"):
                inertia.attrib = dict.fromkeys(INERTIA, "0")
            self.notices.append(f"taken as a point mass: {fault}")
            return
        if mass > 0.0 and self._mend(link):
            return
        if moves:
            self.inertia_faults.append(fault)
        for inertial in link.findall("inertial"):
            link.remove(inertial)

    def _mend(self, link: ET.Element) -> bool:
        """Gives a link the nearest possible inertia, where the robot.yaml asks for that."""
        if not (self.config.possible_inertias and self.may_be_mended):
            return False
        mass, _, about_com = self._inertia(link)
        if not mass > 0.0:
            return False
        inertial = link.find("inertial")
        assert inertial is not None, "it has a mass"
        R = self._origin(inertial).rotation().matrix()
        values = inertia_values(R.T @ possible_inertia(about_com, mass) @ R)
        for inertia in inertial.findall("inertia"):
            inertial.remove(inertia)
        attributes = dict(zip(INERTIA, map(repr, values), strict=True))
        inertial.append(ET.Element("inertia", attributes))
        self.mended.append(link.get("name", ""))
        return True

    def _has_masses(self, moving: list[ET.Element]) -> bool:
        """Whether each moving link has a mass, and nothing that is fixed to it less than none."""
        try:
            masses = [
                [self._inertia(self.links[name])[0] for name in self._below(body, True)]
                for body in map(self._child, moving)
            ]
        except InputError:  # no number: said where the link is checked
            return False
        return all(min(of_body) >= 0.0 and of_body[0] > 0.0 for of_body in masses)

    def _check_inertia(self, name: str, link: ET.Element) -> None:
        mass, _, about_com = self._inertia(link)
        if mass < 0:
            self._fail(link, f'link "{name}" has a mass of {mass:g} kg')
        if mass == 0 and np.any(about_com != 0):
            self._fail(link, f'link "{name}" has a rotational inertia but no mass')
        if mass > 0 and np.any(about_com != 0):
            self._check_physical(link, f'link "{name}"', about_com, self._nearest(link, about_com))

    def _mass_with_fixed(self, body: str) -> float:
        """kg, of a link with what is fixed to it, and the tool on its flange."""
        fixed = self._below(body, True)
        mass = sum(self._inertia(self.links[name])[0] for name in fixed)
        tool = self.config.tool
        return mass if tool is None or self.config.flange not in fixed else mass + tool.mass

    def _fault_without_mass(self, bodies: list[str]) -> InputError:
        """What is wrong where moving links, and what is fixed to them, have no mass."""
        listed = ", ".join(f'"{body}"' for body in bodies)
        if len(bodies) == 1:
            problem = f"moving link {listed} and what is fixed to it have no mass"
            remedy = "give it an <inertial>"
        else:
            problem = f"moving links {listed} and what is fixed to them have no mass"
            remedy = "give each an <inertial>"
        if self.config.flange in self._below(bodies[-1], True):
            carrier = "it" if len(bodies) == 1 else f'"{bodies[-1]}"'
            remedy += f", or state what {carrier} carries as tool in {self.config_source.name}"
        place = place_of(self.links[bodies[0]], self.lines)
        return InputError(self.path, place, problem, remedy)

    def _check_composite(self, body: str) -> None:
        """Checks a moving link that has a mass, with what is fixed to it.

        Masses, centres of mass and inertias are put into the link's frame and summed up about the
        common centre of mass.

        Args:
            body: name of the link.

        Raises:
            InputError: an inertia that no body has.
        """
        tool = self.config.tool
        bodies = []  # mass, centre of mass and inertia about it, in the link's frame
        for name, pose in self._below(body, True).items():
            mass, com, about_com = self._inertia(self.links[name])
            R = pose.rotation().matrix()
            bodies.append((mass, pose @ com, R @ about_com @ R.T))
            if tool is not None and name == self.config.flange:
                bodies.append(
                    (
                        tool.mass,
                        pose @ np.array(tool.com),
                        R @ inertia_matrix(tool.inertia) @ R.T,
                    )
                )
        total = sum(mass for mass, _, _ in bodies)
        link = self.links[body]
        common_com = sum((mass * com for mass, com, _ in bodies), np.zeros(3)) / total
        composite = np.zeros((3, 3))
        for mass, com, about_com in bodies:
            composite += about_com + point_inertia(mass, com - common_com)
        self._check_physical(link, f'moving link "{body}" (with what is fixed to it)', composite)

    def _check_tool(self, tool: ToolConfig) -> None:
        if not tool.mass > 0:
            raise InputError(self.config_source, "tool.mass", f"{tool.mass:g}, expected kg above 0")
        problem = unphysical(inertia_matrix(tool.inertia))
        if problem:
            raise InputError(self.config_source, "tool.inertia", f"not physical: {problem}")

    def _nearest(self, link: ET.Element, about_com: Array) -> str:
        """A sentence with the possible values nearest to a link's, as its file states them."""
        inertial = link.find("inertial")
        nearest = nearest_physical(about_com)
        if inertial is None or nearest is None:
            return ""
        R = self._origin(inertial).rotation().matrix()
        values = zip(INERTIA, inertia_values(R.T @ nearest @ R), strict=True)
        attributes = " ".join(f'{key}="{value:.6g}"' for key, value in values)
        return f"; the nearest possible ones are <inertia {attributes}/>"

    def _check_physical(
        self, link: ET.Element, description: str, inertia: Array, nearest: str = ""
    ) -> None:
        problem = unphysical(inertia)
        if problem:
            inertial = link.find("inertial")
            self._fail(
                inertial if inertial is not None else link,
                f"{description} has no physical inertia: {problem}",
                f"expected values about the centre of mass in kg m^2{nearest}",
            )

    def _inertia(self, link: ET.Element) -> tuple[float, Array, Array]:
        """Mass, centre of mass and inertia about it, in axes of the link."""
        inertial = link.find("inertial")
        if inertial is None:
            return 0.0, np.zeros(3), np.zeros((3, 3))
        mass_element, inertia_element = inertial.find("mass"), inertial.find("inertia")
        mass = 0.0 if mass_element is None else self._number(mass_element, "value", 0.0)
        pose = self._origin(inertial)
        values = [0.0] * 6
        if inertia_element is not None:
            values = [self._number(inertia_element, key, 0.0, _LARGEST_INERTIA) for key in INERTIA]
        R = pose.rotation().matrix()
        return mass, pose.translation(), R @ inertia_matrix(values) @ R.T

    # Small parts ------------------------------------------------------------------------------

    def _below(self, link: str, is_fixed: bool = False) -> dict[str, RigidTransform]:
        """`link` and all that it carries, or that is fixed to it: poses in it, joints at 0."""
        poses = {link: RigidTransform()}
        waiting = [link]
        while waiting:
            name = waiting.pop()
            for joint in self.child_joints.get(name, []):
                if not is_fixed or joint.get("type") == "fixed":
                    poses[self._child(joint)] = poses[name] @ self._origin(joint)
                    waiting.append(self._child(joint))
        return poses

    def _limits(self, joint: ET.Element) -> JointLimits:
        """The limits of a moving joint, and their place in the file.

        A speed or effort of 0, or beyond MAX_NUMBER, counts as not stated, which is inf and None;
        a range of which an end is beyond it is open there.

        Raises:
            InputError: a range without room, or a speed of nearly zero.
        """
        name = joint.get("name", "")
        limit = joint.find("limit")
        lower, upper, velocity, effort = -math.inf, math.inf, math.inf, 0.0
        if limit is not None:
            velocity = self._limit(limit, "velocity") or math.inf
            effort = self._limit(limit, "effort")
            if joint.get("type") != "continuous":
                lower, upper = self._limit(limit, "lower"), self._limit(limit, "upper")
        if lower >= upper:
            self._fail(
                limit if limit is not None else joint,
                f'joint "{name}": lower limit {lower:g} is not below the upper {upper:g}',
                "write its travel into the URDF, or lock the joint in robot.yaml",
            )
        if not velocity >= _MIN_SPEED:
            problem = (
                f'joint "{name}": velocity limit {velocity:g}, expected {_MIN_SPEED:g} or more'
            )
            self._fail(joint, problem)
        is_stated = 0 < effort < math.inf
        return JointLimits(
            name=name,
            place=place_of(joint, self.lines),
            lower=lower,
            upper=upper,
            velocity=velocity,
            effort=effort if is_stated else None,
        )

    def _limit(self, limit: ET.Element, key: str) -> float:
        """A limit of a joint; inf beyond MAX_NUMBER, and then removed for Drake, too."""
        if _ENDLESS.fullmatch(limit.get(key, "")):
            value = float(limit.get(key, ""))
        else:
            value = self._number(limit, key, 0.0, math.inf)
        if abs(value) > MAX_NUMBER:
            limit.attrib.pop(key)
            value = math.copysign(math.inf, value)
        return value

    def _axis(self, joint: ET.Element) -> Array:
        axis = joint.find("axis")
        return np.array([1.0, 0.0, 0.0]) if axis is None else self._vector(axis, "xyz")

    def _origin(self, element: ET.Element) -> RigidTransform:
        origin = element.find("origin")
        if origin is None:
            return RigidTransform()
        return RigidTransform(
            RollPitchYaw(self._vector(origin, "rpy")), self._vector(origin, "xyz")
        )

    def _vector(self, element: ET.Element, key: str) -> Array:
        text = element.get(key, "0 0 0")
        try:
            values = np.array([float(word) for word in text.split()])
        except ValueError:
            values = np.array([])
        if values.shape != (3,) or not np.all(np.abs(values) <= MAX_NUMBER):
            problem = f'{key}="{text}" of <{element.tag}>, expected three numbers'
            remedy = _UNEXPANDED if "$" in text else ""
            self._fail(element, f"{problem} of at most {MAX_NUMBER:g}", remedy)
        return values

    def _number(
        self, element: ET.Element, key: str, default: float, largest: float = MAX_NUMBER
    ) -> float:
        text = element.get(key)
        try:
            value = default if text is None else float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or abs(value) > largest:
            at_most = f" of at most {largest:g}" if math.isfinite(value) else ""
            problem = f'{key}="{text}" of <{element.tag}>, expected a number{at_most}'
            self._fail(element, problem, _UNEXPANDED if "$" in (text or "") else "")
        return value

    @staticmethod
    def _end(joint: ET.Element, role: str) -> str:
        element = joint.find(role)
        return element.get("link", "") if element is not None else ""

    def _parent(self, joint: ET.Element) -> str:
        return self._end(joint, "parent")

    def _child(self, joint: ET.Element) -> str:
        return self._end(joint, "child")

    def _near_link(self, name: str) -> str:
        return nearest(name, self.links) or "links: " + ", ".join(self.links)

    def _fail(self, element: ET.Element, problem: str, remedy: str = "") -> NoReturn:
        raise InputError(self.path, place_of(element, self.lines), problem, remedy)
