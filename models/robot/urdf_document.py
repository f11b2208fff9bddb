"""The document that describes a robot: URDF, or xacro and SDF converted to it."""

import xml.etree.ElementTree as ET
import xml.parsers.expat
from collections.abc import Mapping
from pathlib import Path

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import read_limited
from wrenchsight.models.robot.sdf_document import urdf_of_sdf
from wrenchsight.models.robot.xacro_document import urdf_of_xacro

LARGEST_DOCUMENT = 1 << 26  # bytes


def read_document(
    path: Path, named_by: Path | None = None, arguments: Mapping[str, str] | None = None
) -> tuple[ET.Element, dict[ET.Element, int]]:
    """Reads a robot's description.

    Args:
        path: .urdf, .xacro or .sdf; the root element decides which.
        named_by: the file that names it, for the error line where it is missing.
        arguments: of a xacro file, by name.

    Returns:
        The <robot> element of a URDF, and the lines of its elements in the file; none for a
        document that was converted to a URDF.

    Raises:
        InputError: no such file, no valid XML, another root element, or as `urdf_of_xacro` and
            `urdf_of_sdf`.
    """
    remedy = f"see {named_by}" if named_by is not None else "check the path"
    data = read_limited(path, LARGEST_DOCUMENT, "a URDF", remedy)
    root, lines = _parsed(data, path)
    if root.tag == "sdf":
        return urdf_of_sdf(root, path), {}
    if root.tag != "robot":
        problem = f"<{root.tag}> is the root element, expected <robot> of a URDF, or <sdf>"
        raise InputError(path, f"line {lines[root]}", problem)
    if any(element.tag.startswith("xacro:") for element in root.iter()):
        root, lines = _parsed(urdf_of_xacro(path, arguments), path)[0], {}
    for element in root.iter():
        name = element.get("name", "")
        if not name.isprintable():
            location = f"line {lines[element]}" if lines else f"<{element.tag}>"
            problem = f"the name {name!r} holds characters that cannot be printed"
            raise InputError(path, location, problem, "rename it")
    return root, lines


def _parsed(data: bytes, path: Path) -> tuple[ET.Element, dict[ET.Element, int]]:
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
            problem = "is a YAML file, expected a URDF, xacro or SDF"
            remedy = f"show a robot.yaml with: wrenchsight robot show {path}"
            raise InputError(path, "", problem, remedy) from error
        reason = xml.parsers.expat.ErrorString(error.code)
        raise InputError(path, f"line {error.lineno}", f"no valid XML: {reason}") from error
    except (ValueError, LookupError) as error:  # of the encoding that it states
        raise InputError(path, "line 1", f"cannot be read: {error}", "save it as UTF-8") from error
    return builder.close(), lines
