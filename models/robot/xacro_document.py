"""xacro written out, without ROS: by the package `xacro` of PyPI."""

from pathlib import Path
from typing import Any

from wrenchsight.models.files.files_read import about_to_read
from wrenchsight.models.files.input_error import InputError


def urdf_of_xacro(path: Path) -> bytes:
    """The URDF that a xacro file means, with its arguments' defaults.

    `$(find package)` is looked for upwards from the file: a folder of that name, or the one whose
    package.xml lies there.

    Raises:
        InputError: the package `xacro` is not installed; a package is not found; an argument
            without a default; whatever else xacro refuses.
    """
    by_hand = f"write it out: xacro {path.name} [ARGUMENT:=VALUE ...] > robot.urdf"
    try:
        import xacro
        from xacro import substitution_args
    except ImportError as error:
        remedy = f"pip install xacro (it needs no ROS), or {by_hand}"
        raise InputError(path, "", "is xacro, which is not installed", remedy) from error

    def find(package: str) -> str:
        folder = path.resolve().parent
        for parent in (folder, *folder.parents):
            own = parent.name == package and (parent / "package.xml").is_file()
            if own or (parent / package).is_dir():
                return str(parent if own else parent / package)
        raise LookupError(f"package '{package}' is not found upwards from {folder}")

    before, table = substitution_args._eval_find, substitution_args._eval_dict
    substitution_args._eval_find, table["find"] = find, find
    try:
        document: Any = xacro.process_file(str(path))
    # What xacro raises has no common class, and SystemExit is among it.
    except (Exception, SystemExit) as error:
        problem = " ".join(str(error).split()) or type(error).__name__
        raise InputError(path, "", f"xacro: {problem}", by_hand) from error
    finally:
        substitution_args._eval_find, table["find"] = before, before
    for included in getattr(xacro, "all_includes", []):
        about_to_read(Path(included))
    return bytes(document.toxml(encoding="utf-8"))
