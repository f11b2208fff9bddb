"""Rounded right angles, and what is none."""

import math

import numpy as np
import pytest
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RollPitchYaw, RotationMatrix

from wrenchsight.models.robot.rounded_angles import exact_angle, rounded_rpy


@pytest.mark.parametrize(
    ("text", "exact"),
    [
        ("1.5708", math.pi / 2),
        ("-1.5708", -math.pi / 2),
        ("1.57", math.pi / 2),
        ("3.14", math.pi),
        ("3.1416", math.pi),
        ("3.1415", math.pi),  # cut off, not rounded
        ("0.7854", math.pi / 4),
        ("2.61799", 5 * math.pi / 6),
        ("1.57079632679", math.pi / 2),
        ("15.708e-1", math.pi / 2),
        ("1.5707963267948966", math.pi / 2),
    ],
)
def test_multiples_of_fifteen_degrees(text, exact):
    assert exact_angle(text) == pytest.approx(exact, abs=1e-15)


@pytest.mark.parametrize(
    "text", ["0", "0.0000", "1.6", "1.5", "0.26", "0.785", "1.5705", "1.5706", "1e-5", "0.3", "2"]
)
def test_other_angles_stay(text):
    assert exact_angle(text) == float(text)


def test_text_that_is_no_number_is_an_error():
    with pytest.raises(ValueError, match="could not convert"):
        exact_angle("half")


@pytest.mark.parametrize(
    ("wxyz", "rpy"),
    [
        ([0.707105, 0.707108, 0.0, 0.0], [math.pi / 2, 0.0, 0.0]),
        ([-3.67321e-06, 1.0, 0.0, 0.0], [math.pi, 0.0, 0.0]),
        # Half a turn about a diagonal: pitch is a right angle, where roll and yaw are not unique.
        ([0.5, 0.500003, 0.5, 0.499997], None),
        ([0.92388, 0.0, 0.0, 0.38268], [0.0, 0.0, math.pi / 4]),
        ([0.965926, 0.0, 0.258819, 0.0], [0.0, math.pi / 6, 0.0]),
    ],
)
def test_a_rotation_by_rounded_components_is_the_exact_one(wxyz, rpy):
    R = RotationMatrix(Quaternion(np.array(wxyz) / np.linalg.norm(wxyz)))
    read = RollPitchYaw([exact_angle(word) for word in rounded_rpy(R).split()]).ToRotationMatrix()
    if rpy is None:
        expected = RotationMatrix(np.round(R.matrix()))
    else:
        expected = RollPitchYaw(rpy).ToRotationMatrix()
    np.testing.assert_allclose(read.matrix(), expected.matrix(), atol=1e-15)
    assert np.abs(R.matrix() - expected.matrix()).max() > 1e-7  # the file's own is another


@pytest.mark.parametrize(
    "rpy",
    [
        [math.pi / 2, 0.0, math.pi / 6],  # exact
        [0.3, -0.2, 0.1],
        [math.pi / 2 + 1e-4, 0.0, 0.0],  # a calibrated joint
        [math.pi / 2, 0.01, 0.0],
    ],
)
def test_other_rotations_stay(rpy):
    assert rounded_rpy(RollPitchYaw(rpy).ToRotationMatrix()) is None
