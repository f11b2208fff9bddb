"""A robot's SDF or MJCF as a URDF, by Drake's parser in a child process.

A file can break the parser (an SDF that includes itself overflows its stack), and then breaks the
child alone. The URDF is that of the plant that Drake makes: `drake_child`.
"""

from functools import lru_cache
from pathlib import Path

from wrenchsight.models.robot.limited_child import run_limited

_CHILD = "wrenchsight.models.robot.drake_child"
DOCUMENT_KINDS = {"sdf": "SDF", "mujoco": "MJCF"}
"""Root elements of the documents that Drake reads here, and their names."""

LEFT_OUT = "left_out"
"""Attribute of the <robot>: names of what the document holds beside the arm."""


def urdf_of_model(path: Path, tag: str, digest: str) -> bytes:
    """The URDF of a document whose root element has this tag.

    Args:
        digest: digest of the file's content; a command reads the same file several times.

    Raises:
        InputError: Drake cannot read it, it holds no model or several, or a limit of
            `limited_child` is reached.
    """
    return _urdf_of_model(path.resolve(), path, tag, digest)


@lru_cache(maxsize=8)
def _urdf_of_model(file: Path, path: Path, tag: str, digest: str) -> bytes:
    return run_limited(_CHILD, path, [tag], DOCUMENT_KINDS[tag], "correct it, or give a URDF")
