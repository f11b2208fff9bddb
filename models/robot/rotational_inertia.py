"""Rotational inertia as URDF states it, and whether it can be a body's."""

from collections.abc import Sequence

import numpy as np

from wrenchsight.models.numerics.arrays import Array


def inertia_matrix(values: Sequence[float] | Array) -> Array:
    """(3, 3) of ixx, iyy, izz, ixy, ixz, iyz."""
    ixx, iyy, izz, ixy, ixz, iyz = values
    return np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])


def inertia_values(inertia: Array) -> list[float]:
    """ixx, iyy, izz, ixy, ixz, iyz of a matrix (3, 3)."""
    places = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    return [float(inertia[key]) for key in places]


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
