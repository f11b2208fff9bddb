"""The desired pose D of the tool with its velocity, and the vector that ports carry of it."""

from typing import NamedTuple

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import in_kernels

POSE_REFERENCE_SIZE = 18
"""Entries of a vector `pose_reference`, of `desired_pose`."""


class DesiredPose(NamedTuple):
    """The desired pose D of the tool and its velocity, in axes of W.

    Attributes:
        R_WD: (3, 3) orientation of D in W.
        p_WD: (3,) m.
        V_WD: (6,) velocity of D in W [angular; linear], rad/s and m/s.
    """

    R_WD: Array
    p_WD: Array
    V_WD: Array


@in_kernels
def desired_pose(pose_reference: Array) -> DesiredPose:
    """The parts of a vector (POSE_REFERENCE_SIZE,), as views: R_WD row by row, p_WD, V_WD."""
    return DesiredPose(
        R_WD=pose_reference[:9].reshape(3, 3),
        p_WD=pose_reference[9:12],
        V_WD=pose_reference[12:18],
    )
