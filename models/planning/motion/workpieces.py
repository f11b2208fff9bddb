"""Workpieces with exact smooth surfaces: a plate, and a section of a wind turbine blade.

A surface maps two parameters (u, v) in [0, 1] to a point in the workpiece's frame P and to the
outward unit normal there. All is closed form: what a contact or a path needs is exact, whatever the
mesh that is drawn.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array

Indices = NDArray[np.int32]
_Complex = NDArray[np.complex128]

# Radius of a blade's trailing edge, as how far the circle passes outside of the singular point.
_TRAILING_EDGE_RADIUS = 0.06
_PITCH_AXIS = 0.35  # where a blade's profiles turn, along the chord; 0 at the leading edge


class SurfacePatch(NamedTuple):
    """A surface at pairs (u, v), in axes of P: points p_PS, m, and unit normals, both (..., 3)."""

    p: Array
    n: Array


class Surface(Protocol):
    """A smooth surface over the unit square."""

    periodic_u: bool  # whether u = 1 is u = 0 again

    def at(self, u: ArrayLike, v: ArrayLike) -> SurfacePatch:
        """The surface at u and v of one shape (...)."""


@dataclass
class PlateShapeConfig:
    """A flat rectangle."""

    length: float = 0.4
    """m, along x and u"""
    width: float = 0.3
    """m, along y and v"""

    def surface(self) -> "Plate":
        """The exact surface.

        Raises:
            InputError: a dimension out of range.
        """
        return Plate(self.length, self.width)


@dataclass
class BladeShapeConfig:
    """A section of a wind turbine blade; see `BladeSection`."""

    span: float = 0.5
    """m, along y and v"""
    root_chord: float = 0.34
    """m, along x"""
    tip_chord: float = 0.26
    """m"""
    root_twist_deg: float = 10.0
    """of the chord, at one end"""
    tip_twist_deg: float = 2.0
    """at the other end"""
    thickness: float = 0.24
    """of the chord"""
    camber: float = 0.05
    """of the chord"""

    def surface(self) -> "BladeSection":
        """The exact surface.

        Raises:
            InputError: a dimension out of range.
        """
        return BladeSection(self)


class Plate:
    """A flat rectangle: u along x, v along y, normal along z, its middle at P's origin.

    Args:
        length: along x, m.
        width: along y, m.

    Raises:
        InputError: a dimension out of range.
    """

    periodic_u = False

    def __init__(self, length: float, width: float) -> None:
        _check_positive("plate", length=length, width=width)
        self._length, self._width = length, width

    def at(self, u: ArrayLike, v: ArrayLike) -> SurfacePatch:
        """The surface at u and v of one shape (...)."""
        u, v = _parameters(u, v)
        zero = np.zeros_like(u)
        p = np.stack([(u - 0.5) * self._length, (v - 0.5) * self._width, zero], axis=-1)
        return SurfacePatch(p, np.broadcast_to([0.0, 0.0, 1.0], p.shape).copy())


class BladeSection:
    """A section of a wind turbine blade: an aerofoil that tapers and twists along the span.

    The profile is the image of a circle w under w + b^2 / w (Joukowsky's map) with both of the
    map's singular points inside the circle: an aerofoil whose leading and trailing edges are round,
    analytic all the way round. In P the chord lies along x (leading edge at small x), the span
    along y (v = 0 at y = 0), the suction side up (z). u goes round the profile from the trailing
    edge along the pressure side to the leading edge (near u = 0.5) and back over the suction side.
    Twist turns each profile about the span's axis, nose up; that axis runs through the origin.

    Args:
        shape: its dimensions; chord and twist are linear along the span, thickness (0.02 to 0.5)
            and camber (the rise of the mean line, 0 to 0.12) hold roughly.

    Raises:
        InputError: a dimension out of range.
    """

    periodic_u = True

    def __init__(self, shape: BladeShapeConfig) -> None:
        sizes = {"span": shape.span, "root_chord": shape.root_chord, "tip_chord": shape.tip_chord}
        _check_positive("blade", **sizes)
        for name, low, high in (("thickness", 0.02, 0.5), ("camber", 0.0, 0.12)):
            value = getattr(shape, name)
            if not low <= value <= high:
                raise InputError("blade", name, f"{value:g}, expected {low:g} to {high:g}")
        self._shape = shape
        self._twist = math.radians(shape.root_twist_deg), math.radians(shape.tip_twist_deg)
        # b = 1. The circle passes _TRAILING_EDGE_RADIUS outside of +1; its middle lies to the left
        # for thickness (a Joukowsky profile of offset e is about 1.3 e thick) and up for camber.
        self._middle = complex(-0.77 * shape.thickness, 2.0 * shape.camber)
        self._radius = abs(1.0 + _TRAILING_EDGE_RADIUS - self._middle)
        x = self._joukowsky(np.linspace(0.0, 2.0 * math.pi, 4001))[0].real
        # The profile begins (u = 0) where it reaches farthest back, and has unit chord.
        self._chord = float(np.max(x)) - float(np.min(x))
        self._axis = complex(float(np.min(x)) + _PITCH_AXIS * self._chord, 0.0)
        t = np.linspace(-1.0, 1.0, 20001)
        self._start = float(t[np.argmax(self._joukowsky(t)[0].real)])

    def at(self, u: ArrayLike, v: ArrayLike) -> SurfacePatch:
        """The surface at u and v of one shape (...)."""
        u, v = _parameters(u, v)
        shape, chord = self._shape, self._chord
        turn = -2.0 * math.pi  # clockwise in x and z, so that p_u x p_v points outward
        z, z_t = self._joukowsky(self._start + turn * u)
        z, z_u = (z - self._axis) / chord, z_t * turn / chord
        slope, twist_slope = shape.tip_chord - shape.root_chord, self._twist[1] - self._twist[0]
        size = shape.root_chord + slope * v
        # Nose up: the leading edge, at small x, rises.
        rotation = np.exp(-1j * (self._twist[0] + twist_slope * v))
        scale = size * rotation
        scale_v = (slope - 1j * twist_slope * size) * rotation
        p_u = _point(scale * z_u, np.zeros_like(u))
        n = np.cross(p_u, _point(scale_v * z, np.full_like(u, shape.span)))
        n = n / np.linalg.norm(n, axis=-1, keepdims=True)
        return SurfacePatch(_point(scale * z, shape.span * v), n)

    def _joukowsky(self, t: Array) -> tuple[_Complex, _Complex]:
        """w + 1 / w round the circle w, and its derivative by the angle t."""
        turn = self._radius * np.exp(1j * t)
        w = self._middle + turn
        return w + 1.0 / w, (1.0 - w**-2) * 1j * turn


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


def _point(z: _Complex, y: Array) -> Array:
    return np.stack([z.real, y, z.imag], axis=-1)


def _parameters(u: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
    u, v = np.broadcast_arrays(np.asarray(u, np.float64), np.asarray(v, np.float64))
    return np.array(u), np.array(v)


def _check_positive(source: str, **values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(source, name, f"{value:g} m, expected a length above 0")
