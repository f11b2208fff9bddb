"""Numbers of a URDF as other programs read them."""

import xml.etree.ElementTree as ET

import pytest

from wrenchsight.models.robot.urdf_document import drop_commas


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1.5, 1.3 0.5", "1.5 1.3 0.5"),
        ("1.5, 1.3,\n0.5,", "1.5 1.3\n0.5"),
        ("1,5 0 0", "1,5 0 0"),  # may be a decimal comma
        ("1,2,3", "1,2,3"),  # which PyBullet refuses, too
    ],
)
def test_a_comma_before_a_blank_is_dropped(text: str, expected: str) -> None:
    root = ET.Element("robot", name="a, b")
    origin = ET.SubElement(root, "origin", rpy=text, xyz="0 0 0")
    assert drop_commas(root) == ([origin] if text != expected else [])
    assert origin.get("rpy") == expected
    assert root.get("name") == "a, b"
