"""Numbers of a URDF as other programs read them."""

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from wrenchsight.models.robot.urdf_document import drop_commas, parse_document, place_of


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


@pytest.mark.parametrize(
    ("separator", "places"),
    [
        ("\n", ["line 1", "line 2", "line 3"]),
        ("", ["<robot>", '<link name="upper">', "<inertial>"]),
    ],
)
def test_a_place_is_a_line_or_an_element_where_lines_say_nothing(
    separator: str, places: list[str]
) -> None:
    text = separator.join(["<robot>", '<link name="upper">', "<inertial/></link></robot>"])
    root, lines = parse_document(text.encode(), Path("arm.urdf"))
    assert [place_of(element, lines) for element in root.iter()] == places
    converted = [place_of(element, {}) for element in root.iter()]  # of an SDF
    assert converted == ["<robot>", '<link name="upper">', "<inertial>"]
