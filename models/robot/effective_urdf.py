"""A checked serial arm as one URDF document."""

import copy
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.collision_meshes import CollisionMeshes
from wrenchsight.models.robot.urdf_elements import set_pose

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
