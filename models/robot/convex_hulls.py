"""Convex hulls of collision meshes, in files that Drake reads.

Drake's distances know convex shapes only, and it makes hulls of .obj, .vtk and .gltf files alone.
Robots come with STL and COLLADA files: their hull is computed once and stored in the user's cache,
under the digest of the mesh.

A hull contains its mesh, so that a motion that keeps clear of it keeps clear of the mesh.
"""

import hashlib
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from wrenchsight.models.files.files_read import about_to_read
from wrenchsight.models.numerics.arrays import Array

HULL_SUFFIXES = (".stl", ".dae", ".obj", ".ply", ".off", ".glb")
_HULL_VERSION = b"1"  # of the way that hulls are made; another one leaves those in the cache alone
_LARGEST_FILE = 1 << 28  # bytes
_MOST_VERTICES = 800  # Drake's distances take longer with every vertex
_MANY_POINTS = 20_000  # as many on two circles take qhull some 10 s
_MAX_DIRECTIONS = 150  # of the supporting planes that bound a hull of more


class UnusableMeshError(Exception):
    """A mesh has no hull; the message says why."""


def hull_file(mesh: Path) -> Path:
    """Returns the .obj file of a mesh's convex hull; made if it is not in the cache.

    Raises:
        UnusableMeshError: the file is damaged, flat, or of a kind that is not read.
    """
    suffix = mesh.suffix.lower()
    if suffix not in HULL_SUFFIXES:
        raise UnusableMeshError(suffix or "no file name")
    about_to_read(mesh)
    if mesh.stat().st_size > _LARGEST_FILE:
        raise UnusableMeshError(f"{suffix}, larger than {_LARGEST_FILE >> 20} MB")
    data = mesh.read_bytes()
    digest = hashlib.sha256(_HULL_VERSION + suffix.encode() + data).hexdigest()[:32]
    for folder in _cache_folders():
        path = folder / f"{digest}.obj"
        if path.is_file():
            return path
    vertices, faces = convex_hull(_vertices(mesh))
    text = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in vertices.tolist())
    text += "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces.tolist())
    for folder in _cache_folders():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _write_whole(folder / f"{digest}.obj", text)
        except OSError:
            continue
        return folder / f"{digest}.obj"
    raise UnusableMeshError("no folder to keep its convex hull in")


def hull_vertices(path: Path) -> Array:
    """(V, 3) of a file that `hull_file` has made, in the mesh's unit."""
    lines = path.read_text().splitlines()
    return np.array([line.split()[1:] for line in lines if line.startswith("v ")], float)


def _write_whole(path: Path, text: str) -> None:
    """Writes the file whole or not at all; another process may write the same one meanwhile.

    Raises:
        OSError: it cannot be written.
    """
    handle, name = tempfile.mkstemp(dir=path.parent, suffix=".partial")
    partial = Path(name)
    try:
        with os.fdopen(handle, "w") as file:
            file.write(text)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def convex_hull(points: Array) -> tuple[Array, Any]:
    """Vertices (V, 3) and triangles (F, 3), seen from outside counter-clockwise, of a hull.

    A hull of many vertices is replaced by one of fewer that contains it: the part of space that
    lies within the supporting planes of directions spread evenly over the sphere.

    Raises:
        UnusableMeshError: the points lie in a plane.
    """
    from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

    try:
        if len(points) > _MANY_POINTS:
            # Moved by rounding, no points lie in one plane: qhull takes minutes to hours to merge
            # the facets of as many points on a circle.
            points = points[ConvexHull(points, qhull_options="QJ").vertices]
        hull = None if len(points) > _MANY_POINTS else ConvexHull(points)
        if hull is None or len(hull.vertices) > _MOST_VERTICES:
            # A plane touches the hull in each direction; behind all of them lies the outer hull.
            corners = points if hull is None else points[hull.vertices]
            normals = _spread_directions(_MAX_DIRECTIONS)  # (D, 3) unit
            heights = (normals @ corners.T).max(axis=1)
            inner_point = corners.mean(axis=0)
            planes = np.column_stack([normals, -heights])  # normal . x - height <= 0 inside
            outer = HalfspaceIntersection(planes, inner_point).intersections
            hull = ConvexHull(outer)
            points = outer
    except (QhullError, ValueError) as error:
        raise UnusableMeshError("its points lie in a plane") from error
    # scipy's triangles count all points, in either sense of rotation: they are to count the
    # vertices alone, with their normals outwards, as those of its planes (`equations`).
    index = np.full(len(points), -1)  # of a point: its place among the vertices
    index[hull.vertices] = np.arange(len(hull.vertices))
    faces = hull.simplices.copy()
    triangles = points[faces]  # (F, 3 corners, 3)
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    is_inward = np.einsum("ij,ij->i", normal, hull.equations[:, :3]) < 0
    faces[is_inward] = faces[is_inward][:, [0, 2, 1]]
    return points[hull.vertices], index[faces]


def _spread_directions(count: int) -> Array:
    """(count, 3) unit vectors on a Fibonacci spiral, and the six axes: boxes stay boxes."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    angle = np.pi * (1.0 + np.sqrt(5.0)) * k
    r = np.sqrt(1.0 - z * z)
    spiral = np.column_stack([r * np.cos(angle), r * np.sin(angle), z])
    return np.concatenate([spiral, np.eye(3), -np.eye(3)])


def _vertices(mesh: Path) -> Array:
    """Vertices (N, 3) of a mesh file, each part where the file places it, in the file's unit.

    Of a COLLADA file the unit is applied and the upward axis is ignored, as other tools for robots
    do.
    """
    import trimesh

    try:
        loaded = trimesh.load_scene(mesh)
        vertices = np.asarray(loaded.to_mesh().vertices, np.float64)
    except Exception as error:  # whatever a reader meets in a damaged file
        raise UnusableMeshError(f"{mesh.suffix.lower()}, cannot be read") from error
    if len(vertices) < 4 or not np.isfinite(vertices).all():
        raise UnusableMeshError(f"{mesh.suffix.lower()}, holds no solid")
    return vertices


def _cache_folders() -> list[Path]:
    """Folders for hulls: the user's cache, else a folder for the user in the temporary one."""
    cache = os.environ.get("XDG_CACHE_HOME") or str(Path("~").expanduser() / ".cache")
    user = os.getuid() if hasattr(os, "getuid") else 0
    temporary = Path(tempfile.gettempdir()) / f"wrenchsight-{user}"
    return [Path(cache) / "wrenchsight" / "hulls", temporary / "hulls"]
