import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.motion.workpieces import BladeSection, Plate, Surface, mesh

SURFACES = [Plate(0.5, 0.2), BladeSection(), BladeSection(thickness=0.4, camber=0.0, edge=0.2)]


@pytest.mark.parametrize("surface", SURFACES)
def test_derivatives_are_those_of_finite_differences(surface: Surface) -> None:
    rng = np.random.default_rng(0)
    u, v = rng.uniform(0.05, 0.95, (2, 100))
    h = 1e-6
    at = surface.at(u, v)
    for du, dv, p_d, n_d in ((h, 0.0, at.p_u, at.n_u), (0.0, h, at.p_v, at.n_v)):
        ahead, behind = surface.at(u + du, v + dv), surface.at(u - du, v - dv)
        # Central differences: h^2 times third derivatives (the normal turns fast at the edges).
        np.testing.assert_allclose((ahead.p - behind.p) / (2 * h), p_d, rtol=0, atol=1e-8)
        np.testing.assert_allclose((ahead.n - behind.n) / (2 * h), n_d, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("surface", SURFACES)
def test_normals_are_unit_and_across_the_surface(surface: Surface) -> None:
    u, v = np.meshgrid(np.linspace(0, 1, 50), np.linspace(0, 1, 9))
    at = surface.at(u, v)
    np.testing.assert_allclose(np.linalg.norm(at.n, axis=-1), 1.0, rtol=0, atol=1e-14)
    for tangent in (at.p_u, at.p_v):
        assert np.max(np.abs(np.sum(at.n * tangent, axis=-1))) < 1e-14
    assert np.all(np.sum(np.cross(at.p_u, at.p_v) * at.n, axis=-1) > 0.0)


def test_the_blade_is_closed_and_its_normals_point_out() -> None:
    blade = BladeSection(root_twist=0.0, tip_twist=0.0, root_chord=0.3, tip_chord=0.3)
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
    blade = BladeSection(root_twist=0.2, tip_twist=0.0, root_chord=0.4, tip_chord=0.2)
    u = np.linspace(0.0, 1.0, 2001)
    root, tip = blade.at(u, np.zeros_like(u)).p, blade.at(u, np.ones_like(u)).p
    nose, tail = root[np.argmin(root[:, 0])], root[np.argmax(root[:, 0])]
    angle = math.atan2(nose[2] - tail[2], tail[0] - nose[0])
    flat = BladeSection(root_twist=0.0, tip_twist=0.0, root_chord=0.4, tip_chord=0.2)
    level = flat.at(u, np.zeros_like(u)).p
    nose, tail = level[np.argmin(level[:, 0])], level[np.argmax(level[:, 0])]
    # Where the profile is longest moves a little round its edges as it is turned.
    assert angle - math.atan2(nose[2] - tail[2], tail[0] - nose[0]) == pytest.approx(0.2, abs=0.03)
    assert np.ptp(tip[:, 0]) == pytest.approx(0.2, rel=1e-6)
    np.testing.assert_allclose(tip[:, 1], blade.span)


@settings(max_examples=30, deadline=None)
@given(st.floats(0.02, 0.5), st.floats(0.0, 0.12), st.floats(0.02, 0.3), st.floats(0.1, 1.0))
def test_every_allowed_blade_is_smooth(
    thickness: float, camber: float, edge: float, chord: float
) -> None:
    blade = BladeSection(
        thickness=thickness, camber=camber, edge=edge, root_chord=chord, tip_chord=chord
    )
    at = blade.at(np.linspace(0.0, 1.0, 500), 0.5)
    assert np.all(np.linalg.norm(at.p_u, axis=-1) > 1e-4 * chord)
    assert np.all(np.isfinite(at.n_u))


def test_the_mesh_lies_on_the_surface_and_faces_outward() -> None:
    blade = BladeSection()
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
    expected = np.trapezoid(areas, np.linspace(0.0, blade.span, 21))
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
        BladeSection(**arguments)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="length"):
        Plate(length=-1.0)
