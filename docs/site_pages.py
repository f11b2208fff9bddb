"""Fills in what the documentation takes from the code, so that it cannot fall behind it.

Five directives, each alone on a line of a page:

    <!-- schema: wrenchsight.models.files.X -->   the keys of a YAML file, out of its dataclass
    <!-- api: wrenchsight.models.files -->        every public module below a package
    <!-- public -->                   the names of `wrenchsight`, and its commands
    <!-- robots -->                   sources and licences of the bundled robots
    <!-- results -->                  the table "article / here" of the last study
"""

import dataclasses
import inspect
import re
import typing
from importlib import import_module
from pathlib import Path
from typing import Any

import wrenchsight
from wrenchsight.analyses.commands.discovery import find_commands
from wrenchsight.analyses.study.readme_table import RESULTS, WORLDS, committed, results_table
from wrenchsight.models.files.field_words import field_words, schemas_in

ROOT = Path(__file__).resolve().parent.parent
_DIRECTIVE = re.compile(
    r"^<!-- (schema|api|public|robots|results)(?:: ([\w.]+))? -->$", re.MULTILINE
)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The hook of MkDocs: replaces the directives of one page."""
    return _DIRECTIVE.sub(_replacement, markdown)


def _replacement(match: "re.Match[str]") -> str:
    kind, name = match.groups()
    if kind == "schema":
        module, _, cls = name.rpartition(".")
        return schema_tables(getattr(import_module(module), cls))
    if kind == "api":
        return api_of(name)
    return {"public": public, "robots": robots, "results": results}[kind]()


def api_of(package: str) -> str:
    """Directives of mkdocstrings for every public module below a package, at any depth."""
    folder = ROOT / package.replace(".", "/")
    files = [f.relative_to(folder) for f in sorted(folder.rglob("*.py")) if f.stem[0] != "_"]
    names = [".".join((package, *file.with_suffix("").parts)) for file in files]
    return "\n\n".join(f"::: {name}" for name in names)


def public() -> str:
    """Tables of what `wrenchsight` offers in Python and on the command line, a line each."""
    names = [name for name in wrenchsight.__all__ if not name.startswith("__")]
    rows = [(f"`{name}`", _first_line(getattr(wrenchsight, name))) for name in sorted(names)]
    commands = find_commands().values()
    rows += [(f"`wrenchsight {command.name}`", command.summary) for command in commands]
    return "\n".join(["| name | what |", "|---|---|", *(f"| {a} | {b} |" for a, b in rows)])


def _first_line(thing: Any) -> str:
    text = (inspect.getdoc(thing) or "").partition("\n\n")[0].replace("\n", " ")
    return text.partition(". ")[0].rstrip(".:").replace("|", "&#124;") + "."


def robots() -> str:
    """The page of `models/robots` but for its title."""
    text = (ROOT / "models" / "robots" / "README.md").read_text(encoding="utf-8")
    return text.partition("\n\n")[2].strip()


def results() -> str:
    """The table of `docs/results.json` and `docs/campaign.json`, whole."""
    results, worlds = (committed(ROOT / "README.md", name) for name in (RESULTS, WORLDS))
    return results_table(results, worlds, whole=True)


def schema_tables(schema: type) -> str:
    """Tables of the keys of a dataclass and of the dataclasses inside it, each once."""
    parts, ahead, seen = [], [schema], set[type]()
    while ahead:
        cls = ahead.pop(0)
        if cls in seen:
            continue
        seen.add(cls)
        parts.append(_table(cls))
        hints = typing.get_type_hints(cls)
        ahead += [part for f in dataclasses.fields(cls) for part in schemas_in(hints[f.name])]
    return "\n\n".join(parts)


def _table(cls: type) -> str:
    words = field_words(cls)
    hints = typing.get_type_hints(cls)
    lines = [
        f"**`{cls.__name__}`**: {(cls.__doc__ or '').strip().splitlines()[0]}",
        "",
        "| key | type | default | what |",
        "|---|---|---|---|",
    ]
    for f in dataclasses.fields(cls):
        default = "**required**" if f.metadata.get("required") else f"`{_default(f)}`"
        kind = _kind(hints[f.name])
        lines.append(
            f"| `{f.name}` | {kind} | {default} | {words[f.name].replace('|', '&#124;')} |"
        )
    return "\n".join(lines)


def _default(f: "dataclasses.Field[Any]") -> str:
    value = f.default if f.default_factory is dataclasses.MISSING else f.default_factory()
    if dataclasses.is_dataclass(value):
        return f"{type(value).__name__}"
    text = str(value.as_posix() if isinstance(value, Path) else value)
    return {"None": "null", "True": "true", "False": "false", "": '""'}.get(text, text)


def _kind(hint: Any) -> str:
    names = {int: "whole number", float: "number", str: "text", bool: "true or false", Path: "path"}
    if hint in names:
        return names[hint]
    if hint is type(None):
        return "null"
    origin, inside = typing.get_origin(hint), [_kind(a) for a in typing.get_args(hint)]
    if origin is list:
        return f"list of {inside[0]}"
    if origin is dict:
        return f"{inside[0]}: {inside[1]}"
    if origin is tuple:
        return ", ".join(inside)
    if inside:
        return " or ".join(inside)
    return f"`{hint.__name__}`"
