"""Units of what all joints of an arm have: those that turn in rad and N m, those that slide in m
and N.
"""

from wrenchsight.models.numerics.arrays import Flags

_OF_SLIDING = {
    "rad": "m",
    "rad/s": "m/s",
    "N m": "N",
    "N m s/rad": "N s/m",
}


def joint_unit(unit: str, slides: bool) -> str:
    """The unit of one joint.

    Args:
        unit: of a joint that turns: rad, rad/s, N m or N m s/rad.
        slides: whether the joint is a prismatic one.
    """
    return _OF_SLIDING[unit] if slides else unit


def joint_units(unit: str, slides: Flags) -> str:
    """The unit of all joints; both, as "N m or N", where some turn and some slide.

    Args:
        unit: as `joint_unit`.
        slides: (n,) whether a joint is a prismatic one.
    """
    return " or ".join(dict.fromkeys(joint_unit(unit, is_one) for is_one in sorted(slides)))
