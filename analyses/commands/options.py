"""Options of the commands, made from the fields of their settings.

A command's settings are a dataclass: its config.yaml, all that is needed to run it again. An option
is a key of it: its type and default are the field's, its help the words beside the field.
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
_HELP_ALL: Final = "Show every option, also those that are usually left to --config."


@dataclass(frozen=True)
class Option:
    """An option, or an argument, that is a key of a command's settings.

    Type and default are the field's. A list of numbers is given with commas between them; what is
    false by default is a flag that makes it true.
    """

    place: str  # of the key in the settings, such as `estimate.engine`
    name: str = ""  # of the option, with underscores; else the field's
    help: str = ""  # else the field's words
    shown: bool = True  # in --help; else in --help-all alone
    required: bool = False  # unless `--config` gives it
    argument: bool = False  # given by its position
    flags: str = ""  # spelling of a flag, such as --smooth/--causal
    metavar: str | None = None
    default: str = ""  # shown as the default where the field's is a rule
    least: int | None = None  # of a whole number
    put: Callable[[Any, str], None] | None = None  # puts a text into the settings in its own way

    @property
    def parameter(self) -> str:
        """The name of the command's parameter."""
        return self.name or self.place.rpartition(".")[2]

    @property
    def spelling(self) -> str:
        """The option as it is written on the command line."""
        return self.flags.partition("/")[0] or f"--{self.parameter.replace('_', '-')}"


def hidden(place: str, *keys: str, prefix: str = "") -> Iterator[Option]:
    """Options of keys of one part of the settings, which --help-all alone shows.

    Args:
        prefix: of the options' names, before the keys.
    """
    return (Option(f"{place}.{key}", f"{prefix}{key}", shown=False) for key in keys)


def with_settings(
    schema: type[Settings], options: Sequence[Option], from_file: bool = True
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Makes a command of a function that takes settings.

    The function's first argument is the settings of the run: defaults, then `--config`, then what
    the command line says. Its other arguments are options of its own.

    Args:
        schema: the settings' dataclass, which `load_configuration` reads.
        options: its keys that are options, in the order of the help; each is put into the settings
            after those before it.
        from_file: whether there is `--config`: not where no config.yaml is written.
    """

    def decorate(run: Callable[..., None]) -> Callable[..., None]:
        (_, *rest) = inspect.signature(run).parameters.values()
        own = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in rest]

        def command(ctx: typer.Context, **given: Any) -> None:
            settings = _settled(ctx, schema, options)
            extra = {p.name: ctx if p.name == "ctx" else given[p.name] for p in own}
            run(settings, **extra)

        parameters = [_parameter("ctx", typer.Context)]
        parameters += [_made(schema, option) for option in options]
        parameters += [p for p in own if p.name not in ("ctx", "out")]
        if from_file:
            read = Annotated[Path | None, _config_option(schema, options)]
            parameters.append(_parameter("config", read, None))
        if not all(option.shown for option in options):
            help_all = typer.Option("--help-all", is_eager=True, callback=_help_all, help=_HELP_ALL)
            parameters.append(_parameter("help_all", Annotated[bool, help_all], False))
        parameters += [p for p in own if p.name == "out"]
        made: Any = command
        made.__signature__ = inspect.Signature(parameters)
        made.__annotations__, made.__doc__ = {}, run.__doc__
        return command

    return decorate


def _parameter(name: str, annotation: Any, default: Any = inspect.Parameter.empty) -> Any:
    kind = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(name, kind, default=default, annotation=annotation)


def _made(schema: type[Any], option: Option) -> Any:
    """The parameter that typer makes an option or an argument of."""
    cls, default = _holder(schema, option.place)
    key = option.place.rpartition(".")[2]
    hint = get_type_hints(cls)[key]
    words = option.help or field_words(cls)[key]
    shared: dict[str, Any] = {"help": _sentence(words), "metavar": option.metavar}
    if option.put is not None:
        hint, default = str | None, None
    elif _plain(hint) == list[float]:
        hint, default = str, joined(default or ())
        shared["metavar"] = option.metavar or "X[,X...]"
    elif _plain(hint) == list[str]:
        hint, default = list[str] if option.required else list[str] | None, None
    if option.required:
        default = inspect.Parameter.empty
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


def _sentence(words: str) -> str:
    """A field's words as a sentence, with the unit that they begin with last."""
    found = _UNIT_FIRST.fullmatch(words)
    unit, what = found.groups() if found else ("", words)
    is_file = "." in what.partition(" ")[0]
    text = what if is_file else what[:1].upper() + what[1:]
    return f"{text} ({unit})." if unit else text.rstrip(".") + "."


def _plain(hint: Any) -> Any:
    """A type without the None that it may be."""
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
    for part, after in zip(path, [*path, key][1:], strict=True):
        kinds = schemas_in(get_type_hints(type(holder))[part])
        holder = getattr(holder, part)
        if not hasattr(holder, after):
            names = {kind: {f.name for f in dataclasses.fields(kind)} for kind in kinds}
            holder = next(kind for kind in kinds if after in names[kind])()
    return type(holder), getattr(holder, key)


def _config_option(schema: type[Any], options: Sequence[Option]) -> Any:
    def read(ctx: typer.Context, path: Path | None) -> Path | None:
        if path is not None:
            from wrenchsight.models.files.configuration import load_configuration

            settings = load_configuration(path, schema)
            ctx.meta[_KEY] = settings
            # So that the parser does not ask for what the file gives.
            required = [option for option in options if option.required]
            given = {option.parameter: _get(settings, option.place) for option in required}
            ctx.default_map = {name: value for name, value in given.items() if value}
        return path

    return typer.Option(
        "--config",
        metavar="FILE",
        callback=read,
        is_eager=True,
        help="File of settings, such as a result's config.yaml; options override it.",
    )


def _help_all(ctx: typer.Context, wanted: bool) -> None:
    if wanted and not ctx.resilient_parsing:
        for parameter in ctx.command.params:
            parameter.hidden = False  # type: ignore[attr-defined]
        typer.echo(ctx.get_help())
        raise typer.Exit


def _settled(ctx: typer.Context, schema: type[Settings], options: Sequence[Option]) -> Settings:
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
    elif isinstance(value, Path) and _plain(get_type_hints(type(settings))[name]) is not Path:
        value = str(value)
    elif isinstance(value, list | tuple):
        value = [str(one) if isinstance(one, Path) else one for one in value]
    setattr(settings, name, value)
