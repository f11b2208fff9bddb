"""Registry of experiments: those of this software, of other packages, and those registered.

An experiment is a module with `EXPERIMENT = Experiment(name=..., title=..., run=...)`. The fields
of its entry (ENTRY_FIELDS) are read from that statement without importing the module, so that a
list of experiments imports neither Drake nor numba. These arguments must be literals, but for
`needs` and `uses`: where they are not, `recordings` imports the module.

    wrenchsight.analyses.experiments.*.experiment       are found by themselves
    entry points of the group wrenchsight.experiments   of installed packages name a module each
    registered("my_package.my_experiment")              adds a module for as long as a block lasts

In another process of the same study the module is imported by its name.
"""

import ast
import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from wrenchsight.analyses.study.experiment import Experiment
from wrenchsight.models.files.input_error import InputError

ENTRY_POINTS: Final = "wrenchsight.experiments"
_STATEMENT: Final = "EXPERIMENT"
_MODULE: Final = "experiment"  # of an experiment's folder


@dataclass(frozen=True)
class ExperimentEntry:
    """Entry of an experiment, read without importing its module; see `Experiment`."""

    module: str
    name: str
    title: str
    section: str
    takes_methods: bool = Experiment.takes_methods
    order: float = Experiment.order
    seconds: float = Experiment.seconds
    readme: tuple[str, ...] = Experiment.readme
    needs: tuple[str, ...] | None = Experiment.needs  # None: not a literal
    uses: tuple[str, ...] | None = Experiment.uses  # None: not a literal

    def recordings(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """The sets of recordings that it needs, and those that it reads if they are there."""
        if self.needs is None or self.uses is None:
            experiment: Experiment = import_module(self.module).EXPERIMENT
            return experiment.needs, experiment.uses
        return self.needs, self.uses


ENTRY_FIELDS: Final = tuple(f.name for f in dataclasses.fields(ExperimentEntry))[1:]
_RECORDING_FIELDS: Final = ("needs", "uses")


class ExperimentRegistry:
    """The experiments that a study knows.

    Args:
        packages: names of those in which every folder with an `experiment.py` belongs to it.
        group: group of entry points; empty for none.
    """

    def __init__(self, packages: Sequence[str] = (), group: str = "") -> None:
        self._packages, self._group = tuple(packages), group
        self._registered: dict[str, ExperimentEntry] = {}

    def entries(self) -> dict[str, ExperimentEntry]:
        """The experiments by name, in the order of the report.

        Raises:
            InputError: an installed package offers a module that holds no experiment.
        """
        entries = [*self._of_packages(), *self._of_entry_points(), *self._registered.values()]
        by_name = {entry.name: entry for entry in entries}
        return dict(sorted(by_name.items(), key=lambda item: item[1].order))

    def register(self, module: str) -> ExperimentEntry:
        """Adds the experiment of a module, which can be imported by this name.

        Raises:
            ValueError: the module holds no experiment, or there is one of its name already.
        """
        entry = read_entry(module)
        if entry.name in self.entries():
            taken = self.entries()[entry.name].module
            raise ValueError(f"{module}: {taken} has an experiment {entry.name} already")
        self._registered[entry.name] = entry
        return entry

    def unregister(self, name: str) -> None:
        """Takes an experiment out again.

        Raises:
            ValueError: none of this name was registered.
        """
        if self._registered.pop(name, None) is None:
            raise ValueError(f"no experiment {name} was registered")

    @contextmanager
    def registered(self, module: str) -> Iterator[ExperimentEntry]:
        """Adds the experiment of a module for as long as the block lasts."""
        entry = self.register(module)
        try:
            yield entry
        finally:
            self._registered.pop(entry.name, None)

    def _of_packages(self) -> Iterator[ExperimentEntry]:
        for package in self._packages:
            spec = find_spec(package)
            places = None if spec is None else spec.submodule_search_locations
            for folder in map(Path, () if places is None else places):
                for file in sorted(folder.glob(f"*/{_MODULE}.py")):
                    yield read_entry(f"{package}.{file.parent.name}.{_MODULE}")

    def _of_entry_points(self) -> Iterator[ExperimentEntry]:
        for point in entry_points(group=self._group) if self._group else ():
            try:
                yield read_entry(point.module)
            except ValueError as error:
                package = point.dist.name if point.dist is not None else point.name
                remedy = "repair it or take it out"
                raise InputError(package, "", f"its entry point fails: {error}", remedy) from None


def read_entry(module: str) -> ExperimentEntry:
    """Reads a module's entry in the list of experiments, without importing the module.

    Raises:
        ValueError: the module is not there, or holds no EXPERIMENT with literals in ENTRY_FIELDS.
    """
    path = module_file(module)
    if path is None:
        raise ValueError(f"there is no module {module}")
    return ExperimentEntry(module, **_literals(path, path.stat().st_mtime_ns))


def module_file(module: str) -> Path | None:
    """The file of a module that is not imported; None where there is none."""
    try:
        spec = find_spec(module)
    except ModuleNotFoundError:
        return None
    return None if spec is None or spec.origin is None else Path(spec.origin)


@cache
def _literals(path: Path, changed: int) -> Mapping[str, Any]:
    """The arguments ENTRY_FIELDS of the EXPERIMENT in a file, which must be literals.

    Names of recordings may be something else, known only to who imports the file: None stands for
    these.

    Args:
        path: the module's file. It is parsed from the statement on, which best stands last: the
            whole file takes a hundred times as long.
        changed: when the file was changed, ns; not read, but in the cache's key, so that a changed
            file is read anew.

    Raises:
        ValueError: the file has no such statement, or a field that must be a literal is none.
    """
    begin = f"\n{_STATEMENT} = "
    text = path.read_text(encoding="utf-8")
    if begin not in text:
        raise ValueError(f"{path} has no {_STATEMENT} = Experiment(...)")
    assignment = ast.parse(text[text.index(begin) :]).body[0]
    call = assignment.value if isinstance(assignment, ast.Assign) else None
    if not isinstance(call, ast.Call):
        raise ValueError(f"{path}: its {_STATEMENT} is not Experiment(...)")
    fields = [field.name for field in dataclasses.fields(Experiment)]
    # Those without a keyword are the first fields, as many as there are.
    arguments = dict(zip(fields, call.args, strict=False))
    arguments |= {word.arg: word.value for word in call.keywords if word.arg is not None}
    literals: dict[str, Any] = {}
    for key in ENTRY_FIELDS:
        if key not in arguments:
            continue
        try:
            literals[key] = ast.literal_eval(arguments[key])
        except ValueError:
            if key not in _RECORDING_FIELDS:
                strict_fields = [name for name in ENTRY_FIELDS if name not in _RECORDING_FIELDS]
                names = ", ".join(strict_fields)
                problem = f"{path}: of its {_STATEMENT}, {names} must be literals"
                raise ValueError(problem) from None
            literals[key] = None
    return literals


REGISTRY: Final = ExperimentRegistry(["wrenchsight.analyses.experiments"], ENTRY_POINTS)
