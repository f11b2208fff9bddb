"""Numbers of a URDF as other programs read them."""

import gzip
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from wrenchsight.models.files.input_error import InputError
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


_DECLARED = '<?xml version="1.0"{}?>\n<robot name="é"/>'


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (
            b"<!-- exported -->\n" + _DECLARED.format("").encode(),
            r"line 2: .*is not the first thing in the file; delete what stands before it",
        ),
        (
            _DECLARED.format(' encoding="utf-8"').encode("utf-16"),
            "line 1: .*it is UTF-16, .*; save it as UTF-8",
        ),
        (_DECLARED.format("").encode("latin-1"), "the byte 0xe9 in line 2 is no UTF-8; save it"),
        (gzip.compress(b"<robot/>"), "it is compressed; unpack it"),
        (b'data: "<robot/>"', "it does not begin with <.*unquoted, and a USD exported"),
        (b"<robot>\n<link></robot>", "line 2: no valid XML: mismatched tag$"),
    ],
)
def test_what_expat_refuses_is_said_with_what_to_do(data: bytes, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        parse_document(data, Path("arm.urdf"))


def test_a_document_may_be_utf_16_that_says_so() -> None:
    data = _DECLARED.format(' encoding="utf-16"').encode("utf-16")
    root, _ = parse_document(data, Path("arm.urdf"))
    assert root.get("name") == "é"
