"""Which commands there are, found without importing them."""

import ast
import pkgutil
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Final

import typer
from typer.core import TyperCommand

from wrenchsight.analyses.study.registry import module_file
from wrenchsight.models.files.input_error import InputError

PACKAGE: Final = "wrenchsight.analyses.commands"
ENTRY_POINTS: Final = "wrenchsight.commands"
_FUNCTION: Final = "command"


@dataclass(frozen=True)
class CommandEntry:
    """A command, as far as it shows before its module is imported."""

    name: str
    module: str
    summary: str  # first line of the function's docstring
    order: float  # its place in the help: the module's ORDER, a literal


def find_commands() -> dict[str, CommandEntry]:
    """The commands by name, in the order of the help.

    Raises:
        InputError: an installed package offers a module that is no command.
    """
    modules = pkgutil.iter_modules([str(Path(__file__).parent)], f"{PACKAGE}.")
    bundled = [_read(info.name) for info in modules]
    commands = [entry for entry in bundled if entry is not None]
    for point in entry_points(group=ENTRY_POINTS):
        entry = _read(point.module)
        if entry is None:
            package = point.dist.name if point.dist is not None else point.name
            problem = f"its entry point {point.module} has no function `{_FUNCTION}`"
            raise InputError(package, "", problem, "repair it or take it out")
        commands.append(entry)
    commands.sort(key=lambda entry: (entry.order, entry.name))
    return {entry.name: entry for entry in commands}


def load_command(entry: CommandEntry) -> TyperCommand:
    """Imports a command's module and makes a command of its function.

    A module's COMMAND_CLASS, if it has one, parses the arguments in its own way.
    """
    module: Any = import_module(entry.module)
    app = typer.Typer(add_completion=False)
    app.command(entry.name, cls=getattr(module, "COMMAND_CLASS", TyperCommand))(module.command)
    loaded = typer.main.get_command(app)
    assert isinstance(loaded, TyperCommand)
    return loaded


def _read(module: str) -> CommandEntry | None:
    path = module_file(module)
    return None if path is None else _parsed(module, path, path.stat().st_mtime_ns)


@cache
def _parsed(module: str, path: Path, changed: int) -> CommandEntry | None:
    text = path.read_text(encoding="utf-8")
    if f"\ndef {_FUNCTION}(" not in text:
        return None
    order, summary = 1000.0, ""
    for node in ast.parse(text).body:
        if isinstance(node, ast.FunctionDef) and node.name == _FUNCTION:
            summary = (ast.get_docstring(node) or "").partition("\n")[0]
        elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "ORDER":
            order = float(ast.literal_eval(node.value))
    return CommandEntry(module.rpartition(".")[2].replace("_", "-"), module, summary, order)
