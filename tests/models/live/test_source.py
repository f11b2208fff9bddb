"""Addresses of live sources."""

import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.live.source import SourceAddress, open_source


def test_an_address_is_scheme_place_and_options():
    address = SourceAddress.parse("RTDE://192.168.1.10:30104?frequency=125&effort=torque")
    assert address.scheme == "rtde"
    assert address.host(30004) == ("192.168.1.10", 30104)
    assert address.number("frequency", 500.0, 1.0, 500.0) == 125.0
    assert address.choice("effort", ("current", "torque")) == "torque"
    assert SourceAddress.parse("rtde://robot").host(30004) == ("robot", 30004)
    assert SourceAddress.parse("rtde://[::1]:5").host(30004) == ("::1", 5)
    assert SourceAddress.parse("replay:///a/b c.csv").place == "/a/b c.csv"


@pytest.mark.parametrize(
    "url",
    [
        *("", "robot", "://x", "rtde://", "rtde://h:99999", "rtde://h/path", "rtde://\x1b[2J"),
        *("rtde://a..b", "rtde://.a", f"rtde://{'a' * 64}.b", "rtde://a%00b..c"),
    ],
)
def test_an_invalid_address_is_one_line(url):
    with pytest.raises(InputError) as error:
        SourceAddress.parse(url).host(30004)
    assert "\n" not in str(error.value)
    assert "\x1b" not in str(error.value)


def test_options_and_kinds_are_known_ones(ur10e):
    address = SourceAddress.parse("rtde://h?speed=3&frequency=fast")
    with pytest.raises(InputError, match="speed"):
        address.require_known("frequency")
    with pytest.raises(InputError, match="fast"):
        address.number("frequency", 500.0, 1.0, 500.0)
    with pytest.raises(InputError, match='no source is called "telepathy"'):
        open_source("telepathy://h", ur10e)
