"""Workpieces with exact smooth surfaces: a plate, and a section of a wind turbine blade.

A surface maps two parameters (u, v) in [0, 1] to a point in the workpiece's frame P, with the
derivatives of position and of the outward unit normal. All is closed form: what a contact or a path
needs is exact, whatever the mesh that is drawn.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrenchsight.models.arrays import Array
from wrenchsight.models.files.input_error import InputError

Indices = NDArray[np.int32]
_Complex = NDArray[np.complex128]


class SurfacePatch(NamedTuple):
    """A surface at N pairs (u, v), in axes of P; each field (..., 3).

    Attributes:
        p: the points S, p_PS, m.
        n: outward unit normals.
        p_u, p_v: derivatives of p, m.
        n_u, n_v: derivatives of n, 1.
    """

    p: Array
    n: Array
    p_u: Array
    p_v: Array
    n_u: Array
    n_v: Array


class Surface(Protocol):
    """A smooth surface over the unit square."""

    periodic_u: bool  # whether u = 1 is u = 0 again

    def at(self, u: ArrayLike, v: ArrayLike) -> SurfacePatch:
        """The surface at u and v of one shape (...)."""


@dataclass(frozen=True)
class Plate:
    """A flat rectangle: u along x, v along y, normal along z, its middle at P's origin.

    Attributes:
        length: along x, m.
        width: along y, m.
    """

    length: float = 0.4
    width: float = 0.3

    periodic_u = False

    def __post_init__(self) -> None:
        _check_positive("plate", length=self.length, width=self.width)

    def at(self, u: ArrayLike, v: ArrayLike) -> SurfacePatch:
        """The surface at u and v of one shape (...)."""
        u, v = _parameters(u, v)
        zero = np.zeros_like(u)
        p = np.stack([(u - 0.5) * self.length, (v - 0.5) * self.width, zero], axis=-1)
        axes = np.broadcast_to(np.eye(3)[:, np.newaxis], (3, u.size, 3)).reshape(3, *u.shape, 3)
        nothing = np.zeros_like(p)
        return SurfacePatch(
            p, axes[2].copy(), self.length * axes[0], self.width * axes[1], nothing, nothing.copy()
        )


@dataclass(frozen=True)
class BladeSection:
    """A section of a wind turbine blade: an aerofoil that tapers and twists along the span.

    The profile is the image of a circle w under w + b^2 / w (Joukowsky's map) with both of the
    map's singular points inside the circle: an aerofoil whose leading and trailing edges are round,
    analytic all the way round. In P the chord lies along x (leading edge at small x), the span
    along y (v = 0 at y = 0), the suction side up (z). u goes round the profile from the trailing
    edge along the pressure side to the leading edge (near u = 0.5) and back over the suction side.
    Twist turns each profile about the span's axis, nose up; that axis runs through the origin, at
    `pitch_axis` of the chord.

    Attributes:
        span: m.
        root_chord, tip_chord: m; linear between.
        root_twist, tip_twist: rad; linear between.
        thickness: largest thickness over chord, roughly; 0.02 to 0.5.
        camber: rise of the mean line over chord, roughly; 0 to 0.12.
        edge: radius of the trailing edge, as how far the circle passes outside of the singular
            point, over b; 0.02 to 0.3.
        pitch_axis: along the chord, 0 at the leading edge.

    Raises:
        InputError: a dimension out of range.
    """

    span: float = 0.5
    root_chord: float = 0.34
    tip_chord: float = 0.26
    root_twist: float = math.radians(10.0)
    tip_twist: float = math.radians(2.0)
    thickness: float = 0.24
    camber: float = 0.05
    edge: float = 0.06
    pitch_axis: float = 0.35

    periodic_u = True

    _circle: tuple[complex, float, complex, float] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        _check_positive(
            "blade", span=self.span, root_chord=self.root_chord, tip_chord=self.tip_chord
        )
        for name, low, high in (
            ("thickness", 0.02, 0.5),
            ("camber", 0.0, 0.12),
            ("edge", 0.02, 0.3),
            ("pitch_axis", 0.0, 1.0),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise InputError("blade", name, f"{value:g}, expected {low:g} to {high:g}")
        # b = 1. The circle passes `edge` outside of +1; its middle lies to the left for thickness
        # (a Joukowsky profile of offset e is about 1.3 e thick) and up for camber.
        middle = complex(-0.77 * self.thickness, 2.0 * self.camber)
        radius = abs(1.0 + self.edge - middle)
        t = np.linspace(0.0, 2.0 * math.pi, 4001)
        z = _joukowsky(middle, radius, t)[0]
        # The profile begins (u = 0) where it reaches farthest back, and has unit chord.
        first, last = float(np.min(z.real)), float(np.max(z.real))
        chord = last - first
        axis = complex(first + self.pitch_axis * chord, 0.0)
        object.__setattr__(self, "_circle", (middle, radius, axis, chord))

    @cached_property
    def _start(self) -> float:
        middle, radius, _, _ = self._circle
        t = np.linspace(-1.0, 1.0, 20001)
        return float(t[np.argmax(_joukowsky(middle, radius, t)[0].real)])

    def at(self, u: ArrayLike, v: ArrayLike) -> SurfacePatch:
        """The surface at u and v of one shape (...)."""
        u, v = _parameters(u, v)
        middle, radius, axis, chord = self._circle
        turn = -2.0 * math.pi  # clockwise in x and z, so that p_u x p_v points outward
        z, z_t, z_tt = _joukowsky(middle, radius, self._start + turn * u)
        z, z_u, z_uu = (z - axis) / chord, z_t * turn / chord, z_tt * turn**2 / chord
        slope, twist_slope = self.tip_chord - self.root_chord, self.tip_twist - self.root_twist
        size = self.root_chord + slope * v
        # Nose up: the leading edge, at small x, rises.
        turned = np.exp(-1j * (self.root_twist + twist_slope * v))
        scale = size * turned
        scale_v = (slope - 1j * twist_slope * size) * turned
        scale_vv = (-2j * twist_slope * slope - twist_slope**2 * size) * turned
        zero, along = np.zeros_like(u), np.full_like(u, self.span)
        p = _point(scale * z, self.span * v)
        p_u, p_v = _point(scale * z_u, zero), _point(scale_v * z, along)
        p_uu, p_uv = _point(scale * z_uu, zero), _point(scale_v * z_u, zero)
        p_vv = _point(scale_vv * z, zero)
        return _with_normals(p, p_u, p_v, p_uu, p_uv, p_vv)


def mesh(surface: Surface, num_u: int = 121, num_v: int = 41) -> tuple[Array, Indices]:
    """Triangles for drawing: vertices (M, 3) in P, m, and their indices (T, 3), seen from outside.

    Args:
        num_u, num_v: lines of the grid along each parameter.
    """
    u, v = np.meshgrid(np.linspace(0.0, 1.0, num_u), np.linspace(0.0, 1.0, num_v), indexing="ij")
    patch = surface.at(u, v)
    index = np.arange(num_u * num_v).reshape(num_u, num_v)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    triangles = np.concatenate(
        [np.stack([a, b, c], axis=-1).reshape(-1, 3), np.stack([a, c, d], axis=-1).reshape(-1, 3)]
    )
    return patch.p.reshape(-1, 3), np.asarray(triangles, dtype=np.int32)


def _joukowsky(middle: complex, radius: float, t: Array) -> tuple[_Complex, _Complex, _Complex]:
    """w + 1 / w round a circle w, and its first and second derivative by the angle t."""
    turn = radius * np.exp(1j * t)
    w, w_t, w_tt = middle + turn, 1j * turn, -turn
    return (
        w + 1.0 / w,
        (1.0 - w**-2) * w_t,
        (1.0 - w**-2) * w_tt + 2.0 * w**-3 * w_t**2,
    )


def _point(z: _Complex, y: Array) -> Array:
    return np.stack([z.real, y, z.imag], axis=-1)


def _with_normals(
    p: Array, p_u: Array, p_v: Array, p_uu: Array, p_uv: Array, p_vv: Array
) -> SurfacePatch:
    cross = np.cross(p_u, p_v)
    length = np.linalg.norm(cross, axis=-1, keepdims=True)
    n = cross / length

    def derivative(change: Array) -> Array:
        """Of the unit vector, from that of the cross product."""
        return np.asarray(
            (change - n * np.sum(n * change, axis=-1, keepdims=True)) / length, dtype=np.float64
        )

    n_u = derivative(np.cross(p_uu, p_v) + np.cross(p_u, p_uv))
    n_v = derivative(np.cross(p_uv, p_v) + np.cross(p_u, p_vv))
    return SurfacePatch(p, n, p_u, p_v, n_u, n_v)


def _parameters(u: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
    u, v = np.broadcast_arrays(np.asarray(u, np.float64), np.asarray(v, np.float64))
    return np.array(u), np.array(v)


def _check_positive(what: str, **values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(what, name, f"{value:g} m, expected a length above 0")
