"""The document that describes a robot: URDF, or SDF and MJCF converted to it."""

import codecs
import hashlib
import re
import xml.etree.ElementTree as ET
import xml.parsers.expat
from collections.abc import Mapping
from pathlib import Path
from xml.parsers.expat import errors

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import read_limited
from wrenchsight.models.robot.drake_document import DOCUMENT_KINDS, urdf_of_model
from wrenchsight.models.robot.xacro_document import untrusted_xacro

LARGEST_DOCUMENT = 1 << 26  # bytes
_COMPRESSED = (b"\x1f\x8b", b"PK", b"\x28\xb5\x2f\xfd", b"BZh", b"\xfd7zXZ")  # first bytes
_BEFORE_XML = b"\xef\xbb\xbf \t\r\n"  # bytes that may stand before a document
_NUMBER_LISTS = ("xyz", "rpy", "size", "scale", "rgba")  # attributes that hold several numbers
_COMMA_BEFORE_BLANK = re.compile(r",(?=\s|$)")


def read_document(
    path: Path, named_by: Path | None = None
) -> tuple[ET.Element, dict[ET.Element, int]]:
    """Reads a robot's description.

    Args:
        path: .urdf, .sdf or MJCF's .xml; the root element decides which.
        named_by: the file that names it, for the error line where it is missing.

    Returns:
        The <robot> element of a URDF, and the lines of its elements in the file; none for a
        document that was converted to a URDF.

    Raises:
        InputError: no such file, no valid XML, another root element, xacro (`xacro_document`
            expands it), or as `urdf_of_model`.
    """
    remedy = f"see {named_by}" if named_by is not None else "check the path"
    data = read_limited(path, LARGEST_DOCUMENT, "a URDF", remedy)
    root, lines = parse_document(data, path)
    if root.tag in DOCUMENT_KINDS:
        digest = hashlib.sha256(data).hexdigest()
        root, lines = parse_document(urdf_of_model(path, root.tag, digest), path)[0], {}
    if root.tag != "robot":
        problem = f"<{root.tag}> is the root element, expected <robot> of a URDF, <sdf> or <mujoco>"
        raise InputError(path, place_of(root, lines), problem)
    if is_xacro(path, root):
        raise untrusted_xacro(path)
    for element in root.iter():
        name = element.get("name", "")
        if not name.isprintable():
            problem = f"the name {name!r} holds characters that cannot be printed"
            raise InputError(path, place_of(element, lines), problem, "rename it")
    return root, lines


def place_of(element: ET.Element, lines: Mapping[ET.Element, int]) -> str:
    """Where a message sends its reader: the line of an element, or the element by its name.

    A line says nothing where the whole document is a single one, or was converted to a URDF.

    Args:
        lines: of the elements in the file, as `read_document` returns them.
    """
    if len(set(lines.values())) > 1:
        return f"line {lines[element]}" if element in lines else ""
    name = element.get("name", "")
    has_name = name and name.isprintable()
    return f'<{element.tag} name="{name}">' if has_name else f"<{element.tag}>"


def drop_commas(root: ET.Element) -> list[ET.Element]:
    """Drops commas before the blanks between numbers ("1, 2, 3"), as PyBullet reads them.

    urdfdom, and with it ROS and pinocchio, MuJoCo and Drake refuse such a file. A comma without a
    blank stays: it may be a decimal one.

    Args:
        root: <robot> of a URDF; it is changed.

    Returns:
        The elements that had such commas.
    """
    changed = []
    for element in root.iter():
        for key in _NUMBER_LISTS:
            text = element.get(key, "")
            if "," in text and (plain := _COMMA_BEFORE_BLANK.sub("", text)) != text:
                element.set(key, plain)
                changed.append(element)
    return changed


def is_xacro_file(path: Path) -> bool:
    """Whether a file is to be expanded by xacro.

    Raises:
        InputError: it cannot be read, or is no XML.
    """
    root, _ = parse_document(read_limited(path, LARGEST_DOCUMENT, "a URDF"), path)
    return root.tag == "robot" and is_xacro(path, root)


def is_xacro(path: Path, root: ET.Element) -> bool:
    """Whether a <robot> has elements of xacro, or is named so and has expressions."""
    if any(element.tag.startswith("xacro:") for element in root.iter()):
        return True
    values = (value for element in root.iter() for value in element.attrib.values())
    return path.suffix == ".xacro" and any("$" in value for value in values)


def parse_document(data: bytes, path: Path) -> tuple[ET.Element, dict[ET.Element, int]]:
    """Parses XML without namespaces: a prefix, declared or not, stays part of a name.

    Args:
        data: bytes of the document, in the encoding that it states.
        path: of its file, for error lines.

    Returns:
        The root, and the line of each element.

    Raises:
        InputError: no valid XML.
    """
    lines: dict[ET.Element, int] = {}
    builder = ET.TreeBuilder()
    parser = xml.parsers.expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        lines[builder.start(tag, attributes)] = parser.CurrentLineNumber

    parser.StartElementHandler = start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(data, True)
    except xml.parsers.expat.ExpatError as error:
        if path.suffix in {".yaml", ".yml"}:
            problem = "is a YAML file, expected a URDF, xacro, SDF or MJCF"
            remedy = f"show a robot.yaml with: wrenchsight robot show {path}"
            raise InputError(path, "", problem, remedy) from error
        reason, remedy = _reason(data, error)
        problem = f"no valid XML: {reason}"
        raise InputError(path, f"line {error.lineno}", problem, remedy) from error
    except (ValueError, LookupError) as error:  # of the encoding that it states
        raise InputError(path, "line 1", f"cannot be read: {error}", "save it as UTF-8") from error
    return builder.close(), lines


def _reason(data: bytes, error: xml.parsers.expat.ExpatError) -> tuple[str, str]:
    """What is wrong with a document that expat refuses, and what to do; '' where that is plain."""
    reason = xml.parsers.expat.ErrorString(error.code)
    if error.code == errors.codes[errors.XML_ERROR_MISPLACED_XML_PI]:
        return (
            "<?xml ...?> is not the first thing in the file",
            "delete what stands before it, a comment or an empty line, or move that below it",
        )
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return f"it is UTF-16, as PowerShell's > writes it ({reason})", "save it as UTF-8"
    if data.startswith(_COMPRESSED):
        return "it is compressed", "unpack it (gunzip, unzip)"
    if data.lstrip(_BEFORE_XML)[:1] not in (b"<", b""):
        return (
            f"it does not begin with < ({reason})",
            "give a URDF, xacro, SDF or MJCF; a topic's or parameter's text has to be unquoted, "
            "and a USD exported as one of these",
        )
    if error.code == errors.codes[errors.XML_ERROR_INVALID_TOKEN]:
        try:
            data.decode()
        except UnicodeDecodeError as wrong:
            byte = data[wrong.start]
            line = data.count(b"\n", 0, wrong.start) + 1
            return f"the byte {byte:#x} in line {line} is no UTF-8", "save it as UTF-8"
    return reason, ""
