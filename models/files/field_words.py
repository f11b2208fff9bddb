"""The description of a dataclass's fields in the source: for the docs and the command line.

The description of a field is the comment on its line, below or above it, or a string below it. A
comment between two fields is that of the upper one, unless it has one on its line, or the class has
a comment above its first field.
"""

import ast
import dataclasses
import re
import typing
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any


def schemas_in(hint: Any) -> list[type]:
    """The dataclasses in a type: itself, or those inside a union, a list or a dict."""
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return [hint]
    return [schema for part in typing.get_args(hint) for schema in schemas_in(part)]


@cache
def field_words(cls: type) -> dict[str, str]:
    """The description of each field, by its name.

    Raises:
        ValueError: fields without a description, named: nothing stays undocumented.
    """
    words: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        if dataclasses.is_dataclass(base):
            words |= _words_of(base)
    hints = typing.get_type_hints(cls)
    for f in dataclasses.fields(cls):
        inner_schemas = schemas_in(hints[f.name])
        if not words.get(f.name) and inner_schemas:  # the first line of that class's docstring
            words[f.name] = (inner_schemas[0].__doc__ or "").strip().splitlines()[0]
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
    first = next((node.lineno for node in body if isinstance(node, ast.AnnAssign)), 1)
    stand_above = bool(_comment_above(lines, first - 1))
    words: dict[str, str] = {}
    for node, next_node in zip(body, [*body[1:], None], strict=True):
        if not (isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)):
            continue
        end = node.end_lineno or node.lineno
        comments = [_comment(line) for line in lines[node.lineno - 1 : end]]
        of_next = stand_above or any(comments)  # whether what follows speaks of the next field
        for line in [] if of_next else lines[end:]:
            if not line.strip().startswith("#"):
                break
            comments.append(_comment(line))
        if isinstance(next_node, ast.Expr) and isinstance(next_node.value, ast.Constant):
            comments.append(" ".join(str(next_node.value.value).split()))
        text = " ".join(part for part in comments if part) or _comment_above(lines, node.lineno - 1)
        words[node.target.id] = text or attributes.get(node.target.id, "")
    return words


def _comment_above(lines: list[str], index: int) -> str:
    """The lines of comment right above a line."""
    comments: list[str] = []
    while index > 0 and lines[index - 1].strip().startswith("#"):
        index -= 1
        comments.insert(0, _comment(lines[index]))
    return " ".join(comments)


def _comment(line: str) -> str:
    """The comment at the end of a line of code; a '#' inside quotes is none."""
    match = re.match(r"""(?:[^"'#]|"[^"]*"|'[^']*')*#\s?(.*)""", line)
    text = match.group(1).strip() if match else ""
    return "" if text.startswith(("noqa", "type:")) else text


def _attributes_of(docstring: str) -> dict[str, str]:
    """Name -> words of the section "Attributes:" of a docstring."""
    _, _, section = docstring.partition("Attributes:")
    entries = re.findall(r"^\s+(\w+): (.+(?:\n\s{12,}.+)*)", section, re.MULTILINE)
    return {name: " ".join(text.split()) for name, text in entries}
