"""What a dataclass's fields are, for the docs and the command line: the string below each.

A field that has none and holds another dataclass has the first line of that one's docstring.
"""

import dataclasses
import typing
from functools import cache
from typing import Any

from docstring_parser import parse_from_object


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
            described = parse_from_object(base).params
            words |= {
                entry.arg_name: " ".join((entry.description or "").split()) for entry in described
            }
    hints = typing.get_type_hints(cls)
    for f in dataclasses.fields(cls):
        inner_schemas = schemas_in(hints[f.name])
        if not words.get(f.name) and inner_schemas:  # the first line of that class's docstring
            words[f.name] = (inner_schemas[0].__doc__ or "").strip().splitlines()[0]
    missing = [f.name for f in dataclasses.fields(cls) if not words.get(f.name)]
    if missing:
        raise ValueError(f"{cls.__module__}.{cls.__name__}: no words for {', '.join(missing)}")
    return words
