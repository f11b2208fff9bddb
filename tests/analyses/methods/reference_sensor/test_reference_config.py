"""Settings of a sensor that make no sense are refused with one line."""

from dataclasses import replace

import pytest

from wrenchsight.analyses.methods.reference_sensor.reference_config import (
    ReferenceConfig,
    checked_reference,
    tare_numbers,
)
from wrenchsight.models.files.input_error import InputError

_PLAIN = ReferenceConfig("fx,fy,fz", frame="tool")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frame": "flange"}, 'reference-frame: is "flange"'),
        ({"sign": "-1"}, 'reference-sign: is "-1"'),
        ({"turn": [1.0]}, "expected three angles"),
        ({"turn": [0.0, 0.0, 1.0], "frame": "found"}, "needs the frame"),
        ({"delay": "soon"}, 'is "soon", expected seconds'),
        ({"delay": "60"}, "at most 5"),
        ({"tare": "0,x"}, 'is "0,x", expected none, start, fit, or numbers'),
        ({"contact_force": 0.0}, "expected more than zero"),
        ({"rest_speed": float("nan")}, "expected more than zero"),
    ],
)
def test_invalid_configurations_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        checked_reference(replace(_PLAIN, **change))


def test_valid_configurations_are_unchanged():
    config = replace(_PLAIN, tare="0.5,1,-2", delay="-0.02", turn=[0.0, 0.0, 3.14])
    assert checked_reference(config) is config
    assert tare_numbers(config) == [0.5, 1.0, -2.0]
    assert tare_numbers(_PLAIN) is None
