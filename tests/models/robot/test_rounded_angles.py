"""Rounded right angles, and what is none."""

import math

import pytest

from wrenchsight.models.robot.rounded_angles import exact_angle


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
