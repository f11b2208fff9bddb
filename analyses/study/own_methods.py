"""Estimators of others that a study measures beside its own: `study --method MODULE:FUNCTION`.

A method is a function that is called with a `MethodSetting`, once for each arm and tool, and
returns one of

    an observer's configuration   of a kind in `wrenchsight.models.observers.observer_kinds`; the
                                  model of the setting does the rest
    a callable                    (q, v, current) -> (wrench, covariance) of a whole log:
                                  q, v, current (N, n) rad, rad/s, A; wrench (N, 6), exerted by the
                                  environment on the robot, [mx my mz fx fy fz] in N m and N at E in
                                  axes of W; covariance (N, 6, 6), or None where it states none
    None                          where it does not enter a task

A callable may have three more methods, each for a task that no wrench answers:

    torque(q, v) -> (N, n)                     N m, of the motors, of motion without contact
    wrench_of_torque(J, tau_ext)               wrench and covariance as above, from the joint torque
                                               (N, n) that an arm reports itself, J (N, 6, n)
    touched_link(t, tau_ext, J) -> (N,)        0 without contact, else the link, 1 to n

Methods are found by the text MODULE:FUNCTION, or NAME=MODULE:FUNCTION (else the name is the
function's, or, of a function `make`, the module's), or by entry points of the group
`wrenchsight.methods`. The module is imported from the working directory, too.
"""

import importlib
import re
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from wrenchsight.analyses.output.result_marker import file_checksum
from wrenchsight.analyses.study.registry import module_file
from wrenchsight.models.files.input_error import InputError

if TYPE_CHECKING:
    from wrenchsight.models.identification.identified_model import IdentifiedModel
    from wrenchsight.models.recordings.recording import Recording
    from wrenchsight.models.robot.robot import Robot

ENTRY_POINTS: Final = "wrenchsight.methods"
BUILT_IN: Final = ("plain", "plain_tools", "article", "kalman", "ours")
"""Names of the benchmark's methods, which no other method may have."""
_OPTION: Final = "--method"
_TEXT: Final = re.compile(r"(?:([\w-]+)=)?([A-Za-z_][\w.]*):([A-Za-z_]\w*)")


@dataclass(frozen=True)
class MethodSetting:
    """Setting in which a method is made: the task, the arm and its model.

    Attributes:
        task: the benchmark's task: torque, load, contact, detection, link or wrench.
        robot: the arm, E where the wrench is wanted.
        model: that of `ours`: identified on `free_logs` with presliding friction; for contact, on
            another arm of the same make, its friction found again on them; the robot's own files
            where there are none.
        free_logs: recordings of the arm in free motion.
        time_step: s between the samples that will be read.
    """

    task: str
    robot: "Robot"
    model: "IdentifiedModel"
    free_logs: "tuple[Recording, ...]"
    time_step: float


@dataclass(frozen=True)
class MethodEntry:
    """A method as it was named, MODULE:FUNCTION, by `origin`: an option or a package."""

    name: str
    module: str
    function: str
    origin: str = field(default=_OPTION, compare=False)

    @property
    def place(self) -> str:
        """MODULE:FUNCTION."""
        return f"{self.module}:{self.function}"

    @property
    def option(self) -> str:
        """How a command line names it; empty where an installed package does."""
        return f" {_OPTION} {self.name}={self.place}" if self.origin == _OPTION else ""

    def load(self) -> Callable[[MethodSetting], Any]:
        """The function.

        Raises:
            InputError: the module cannot be imported, or has no such function.
        """
        try:
            module = importlib.import_module(self.module)
        except (Exception, SystemExit) as error:
            missing = error.name if isinstance(error, ModuleNotFoundError) else None
            # It, or a package around it, rather than something that it imports itself.
            if missing and f"{self.module}.".startswith(f"{missing}."):
                problem = f"there is no module {self.module}"
                remedy = "start in the folder that holds it, or install it"
            else:
                problem = f"{self.module} cannot be imported ({reason_of(error)})"
                remedy = "repair it"
            raise InputError(self.origin, "", problem, remedy) from error
        make = getattr(module, self.function, None)
        if make is None:
            problem = f"{self.module} has no function {self.function!r}"
            raise InputError(self.origin, "", problem, "name it MODULE:FUNCTION")
        if not callable(make):
            problem = f"{self.place} is no function, but a {type(make).__name__}"
            raise InputError(self.origin, "", problem, "name a function that takes a MethodSetting")
        loaded: Callable[[MethodSetting], Any] = make
        return loaded

    def fingerprint(self) -> str:
        """Fingerprint of its figures: its name and its module's file, without imports."""
        file = module_file(self.module)
        return f"{self.name}={self.place} {'' if file is None else file_checksum(file)}"


def reason_of(error: BaseException) -> str:
    """One line about an error: its kind and the first line of its text."""
    lines = str(error).strip().splitlines()
    return f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__


def named_methods(texts: Iterable[str], imported: bool = True) -> tuple[MethodEntry, ...]:
    """The methods of entry points and those named by texts, in this order.

    With texts the working directory is appended to `sys.path`, since their modules may be there.

    Args:
        texts: texts of `--method`.
        imported: whether each is imported now, so that one that is not there is refused before
            anything runs; not needed where no experiment takes methods.

    Raises:
        InputError: a text is no method's; two have one name; a module or function is not there.
    """
    installed = [_of_text(f"{point.name}={point.value}", _package(point)) for point in _installed()]
    requested = [_of_text(text) for text in dict.fromkeys(texts)]
    working_directory = str(Path.cwd())
    if requested and working_directory not in sys.path:
        sys.path.append(working_directory)
    used = set(BUILT_IN)
    for entry in (*installed, *requested):
        if entry.name in used:
            problem = f"there is already a method named {entry.name!r}"
            remedy = f"give another name: ANOTHER={entry.place}"
            raise InputError(entry.origin, "", problem, remedy)
        used.add(entry.name)
        if imported:
            entry.load()
    return (*installed, *requested)


def _installed() -> list[Any]:
    return sorted(entry_points(group=ENTRY_POINTS), key=lambda point: point.name)


def _package(point: Any) -> str:
    """Which installed package offers an entry point."""
    return f"package {point.dist.name if point.dist is not None else point.name}"


def _of_text(text: str, origin: str = _OPTION) -> MethodEntry:
    match = _TEXT.fullmatch(text)
    if match is None:
        problem = f"expected MODULE:FUNCTION or NAME=MODULE:FUNCTION, found {text!r}"
        raise InputError(origin, "", problem, "such as my_module:make")
    name, module, function = match.groups()
    last = module.rpartition(".")[2]
    return MethodEntry(name or (last if function == "make" else function), module, function, origin)
