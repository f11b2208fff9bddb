"""Units of joints that turn and of joints that slide."""

import numpy as np
import pytest

from wrenchsight.analyses.output.joint_units import joint_unit, joint_units

TURNS, SLIDES = np.zeros(3, bool), np.ones(3, bool)
SECOND_SLIDES = np.array([False, True, False])


def test_a_sliding_joint_has_forces_and_metres():
    assert [joint_unit(unit, slides=False) for unit in ("N m", "rad/s")] == ["N m", "rad/s"]
    assert [joint_unit(unit, slides=True) for unit in ("N m", "rad/s")] == ["N", "m/s"]


@pytest.mark.parametrize(
    ("slides", "unit"),
    [(TURNS, "N m s/rad"), (SLIDES, "N s/m"), (SECOND_SLIDES, "N m s/rad or N s/m")],
)
def test_both_units_stand_where_some_turn_and_some_slide(slides, unit):
    assert joint_units("N m s/rad", slides) == unit
