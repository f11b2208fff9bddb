"""Rotational inertia as URDF states it, of a body's parameters, and whether it can be a body's.

The ten parameters of a body are m, m c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz about a frame's origin.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wrenchsight.models.numerics.arrays import Array

MASS, MOMENT, INERTIA = 0, slice(1, 4), slice(4, 10)  # in the ten parameters: m, m c, the rest
INERTIA_PLACES = [4, 6, 9, 5, 7, 8]  # of Ixx, Iyy, Izz, Ixy, Ixz, Iyz in the ten parameters
_MIN_MOMENT_SHARE = 1e-4  # of the sum of moments: least second moment of mass when corrected
_WATER_DENSITY = 1000.0  # kg/m^3
_NO_SIZE = 1e-6  # of a ball's moment, below which a stated one is a placeholder
_MAX_MOMENT_CHANGE = 0.1  # of the largest moment, that a correction changes at most


def inertia_matrix(values: Sequence[float] | Array) -> Array:
    """(3, 3) of ixx, iyy, izz, ixy, ixz, iyz."""
    ixx, iyy, izz, ixy, ixz, iyz = values
    return np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])


def inertia_values(inertia: Array) -> list[float]:
    """ixx, iyy, izz, ixy, ixz, iyz of a matrix (3, 3)."""
    places = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    return [float(inertia[key]) for key in places]


def inertia_about_origin(parameters: Array) -> Array:
    """(3, 3) kg m^2, of ten parameters."""
    return inertia_matrix(parameters[INERTIA_PLACES])


def point_inertia(mass: float, p: Array) -> Array:
    """(3, 3) kg m^2 about the origin, of a mass at p (3,) m: what a body's inertia gains there."""
    return np.asarray(mass * (p @ p * np.eye(3) - np.outer(p, p)))


class BodyInertia(NamedTuple):
    """A body's inertia as files state it.

    Attributes:
        mass: kg.
        com: (3,) m.
        inertia: (3, 3) kg m^2 about the centre of mass.
    """

    mass: float
    com: Array
    inertia: Array

    @classmethod
    def of(cls, parameters: Array) -> "BodyInertia":
        """Of ten parameters, with a mass above zero."""
        mass = float(parameters[MASS])
        com = parameters[MOMENT] / mass
        return cls(mass, com, inertia_about_origin(parameters) - point_inertia(mass, com))


def unphysical(inertia: Array) -> str:
    """Why a rotational inertia about a centre of mass cannot be real; '' if it can."""
    moments = np.linalg.eigvalsh(inertia)
    listed = ", ".join(f"{moment:.3g}" for moment in moments)
    if not moments[0] > 1e-12 * max(moments[2], 1e-12):
        return f"principal moments {listed} are not all above 0"
    # A flat body meets the triangle inequality with equality; published values are rounded.
    if moments[0] + moments[1] < moments[2] * (1 - 1e-6):
        return f"principal moments {listed} break the triangle inequality"
    return ""


def nearest_physical(inertia: Array) -> Array | None:
    """The possible inertia (3, 3) that a rounded or mistyped one lies near; None if there is none.

    A body's moments are sums of second moments of its mass along the principal axes, none of which
    is below 0. The one that is, is set to a ten-thousandth of all: a flat body.

    Args:
        inertia: (3, 3) kg m^2 about the centre of mass.
    """
    moments, axes = np.linalg.eigh(inertia)
    if not moments[0] > 0.0:
        return None
    changed = _possible_moments(moments)
    if np.abs(changed - moments).max() > _MAX_MOMENT_CHANGE * moments[2]:
        return None
    return np.asarray((axes * changed) @ axes.T)


def possible_inertia(inertia: Array, mass: float) -> Array:
    """A possible inertia (3, 3) in the place of one that no body has, however far off it is.

    Where the stated one is of no size at all, it is that of a ball as dense as water.

    Args:
        inertia: (3, 3) kg m^2 about the centre of mass.
        mass: kg, above 0.
    """
    moments, axes = np.linalg.eigh(inertia)
    ball = ball_moment(mass)
    if not moments[2] > _NO_SIZE * ball:
        return np.asarray(ball * np.eye(3))
    return np.asarray((axes * _possible_moments(np.maximum(moments, 0.0))) @ axes.T)


def ball_moment(mass: float) -> float:
    """kg m^2, about its centre, of a ball of `mass` kg that is as dense as water."""
    return float(0.4 * mass * (3.0 * mass / (4.0 * np.pi * _WATER_DENSITY)) ** (2.0 / 3.0))


def _possible_moments(moments: Array) -> Array:
    """Principal moments (3,) whose second moments of mass are all above 0, nearest to these."""
    spread = np.maximum(0.5 * moments.sum() - moments, _MIN_MOMENT_SHARE * moments.sum())
    return np.asarray(spread.sum() - spread)
