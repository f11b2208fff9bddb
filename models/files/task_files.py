"""Task files by name: those that come with the package, or the user's own."""

from importlib import resources
from pathlib import Path

from wrenchsight.models.files.configuration import nearest
from wrenchsight.models.files.input_error import InputError


def bundled_tasks(kind: str) -> list[str]:
    """Names of the tasks of one kind ("placement" or "redundancy") that come with the package."""
    return sorted(file.stem for file in _folder(kind).glob("*.yaml"))


def task_file(name_or_path: str | Path, kind: str) -> Path:
    """Returns the file of a bundled task, or the path as it is.

    Raises:
        InputError: neither a bundled name nor the path of a YAML file.
    """
    text, path = str(name_or_path), Path(name_or_path)
    names = bundled_tasks(kind)
    if text in names:
        return _folder(kind) / f"{text}.yaml"
    if not path.exists() and path.suffix not in {".yaml", ".yml"}:
        remedy = nearest(text, names) or f"give the path of a YAML file or one of {names}"
        raise InputError(text, "", "no such task", remedy)
    return path


def _folder(kind: str) -> Path:
    return Path(str(resources.files("wrenchsight.models"))) / "tasks" / kind
