"""Work on a file of unknown origin in a child process with limits of time and memory.

A parser that a file breaks (a stack that overflows, memory without end) ends the child, and what is
said of it is one line.
"""

import os
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from wrenchsight.models.files.input_error import InputError

CPU_TIME = 6  # s of processor time
# s on the clock: a child that waits as long takes no processor time. One that asks for a processor
# which others hold is slow, and not at fault.
WATCH_TIME = 15.0
_LEAST_SHARE = 0.01  # of the watch, s of processor time that a child takes which does not wait
LARGEST_OUTPUT = 1 << 26  # bytes
_LONGEST_PROBLEM = 400  # characters
_SIGNALS_OF_LIMITS = (signal.SIGXCPU, signal.SIGKILL, signal.SIGXFSZ)


def run_limited(
    module: str,
    path: Path,
    arguments: Sequence[str],
    what: str,
    remedy: str | Callable[[str], str],
) -> bytes:
    """Returns what `python -m MODULE PATH ARGUMENTS` writes to its standard output.

    The module calls `limit_process` before anything else, and ends with what is wrong as the last
    line of its standard error and a code that is not 0. Of a child that was stopped at a limit that
    line may be any warning: the limit is named instead.

    Args:
        module: full name of the child's module.
        path: the file of unknown origin.
        arguments: of the child, behind the path.
        what: what is done, for error lines: "xacro".
        remedy: what to do, whatever the problem is; or what to do about the problem stated.

    Raises:
        InputError: the child failed, or reached a limit.
    """
    with tempfile.TemporaryDirectory(prefix="wrenchsight-") as folder:
        output, errors = Path(folder) / "output", Path(folder) / "errors"
        with output.open("wb") as out, errors.open("wb") as err:
            # -P: no module is imported from the working directory.
            command = [sys.executable, "-P", "-m", module, str(path), *arguments]
            code = _code_of(
                subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=out, stderr=err)
            )
        if code == 0:
            return output.read_bytes()
        lines = errors.read_text(encoding="utf-8", errors="replace").split("\n")
    last_line = " ".join(next((line for line in reversed(lines) if line.strip()), "").split())
    if code is None:
        problem = f"waits for more than {WATCH_TIME:g} s; it was stopped"
    elif -code in _SIGNALS_OF_LIMITS or "MemoryError" in last_line or "bad_alloc" in last_line:
        problem = _ending_of(code)
    else:
        problem = last_line or _ending_of(code)
    words = remedy if isinstance(remedy, str) else remedy(problem)
    raise InputError(path, "", f"{what}: {problem[:_LONGEST_PROBLEM]}", words)


def _code_of(child: subprocess.Popen[bytes]) -> int | None:
    """The code with which a child ends; None where it waited and was stopped."""
    with child:
        try:
            taken = 0.0  # s of processor time, when it was last looked at
            while True:
                try:
                    return child.wait(timeout=WATCH_TIME)
                except subprocess.TimeoutExpired:
                    asks, before, taken = _asks_for_processor(child.pid), taken, _taken(child.pid)
                    if not asks and taken - before < _LEAST_SHARE * WATCH_TIME:
                        return None
        finally:
            child.kill()  # nothing where it has ended


def _asks_for_processor(pid: int) -> bool:
    """Whether a process runs, or would if no other held the processors."""
    return _status(pid)[:1] == ["R"]


def _taken(pid: int) -> float:
    """s that a process has taken from processors; 0 where the system does not say."""
    words = _status(pid)
    if len(words) < 13:
        return 0.0
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def _status(pid: int) -> list[str]:
    """Words of Linux on a process, from its state on; none on other systems."""
    try:  # number (name) state ...: the name may hold blanks and brackets
        return Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(")")[2].split()
    except OSError:
        return []


def limit_process(memory: int) -> None:
    """Limits the process that calls it: CPU_TIME, size of files, and `memory` in bytes."""
    for what, limit in (
        (resource.RLIMIT_CPU, CPU_TIME),
        (resource.RLIMIT_AS, memory),
        (resource.RLIMIT_FSIZE, LARGEST_OUTPUT),
        (resource.RLIMIT_CORE, 0),
    ):
        _, hard = resource.getrlimit(what)
        least = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
        resource.setrlimit(what, (least, least))


def _ending_of(code: int) -> str:
    """A few words on a process that was stopped, or ended without any."""
    if -code in (signal.SIGXCPU, signal.SIGKILL):
        times = f"takes more than {CPU_TIME} s of processor time"
        return f"{times}, or more memory than there is; it was stopped"
    if code == -signal.SIGXFSZ:
        return f"writes more than {LARGEST_OUTPUT >> 20} MB; it was stopped"
    if code < 0:
        name = signal.Signals(-code).name
        return f"the file breaks the parser ({name}), as one that includes itself does"
    return "needs more memory than it may have; it was stopped"
