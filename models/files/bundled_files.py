"""Files by name: those that come with the package, or the user's."""

from importlib import resources
from pathlib import Path

from wrenchsight.models.files.configuration import nearest
from wrenchsight.models.files.input_error import InputError


def bundled_files(folder: str) -> dict[str, Path]:
    """The YAML files in a folder of wrenchsight.models, and the robot.yaml of folders in it.

    Returns:
        By name, in alphabetical order: of the file without its ending, or of the robot's folder.
    """
    directory = Path(str(resources.files("wrenchsight.models"))) / folder
    files = {path.stem: path for path in directory.glob("*.yaml")}
    files |= {path.parent.name: path for path in directory.glob("*/robot.yaml")}
    return dict(sorted(files.items()))


def named_file(name_or_path: str | Path, folder: str, description: str) -> Path:
    """Returns the file of a bundled name, or the path as it is.

    Args:
        folder: as `bundled_files`.
        description: description of the file, for error lines: "task".

    Raises:
        InputError: neither a bundled name nor the path of a YAML file.
    """
    text, path, bundled = str(name_or_path), Path(name_or_path), bundled_files(folder)
    if text in bundled:
        return bundled[text]
    if not path.exists() and path.suffix.lower() not in (".yaml", ".yml"):
        choices = f"give the path of a YAML file or one of {', '.join(bundled)}"
        raise InputError(text, "", f"no such {description}", nearest(text, bundled) or choices)
    return path


def task_file(name_or_path: str | Path, kind: str) -> Path:
    """Returns the file of a task, as `named_file`; its kind is "placement" or "redundancy"."""
    return named_file(name_or_path, f"tasks/{kind}", "task")
