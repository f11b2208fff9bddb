"""Options of the commands, made from the fields of their settings.

A command's settings are a dataclass: its config.yaml, all that is needed to run it again. An option
is one of its keys: type and default are the field's, its help is the text below the field.
`--config FILE` reads the settings from such a file, and options on the command line override it.
"""

import dataclasses
import inspect
import re
import types
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar, Union, get_args, get_origin, get_type_hints

import typer
from typer.core import TyperCommand

from wrenchsight.models.files.field_words import field_words, schemas_in
from wrenchsight.models.files.input_error import InputError

Settings = TypeVar("Settings")

Out = Annotated[Path, typer.Option(help="Folder for the results.", show_default=True)]

_UNIT_FIRST: Final = re.compile(
    r"((?:N m|N|1/s|rad|Hz|m|s)(?:/s(?:\^2)?)?(?: \([^)]*\)| about E)?), (.+)"
)
_KEY: Final = "wrenchsight.settings"
_CONTEXT: Final = "ctx"  # names of a command's arguments that are reserved
_OUT: Final = "out"
_HELP_ALL: Final = "Show every option, also those that are usually left to --config."


@dataclass(frozen=True)
class Option:
    """An option, or an argument, that is a key of a command's settings.

    Type and default are the field's. A list of numbers is written with commas between them. A key
    that is false by default becomes a flag.

    Attributes:
        place: place of the key in the settings, such as `estimate.engine`.
        name: name of the option, with underscores; else the field's.
        help: help of the option; else the field's text.
        shown: in --help; else in --help-all alone.
        required: unless `--config` gives it.
        argument: whether its position names it.
        flags: spelling of a flag, such as --smooth/--causal.
        metavar: that the help shows.
        default: that the help shows where the field's default is a rule.
        least: smallest value of a whole number.
        put: puts the option's text into the settings where that is no plain assignment.
    """

    place: str
    name: str = ""
    help: str = ""
    shown: bool = True
    required: bool = False
    argument: bool = False
    flags: str = ""
    metavar: str | None = None
    default: str = ""
    least: int | None = None
    put: Callable[[Any, str], None] | None = None

    @property
    def parameter(self) -> str:
        """The name of the command's parameter."""
        return self.name or self.place.rpartition(".")[2]

    @property
    def spelling(self) -> str:
        """The option as it is written on the command line."""
        return self.flags.partition("/")[0] or f"--{self.parameter.replace('_', '-')}"


def hidden(place: str, *keys: str, prefix: str = "") -> Iterator[Option]:
    """Options for keys of one part of the settings, which only --help-all shows.

    Args:
        prefix: prefix of the options' names, before the keys.
    """
    return (Option(f"{place}.{key}", f"{prefix}{key}", shown=False) for key in keys)


def with_settings(
    schema: type[Settings], options: Sequence[Option], from_file: bool = True
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Makes a command of a function that takes settings.

    The function's first argument is the settings of the run: defaults, overridden by `--config`,
    overridden by the command line. Its further arguments are options outside the settings. Two of
    their names are reserved: `ctx` (_CONTEXT) is no option, and gets typer's context; `out` (_OUT)
    stands last.

    typer reads a command's options from its signature: here it is made of the keys' options, the
    function's further ones, --config, --help-all, and last --out.

    Args:
        schema: the settings' dataclass, which `load_configuration` reads.
        options: its keys that are options, in the order of the help; they are put into the settings
            in this order.
        from_file: whether there is `--config`; not for a command that writes no config.yaml.
    """

    def decorate(run: Callable[..., None]) -> Callable[..., None]:
        _settings, *others = inspect.signature(run).parameters.values()
        further = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in others]

        def command(ctx: typer.Context, **values: Any) -> None:
            # The context has the options' values, and tells those given from their defaults.
            settings = _settings_of_run(ctx, schema, options)
            arguments = {p.name: ctx if p.name == _CONTEXT else values[p.name] for p in further}
            run(settings, **arguments)

        parameters = [_parameter(_CONTEXT, typer.Context)]
        parameters += [_parameter_of(schema, option) for option in options]
        parameters += [p for p in further if p.name not in (_CONTEXT, _OUT)]
        if from_file:
            read = Annotated[Path | None, _config_option(schema, options)]
            parameters.append(_parameter("config", read, None))
        if not all(option.shown for option in options):
            help_all = typer.Option("--help-all", is_eager=True, callback=_help_all, help=_HELP_ALL)
            parameters.append(_parameter("help_all", Annotated[bool, help_all], False))
        parameters += [p for p in further if p.name == _OUT]  # last in the help
        made: Any = command
        made.__signature__ = inspect.Signature(parameters)  # read by typer, instead of **values
        made.__annotations__ = {}  # which typer would read first
        made.__doc__ = run.__doc__
        return command

    return decorate


def _parameter(name: str, annotation: Any, default: Any = inspect.Parameter.empty) -> Any:
    kind = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(name, kind, default=default, annotation=annotation)


def _parameter_of(schema: type[Any], option: Option) -> Any:
    """The parameter from which typer makes the option or argument."""
    cls, default = _holder(schema, option.place)
    key = option.place.rpartition(".")[2]
    text = option.help or field_words(cls)[key]
    hint, default, metavar = _typed(get_type_hints(cls)[key], default, option)
    if option.required:
        default = inspect.Parameter.empty
    shared: dict[str, Any] = {"help": _sentence(text), "metavar": metavar}
    if option.argument:
        return _parameter(option.parameter, Annotated[hint, typer.Argument(**shared)], default)
    spellings = [option.flags] if option.flags else []
    if hint is bool and default is False and not spellings:
        spellings = [option.spelling]  # no --no-...
    shared |= {"hidden": not option.shown, "min": option.least}
    shared["show_default"] = option.default or (default not in ("", None))
    return _parameter(
        option.parameter, Annotated[hint, typer.Option(*spellings, **shared)], default
    )


def _typed(hint: Any, default: Any, option: Option) -> tuple[Any, Any, str | None]:
    """Type, default and metavar of an option on the command line, which has words alone.

    Args:
        hint, default: of the field in the settings.
    """
    if option.put is not None:  # it reads the word itself
        return str | None, None, option.metavar
    if _plain(hint) == list[float]:  # numbers with commas between them, in one word
        return str, joined(default or ()), option.metavar or "X[,X...]"
    if _plain(hint) == list[str]:  # a word each time that the option is given
        return list[str] if option.required else list[str] | None, None, option.metavar
    return hint, default, option.metavar


def _sentence(text: str) -> str:
    """A field's text as a sentence; a unit at its begin moves to the end."""
    unit = ""
    match = _UNIT_FIRST.fullmatch(text)
    if match:
        unit, text = match.groups()
    first_word = text.partition(" ")[0]
    is_file_or_address = "." in first_word or "://" in first_word
    if not is_file_or_address:
        text = text[:1].upper() + text[1:]
    return f"{text} ({unit})." if unit else text.rstrip(".") + "."


def _plain(hint: Any) -> Any:
    """The type without None."""
    if get_origin(hint) in (Union, types.UnionType):
        kinds = [kind for kind in get_args(hint) if kind is not type(None)]
        return kinds[0] if len(kinds) == 1 else hint
    return hint


def _holder(schema: type[Any], place: str) -> tuple[Any, Any]:
    """The dataclass that has the key at a place, and the key's default.

    Where a part has one of several kinds, or is left out, it is the first kind with that key.
    """
    *path, key = place.split(".")
    holder: Any = schema()
    for part, next_key in zip(path, [*path, key][1:], strict=True):
        kinds = schemas_in(get_type_hints(type(holder))[part])
        holder = getattr(holder, part)
        if not hasattr(holder, next_key):
            names = {kind: {f.name for f in dataclasses.fields(kind)} for kind in kinds}
            holder = next(kind for kind in kinds if next_key in names[kind])()
    return type(holder), getattr(holder, key)


def _config_option(schema: type[Any], options: Sequence[Option]) -> Any:
    def read(ctx: typer.Context, path: Path | None) -> Path | None:
        if path is not None:
            from wrenchsight.models.files.configuration import load_configuration

            settings = load_configuration(path, schema)
            ctx.meta[_KEY] = settings
            # The parser does not require the keys that the file gives.
            required = [option for option in options if option.required]
            values = {option.parameter: _get(settings, option.place) for option in required}
            ctx.default_map = {name: value for name, value in values.items() if value}
        return path

    return typer.Option(
        "--config",
        metavar="FILE",
        callback=read,
        is_eager=True,
        help="File of settings, such as a result's config.yaml; options override it.",
    )


def _help_all(ctx: typer.Context, is_requested: bool) -> None:
    if is_requested and not ctx.resilient_parsing:
        for parameter in ctx.command.params:
            parameter.hidden = False  # type: ignore[attr-defined]
        typer.echo(ctx.get_help())
        raise typer.Exit


def _settings_of_run(
    ctx: typer.Context, schema: type[Settings], options: Sequence[Option]
) -> Settings:
    settings: Settings = deepcopy(ctx.meta.get(_KEY)) or schema()
    for option in options:
        if not on_command_line(ctx, option.parameter):
            continue
        value = ctx.params[option.parameter]
        if option.put is not None:
            option.put(settings, value)
        else:
            _put(settings, option.place, value, option.spelling)
    return settings


def on_command_line(ctx: typer.Context, name: str) -> bool:
    """Whether the command line states a parameter, rather than its default or the file."""
    source = ctx.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"  # its class moves between releases


def numbers(text: str, option: str) -> list[float]:
    """The numbers of a text such as `0,0,-1`.

    Raises:
        InputError: it holds anything else.
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
        expanded, current = list[str](), ""
        for index, word in enumerate(args):
            if word == "--":
                return super().parse_args(ctx, expanded + args[index:])
            if word.startswith("-"):
                current = word if word in self.options else ""
            elif current and args[index - 1] != current:
                expanded.append(current)
            expanded.append(word)
        return super().parse_args(ctx, expanded)


def _get(settings: Any, place: str) -> Any:
    for name in place.split("."):
        settings = getattr(settings, name, None)
    return settings


def _put(settings: Any, place: str, value: Any, option: str) -> None:
    *path, name = place.split(".")
    for part in path:
        settings = getattr(settings, part)
        if settings is None:  # a part that is not requested has no settings
            return
    if not hasattr(settings, name):  # the file configures another kind
        raise InputError(option, "", f"{type(settings).__name__} has no {name}", "leave it out")
    if isinstance(value, str) and isinstance(getattr(settings, name), list):
        value = numbers(value, option)
    elif isinstance(value, Path) and _plain(get_type_hints(type(settings))[name]) is not Path:
        value = str(value)
    elif isinstance(value, list | tuple):
        value = [str(entry) if isinstance(entry, Path) else entry for entry in value]
    setattr(settings, name, value)
