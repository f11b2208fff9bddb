"""Hulls of meshes, against scipy's test of what lies inside and coal's reading of the files."""

from collections.abc import Iterator
from pathlib import Path

import coal
import numpy as np
import pytest
import scipy.spatial
import trimesh
from scipy.spatial import ConvexHull

from wrenchsight.models.robot import convex_hulls
from wrenchsight.models.robot.convex_hulls import UnusableMeshError, convex_hull, hull_file


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A cache of the test's own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    yield tmp_path / "cache" / "wrenchsight" / "hulls"


def _beyond(points: np.ndarray, vertices: np.ndarray) -> float:
    """How far a point lies outside the hull of the vertices, m; negative inside."""
    planes = ConvexHull(vertices).equations
    return float((points @ planes[:, :3].T + planes[:, 3]).max())


@pytest.mark.parametrize("count", [30, 5000])
def test_a_hull_contains_its_points(count: int) -> None:
    rng = np.random.default_rng(count)
    points = rng.normal(size=(count, 3))
    if count > 100:  # all of them corners
        points *= [[0.3, 0.1, 0.2]] / np.linalg.norm(points, axis=1, keepdims=True)
    vertices, faces = convex_hull(points)
    assert len(vertices) <= 800
    assert _beyond(points, vertices) < 1e-12
    # Between planes of 150 directions, 10 degrees from one another, a body may bulge a little.
    assert _beyond(vertices, points) < 0.04 * 0.3
    corners = vertices[faces]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    middle = corners.mean(axis=1) - vertices.mean(axis=0)
    assert (np.einsum("ij,ij->i", outward, middle) > 0).all()


def test_a_plane_has_none() -> None:
    points = np.random.default_rng(0).normal(size=(50, 3)) * [1.0, 1.0, 0.0]
    with pytest.raises(UnusableMeshError, match="lie in a plane"):
        convex_hull(points)


def test_the_file_is_made_once(
    tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = tmp_path / "part.STL"
    trimesh.creation.annulus(0.05, 0.1, 0.3).export(mesh, file_type="stl")
    first = hull_file(mesh)
    assert first.parent == cache
    assert [file.suffix for file in cache.iterdir()] == [".obj"]
    read = trimesh.load_mesh(first)
    assert read.volume == pytest.approx(trimesh.load_mesh(mesh).convex_hull.volume, rel=1e-6)
    monkeypatch.setattr(convex_hulls, "convex_hull", None)  # not asked again
    assert hull_file(mesh) == first


def test_where_the_cache_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cache").write_text("a file")
    monkeypatch.setattr(convex_hulls.tempfile, "gettempdir", lambda: str(tmp_path / "temporary"))
    mesh = tmp_path / "part.stl"
    trimesh.creation.box((0.1, 0.2, 0.3)).export(mesh)
    assert hull_file(mesh).is_relative_to(tmp_path / "temporary")


def test_nothing_is_left_of_a_file_that_cannot_be_written(
    tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(path: Path, target: Path) -> None:
        raise OSError("no space left on device")

    mesh = tmp_path / "part.stl"
    trimesh.creation.box((0.1, 0.2, 0.3)).export(mesh)
    monkeypatch.setattr(Path, "replace", fails)
    with pytest.raises(UnusableMeshError, match="no folder"):
        hull_file(mesh)
    assert list(cache.iterdir()) == []


@pytest.mark.parametrize("content", [b"", b"solid nothing\nendsolid", b"\0" * 300])
def test_a_damaged_file(tmp_path: Path, content: bytes) -> None:
    mesh = tmp_path / "part.stl"
    mesh.write_bytes(content)
    with pytest.raises(UnusableMeshError):
        hull_file(mesh)
    with pytest.raises(UnusableMeshError, match=r"\.step"):
        hull_file(tmp_path / "part.step")


@pytest.mark.parametrize(
    "name",
    [
        "ur_description/meshes/ur5/collision/forearm.stl",
        "panda_description/meshes/collision/link5.stl",
        "kinova_description/meshes/arm.dae",
        "kinova_description/meshes/base.dae",
    ],
)
def test_the_place_and_size_are_those_that_coal_reads(wheel_robots: Path, name: str) -> None:
    shape = coal.MeshLoader().load(str(wheel_robots / name), np.ones(3))
    shape.computeLocalAABB()
    vertices = np.asarray(trimesh.load_mesh(hull_file(wheel_robots / name)).vertices)
    np.testing.assert_allclose(vertices.min(axis=0), shape.aabb_local.min_, atol=1e-6)
    np.testing.assert_allclose(vertices.max(axis=0), shape.aabb_local.max_, atol=1e-6)


def test_no_many_points_in_one_plane_come_to_qhull(monkeypatch: pytest.MonkeyPatch) -> None:
    """A cylinder with 30,000 points on each rim: qhull merges their facets for over a minute."""
    angle = np.linspace(0.0, 2.0 * np.pi, 30_000, endpoint=False)
    rim = np.column_stack([0.05 * np.cos(angle), 0.05 * np.sin(angle)])
    points = np.concatenate([np.insert(rim, 2, z, axis=1) for z in (0.0, 0.2)])

    def hull(given: np.ndarray, qhull_options: str | None = None) -> ConvexHull:
        assert qhull_options == "QJ" or len(given) <= 20_000
        return ConvexHull(given, qhull_options=qhull_options)

    monkeypatch.setattr(scipy.spatial, "ConvexHull", hull)
    vertices, _ = convex_hull(points)
    assert _beyond(points[::100], vertices) < 1e-8  # m: what qhull moves points by
    # Planes of 150 directions, 10 degrees from one another, leave the rim a bulge.
    assert (np.abs(vertices) < [0.052, 0.052, 0.2 + 1e-9]).all()


def test_a_fine_box_is_a_box() -> None:
    x = np.linspace(-1.0, 1.0, 70)
    side = np.array([(a, b, c) for a in x for b in x for c in (-1.0, 1.0)])
    points = np.concatenate([np.roll(side, k, axis=1) for k in range(3)])
    vertices, _ = convex_hull(points)
    assert sorted(map(tuple, vertices.round(9))) == sorted(
        (a, b, c) for a in (-1.0, 1.0) for b in (-1.0, 1.0) for c in (-1.0, 1.0)
    )
