import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.planning.motion.surface_path import SurfacePath, frame_about, rotation_about
from wrenchsight.models.planning.motion.workpieces import BladeShapeConfig, Plate

HEADER = "x,y,z,nx,ny,nz\n"


def test_samples_lie_on_the_surface_at_even_distances() -> None:
    blade = BladeShapeConfig().surface()
    R_WP = Rotation.from_euler("xyz", [0.1, 0.2, 0.3]).as_matrix()
    p_WP = np.array([0.4, -0.2, 0.1])
    path = SurfacePath.on_surface(blade, (0.55, 0.2), (0.95, 0.8), 61, R_WP, p_WP)
    steps = np.diff(path.distance)
    # Even to the curvature of the path within a step, and the interpolation of the arc length.
    np.testing.assert_allclose(steps, steps.mean(), rtol=2e-3)
    ends = blade.at([0.55, 0.95], [0.2, 0.8])
    np.testing.assert_allclose(path.p_WS[[0, -1]], ends.p @ R_WP.T + p_WP, atol=1e-12)
    np.testing.assert_allclose(path.n_W[[0, -1]], ends.n @ R_WP.T, atol=1e-12)


def test_a_closed_profile_goes_on_round() -> None:
    path = SurfacePath.on_surface(BladeShapeConfig().surface(), (0.75, 0.5), (1.25, 0.5), 400)
    assert path.num_samples == 400
    with pytest.raises(InputError, match="leaves the surface"):
        SurfacePath.on_surface(Plate(0.3, 0.2), (0.75, 0.5), (1.25, 0.5), 20)


def test_the_tool_points_into_the_surface_at_every_angle() -> None:
    path = SurfacePath.on_surface(BladeShapeConfig().surface(), (0.55, 0.2), (0.9, 0.8), 25)
    axis = np.array([0.3, -0.4, 0.5])
    for psi in (0.0, 1.0, -2.5):
        R_WE = path.orientations(np.full(25, psi), axis)
        np.testing.assert_allclose(
            R_WE @ np.swapaxes(R_WE, 1, 2), np.broadcast_to(np.eye(3), (25, 3, 3)), atol=1e-14
        )
        np.testing.assert_allclose(
            R_WE @ (axis / np.linalg.norm(axis)), -path.n_W, rtol=0, atol=1e-14
        )
    turned = path.orientations(np.full(25, 0.7), axis) @ np.swapaxes(path.frames(axis), 1, 2)
    vectors = Rotation.from_matrix(turned).as_rotvec()
    np.testing.assert_allclose(vectors, 0.7 * path.n_W, rtol=0, atol=1e-12)


def test_frames_do_not_turn_about_the_normal_on_their_way() -> None:
    """On a cylinder, parallel transport round it leaves the axis where it is."""
    angle = np.linspace(0.0, 2.0, 50)
    normals = np.stack([np.cos(angle), np.zeros(50), np.sin(angle)], axis=1)
    path = SurfacePath(0.3 * normals, normals)
    R_WE = path.frames()
    np.testing.assert_allclose(R_WE[:, :, 1], np.tile(R_WE[0, :, 1], (50, 1)), atol=1e-12)
    # The first axis lies along the path, as far as the normal lets it.
    np.testing.assert_allclose(R_WE[0] @ [1, 0, 0], [0, 0, 1], atol=1e-12)


def test_a_flat_path_keeps_one_orientation() -> None:
    path = SurfacePath.on_surface(Plate(0.3, 0.2), (0.1, 0.1), (0.9, 0.9), 10)
    np.testing.assert_allclose(path.frames(), np.tile(path.frames()[0], (10, 1, 1)), atol=1e-15)
    np.testing.assert_allclose(frame_about(np.array([0.0, 0.0, 2.0])), np.eye(3), atol=0)


def test_rotations_are_rodrigues() -> None:
    rng = np.random.default_rng(0)
    axis = rng.normal(size=(20, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    angle = rng.uniform(-4.0, 4.0, 20)
    expected = Rotation.from_rotvec(axis * angle[:, np.newaxis]).as_matrix()
    np.testing.assert_allclose(rotation_about(axis, angle), expected, atol=1e-14)


def test_a_cam_file_is_read_in_the_workpieces_frame(tmp_path: Path) -> None:
    file = tmp_path / "path.csv"
    file.write_text("id,nx,ny,nz,x,y,z\na,0,0,1,0.1,0.2,0.3\n\nb,0,0.6,0.8,0.2,0.2,0.3\n")
    R_WP = Rotation.from_euler("z", math.pi / 2).as_matrix()
    path = SurfacePath.read_csv(file, R_WP, np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(path.p_WS, [[0.8, 0.1, 0.3], [0.8, 0.2, 0.3]], atol=1e-15)
    np.testing.assert_allclose(path.n_W, [[0, 0, 1], [-0.6, 0, 0.8]], atol=1e-15)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x,y,z,nx,ny\n", ["line 1", "nz"]),
        (HEADER + "0,0,0,0,0,1\n", ["1 samples", "two or more"]),
        (HEADER, ["0 samples"]),
        (HEADER + "0,0,0,0,0,1\n1,0,0,0,0,2\n", ["line 3", "length 2", "unit"]),
        (HEADER + "0,0,0,0,0,1\n1,0,0,0,0,1\n2,0,0,0,0,-1\n", ["line 4", "other side"]),
        (HEADER + "0,0,0,0,0,1\n1,nan,0,0,0,1\n", ["line 3", "finite"]),
        (HEADER + "0,0,0,0,0,1\n1e200,0,0,0,0,1\n", ["line 3", "1e+200 m", "1000 at most"]),
        (HEADER + "0,0,0,0,0,1\n1,0,0,1e308,0,1e308\n", ["line 3", "length inf"]),
        (HEADER + "0,0,0,0,0,1\n1,x,0,0,0,1\n", ["line 3", "column y", '"x"']),
        (HEADER + "0,0,0,0,0,1\n1,0\n", ["line 3", "column z", "nothing"]),
        (HEADER + "0,0,0,0,0,1\n0,0,0,0,0,1\n", ["line 3", "line before"]),
    ],
)
def test_a_bad_cam_file_is_one_clear_line(tmp_path: Path, text: str, words: list[str]) -> None:
    file = tmp_path / "path.csv"
    file.write_text(text)
    with pytest.raises(InputError) as caught:
        SurfacePath.read_csv(file)
    line = str(caught.value)
    assert line.startswith(str(file)) and "\n" not in line
    for word in words:
        assert word in line
    with pytest.raises(InputError, match="no such file"):
        SurfacePath.read_csv(tmp_path / "none.csv")
    with pytest.raises(InputError, match="larger than 16 MB"):
        SurfacePath.read_csv("/dev/zero")
