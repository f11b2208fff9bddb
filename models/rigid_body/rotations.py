"""Kernels for rotation matrices: the rotation vector, the quaternion."""

import math

import numpy as np

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel


@kernel
def rotation_vector(R: Array, out: Array) -> None:
    """Writes the rotation vector (3,) of R (3, 3), its length in [0, pi], through the quaternion.

    Accurate near zero and near pi. At pi exactly either of the two vectors is right; the choice is
    deterministic. The quaternion (w, x, y, z) is scaled by what its branch has not divided by: only
    its direction counts.
    """
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    # Shepperd's method: divide by the largest of the four components.
    if trace > R[0, 0] and trace > R[1, 1] and trace > R[2, 2]:
        w = 1.0 + trace
        x, y, z = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    elif R[0, 0] >= R[1, 1] and R[0, 0] >= R[2, 2]:
        w = R[2, 1] - R[1, 2]
        x, y, z = 1.0 + 2.0 * R[0, 0] - trace, R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]
    elif R[1, 1] >= R[2, 2]:
        w = R[0, 2] - R[2, 0]
        x, y, z = R[0, 1] + R[1, 0], 1.0 + 2.0 * R[1, 1] - trace, R[1, 2] + R[2, 1]
    else:
        w = R[1, 0] - R[0, 1]
        x, y, z = R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], 1.0 + 2.0 * R[2, 2] - trace
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    sine = np.sqrt(x * x + y * y + z * z)
    scale = 2.0 * np.arctan2(sine, w) / sine if sine > 0.0 else 0.0
    out[0], out[1], out[2] = scale * x, scale * y, scale * z


@kernel
def quaternion_of(R: Array, quaternion: Array) -> None:
    """Writes the unit quaternion (w, x, y, z) of a rotation matrix; its sign is arbitrary."""
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    if trace > 0.0:
        s = 2.0 * math.sqrt(1.0 + trace)
        quaternion[0] = 0.25 * s
        quaternion[1] = (R[2, 1] - R[1, 2]) / s
        quaternion[2] = (R[0, 2] - R[2, 0]) / s
        quaternion[3] = (R[1, 0] - R[0, 1]) / s
        return
    i = 0
    if R[1, 1] > R[0, 0]:
        i = 1
    if R[2, 2] > R[i, i]:
        i = 2
    j, k = (i + 1) % 3, (i + 2) % 3
    s = 2.0 * math.sqrt(1.0 + R[i, i] - R[j, j] - R[k, k])
    quaternion[0] = (R[k, j] - R[j, k]) / s
    quaternion[1 + i] = 0.25 * s
    quaternion[1 + j] = (R[j, i] + R[i, j]) / s
    quaternion[1 + k] = (R[k, i] + R[i, k]) / s
