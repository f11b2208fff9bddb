"""Files by name: those that come with the package, or the user's own."""

from importlib import resources
from pathlib import Path

from wrenchsight.models.files.configuration import nearest
from wrenchsight.models.files.input_error import InputError


def bundled_files(folder: str) -> dict[str, Path]:
    """The YAML files in a folder of wrenchsight.models, and the robot.yaml of folders in it.

    Returns:
        By name, in alphabetical order: of the file without its ending, or of the robot's folder.
    """
    place = Path(str(resources.files("wrenchsight.models"))) / folder
    found = {path.stem: path for path in place.glob("*.yaml")}
    found |= {path.parent.name: path for path in place.glob("*/robot.yaml")}
    return dict(sorted(found.items()))


def named_file(name_or_path: str | Path, folder: str, what: str) -> Path:
    """Returns the file of a bundled name, or the path as it is.

    Args:
        folder: as `bundled_files`.
        what: for error lines: "task".

    Raises:
        InputError: neither a bundled name nor the path of a YAML file.
    """
    text, path, bundled = str(name_or_path), Path(name_or_path), bundled_files(folder)
    if text in bundled:
        return bundled[text]
    if not path.exists() and path.suffix.lower() not in (".yaml", ".yml"):
        known = f"give the path of a YAML file or one of {', '.join(bundled)}"
        raise InputError(text, "", f"no such {what}", nearest(text, bundled) or known)
    return path


def task_file(name_or_path: str | Path, kind: str) -> Path:
    """As `named_file`, of the tasks of one kind: "placement" or "redundancy"."""
    return named_file(name_or_path, f"tasks/{kind}", "task")
