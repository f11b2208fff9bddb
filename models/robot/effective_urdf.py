"""A checked serial arm as one URDF document."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

from models.files.input_error import InputError
from models.robot.collision_meshes import CollisionMeshes


@dataclass(frozen=True)
class JointLimits:
    """What the URDF says of a moving joint."""

    name: str
    line: int  # of the file; 0 where it was no URDF
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
    ) -> None:
        self._root = root
        self.meshes = meshes
        self.joints = joints  # moving ones, base to tool
        self.notices = notices
        self.source = source
        self.inertia_fault = inertia_fault  # the first, where dynamics cannot be told

    def text(self, name: str, hulls: bool = False) -> str:
        """The document, with `name` as the robot's.

        Args:
            hulls: with the convex hulls of the collision meshes that Drake does not read.
        """
        self._root.set("name", name)
        if not hulls:
            return ET.tostring(self._root, encoding="unicode")
        with self.meshes.as_hulls():
            return ET.tostring(self._root, encoding="unicode")
