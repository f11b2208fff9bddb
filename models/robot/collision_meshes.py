"""The collision shapes of a URDF that Drake cannot take as they stand."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from wrenchsight.models.robot.convex_hulls import UnusableMeshError, hull_file


class CollisionMeshes:
    """Collision elements that have been taken out of a URDF, and the hulls that stand for them."""

    def __init__(self) -> None:
        self._meshes: list[tuple[ET.Element, ET.Element, Path]] = []  # link, element, mesh
        self._lost: list[str] = []
        self._placed: list[tuple[ET.Element, ET.Element]] | None = None

    @property
    def count(self) -> int:
        """How many of them are meshes in files that a hull may be made of."""
        return len(self._meshes)

    def add(self, link: ET.Element, element: ET.Element, mesh: Path | None, reason: str) -> None:
        """Notes an element of a link; `mesh` is None where no hull can stand for it."""
        if mesh is None:
            self._lost.append(f"{link.get('name')} ({reason})")
        else:
            element.set("name", f"{link.get('name')}_hull_{len(self._meshes)}")
            self._meshes.append((link, element, mesh))

    def unusable(self) -> tuple[str, ...]:
        """Links with a shape that nothing stands for, each with the reason; hulls are made now."""
        self._place()
        return tuple(self._lost)

    @contextmanager
    def as_hulls(self) -> Iterator[None]:
        """Puts the hulls into their links for the length of the block."""
        placed = self._place()
        for link, element in placed:
            link.append(element)
        try:
            yield
        finally:
            for link, element in placed:
                link.remove(element)

    def _place(self) -> list[tuple[ET.Element, ET.Element]]:
        if self._placed is None:
            self._placed = []
            for link, element, mesh in self._meshes:
                try:
                    hull = hull_file(mesh)
                except UnusableMeshError as error:
                    self._lost.append(f"{link.get('name')} ({error})")
                    continue
                shape = element.find("geometry/mesh")
                assert shape is not None
                shape.set("filename", hull.as_uri())
                self._placed.append((link, element))
        return self._placed
