"""Vectors, rotations and symmetric matrices of three axes, as tuples that stay in registers.

A kernel reads them from named columns of a row of an array, and writes them back. The formulas then
read as in a textbook, and take no memory.
"""

import math

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel

Vector = tuple[float, float, float]
Rotation = tuple[Vector, Vector, Vector]
"""The rows of a (3, 3) matrix."""
Symmetric = tuple[float, float, float, float, float, float]
"""xx, xy, yy, xz, yz, zz of a symmetric (3, 3) matrix."""

ZERO_VECTOR = (0.0, 0.0, 0.0)
UNIT_ROTATION = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@kernel
def vector_at(array: Array, row: int, column: int) -> Vector:
    """Three numbers of a row, from a column on."""
    return array[row, column], array[row, column + 1], array[row, column + 2]


@kernel
def rotation_at(array: Array, row: int, column: int) -> Rotation:
    """A (3, 3) matrix that stands row by row in a row, from a column on."""
    return (
        vector_at(array, row, column),
        vector_at(array, row, column + 3),
        vector_at(array, row, column + 6),
    )


@kernel
def symmetric_at(array: Array, row: int, column: int) -> Symmetric:
    """A symmetric matrix that stands in a row as xx, xy, yy, xz, yz, zz, from a column on."""
    xx, xy, yy = vector_at(array, row, column)
    xz, yz, zz = vector_at(array, row, column + 3)
    return xx, xy, yy, xz, yz, zz


@kernel
def write_vector(array: Array, row: int, column: int, a: Vector) -> None:
    """Writes a vector where `vector_at` reads it."""
    array[row, column], array[row, column + 1], array[row, column + 2] = a


@kernel
def write_rotation(array: Array, row: int, column: int, R: Rotation) -> None:
    """Writes a matrix where `rotation_at` reads it."""
    write_vector(array, row, column, R[0])
    write_vector(array, row, column + 3, R[1])
    write_vector(array, row, column + 6, R[2])


@kernel
def write_symmetric(array: Array, row: int, column: int, matrix: Symmetric) -> None:
    """Writes a matrix where `symmetric_at` reads it."""
    xx, xy, yy, xz, yz, zz = matrix
    write_vector(array, row, column, (xx, xy, yy))
    write_vector(array, row, column + 3, (xz, yz, zz))


@kernel
def plus(a: Vector, b: Vector) -> Vector:
    """a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@kernel
def minus(a: Vector, b: Vector) -> Vector:
    """a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel
def times(factor: float, a: Vector) -> Vector:
    """The vector a times a number."""
    return factor * a[0], factor * a[1], factor * a[2]


@kernel
def dot(a: Vector, b: Vector) -> float:
    """a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a: Vector, b: Vector) -> Vector:
    """a x b."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@kernel
def rotated(R: Rotation, a: Vector) -> Vector:
    """R a: from the axes of the frame into those that R is seen from."""
    return dot(R[0], a), dot(R[1], a), dot(R[2], a)


@kernel
def rotated_back(R: Rotation, a: Vector) -> Vector:
    """R^T a: into the axes of the frame."""
    return (
        R[0][0] * a[0] + R[1][0] * a[1] + R[2][0] * a[2],
        R[0][1] * a[0] + R[1][1] * a[1] + R[2][1] * a[2],
        R[0][2] * a[0] + R[1][2] * a[1] + R[2][2] * a[2],
    )


@kernel
def rotation_product(A: Rotation, B: Rotation) -> Rotation:
    """A B."""
    return rotated_back(B, A[0]), rotated_back(B, A[1]), rotated_back(B, A[2])


@kernel
def turn_about(axis: Vector, angle: float) -> Rotation:
    """The rotation by an angle (rad) about a unit axis, as Rodrigues."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = axis
    d = 1.0 - c
    return (
        (c + d * x * x, d * x * y - s * z, d * x * z + s * y),
        (d * x * y + s * z, c + d * y * y, d * y * z - s * x),
        (d * x * z - s * y, d * y * z + s * x, c + d * z * z),
    )


@kernel
def symmetric_times(matrix: Symmetric, a: Vector) -> Vector:
    """A symmetric matrix times a."""
    xx, xy, yy, xz, yz, zz = matrix
    x, y, z = a
    return xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z


@kernel
def symmetric_sum(A: Symmetric, B: Symmetric) -> Symmetric:
    """A + B."""
    return A[0] + B[0], A[1] + B[1], A[2] + B[2], A[3] + B[3], A[4] + B[4], A[5] + B[5]


@kernel
def symmetric_rotated(R: Rotation, matrix: Symmetric) -> Symmetric:
    """R matrix R^T."""
    x, y, z = R
    along_x, along_y = symmetric_times(matrix, x), symmetric_times(matrix, y)
    along_z = symmetric_times(matrix, z)
    return (
        dot(along_x, x),
        dot(along_x, y),
        dot(along_y, y),
        dot(along_x, z),
        dot(along_y, z),
        dot(along_z, z),
    )


@kernel
def symmetric_outer(a: Vector, b: Vector) -> Symmetric:
    """How a . (matrix b) depends on xx, xy, yy, xz, yz, zz of a symmetric matrix."""
    return (
        a[0] * b[0],
        a[0] * b[1] + a[1] * b[0],
        a[1] * b[1],
        a[0] * b[2] + a[2] * b[0],
        a[1] * b[2] + a[2] * b[1],
        a[2] * b[2],
    )
