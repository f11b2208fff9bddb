"""Options that several commands have, and settings that come from a file and from options.

A command's settings are a dataclass: its config.yaml, all that is needed to run it again. Their
defaults are the options' defaults; `--config FILE` reads them from such a file, and options on the
command line override it.
"""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from typer.core import TyperCommand

from wrenchsight.models.files.input_error import InputError

Settings = TypeVar("Settings")

Out = Annotated[Path, typer.Option(help="Folder for the results.", show_default=True)]
Data = Annotated[Path, typer.Option(help="Folder of the real recordings.")]
Seed = Annotated[int, typer.Option(min=0, help="Seed of every random number.")]
Quick = Annotated[bool, typer.Option("--quick", help="Shorter and coarser: to try things out.")]
Truth = Annotated[
    str,
    typer.Option(
        metavar="own|plain",
        help="What simulated arms truly are: as their robot.yaml has it, or with plain friction "
        "alone, all else exact.",
    ),
]
RobotName = Annotated[
    str, typer.Option(help="A bundled robot's name, or the path of a robot.yaml.")
]
Check = Annotated[bool, typer.Option(help="Check the log against the robot's limits and gravity.")]
AcceptSigns = Annotated[
    bool,
    typer.Option(
        "--accept-signs",
        help="Take the drives' signs as the robot's file has them, although gravity, inertia "
        "and friction contradict them; the result says so.",
    ),
]
LogFormat = Annotated[
    str | None,
    typer.Option(help="Description of the log's columns: a bundled name or the path of a YAML."),
]

_KEY = "wrenchsight.settings"


def config_option(schema: type[Settings], places: Mapping[str, str]) -> Any:
    """The option `--config` of a command whose settings are `schema`.

    Args:
        schema: a dataclass that `load_configuration` reads.
        places: of each parameter of the command that is a setting, where it stands in `schema`,
            such as `estimate.engine`.
    """

    def read(ctx: typer.Context, path: Path | None) -> Path | None:
        if path is not None:
            from wrenchsight.models.files.configuration import load_configuration

            settings = load_configuration(path, schema)
            ctx.meta[_KEY] = settings
            # So that the parser does not ask for what the file gives.
            given = {name: _get(settings, place) for name, place in places.items()}
            required = {p.name for p in ctx.command.params if p.required}
            ctx.default_map = {k: v for k, v in given.items() if k in required and v}
        return path

    return typer.Option(
        "--config",
        metavar="FILE",
        callback=read,
        is_eager=True,
        help="File of settings, such as a result's config.yaml; options override it.",
    )


def settled(
    ctx: typer.Context,
    schema: type[Settings],
    places: Mapping[str, str],
    start: Settings | None = None,
) -> Settings:
    """The settings of this run: defaults, then `--config`, then what the command line says.

    Args:
        ctx: of the command.
        schema, places: as `config_option`.
        start: settings to put the command line's into, instead of the defaults or the file's.

    Raises:
        InputError: a text that is not a list of numbers.
    """
    settings: Settings = start or deepcopy(ctx.meta.get(_KEY)) or schema()
    for name, place in places.items():
        if on_command_line(ctx, name):
            _put(settings, place, ctx.params[name], f"--{name.replace('_', '-')}")
    return settings


def from_file(ctx: typer.Context) -> bool:
    """Whether the command has read `--config`."""
    return _KEY in ctx.meta


def on_command_line(ctx: typer.Context, name: str) -> bool:
    """Whether a parameter was given there, rather than left to its default or to the file."""
    source = ctx.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"  # its class moves between releases


def numbers(text: str, option: str) -> list[float]:
    """The numbers of a text such as `0,0,-1`.

    Raises:
        InputError: there are other words in it.
    """
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        problem = f"expected a number, or numbers with commas between them, found {text!r}"
        raise InputError(option, "", problem) from None


def joined(values: Sequence[float]) -> str:
    """Numbers as `numbers` reads them."""
    return ",".join(f"{value:g}" for value in values)


class SeveralValues(TyperCommand):
    """Lets `--validate A B` stand for `--validate A --validate B`, as a shell's `*` writes it."""

    options = ("--validate", "--load")

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        spelt, current = list[str](), ""
        for index, word in enumerate(args):
            if word == "--":
                return super().parse_args(ctx, spelt + args[index:])
            if word.startswith("-"):
                current = word if word in self.options else ""
            elif current and args[index - 1] != current:
                spelt.append(current)
            spelt.append(word)
        return super().parse_args(ctx, spelt)


def _get(settings: Any, place: str) -> Any:
    for name in place.split("."):
        settings = getattr(settings, name, None)
    return settings


def _put(settings: Any, place: str, value: Any, option: str) -> None:
    *path, name = place.split(".")
    for part in path:
        settings = getattr(settings, part)
        if settings is None:  # a part that is not asked for has no settings
            return
    if not hasattr(settings, name):  # of another kind, as the file has it
        raise InputError(option, "", f"{type(settings).__name__} has no {name}", "leave it out")
    if isinstance(value, str) and isinstance(getattr(settings, name), list):
        value = numbers(value, option)
    elif isinstance(value, Path):
        value = str(value)
    elif isinstance(value, list | tuple):
        value = [str(one) if isinstance(one, Path) else one for one in value]
    setattr(settings, name, value)
