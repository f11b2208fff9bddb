"""A checked serial arm as one URDF document."""

import copy
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.collision_meshes import CollisionMeshes
from wrenchsight.models.robot.rotational_inertia import ball_moment, inertia_values
from wrenchsight.models.robot.urdf_elements import INERTIA, set_pose, text_of

_NAMESPACES = {"drake": "http://drake.mit.edu"}


@dataclass(frozen=True)
class JointLimits:
    """The limits of a moving joint in the URDF."""

    name: str
    place: str  # in the file, of `place_of`
    lower: float  # rad or m; -inf where there is none
    upper: float
    velocity: float  # rad/s or m/s; inf where there is none
    effort: float | None  # N m or N; None where it is missing or not above 0


class EffectiveUrdf:
    """A checked serial arm as one self-contained URDF document."""

    def __init__(
        self,
        root: ET.Element,
        joints: tuple[JointLimits, ...],
        notices: tuple[str, ...],
        source: Path,
        meshes: CollisionMeshes,
        inertia_fault: InputError | None = None,
        inertias_may_be_mended: bool = False,
        massless: tuple[str, ...] = (),
        standing: tuple[tuple[ET.Element, ET.Element], ...] = (),
        base_link: str = "",
    ) -> None:
        _declare_prefixes(root)
        self._root = root
        self.meshes = meshes
        self.joints = joints  # moving ones, base to tool
        self.notices = notices
        self.source = source
        self.base_link = base_link  # its name in the document
        self._standing = standing  # links around the arm and their joints, where distances count
        self.inertia_fault = inertia_fault  # the first, where dynamics cannot be computed
        self.inertias_may_be_mended = inertias_may_be_mended  # by possible_inertias of a robot.yaml
        self.massless = massless  # links that move; where only their masses are missing

    def with_moved_joints(self, joint_poses: Mapping[str, tuple[Array, Array]]) -> "EffectiveUrdf":
        """A copy with the frames of some joints moved, relative to their parents' links.

        Args:
            joint_poses: by name, translation (3,) m and rotation vector (3,) rad from a joint's
                frame as it is to the moved one, in axes of the former.
        """
        root = copy.deepcopy(self._root)
        for joint in root.iter("joint"):
            # Without an axis a <joint> is fixed, or belongs to a transmission.
            if joint.get("name") not in joint_poses or joint.find("axis") is None:
                continue
            translation, rotation = joint_poses[str(joint.get("name"))]
            angle = float(np.linalg.norm(rotation))
            axis = rotation / angle if angle > 0.0 else np.array([0.0, 0.0, 1.0])
            move = RigidTransform(RotationMatrix(AngleAxis(angle, axis)), translation)
            set_pose(joint, _origin(joint) @ move)
        moved = copy.copy(self)
        moved._root = root
        return moved

    @property
    def massless_joints(self) -> tuple[int, ...]:
        """The joints whose links have no mass, where that is all that dynamics lack."""
        children = self._moved_links()
        return tuple(j for j, link in enumerate(children) if link in self.massless)

    def with_rods(self, masses: Sequence[float], ends: Array) -> "EffectiveUrdf":
        """A copy in which links without a mass are even rods, where that is all that is missing.

        A rod's inertia is m (|e|^2 1 - e e^T) / 12 about its middle, that of a ball of its mass
        added, so that it turns about its own line with some. The notice of the fault goes with it.

        Args:
            masses: (n,) kg of the moving links; those of links with a mass are not read.
            ends: (n, 3) m, in each link's frame: the rods reach from its origin to there.
        """
        root = copy.deepcopy(self._root)
        links = {link.get("name"): link for link in root.findall("link")}
        children = self._moved_links()
        for j in self.massless_joints:
            rod = masses[j] / 12.0 * (ends[j] @ ends[j] * np.eye(3) - np.outer(ends[j], ends[j]))
            values = inertia_values(rod + ball_moment(masses[j]) * np.eye(3))
            link = links[children[j]]
            for stated in link.findall("inertial"):  # without a mass
                link.remove(stated)
            inertial = ET.SubElement(link, "inertial")
            ET.SubElement(inertial, "origin", xyz=text_of(0.5 * ends[j]))
            ET.SubElement(inertial, "mass", value=repr(float(masses[j])))
            attributes = dict(zip(INERTIA, map(repr, values), strict=True))
            ET.SubElement(inertial, "inertia", attributes)
        heavy = copy.copy(self)
        heavy._root = root
        heavy.notices = tuple(n for n in self.notices if not n.endswith(str(self.inertia_fault)))
        heavy.inertia_fault, heavy.massless = None, ()
        return heavy

    def _moved_links(self) -> list[str]:
        """Names of the links that the moving joints carry, base to tool."""
        children = {}
        for joint in self._root.findall("joint"):
            child = joint.find("child")
            if child is not None:
                children[joint.get("name", "")] = child.get("link", "")
        return [children[joint.name] for joint in self.joints]

    def text(self, name: str, hulls: bool = False) -> str:
        """The document, with `name` as the robot's.

        Args:
            hulls: with the convex hulls of the collision meshes that Drake does not read, and with
                the links that stand around the arm: for distances.
        """
        root = self.element(name)
        if hulls:
            root.extend(copy.deepcopy(element) for pair in self._standing for element in pair)
            links = {link.get("name"): link for link in root.findall("link")}
            for link, element in self.meshes.hulls():
                links[link].append(element)
        return ET.tostring(root, encoding="unicode")

    def element(self, name: str) -> ET.Element:
        """A copy of the document's <robot>, with `name` as the robot's; prefixes stay in names."""
        root = copy.deepcopy(self._root)
        root.set("name", name)
        return root


def _origin(joint: ET.Element) -> RigidTransform:
    """The pose that a joint states for its frame in its parent link's; left out, that frame."""
    origin = joint.find("origin")
    stated = {} if origin is None else origin.attrib
    xyz = np.array(stated.get("xyz", "0 0 0").split(), dtype=np.float64)
    rpy = np.array(stated.get("rpy", "0 0 0").split(), dtype=np.float64)
    return RigidTransform(RollPitchYaw(rpy), xyz)


def _declare_prefixes(root: ET.Element) -> None:
    """Declares the prefixes of a <robot> that its file does not: Drake asks for none, XML does."""
    for element in root.iter():
        for name in (element.tag, *element.attrib):
            prefix, colon, _ = name.partition(":")
            if colon and prefix not in ("xml", "xmlns"):
                root.attrib.setdefault(f"xmlns:{prefix}", _NAMESPACES.get(prefix, f"urn:{prefix}"))
