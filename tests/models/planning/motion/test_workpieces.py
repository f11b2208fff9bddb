import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.planning.motion.workpieces import (
    BladeShapeConfig,
    Plate,
    PlateShapeConfig,
    Surface,
    mesh,
)

SURFACES = [
    Plate(0.5, 0.2),
    BladeShapeConfig().surface(),
    BladeShapeConfig(thickness=0.4, camber=0.0).surface(),
]


@pytest.mark.parametrize("surface", SURFACES)
def test_normals_are_unit_across_the_surface_and_out_of_it(surface: Surface) -> None:
    rng = np.random.default_rng(0)
    u, v = rng.uniform(0.05, 0.95, (2, 100))
    n, h = surface.at(u, v).n, 1e-6
    np.testing.assert_allclose(np.linalg.norm(n, axis=-1), 1.0, rtol=0, atol=1e-14)
    p_u = (surface.at(u + h, v).p - surface.at(u - h, v).p) / (2 * h)
    p_v = (surface.at(u, v + h).p - surface.at(u, v - h).p) / (2 * h)
    outward = np.cross(p_u, p_v)
    outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
    # Central differences: h^2 times third derivatives (the normal turns fast at the edges).
    np.testing.assert_allclose(n, outward, rtol=0, atol=1e-7)


def test_the_blade_is_closed_and_its_normals_point_out() -> None:
    blade = BladeShapeConfig(0.5, 0.3, 0.3, 0.0, 0.0).surface()
    u = np.linspace(0.0, 1.0, 4001)
    at = blade.at(u, np.zeros_like(u))
    np.testing.assert_allclose(at.p[0], at.p[-1], rtol=0, atol=1e-14)
    np.testing.assert_allclose(at.n[0], at.n[-1], rtol=0, atol=1e-12)
    # Gauss: the outward flux of (x, 0, z) / 2 round the profile is its area; so is Green's sum.
    length = np.linalg.norm(np.diff(at.p, axis=0), axis=1)
    middle = blade.at(0.5 * (u[1:] + u[:-1]), np.zeros(4000))
    flux = 0.5 * np.sum(np.sum(middle.p * middle.n, axis=1) * length)
    x, z = at.p[:, 0], at.p[:, 2]
    area = 0.5 * abs(np.sum(x[:-1] * z[1:] - x[1:] * z[:-1]))
    assert flux == pytest.approx(area, rel=1e-5)
    assert np.ptp(x) == pytest.approx(0.3, rel=1e-5)
    assert np.ptp(z) / 0.3 == pytest.approx(0.24, rel=0.2)  # thickness, roughly


def test_twist_raises_the_leading_edge_and_taper_shortens_the_chord() -> None:
    blade = BladeShapeConfig(0.5, 0.4, 0.2, math.degrees(0.2), 0.0).surface()
    u = np.linspace(0.0, 1.0, 2001)
    root, tip = blade.at(u, np.zeros_like(u)).p, blade.at(u, np.ones_like(u)).p
    nose, tail = root[np.argmin(root[:, 0])], root[np.argmax(root[:, 0])]
    angle = math.atan2(nose[2] - tail[2], tail[0] - nose[0])
    flat = BladeShapeConfig(0.5, 0.4, 0.2, 0.0, 0.0).surface()
    level = flat.at(u, np.zeros_like(u)).p
    nose, tail = level[np.argmin(level[:, 0])], level[np.argmax(level[:, 0])]
    # Where the profile is longest moves a little round its edges as it is turned.
    assert angle - math.atan2(nose[2] - tail[2], tail[0] - nose[0]) == pytest.approx(0.2, abs=0.03)
    assert np.ptp(tip[:, 0]) == pytest.approx(0.2, rel=1e-6)
    np.testing.assert_allclose(tip[:, 1], 0.5)


@settings(max_examples=30, deadline=None)
@given(st.floats(0.02, 0.5), st.floats(0.0, 0.12), st.floats(0.1, 1.0))
def test_every_allowed_blade_is_smooth(thickness: float, camber: float, chord: float) -> None:
    shape = BladeShapeConfig(thickness=thickness, camber=camber, root_chord=chord, tip_chord=chord)
    at = shape.surface().at(np.linspace(0.0, 1.0, 500), 0.5)
    assert np.all(np.linalg.norm(np.diff(at.p, axis=0), axis=-1) > 1e-4 / 500 * chord)
    assert np.all(np.sum(at.n[1:] * at.n[:-1], axis=-1) > 0.0)  # no edge to turn round


def test_the_mesh_lies_on_the_surface_and_faces_outward() -> None:
    blade = BladeShapeConfig().surface()
    vertices, triangles = mesh(blade, 61, 11)
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    assert np.all(area > 0.0)
    # A mesh that faces outward encloses a positive volume (its open ends add nothing here: they
    # lie across y, and the field has no y).
    field = (a + b + c) / 3.0 * [1.0, 0.0, 1.0]
    volume = 0.25 * np.sum(field * np.cross(b - a, c - a))
    u = np.linspace(0.0, 1.0, 2001)
    areas = []
    for v in np.linspace(0.0, 1.0, 21):
        p = blade.at(u, np.full_like(u, v)).p
        areas.append(0.5 * abs(np.sum(p[:-1, 0] * p[1:, 2] - p[1:, 0] * p[:-1, 2])))
    expected = np.trapezoid(areas, np.linspace(0.0, 0.5, 21))
    assert volume == pytest.approx(expected, rel=0.02)  # 60 chords of a curved profile


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"thickness": 0.9}, "thickness"),
        ({"camber": -0.1}, "camber"),
        ({"span": 0.0}, "span"),
        ({"tip_chord": math.nan}, "tip_chord"),
    ],
)
def test_impossible_blades_are_refused(arguments: dict[str, float], word: str) -> None:
    with pytest.raises(InputError, match=word):
        BladeShapeConfig(**arguments).surface()
    with pytest.raises(InputError, match="length"):
        PlateShapeConfig(length=-1.0).surface()
