"""Conversion of xacro to URDF without ROS, by the package `xacro` of PyPI in a restricted copy.

A robot's file comes from anyone, and xacro evaluates its expressions as Python, reads any file and
repeats without end. Here a private copy of the package works with `xacro_expression`, reads files
of the robot's folders alone, and stops when the document has had its share of work.
"""

import importlib.util
import re
import xml.dom.minidom
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import yaml

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.files.limited_file import read_limited
from wrenchsight.models.robot.xacro_expression import (
    FUNCTIONS,
    ExpressionError,
    Namespace,
    Work,
    bounded,
    evaluate,
)

LARGEST_FILE: Final = 1 << 22  # bytes of XML
LARGEST_YAML: Final = 1 << 18  # bytes; read at some 200 kB a second
LONGEST_TEXT: Final = 20_000  # characters of a text with expressions
WORK: Final = 10_000_000  # units that a document may take, about a microsecond each
_ELEMENT: Final = 300  # units that an element takes each time that it is gone through
_LONGEST_PROBLEM: Final = 400  # characters
_UNITS: Final = {"radians": 1.0, "degrees": 0.017453292519943295} | {
    "meters": 1.0,
    "millimeters": 0.001,
    "foot": 0.3048,
    "inches": 0.0254,
}
# As xacro's own pattern, which takes exponential time where it does not fit.
_MACRO_ARGUMENT: Final = re.compile(
    r"^\s*([^\s:=]+?)\s*:?=\s*(\^\|?)?"
    r"""(\$\{[^}]*+\}|\$\([^)]*+\)|(?:'[^']*+'|"[^"]*+"|[^\s'"]++)++|)(?:\s+|$)(.*)"""
)


def urdf_of_xacro(path: Path, arguments: Mapping[str, str] | None = None) -> bytes:
    """The URDF that a xacro file means, with these arguments and the defaults of all others.

    `$(find package)` is looked for upwards from the file: a package.xml of that name, or a folder
    of that name that holds the file. What the file includes lies below its folder or in a package.

    Raises:
        InputError: the package `xacro` is not installed; a package is not found; an argument
            without a default; whatever else xacro or `evaluate` refuses.
    """
    by_hand = (
        "give what it asks for (--xacro-arg NAME:=VALUE), or write it out: "
        f"xacro {path.name} [ARGUMENT:=VALUE ...] > robot.urdf"
    )
    specification = importlib.util.find_spec("xacro")
    if specification is None or specification.loader is None:
        remedy = f"pip install xacro (it needs no ROS), or {by_hand}"
        raise InputError(path, "", "is xacro, which is not installed", remedy)
    xacro: Any = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(xacro)
    try:
        _Document(xacro, path)
        mappings = {str(name): str(value) for name, value in (arguments or {}).items()}
        document = xacro.process_file(str(path), mappings=mappings)
        return bytes(document.toxml(encoding="utf-8"))
    # What xacro raises has no common class, and SystemExit is among it.
    except (Exception, SystemExit) as error:
        problem = " ".join(str(error).split()) or type(error).__name__
        raise InputError(path, "", f"xacro: {problem[:_LONGEST_PROBLEM]}", by_hand) from error


class _Document:
    """Takes the place of those parts of xacro that evaluate, read and repeat.

    Args:
        xacro: a copy of the module, whose functions are replaced.
        path: the robot's file.
    """

    def __init__(self, xacro: Any, path: Path) -> None:
        self._xacro = xacro
        self._folder = path.resolve().parent
        self._folders = {self._folder}
        self._folders.update(f for f in self._folder.parents if (f / "package.xml").is_file())
        self._yaml: dict[Path, Any] = {}
        self._work = Work(WORK)
        self._eval_all, self._eval_text = xacro.eval_all, xacro.eval_text
        namespace = Namespace(
            {
                "load_yaml": self._load_yaml,
                "abs_filename": lambda name: str(xacro.abs_filename_spec(str(name))),
                "arg": lambda name: xacro.substitution_args_context["arg"][name],
                "dotify": lambda value: value,
                "tokenize": lambda text: [t for t in re.split("[,; ]", text) if t],
                "fatal": self._fatal,
                **dict.fromkeys(("message", "warning", "error", "print_location"), _silent),
            }
        )
        xacro._global_symbols = {**FUNCTIONS, **namespace, "xacro": namespace}
        xacro.re_macro_arg = _MACRO_ARGUMENT
        xacro.warning = xacro.error = xacro.message = xacro.print_location = _silent
        xacro.safe_eval = self._safe_eval
        xacro.eval_extension = self._substitution
        xacro.eval_text = self._text
        xacro.eval_all = self._all
        xacro.get_include_files = self._includes
        xacro.parse = self._parse

    def _safe_eval(self, expression: str, names: Any, _: Any = None) -> Any:
        return bounded(evaluate(expression, names, self._work))

    def _text(self, text: str, symbols: Any) -> Any:
        self._work.spend(1 + len(text))
        if len(text) > LONGEST_TEXT and "$" in text:
            raise ExpressionError(f"a text of more than {LONGEST_TEXT} characters")
        return self._eval_text(text, symbols)

    def _all(self, node: Any, macros: Any, symbols: Any) -> None:
        self._work.spend(_ELEMENT)
        self._eval_all(node, macros, symbols)

    def _substitution(self, text: str) -> str:
        """What `$(command argument)` stands for; the environment is not the robot's to read."""
        command, *words = text[2:-1].split() or [""]
        argument = " ".join(words)
        arguments = self._xacro.substitution_args_context["arg"]
        if command == "arg" and argument in arguments:
            return str(arguments[argument])
        if command == "arg":
            raise ExpressionError(f"Undefined substitution argument {argument}")
        if command == "find":
            return str(self._find(argument))
        if command == "dirname":
            return str(Path(self._xacro.filestack[-1]).resolve().parent)
        if command == "cwd":
            return str(self._folder)
        if command == "optenv" and words:
            return " ".join(words[1:])
        if command == "eval":
            functions = {"arg": arguments.__getitem__, "find": lambda name: str(self._find(name))}
            names = {**FUNCTIONS, "true": True, "false": False, **functions}
            typed = {name: self._xacro.Table._eval_literal(v) for name, v in arguments.items()}
            return str(self._safe_eval(argument, names | typed))
        raise ExpressionError(f"$({command} ...) is not known here")

    def _find(self, package: str) -> Path:
        for parent in (self._folder, *self._folder.parents):
            for folder in (parent, parent / package):
                if _is_package(folder, package) or (
                    folder.name == package and self._folder.is_relative_to(folder)
                ):
                    self._folders.add(folder.resolve())
                    return folder
        raise ExpressionError(f"package '{package}' is not found upwards from {self._folder}")

    def _inside(self, name: str) -> Path:
        """The file of that name, if the robot may read it.

        Raises:
            ExpressionError: it lies elsewhere, or is no plain file.
        """
        path = Path(self._xacro.abs_filename_spec(name)).resolve()
        if not any(path.is_relative_to(folder) for folder in self._folders):
            raise ExpressionError(f"{path} lies neither below {self._folder} nor in a package")
        if path.exists() and not path.is_file():
            raise ExpressionError(f"{path} is no file")
        return path

    def _includes(self, name: str, symbols: Any) -> Iterator[str]:
        name = str(self._xacro.abs_filename_spec(str(self._xacro.eval_text(name, symbols))))
        if not re.search("[*[?]", name):  # a pattern
            yield str(self._inside(name))
            return
        folder = Path(re.split("[*[?]", name, maxsplit=1)[0] + "_").parent
        self._inside(str(folder / "any"))  # before the disk is gone through
        for file in sorted(folder.glob(str(Path(name).relative_to(folder)))):
            yield str(self._inside(str(file)))

    def _parse(self, _: Any, name: str) -> xml.dom.minidom.Document:
        path = Path(name)
        if not path.exists():
            self._xacro.filestack.pop()
            missing = FileNotFoundError(f"no such file: {path}")
            raise self._xacro.XacroException(exc=missing)
        data = read_limited(path, LARGEST_FILE, "a xacro file")
        self._work.spend(len(data) // 2 + _ELEMENT // 3 * data.count(b"<"))
        return xml.dom.minidom.parseString(data)

    def _load_yaml(self, name: str) -> Any:
        path = self._inside(str(name))
        if path not in self._yaml:
            data = read_limited(path, LARGEST_YAML, "a YAML file")
            self._work.spend(5 * len(data))
            try:
                self._yaml[path] = bounded(yaml.load(data, _loader(self._work)))
            except (yaml.YAMLError, ArithmeticError, LookupError, RecursionError) as error:
                raise ExpressionError(f"{path}: {error}") from error
        return self._yaml[path]

    @staticmethod
    def _fatal(*words: Any) -> None:
        raise ExpressionError(" ".join(map(str, words)))


def _is_package(folder: Path, name: str) -> bool:
    """Whether a folder is the package of that name: by its package.xml, or its own name."""
    package_file = folder / "package.xml"
    if not package_file.is_file():
        return False
    match = re.search(
        rb"<name>\s*([\w.-]+)\s*</name>", read_limited(package_file, 1 << 20, "a package.xml")
    )
    return folder.name == name or (match is not None and match[1].decode() == name)


def _loader(work: Work) -> type[yaml.SafeLoader]:
    """YAML with xacro's units: `!degrees 90`."""

    class Loader(yaml.SafeLoader):
        """Knows units."""

    def construct(factor: float) -> Any:
        return lambda loader, node: (
            factor * float(evaluate(loader.construct_scalar(node), FUNCTIONS, work))
        )

    for unit, factor in _UNITS.items():
        Loader.add_constructor(f"!{unit}", construct(factor))
    return Loader


def _silent(*_: Any, **__: Any) -> str:
    """Takes the place of xacro's messages, which would print what the file says as it stands."""
    return ""
