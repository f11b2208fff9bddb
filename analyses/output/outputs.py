"""Result files: written whole or not at all, the same bytes for the same content."""

import dataclasses
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import Enum
from pathlib import Path
from typing import Any, get_args

import numpy as np

from wrenchsight.analyses.output.figures import Figure, save_figure
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.whole_file import whole_file, writing_to

NOT_FINITE = "not_finite"  # key under which a file lists its values that are not numbers


def plain(value: Any, path: str = "", not_finite: list[str] | None = None) -> Any:
    """Returns `value` as dict, list, str, int, float, bool and None only.

    Numpy scalars and arrays, dataclasses, configurations of Drake's, enumerations, paths and tuples
    are converted; keys become text. Neither JSON nor a reader of metrics has a use for NaN or
    infinity: they become None, and their places (`initial.errors.3`) are appended to `not_finite`.

    Args:
        path: place of the value in a whole that holds it (`initial.errors`), with which the places
            begin; empty for the whole itself.
        not_finite: takes the places; None: nobody asks for them.

    Raises:
        TypeError: the value, or one inside it, has no plain form.
    """
    places = not_finite if not_finite is not None else []
    if isinstance(value, Enum):
        value = value.value
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        if math.isfinite(value):
            return value
        places.append(path)
        return None
    if isinstance(value, Path):
        return value.as_posix()
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if hasattr(type(value), "__fields__"):  # a configuration of Drake's
        value = {field.name: getattr(value, field.name) for field in type(value).__fields__}
    if isinstance(value, Mapping):
        return {str(k): plain(v, f"{path}.{k}".lstrip("."), places) for k, v in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, bytes):
        return [plain(v, f"{path}.{i}".lstrip("."), places) for i, v in enumerate(value)]
    raise TypeError(f"{path or 'value'}: {type(value).__name__} has no plain form")


def plain_metrics(metrics: Mapping[str, Any]) -> dict[str, Any]:
    """Returns `plain(metrics)`; the places of NaN and infinities are listed under "not_finite"."""
    places: list[str] = []
    result: dict[str, Any] = plain(metrics, "", places)
    if places:
        result[NOT_FINITE] = sorted(places)
    return result


def json_text(value: Any) -> str:
    """Returns plain `value` as JSON: keys sorted, lists of scalars on one line, full precision."""
    return _json(value, "") + "\n"


def _json(value: Any, indent: str) -> str:
    inner = indent + "  "
    if isinstance(value, dict) and value:
        items = [f"{inner}{_json(k, '')}: {_json(value[k], inner)}" for k in sorted(value)]
        return "{\n" + ",\n".join(items) + f"\n{indent}}}"
    if isinstance(value, list) and any(isinstance(v, dict | list) for v in value):
        return "[\n" + ",\n".join(inner + _json(v, inner) for v in value) + f"\n{indent}]"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


class OutputFolder:
    """A folder for results; made if it is not there.

    Args:
        path: the folder.

    Raises:
        InputError: a file is in the way, or the folder cannot be made or written to.
    """

    def __init__(self, path: Path) -> None:
        remedy = "choose another folder with --out"
        try:
            path.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError):
            in_the_way = next((p for p in (path, *path.parents) if p.is_file()), path)
            raise InputError(in_the_way, "", "is a file where a folder is needed", remedy) from None
        except OSError as error:
            problem = f"cannot make this folder ({error.strerror})"
            raise InputError(path, "", problem, remedy) from error
        if not os.access(path, os.W_OK | os.X_OK):
            raise InputError(path, "", "no permission to write in this folder", remedy)
        self.path = path

    def __truediv__(self, name: str) -> Path:
        return self.path / name

    @contextmanager
    def atomic(self, name: str) -> Iterator[Path]:
        """Gives a path to write to, which becomes file `name` if the block ends without error.

        Raises:
            InputError: the file cannot be written: a full disk, no permission.
        """
        path = self.path / name
        with writing_to(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as partial, writing_to(path):
            yield partial

    def write_text(self, name: str, text: str) -> Path:
        """Writes file `name` (UTF-8) and returns its path.

        Raises:
            InputError: it cannot be written; an earlier file of that name is as it was.
        """
        with self.atomic(name) as partial:
            partial.write_text(text, encoding="utf-8", newline="\n")
        return self.path / name

    def write_json(self, name: str, value: Any) -> Path:
        """Writes `value` as JSON with sorted keys and returns the file's path.

        NaN and infinities become null; a mapping lists their places under "not_finite".

        Raises:
            TypeError: a value has no plain form.
        """
        content = plain_metrics(value) if isinstance(value, Mapping) else plain(value)
        return self.write_text(name, json_text(content))

    def write_settings(self, name: str, settings: Any) -> Path:
        """Writes YAML with sorted keys and returns the file's path.

        Of a dataclass it is YAML that `load_configuration` reads back: where a field may hold one
        of several dataclasses, one that is not the first has its tag. Values become plain as in
        `plain`: NaN and infinities are null.

        Raises:
            TypeError: a value has no plain form.
            InputError: it cannot be written.
        """
        import yaml

        class Dumper(yaml.SafeDumper):  # of its own: representers are kept in the class
            """Knows mappings with a tag."""

        Dumper.add_representer(
            _Tagged, lambda dumper, value: dumper.represent_mapping(value.tag, dict(value))
        )
        text = yaml.dump(
            _with_tags(settings),
            Dumper=Dumper,
            sort_keys=True,
            allow_unicode=True,
            default_flow_style=None,  # innermost lists and mappings on one line
            width=100,
        )
        return self.write_text(name, text)

    def write_figure(self, name: str, figure: Figure) -> Path:
        """Writes `figure` as figures/`name`.png and returns the file's path."""
        return save_figure(figure, self.path / "figures" / f"{name}.png")


class _Tagged(dict[str, Any]):
    """A mapping with a tag of YAML."""

    tag = ""


def _with_tags(value: Any) -> Any:
    """As `plain`, with the tags that tell the dataclasses of one field apart."""
    if isinstance(value, list):
        return [_with_tags(one) for one in value]
    if not dataclasses.is_dataclass(value) or isinstance(value, type):
        return plain(value)
    tagged: dict[str, Any] = {}
    for field in dataclasses.fields(value):
        field_value = getattr(value, field.name)
        kinds = [kind for kind in get_args(field.type) if dataclasses.is_dataclass(kind)]
        converted = _with_tags(field_value)
        if type(field_value) in kinds[1:]:
            converted = _Tagged(converted)
            converted.tag = f"!{type(field_value).__name__}"
        tagged[field.name] = converted
    return tagged
