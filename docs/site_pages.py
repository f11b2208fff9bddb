"""Fills in what the documentation takes from the code, so that it cannot fall behind it.

Three directives, each alone on a line of a page:

    <!-- schema: wrenchsight.models.files.X -->   the keys of a YAML file, out of its dataclass
    <!-- api: wrenchsight.models.files -->        every public module below a package
    <!-- results -->                  the table "article / here" of the last study
"""

import ast
import dataclasses
import re
import typing
from importlib import import_module
from pathlib import Path
from typing import Any

from wrenchsight.analyses.study.readme_table import RESULTS, WORLDS, committed, results_table

ROOT = Path(__file__).resolve().parent.parent
_DIRECTIVE = re.compile(r"^<!-- (schema|api|results)(?:: ([\w.]+))? -->$", re.MULTILINE)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The hook of MkDocs: replaces the directives of one page."""
    return _DIRECTIVE.sub(_replacement, markdown)


def _replacement(match: "re.Match[str]") -> str:
    kind, name = match.groups()
    if kind == "schema":
        module, _, cls = name.rpartition(".")
        return schema_tables(getattr(import_module(module), cls))
    return api_of(name) if kind == "api" else results()


def api_of(room: str) -> str:
    """Directives of mkdocstrings for every public module below a package, at any depth."""
    folder = ROOT / room.replace(".", "/")
    files = [f.relative_to(folder) for f in sorted(folder.rglob("*.py")) if f.stem[0] != "_"]
    names = [".".join((room, *file.with_suffix("").parts)) for file in files]
    return "\n\n".join(f"::: {name}" for name in names)


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
        ahead += [part for f in dataclasses.fields(cls) for part in _schemas_in(hints[f.name])]
    return "\n\n".join(parts)


def _schemas_in(hint: Any) -> list[type]:
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return [hint]
    return [found for part in typing.get_args(hint) for found in _schemas_in(part)]


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
    if inside:
        return " or ".join(inside)
    return f"`{hint.__name__}`"


def field_words(cls: type) -> dict[str, str]:
    """What the source says of each field: a comment on its line, below or above, or a string below.

    Raises:
        ValueError: a field without words, named: nothing stays undocumented.
    """
    words: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        if dataclasses.is_dataclass(base):
            words |= _words_of(base)
    hints = typing.get_type_hints(cls)
    for f in dataclasses.fields(cls):
        inside = _schemas_in(hints[f.name])
        if not words.get(f.name) and inside:  # what the class inside says of itself
            words[f.name] = (inside[0].__doc__ or "").strip().splitlines()[0]
    missing = [f.name for f in dataclasses.fields(cls) if not words.get(f.name)]
    if missing:
        raise ValueError(f"{cls.__module__}.{cls.__name__}: no words for {', '.join(missing)}")
    return words


def _words_of(cls: type) -> dict[str, str]:
    file = import_module(cls.__module__).__file__
    assert file is not None
    source = Path(file).read_text(encoding="utf-8")
    lines = source.splitlines()
    body = next(
        node.body
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.ClassDef) and node.name == cls.__name__
    )
    attributes = _attributes_of(cls.__doc__ or "")
    words: dict[str, str] = {}
    for node, after in zip(body, [*body[1:], None], strict=True):
        if not (isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)):
            continue
        last = node.end_lineno or node.lineno
        said = [_comment(line) for line in lines[node.lineno - 1 : last]]
        for line in lines[last:] if not any(said) else []:  # else they speak of the next field
            if not line.strip().startswith("#"):
                break
            said.append(_comment(line))
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            said.append(" ".join(str(after.value.value).split()))
        text = " ".join(part for part in said if part) or _comment_above(lines, node.lineno - 1)
        words[node.target.id] = text or attributes.get(node.target.id, "")
    return words


def _comment_above(lines: list[str], index: int) -> str:
    """The lines of comment right above a line."""
    said: list[str] = []
    while index > 0 and lines[index - 1].strip().startswith("#"):
        index -= 1
        said.insert(0, _comment(lines[index]))
    return " ".join(said)


def _comment(line: str) -> str:
    """The comment at the end of a line of code; a '#' inside quotes is none."""
    found = re.match(r"""(?:[^"'#]|"[^"]*"|'[^']*')*#\s?(.*)""", line)
    text = found.group(1).strip() if found else ""
    return "" if text.startswith(("noqa", "type:")) else text


def _attributes_of(docstring: str) -> dict[str, str]:
    """Name -> words of the section "Attributes:" of a docstring."""
    _, _, section = docstring.partition("Attributes:")
    found = re.findall(r"^\s+(\w+): (.+(?:\n\s{12,}.+)*)", section, re.MULTILINE)
    return {name: " ".join(text.split()) for name, text in found}
