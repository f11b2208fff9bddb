"""Right angles that a URDF writes with few digits: 1.5708 means pi / 2.

Two axes that are meant parallel and are 4e-6 rad off it make parameters determined that are not:
an arm of seven joints has 70 base parameters at a condition number of 2e5 instead of 69 at 6.
"""

import math

import numpy as np
from pydrake.math import RollPitchYaw, RotationMatrix

_ANGLE_STEP = math.pi / 12  # multiples of 15 degrees are what people write
_LEAST_DECIMALS = 4  # of any multiple; 1.57 and 3.14 alone may have two
_RIGHT_ANGLE = math.pi / 2
_QUATERNION_TOLERANCE = 2e-5  # rad, of a rotation by components of five digits (0.70711)
_MAX_ROUNDING = 1e-9  # rad, within which a rotation is exact but for the computer's rounding


def exact_angle(text: str) -> float:
    """The angle that a number in a URDF means, rad.

    It is the multiple of 15 degrees that was rounded, or cut off, to these digits; else the number
    as it stands. With two or three decimals only right angles are taken.

    Raises:
        ValueError: no number.
    """
    value = float(text)
    mantissa, _, exponent = text.lower().partition("e")
    decimals = len(mantissa.partition(".")[2]) - int(exponent or "0")
    step = _ANGLE_STEP if decimals >= _LEAST_DECIMALS else _RIGHT_ANGLE
    if decimals < 2 or not math.isfinite(value):
        return value
    exact = round(value / step) * step
    if exact == 0.0 or abs(exact - value) >= 10.0**-decimals:
        return value
    return exact


def rounded_rpy(R: RotationMatrix) -> str | None:
    """Roll, pitch and yaw of a rotation that a file has rounded, as `exact_angle` takes them.

    A quaternion (0.707105, 0.707108, 0, 0) is a right angle but for 4e-6 rad. Taken are rotations
    near those by right angles, and near multiples of 15 degrees in all three angles.

    Returns:
        Three numbers of five decimals; None of a rotation that is exact, or near none of them.
    """
    matrix = R.matrix()
    exact = np.round(matrix)
    if np.abs(matrix - exact).max() >= _QUATERNION_TOLERANCE:
        angles = RollPitchYaw(R).vector()
        exact_angles = np.round(angles / _ANGLE_STEP) * _ANGLE_STEP
        if np.abs(angles - exact_angles).max() >= _QUATERNION_TOLERANCE:
            return None
        exact = RollPitchYaw(exact_angles).ToRotationMatrix().matrix()
    if np.abs(matrix - exact).max() < _MAX_ROUNDING:
        return None
    angles = RollPitchYaw(RotationMatrix(exact)).vector()
    return " ".join(f"{angle:.5f}" for angle in angles)
