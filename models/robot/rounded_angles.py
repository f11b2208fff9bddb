"""Right angles that a URDF writes with few digits: 1.5708 means pi / 2.

Two axes that are meant parallel and are 4e-6 rad off it make parameters determined that are not:
an arm of seven joints has 70 base parameters at a condition number of 2e5 instead of 69 at 6.
"""

import math

_ANGLE_STEP = math.pi / 12  # multiples of 15 degrees are what people write
_LEAST_DECIMALS = 4  # of any multiple; 1.57 and 3.14 alone may have two
_RIGHT_ANGLE = math.pi / 2


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
