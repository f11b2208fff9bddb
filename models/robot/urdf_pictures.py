"""The visual and collision shapes of a URDF: shapes that Drake cannot read are dropped."""

import xml.etree.ElementTree as ET
from pathlib import Path

from wrenchsight.models.files.files_read import about_to_read
from wrenchsight.models.robot.collision_meshes import CollisionMeshes
from wrenchsight.models.robot.convex_hulls import HULL_SUFFIXES
from wrenchsight.models.robot.gltf import gltf_fault
from wrenchsight.models.robot.ros_packages import find_package
from wrenchsight.models.robot.urdf_shapes import hull_fault, size_fault

_MESH_SUFFIXES = (".obj", ".gltf", ".vtk")
_SHAPE_TAGS = (
    "box",
    "cylinder",
    "sphere",
    "capsule",
    "ellipsoid",
    "drake:capsule",
    "drake:ellipsoid",
)


def drop_pictures(
    links: dict[str, ET.Element], urdf: Path, collisions: CollisionMeshes
) -> list[str]:
    """Drops the shapes that Drake cannot read; collision meshes go to `collisions`.

    Args:
        links: by name, changed.
        urdf: the file; meshes are searched for beside it and above.
        collisions: takes the meshes whose convex hulls can be made.

    Returns:
        Sentences on the dropped shapes.
    """
    dropped: dict[tuple[str, str], int] = {}  # number of shapes by their kind and the reason
    for name, link in links.items():
        for kind in ("visual", "collision"):
            for element in link.findall(kind):
                reason = _with_mesh_resolved(element, urdf)
                if not reason:
                    continue
                link.remove(element)
                if kind == "collision":
                    # None where no hull can be made: it is dropped, for a reason that says more
                    # where the file is missing.
                    mesh, missing = _mesh_for_hull(element, urdf)
                    collisions.add(name, element, mesh, missing or reason)
                    if mesh is not None:
                        continue
                dropped[kind, reason] = dropped.get((kind, reason), 0) + 1
    notices = []
    if collisions.count:
        notices.append(
            f"{collisions.count} collision meshes count as their convex hulls in clearance checks; "
            "in a simulation nothing collides with them"
        )
    without = {"visual": "it is drawn without them", "collision": "nothing collides with them"}
    for (kind, reason), count in dropped.items():
        shapes = "shape" if count == 1 else "shapes"
        notices.append(f"{count} {kind} {shapes} dropped ({reason}): {without[kind]}")
    return notices


def _with_mesh_resolved(element: ET.Element, urdf: Path) -> str:
    """Makes the mesh of a visual or collision element one that Drake finds, by its whole path.

    Returns:
        The reason why Drake cannot read the element, which is then left as it is; '' if it can.
    """
    geometry = element.find("geometry")
    shape = next(iter(geometry), None) if geometry is not None else None
    if shape is None:
        return "no geometry"
    if shape.tag not in (*_SHAPE_TAGS, "mesh"):
        return f"<{shape.tag}>"
    if fault := size_fault(shape):
        return fault
    if shape.tag != "mesh":
        return ""
    name = shape.get("filename", "")
    suffix = Path(name).suffix.lower()
    if suffix not in _MESH_SUFFIXES:
        return suffix or "no file name"
    mesh_file = resolved_mesh(name, urdf)
    if mesh_file is None:
        return f"{suffix}, file not found"
    about_to_read(mesh_file)
    if suffix == ".gltf" and (fault := gltf_fault(mesh_file)):
        return fault
    if element.tag == "collision" and (fault := hull_fault(mesh_file)):
        return fault
    shape.set("filename", mesh_file.as_uri())
    return ""


def _mesh_for_hull(element: ET.Element, urdf: Path) -> tuple[Path | None, str]:
    """The file of a collision mesh whose hull can be made, and an error where it is missing."""
    shape = element.find("geometry/mesh")
    name = "" if shape is None else shape.get("filename", "")
    mesh_file = resolved_mesh(name, urdf) if name else None
    if name and mesh_file is None:
        return None, f"{name} not found, searched for at {_mesh_places(name, urdf)[0]} and above"
    return mesh_file if Path(name).suffix.lower() in HULL_SUFFIXES else None, ""


def resolved_mesh(name: str, urdf: Path) -> Path | None:
    """The file of a mesh's URI; a package is searched for as in `ros_packages`."""
    found = next((path for path in _mesh_places(name, urdf) if path.is_file()), None)
    if found is None and name.startswith("package://"):
        package, _, path_in_package = _path_of(name).partition("/")
        folder = find_package(package, urdf.resolve().parent)
        if folder is not None and (folder / path_in_package).is_file():
            found = folder / path_in_package
    return found


def _path_of(name: str) -> str:
    """PACKAGE/PATH of a URI; package:///PACKAGE/PATH is written, too."""
    return name.removeprefix("package://").lstrip("/")


def _mesh_places(name: str, urdf: Path) -> list[Path]:
    folder = urdf.resolve().parent
    if name.startswith("package://"):
        relative = _path_of(name)
        path_in_package = relative.partition("/")[2]
        candidates = [parent / relative for parent in (folder, *folder.parents)]
        candidates += [
            parent / path_in_package
            for parent in (folder, *folder.parents)
            if (parent / "package.xml").is_file()
        ]
        return candidates
    return [folder / name.removeprefix("file://")]
