"""The picture of a diagram's blocks and wires."""

import re
import shutil
import subprocess
from pathlib import Path

from pydrake.systems.framework import System

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import whole_file, writing_to

PICTURE_FORMATS = ("svg", "png", "pdf")


def graph_text(system: System, max_depth: int | None = None) -> str:
    """The blocks, ports and wires of `system` in Graphviz's dot language.

    Args:
        system: a Diagram or a LeafSystem.
        max_depth: levels of nested diagrams to open; None opens all.
    """
    text: str = system.GetGraphvizString(max_depth=max_depth)
    # A Python block's title carries its module; the class says enough.
    return re.sub(r"<B>(?:\w+\.)+(\w+)</B>", r"<B>\1</B>", text)


def write_graph(system: System, path: Path, max_depth: int | None = None) -> Path:
    """Draws `system` into `path`, whose ending chooses the format: .svg, .png, .pdf or .dot.

    A picture needs Graphviz's program `dot`. Without it the text is written beside, as .dot, for
    any viewer to draw.

    Returns:
        the path that was written: `path`, or the same with the ending .dot.

    Raises:
        InputError: another ending, a folder that does not exist, or `dot` cannot draw it.
    """
    path = Path(path)
    ending = path.suffix.lstrip(".").lower()
    if ending not in (*PICTURE_FORMATS, "dot"):
        raise InputError(
            path,
            "",
            f"the ending {path.suffix!r} names no format of a graph",
            "use .svg, .png, .pdf or .dot",
        )
    if not path.parent.is_dir():
        raise InputError(path, "", f"the folder {path.parent} does not exist", "create it first")
    text = graph_text(system, max_depth)
    program = shutil.which("dot")
    if ending == "dot" or program is None:
        path = path.with_suffix(".dot")
        content = text.encode()
    else:
        drawn = subprocess.run(
            [program, f"-T{ending}"], input=text.encode(), capture_output=True, check=False
        )
        if drawn.returncode != 0:
            reason = drawn.stderr.decode(errors="replace").strip()
            raise InputError(path, "", f"Graphviz cannot draw the diagram: {reason}")
        content = drawn.stdout
    with whole_file(path) as partial, writing_to(path):
        partial.write_bytes(content)
    return path
