"""The process that `Sandbox` talks to: it loads everything once and forks for each command.

A line of JSON in, a line of JSON out.
"""

import gc
import json
import math
import multiprocessing.util
import os
import resource
import select
import signal
import sys
import tempfile
import time
import traceback
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

_TIDYING = 20  # s of the same, until what a command had started is gone
_PATIENCE = 10  # of the clock on the wall: a machine may have much else to do


def _command_line(arguments: list[str]) -> int:
    """Runs the command line as the console script does; returns the exit code."""
    import wrenchsight.__main__ as program

    sys.argv = ["wrenchsight", *arguments]
    try:
        program.main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
        return 1
    return 0


def _in_the_child(question: dict[str, Any], out: IO[bytes], err: IO[bytes]) -> int:
    os.setpgid(0, 0)
    multiprocessing.util._finalizer_registry.clear()  # the parent's
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(out.fileno(), 1)
    os.dup2(err.fileno(), 2)
    os.chdir(question["folder"])
    size = _memory("VmSize") + question["bytes"]
    resource.setrlimit(resource.RLIMIT_AS, (size, size))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(question["seconds"]),) * 2)
    if question["file"] is not None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (question["file"], question["file"]))
    if not question["draws"]:
        _leave_figures_empty()
    arguments = [os.fsdecode(a.encode("latin-1")) for a in question["run"]]
    signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # not before: none of this is a command
    try:
        return _command_line(arguments)
    finally:
        # As an interpreter does that ends: a pool's semaphores would else be reported as leaked.
        multiprocessing.util._exit_function()


def _leave_figures_empty() -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    def print_png(canvas: object, path: str | Path, **more: object) -> None:
        Path(path).touch()

    FigureCanvasAgg.print_png = print_png


def _memory(name: str) -> int:
    """Bytes of this process: VmSize, VmHWM."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(f"{name}:"):
            return 1024 * int(line.split()[1])
    return 0


def _run(question: dict[str, Any]) -> dict[str, Any]:
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = os.fork()
        if child == 0:
            code = 1
            try:
                code = _in_the_child(question, out, err)
                sys.stdout.flush()
                sys.stderr.flush()
            except BaseException:
                os.write(2, traceback.format_exc().encode())
            finally:
                os._exit(code)
        with suppress(OSError):
            os.setpgid(child, child)  # whichever of the two is first
        if question["end"] is not None:
            _end(child, *question["end"])
        timed_out = not _ends_within(child, _PATIENCE * question["seconds"])
        if timed_out:
            os.killpg(child, signal.SIGKILL)
        _, status, usage = os.wait4(child, 0)
        left_running = question["end"] is not None and not _group_ends(child)
        seconds = usage.ru_utime + usage.ru_stime
        out.seek(0)
        err.seek(0)
        return {
            "code": os.waitstatus_to_exitcode(status),
            "stdout": out.read().decode("utf-8", "replace"),
            "stderr": err.read().decode("utf-8", "replace"),
            "seconds": seconds,
            "peak_bytes": max(0, 1024 * usage.ru_maxrss - _memory("VmRSS")),
            "timed_out": timed_out or seconds >= question["seconds"],
            "left_running": left_running,
        }


def _end(child: int, after: float, number: int, group: bool) -> None:
    if not _ends_within(child, after):
        with suppress(ProcessLookupError):
            (os.killpg if group else os.kill)(child, number)


def _group_ends(group: int) -> bool:
    """Whether its last process is gone soon; those that are not are ended."""
    until = time.monotonic() + _TIDYING
    while time.monotonic() < until:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.02)
    os.killpg(group, signal.SIGKILL)
    return False


def _ends_within(child: int, seconds: float) -> bool:
    watched = os.pidfd_open(child)
    try:
        return bool(select.select([watched], [], [], seconds)[0])
    finally:
        os.close(watched)


def _warm_up(question: dict[str, Any]) -> dict[str, Any]:
    os.chdir(question["folder"])
    descriptors = os.dup(1), os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    try:
        return {"code": _command_line(question["warm_up"])}
    finally:
        gc.collect()
        gc.freeze()  # or each child's first collection copies all pages of this process
        sys.stdout.flush()
        sys.stderr.flush()
        os.dup2(descriptors[0], 1)
        os.dup2(descriptors[1], 2)
        for descriptor in (*descriptors, nowhere):
            os.close(descriptor)


def main() -> None:
    """Answers questions until there are no more; its arguments are modules with experiments."""
    for module in sys.argv[1:]:
        from wrenchsight.analyses.study.registry import REGISTRY

        REGISTRY.register(module)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = os.fdopen(os.dup(1), "w")
    for line in sys.stdin:
        question = json.loads(line)
        answer = _warm_up(question) if "warm_up" in question else _run(question)
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
