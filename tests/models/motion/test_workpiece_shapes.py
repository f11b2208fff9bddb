import math

import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.motion.workpiece_shapes import BladeShapeConfig, PlateShapeConfig
from wrenchsight.models.motion.workpieces import BladeSection, Plate


def test_a_stated_shape_is_the_surface_of_its_numbers():
    assert PlateShapeConfig(0.5, 0.2).surface() == Plate(length=0.5, width=0.2)
    stated = BladeShapeConfig(0.6, 0.3, 0.2, 12.0, 3.0, 0.2, 0.04)
    assert stated.surface() == BladeSection(
        span=0.6,
        root_chord=0.3,
        tip_chord=0.2,
        root_twist=math.radians(12.0),
        tip_twist=math.radians(3.0),
        thickness=0.2,
        camber=0.04,
    )


def test_a_shape_that_is_none_is_refused():
    with pytest.raises(InputError, match="length"):
        PlateShapeConfig(length=-0.1).surface()
    with pytest.raises(InputError, match="span"):
        BladeShapeConfig(span=0.0).surface()
