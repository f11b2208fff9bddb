"""Configuration files: dataclasses read from YAML and written back to it.

`pydrake.common.yaml.yaml_load_typed` does the reading. It names neither file nor line, so the
document is first checked against the schema on the YAML nodes, which know where they stand.

A schema is a dataclass in which every field has a default and which is not frozen: the loader
makes one and sets what the file names. A field without which the file makes no sense carries
`metadata=REQUIRED`.
"""

import copy
import dataclasses
import difflib
import functools
import math
import re
import types
import typing
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import yaml
from pydrake.common import pretty_class_name
from pydrake.common.yaml import yaml_dump_typed, yaml_load_typed

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import read_limited
from wrenchsight.models.files.whole_file import whole_file

T = TypeVar("T")

REQUIRED: dict[str, bool] = {"required": True}
"""Metadata of a field that the file must give: `field(default=..., metadata=REQUIRED)`."""

# What PyYAML's constructors raise over a tag or a value that makes no sense.
_ODD_YAML = (yaml.YAMLError, ArithmeticError, AttributeError, LookupError, RecursionError,
             TypeError, ValueError)  # fmt: skip
# Neither file names nor a URDF may hold these: control characters and lone surrogates.
_CONTROL = re.compile("[\\x00-\\x08\\x0b\\x0c\\x0e-\\x1f\\x7f\\ud800-\\udfff]")
MAX_ALIASED = 100_000  # values that the aliases of a file may repeat
LARGEST_FILE = 1 << 23  # bytes; a model with a network for each joint takes some 100 kB
_NULL_TAG = "tag:yaml.org,2002:null"
_BOOL_TAG = "tag:yaml.org,2002:bool"
_MOST_SHOWN = 80  # characters of a value, in an error line
_KINDS = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}


def load_configuration(path: str | Path, schema: type[T]) -> T:
    """Reads a YAML file into `schema`.

    Args:
        path: the file.
        schema: a dataclass, or `dict[str, ...]` of dataclasses.

    Raises:
        InputError: the file is missing or no YAML; a key is unknown, repeated or missing; a value
            has the wrong type. The line names the file and the line in it.
    """
    path = Path(path)
    # PyYAML takes a tenth of a second for files that experiments read again and again.
    kind: Any = schema
    return typing.cast("T", copy.deepcopy(_loaded(path, _read_text(path), kind)))


@functools.lru_cache(maxsize=16)
def _loaded(path: Path, text: str, schema: Any) -> Any:
    """The content of a YAML text as an object of `schema`; see `load_configuration`.

    It is cached by its content, so that a file that has changed is read anew. `load_configuration`
    gives out copies, as the objects can be changed.

    Keys and types are checked before Drake's loader reads it, whose errors name no line.

    Args:
        path: of the file, for error lines.
        text: its content.
        schema: a dataclass, or dict[str, dataclass].

    Raises:
        InputError: no YAML, an unknown key, or a value of another type; names the line.
    """
    try:
        loader = yaml.SafeLoader(text)
        node = loader.get_single_node()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        location = f"line {mark.line + 1}" if mark else ""
        raise InputError(
            path, location, f"no valid YAML: {error.problem or error.context}"
        ) from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise InputError(path, "", f"no valid YAML: {error}") from error
    if node is None:
        raise InputError(path, "", "the file is empty", "expected keys and values in YAML")
    check = _Check(path, loader)
    try:
        check.aliases(node)
        check.value(node, schema, "", is_root=True)
    except InputError:  # names the line already
        raise
    except _ODD_YAML as error:
        raise InputError(path, "", f"cannot be read as {_name(schema)}: {error}") from error
    try:
        if typing.get_origin(schema) is dict:
            # yaml_load_typed takes a table of configurations only as a field.
            item_schema = typing.get_args(schema)[1]
            return {
                name: yaml_load_typed(schema=item_schema, data=text, child_name=name)
                for name in check.names(node)
            }
        return yaml_load_typed(schema=schema, data=text)
    except (RuntimeError, *_ODD_YAML) as error:
        raise InputError(path, "", f"cannot be read as {_name(schema)}: {error}") from error


def save_configuration(configuration: Any, path: str | Path) -> None:
    """Writes a dataclass as YAML that `load_configuration` reads back; whole or not at all.

    Raises:
        InputError: the file cannot be written there.
    """
    # Drake leaves out what is None, also where the default is something.
    absent = [
        field.name
        for field in dataclasses.fields(configuration)
        if getattr(configuration, field.name) is None and field.default is not None
    ]
    text = yaml_dump_typed(configuration) + "".join(f"{name}: null\n" for name in absent)
    with whole_file(path) as partial:
        partial.write_text(text, encoding="utf-8")


def nearest(word: str, choices: typing.Iterable[str]) -> str:
    """The choice most like `word`, as a remedy: 'did you mean "home"?'; '' where none is."""
    match = difflib.get_close_matches(word, list(choices), n=1, cutoff=0.6)
    return f'did you mean "{match[0]}"?' if match else ""


def _read_text(path: Path) -> str:
    if path.is_dir():
        candidates = sorted(path.glob("*.yaml"))[:3]
        remedy = f"name a file in it: {', '.join(map(str, candidates))}" if candidates else ""
        raise InputError(path, "", "is a directory, expected a YAML file", remedy)
    try:
        return read_limited(path, LARGEST_FILE, "a YAML file").decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(path, "", "is no text file", "expected YAML in UTF-8") from error


def _name(schema: Any) -> str:
    return _KINDS.get(schema, getattr(schema, "__name__", str(schema)))


def _is_union(schema: Any) -> bool:
    return typing.get_origin(schema) in (typing.Union, types.UnionType)


def _fields(schema: Any) -> dict[str, Any] | None:
    """Field names and types of a dataclass, or of a C++ class that Drake can read from YAML."""
    if dataclasses.is_dataclass(schema):
        return {field.name: field.type for field in dataclasses.fields(schema)}
    bound = getattr(schema, "__fields__", None)
    return None if bound is None else {field.name: field.type for field in bound}


class _Check:
    """Checks a YAML node tree against a schema, and names the line of an error."""

    def __init__(self, path: Path, loader: Any) -> None:
        self._path = path
        self._loader = loader
        self._flat: set[int] = set()  # mapping nodes whose merge keys are resolved

    def names(self, node: Any) -> list[str]:
        """The keys of the document."""
        return list(self._items(node, "", is_root=True))

    def aliases(self, root: Any) -> None:
        """Refuses aliases that stand for too many values: what reads them visits each again."""
        sizes: dict[int, int] = {}  # by node: values that it stands for; 0 while it is counted

        def size_of(node: Any) -> int:
            if id(node) in sizes:
                if sizes[id(node)] == 0:
                    raise self._error(node, "", "an alias stands inside its own anchor")
                return sizes[id(node)]
            sizes[id(node)] = 0
            children = [] if isinstance(node, yaml.ScalarNode) else node.value
            if isinstance(node, yaml.MappingNode):
                children = [part for pair in node.value for part in pair]
            sizes[id(node)] = size = 1 + sum(map(size_of, children))
            return size

        repeated = size_of(root) - len(sizes)
        if repeated > MAX_ALIASED:
            problem = f"its aliases repeat {float(repeated):.3g} values, expected {MAX_ALIASED}"
            raise InputError(self._path, "", f"{problem} at most", "write them out, or drop them")

    def value(self, node: Any, schema: Any, name: str, is_root: bool = False) -> None:
        origin = typing.get_origin(schema)
        if _is_union(schema):
            self._union(node, schema, name)
        elif schema in _KINDS:
            self._scalar(node, schema, name)
        elif schema is Path:
            self._scalar(node, str, name)
        elif schema is np.ndarray:
            self._array(node, name)
        elif origin is list:
            (item_schema,) = typing.get_args(schema)
            if not isinstance(node, yaml.SequenceNode):
                raise self._error(node, name, f"expected a list, found {self._describe(node)}")
            for index, item in enumerate(node.value):
                self.value(item, item_schema, f"{name}[{index}]")
        elif origin is dict:
            _, item_schema = typing.get_args(schema)
            for key, (_, item) in self._items(node, name, is_root).items():
                self.value(item, item_schema, f"{name}.{key}" if name else key)
        else:
            self._mapping(node, schema, name, is_root)

    def _union(self, node: Any, schema: Any, name: str) -> None:
        """Checks a node of several possible types.

        A tag decides. Without one a plain value may be of any type of the union; a list or a
        mapping is of the first, as Drake's loader has it.

        Args:
            node: of the YAML text.
            schema: a union of types, maybe with None.
            name: of the key, for error lines.

        Raises:
            InputError: a tag (!Kind) that names no type of the union, or a value that fits none.
        """
        options = typing.get_args(schema)
        if node.tag == _NULL_TAG and type(None) in options:
            return
        options = tuple(option for option in options if option is not type(None))
        if node.tag.startswith("!") and not node.tag.startswith("!!"):
            options_by_tag = {pretty_class_name(option).split("[")[0]: option for option in options}
            tag = node.tag[1:]
            if tag not in options_by_tag:
                raise self._error(
                    node,
                    name,
                    f"unknown kind !{tag}, expected "
                    + " or ".join(f"!{key}" for key in options_by_tag),
                    nearest(tag, options_by_tag),
                )
            self.value(node, options_by_tag[tag], name)
            return
        if isinstance(node, yaml.ScalarNode) and len(options) > 1:
            for option in options:
                try:
                    self.value(node, option, name)
                except InputError:
                    continue
                return
            expected = " or ".join(_name(option) for option in options)
            raise self._error(node, name, f"expected {expected}, found {self._describe(node)}")
        self.value(node, options[0], name)

    def _scalar(self, node: Any, schema: Any, name: str) -> None:
        if not isinstance(node, yaml.ScalarNode) or not self._fits(node, schema):
            raise self._error(
                node, name, f"expected {_KINDS[schema]}, found {self._describe(node)}"
            )
        is_seed = schema is int and name.rpartition(".")[2] == "seed"
        if is_seed and float(self._loader.construct_object(node)) < 0.0:
            raise self._error(node, name, f"{node.value}, expected 0 or more")
        if schema is str and _CONTROL.search(node.value):
            raise self._error(node, name, "holds a control character, expected plain text")

    def _fits(self, node: Any, schema: Any) -> bool:
        value = self._loader.construct_object(node)
        if schema is str:
            return isinstance(value, str)
        if schema is bool:
            return bool(node.tag == _BOOL_TAG)
        if isinstance(value, bool) or value is None:
            return False
        try:
            number = float(value)
            # YAML 1.1 reads 1e-3 as a text; Drake's loader makes the number of it.
            return not math.isnan(number) and (schema is float or int(value) == number)
        except (TypeError, ValueError, OverflowError):
            return False

    def _array(self, node: Any, name: str) -> None:
        if not isinstance(node, yaml.SequenceNode):
            raise self._error(
                node, name, f"expected a list of numbers, found {self._describe(node)}"
            )
        for index, item in enumerate(node.value):
            if isinstance(item, yaml.SequenceNode):
                self._array(item, f"{name}[{index}]")
            else:
                self._scalar(item, float, f"{name}[{index}]")
        if len({len(i.value) if isinstance(i, yaml.SequenceNode) else 0 for i in node.value}) > 1:
            raise self._error(node, name, "the rows have different lengths")

    def _mapping(self, node: Any, schema: Any, name: str, is_root: bool) -> None:
        fields = _fields(schema)
        if fields is None:
            return  # a type that only yaml_load_typed can judge
        items = self._items(node, name, is_root)
        for key, (key_node, item) in items.items():
            if key not in fields:
                owner = f' of "{name}"' if name else ""
                remedy = nearest(key, fields) or "known keys: " + ", ".join(fields)
                raise self._error(key_node, "", f'unknown key "{key}"{owner}', remedy)
            self.value(item, fields[key], f"{name}.{key}" if name else key)
        if not dataclasses.is_dataclass(schema):
            return
        for field in dataclasses.fields(schema):
            if field.metadata.get("required") and field.name not in items:
                owner = f'"{name}"' if name else "the file"
                raise self._error(
                    node, "", f'{owner} lacks the key "{field.name}" ({_name(field.type)})'
                )

    def _items(self, node: Any, name: str, is_root: bool = False) -> dict[str, tuple[Any, Any]]:
        if not isinstance(node, yaml.MappingNode):
            raise self._error(
                node, name, f"expected keys with values, found {self._describe(node)}"
            )
        if id(node) not in self._flat:
            # Once only: afterwards a key that overrides a merged one is present twice, rightly.
            keys: set[str] = set()
            for key, _ in node.value:
                if key.value in keys:
                    raise self._error(key, "", f'the key "{key.value}" is given twice')
                keys.add(key.value)
            self._loader.flatten_mapping(node)
            self._flat.add(id(node))
        # A root key with a leading underscore is a template for YAML anchors, as in Drake.
        return {
            str(key.value): (key, item)
            for key, item in node.value
            if not (is_root and str(key.value).startswith("_"))
        }

    def _describe(self, node: Any) -> str:
        if isinstance(node, yaml.MappingNode):
            return "keys with values"
        if isinstance(node, yaml.SequenceNode):
            return "a list"
        if node.tag == _NULL_TAG:
            return "nothing"
        value = str(node.value)
        return f'"{value}"' if len(value) <= _MOST_SHOWN else f'"{value[:_MOST_SHOWN]} .."'

    def _error(self, node: Any, name: str, problem: str, remedy: str = "") -> InputError:
        location = f"line {node.start_mark.line + 1}" + (f", {name}" if name else "")
        return InputError(self._path, location, problem, remedy)
