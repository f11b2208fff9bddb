"""Expansion of xacro to URDF by the package `xacro`, in a child process.

A xacro file is code of the one who wrote it: its expressions are Python. So it is expanded only
where its user trusts it, once, when a robot.yaml is drafted; no robot.yaml names one.
"""

import importlib.util
from collections.abc import Mapping
from pathlib import Path

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.limited_child import run_limited
from wrenchsight.models.robot.ros_packages import PACKAGE_NOT_FOUND

_CHILD = "wrenchsight.models.robot.xacro_child"


def untrusted_xacro(path: Path) -> InputError:
    """The error of a xacro file that nobody has said to trust."""
    return InputError(
        path,
        "",
        "is xacro, which runs code of its author",
        f"if you trust it: wrenchsight robot {path.name} --trust-xacro [--xacro-arg NAME:=VALUE]; "
        f"or expand it yourself, in an environment of ROS: xacro {path.name} > robot.urdf",
    )


def urdf_of_xacro(path: Path, arguments: Mapping[str, str]) -> bytes:
    """The URDF that a trusted xacro file means, with these arguments and the defaults of others.

    `$(find package)` is looked for as in `ros_packages`.

    Raises:
        InputError: the package `xacro` is not installed; a package is not found; an argument
            without a default; what xacro refuses; a limit of `limited_child`.
    """
    if importlib.util.find_spec("xacro") is None:
        raise InputError(path, "", "is xacro, which is not installed", "pip install xacro")
    words = [f"{name}:={value}" for name, value in arguments.items()]
    return run_limited(_CHILD, path, words, "xacro", _remedy)


def _remedy(problem: str) -> str:
    if PACKAGE_NOT_FOUND in problem:
        return (
            "put the package, with its package.xml and under this name, beside the file's "
            "repository, or set ROS_PACKAGE_PATH to the folder that holds it"
        )
    if "argument" in problem:
        return "give what it asks for (--xacro-arg NAME:=VALUE), or correct the file"
    return "correct the file"
