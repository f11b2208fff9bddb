"""Expansion of xacro to URDF by the package `xacro`, in a child process.

A xacro file is code of the one who wrote it: its expressions are Python. So it is expanded only
where its user trusts it, once, when a robot.yaml is drafted; no robot.yaml names one.
"""

import importlib.util
import re
from collections.abc import Mapping
from pathlib import Path

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import read_limited
from wrenchsight.models.robot.limited_child import run_limited
from wrenchsight.models.robot.ros_packages import (
    PACKAGE_NOT_FOUND,
    find_package,
    folder_that_holds,
)
from wrenchsight.models.robot.xacro_child import PACKAGES_FOLLOW

_CHILD = "wrenchsight.models.robot.xacro_child"
_LARGEST_FILE = 1 << 26  # bytes
_UNDEFINED_ARGUMENT = re.compile(r"[Uu]ndefined substitution argument (\w+)")
_MACRO = re.compile(r"<xacro:macro\s([^>]*)>")
_ATTRIBUTE = re.compile(r"""(name|params)\s*=\s*["']([^"']*)["']""")
_PATH_IN_PACKAGE = re.compile(r"\$\(find ([\w.-]+)\)/([\w./-]+)")


def untrusted_xacro(path: Path) -> InputError:
    """The error of a xacro file that nobody has said to trust."""
    return InputError(
        path,
        "",
        "is xacro, which runs code of its author",
        f"if you trust it: wrenchsight robot {path.name} --trust-xacro [--xacro-arg NAME:=VALUE]; "
        f"or expand it yourself, in an environment of ROS: xacro {path.name} > robot.urdf",
    )


def renamed_packages(path: Path) -> dict[str, Path]:
    """Packages that a xacro file asks for by a name that its own folders no longer have.

    Whoever copies a package into another project renames its folder and drops its package.xml. Its
    folder is the one above the file that holds all that the file asks of the package.

    Args:
        path: xacro file; only what it asks for itself is looked at.

    Returns:
        The folders by the package's name.
    """
    text = read_limited(path, _LARGEST_FILE, "a xacro file").decode("utf-8", errors="replace")
    paths: dict[str, list[str]] = {}
    for name, path_in_package in _PATH_IN_PACKAGE.findall(text):
        paths.setdefault(name, []).append(path_in_package)
    folders = {
        name: folder_that_holds(of_package, path.parent)
        for name, of_package in paths.items()
        if find_package(name, path.resolve().parent) is None
    }
    return {name: folder for name, folder in folders.items() if folder is not None}


def urdf_of_xacro(path: Path, arguments: Mapping[str, str]) -> bytes:
    """The URDF that a trusted xacro file means, with these arguments and the defaults of others.

    `$(find package)` is looked for as in `ros_packages`, and among `renamed_packages`.

    Raises:
        InputError: the package `xacro` is not installed; a package is not found; an argument
            without a default; what xacro refuses; a limit of `limited_child`.
    """
    if importlib.util.find_spec("xacro") is None:
        raise InputError(path, "", "is xacro, which is not installed", "pip install xacro")
    words = [f"{name}:={value}" for name, value in arguments.items()]
    words.append(PACKAGES_FOLLOW)
    words += [f"{name}:={folder}" for name, folder in renamed_packages(path).items()]
    return run_limited(_CHILD, path, words, "xacro", _remedy)


def refuse_uncalled_macros(urdf: bytes, path: Path) -> None:
    """Refuses a xacro file that has become a robot without links, as one that defines macros alone.

    Args:
        urdf: what xacro has made of it.
        path: of the xacro file.

    Raises:
        InputError: with the macros that the file defines and does not call.
    """
    if b"<link" in urdf:
        return
    text = read_limited(path, _LARGEST_FILE, "a xacro file").decode("utf-8", errors="replace")
    macros = [dict(_ATTRIBUTE.findall(words)) for words in _MACRO.findall(text)]
    calls = [
        f"<xacro:{macro['name']} {_attributes(macro.get('params', ''))}/>"
        for macro in macros
        if "name" in macro and f"<xacro:{macro['name']}" not in text
    ]
    if not calls:
        raise InputError(path, "", "xacro makes no <link> of it", "give the file of a whole robot")
    problem = (
        f"defines a macro and calls it nowhere, so that xacro makes no <link> of it: {calls[0]}"
    )
    remedy = "write the call into it, or give the file that includes it and calls it"
    raise InputError(path, "", problem, remedy)


def _attributes(parameters: str) -> str:
    """Attributes of a macro's call; blocks (*origin), which are elements within it, as such."""
    names = [word.partition(":=")[0].partition("=")[0] for word in parameters.split()]
    return " ".join(f'{name}="..."' for name in names if not name.startswith("*"))


def _remedy(problem: str) -> str:
    if PACKAGE_NOT_FOUND in problem:
        return (
            "put the package, with its package.xml and under this name, beside the file's "
            "repository, or set ROS_PACKAGE_PATH to the folder that holds it"
        )
    if (undefined := _UNDEFINED_ARGUMENT.search(problem)) is not None:
        name = undefined.group(1)
        return f"give the argument {name}: --xacro-arg {name}:=VALUE"
    if "argument" in problem:
        return "give what it asks for (--xacro-arg NAME:=VALUE), or correct the file"
    return "correct the file"
