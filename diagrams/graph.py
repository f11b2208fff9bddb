"""The picture of a diagram's blocks and wires."""

import re
import shutil
import subprocess
from pathlib import Path

from pydrake.systems.framework import System

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import whole_file, writing_to


def graph_text(system: System) -> str:
    """The blocks, ports and wires of a Diagram or LeafSystem in Graphviz's dot language."""
    # A Python block's title carries its module; the class says enough.
    return re.sub(r"<B>(?:\w+\.)+(\w+)</B>", r"<B>\1</B>", system.GetGraphvizString())


def write_graph(system: System, path: Path) -> Path:
    """Draws a Diagram or LeafSystem into `path`, an .svg.

    A picture needs Graphviz's program `dot`. Without it the text is written in the picture's place,
    as .dot, for any viewer to draw. Either file is written whole or not at all.

    Args:
        system: as built; a Diagram is drawn with all that is in it.
        path: path of the picture.

    Returns:
        The path that was written: `path`, or the same with the ending .dot.

    Raises:
        InputError: `dot` cannot draw it, or the file cannot be written.
    """
    text = graph_text(system).encode()
    program = shutil.which("dot")
    if program is None:
        written_path, content = path.with_suffix(".dot"), text
    else:
        drawn = subprocess.run([program, "-Tsvg"], input=text, capture_output=True, check=False)
        if drawn.returncode != 0:
            reason = drawn.stderr.decode(errors="replace").strip()
            raise InputError(path, "", f"Graphviz cannot draw the diagram: {reason}")
        written_path, content = path, drawn.stdout
    with whole_file(written_path) as partial, writing_to(written_path):
        partial.write_bytes(content)
    return written_path
