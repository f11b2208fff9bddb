"""The collision meshes of a URDF that Drake cannot read, and their convex hulls."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from wrenchsight.models.robot.convex_hulls import UnusableMeshError, hull_file, hull_vertices


class CollisionMeshes:
    """Collision elements that have been taken out of a URDF, and the hulls that stand for them."""

    def __init__(self) -> None:
        self._meshes: list[tuple[str, ET.Element, Path]] = []  # link, element, mesh
        self._unusable: list[str] = []
        self._hulls: list[tuple[str, ET.Element]] | None = None
        self._hull_files: list[Path] = []  # of `_hulls`

    @property
    def count(self) -> int:
        """Number of elements with a mesh file of which a hull may be made."""
        return len(self._meshes)

    def add(self, link: str, element: ET.Element, mesh: Path | None, reason: str) -> None:
        """Adds an element of a link; `mesh` is None where no hull can be made of it."""
        if mesh is None:
            self._unusable.append(f"{link} ({reason})")
        else:
            element.set("name", f"{link}_hull_{len(self._meshes)}")
            self._meshes.append((link, element, mesh))

    def unusable(self) -> tuple[str, ...]:
        """Links with a shape that has no hull, each with the reason; hulls are made now."""
        self.hulls()
        return tuple(self._unusable)

    def hulls(self) -> list[tuple[str, ET.Element]]:
        """The hulls as collision elements, each with its link's name; made at the first call."""
        if self._hulls is None:
            self._hulls = []
            for link, element, mesh in self._meshes:
                try:
                    hull = hull_file(mesh)
                except UnusableMeshError as error:
                    self._unusable.append(f"{link} ({error})")
                    continue
                shape = element.find("geometry/mesh")
                assert shape is not None
                shape.set("filename", hull.as_uri())
                self._hulls.append((link, element))
                self._hull_files.append(hull)
        return self._hulls

    def lengths(self) -> dict[str, float]:
        """m, the longest side along an axis of the hulls, by link; the largest of a link's."""
        lengths: dict[str, float] = {}
        for (link, element), path in zip(self.hulls(), self._hull_files, strict=True):
            shape = element.find("geometry/mesh")
            assert shape is not None
            scale = np.array([float(word) for word in shape.get("scale", "1 1 1").split()])
            sides = scale * np.ptp(hull_vertices(path), axis=0)
            lengths[link] = max(lengths.get(link, 0.0), float(np.abs(sides).max()))
        return lengths
