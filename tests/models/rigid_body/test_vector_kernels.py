"""The formulas of three axes against numpy's."""

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.vector_kernels import (
    Symmetric,
    Vector,
    cross,
    dot,
    minus,
    plus,
    rotated,
    rotated_back,
    rotation_at,
    rotation_product,
    symmetric_at,
    symmetric_outer,
    symmetric_rotated,
    symmetric_sum,
    symmetric_times,
    times,
    turn_about,
    vector_at,
    write_rotation,
    write_symmetric,
    write_vector,
)

ROUNDING = 1e-14  # some roundings of numbers of size 1 to 3


def _vectors(count: int) -> list[Vector]:
    rows = np.random.default_rng(0).normal(size=(count, 3)).tolist()
    return [(x, y, z) for x, y, z in rows]


def _matrix(packed: Symmetric) -> Array:
    xx, xy, yy, xz, yz, zz = packed
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _close(actual: object, expected: object) -> bool:
    return bool(np.abs(np.subtract(actual, expected)).max() < ROUNDING)  # type: ignore[arg-type]


def test_vectors() -> None:
    a, b = _vectors(2)
    assert _close(plus(a, b), np.add(a, b)) and _close(minus(a, b), np.subtract(a, b))
    assert _close(times(3.0, a), 3.0 * np.array(a))
    assert _close(dot(a, b), np.dot(a, b)) and _close(cross(a, b), np.cross(a, b))


def test_rotations() -> None:
    a, direction, other = _vectors(3)
    axis = times(1.0 / float(np.linalg.norm(direction)), direction)
    R, S = turn_about(axis, 0.7), turn_about((0.0, 0.6, 0.8), -2.0)
    assert _close(R, Rotation.from_rotvec(0.7 * np.array(axis)).as_matrix())
    assert _close(rotated(R, a), np.array(R) @ a)
    assert _close(rotated_back(R, other), np.array(R).T @ other)
    assert _close(rotation_product(R, S), np.array(R) @ np.array(S))


def test_symmetric_matrices() -> None:
    a, b, first, second = _vectors(4)
    A: Symmetric = (*first, *second)
    B: Symmetric = (*second, *a)
    R = turn_about((0.0, 0.6, 0.8), -2.0)
    assert _close(symmetric_times(A, a), _matrix(A) @ a)
    assert _close(_matrix(symmetric_sum(A, B)), _matrix(A) + _matrix(B))
    assert _close(_matrix(symmetric_rotated(R, A)), np.array(R) @ _matrix(A) @ np.array(R).T)
    assert _close(np.dot(symmetric_outer(a, b), A), np.array(a) @ _matrix(A) @ b)


def test_columns_are_read_as_they_are_written() -> None:
    a, b = _vectors(2)
    array = np.zeros((2, 20))
    R, A = turn_about((0.0, 0.6, 0.8), -2.0), (*a, *b)
    write_vector(array, 1, 1, a)
    write_rotation(array, 1, 4, R)
    write_symmetric(array, 1, 13, A)
    assert vector_at(array, 1, 1) == a
    assert rotation_at(array, 1, 4) == R
    assert symmetric_at(array, 1, 13) == A
    assert np.count_nonzero(array[0]) == 0 and array[1, 0] == 0.0 and array[1, 19] == 0.0
