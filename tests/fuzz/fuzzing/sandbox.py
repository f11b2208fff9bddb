"""Runs the command line in a process of its own, with limits of time and memory.

One process has imported everything and loaded the kernels; for each command it forks. A command
so costs what it computes, and not the second or two that the imports take.
"""

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from wrenchsight.analyses.output.compilation import ANNOUNCEMENT

SECONDS = 10.0
BYTES = 2 << 30
_PACKAGE = Path(__file__).parents[1]
_ROOT = Path(__file__).parents[3]


@dataclass(frozen=True)
class Ending:
    """How a command ended.

    Attributes:
        code: exit code; negative: the signal that ended it.
        seconds: of the processor.
        peak_bytes: most memory that it held, beyond what it was forked with.
        timed_out: whether it was ended for its time, or for waiting for what never came.
        left_running: whether a process that it had started was there some seconds later.
    """

    code: int
    stdout: str
    stderr: str
    seconds: float
    peak_bytes: int
    timed_out: bool
    left_running: bool = False

    def fault(self) -> str | None:
        """What makes this ending a defect, whatever the input was; None if it is as it should."""
        if self.timed_out:
            return f"took more than {self.seconds:.0f} s"
        if "Traceback" in self.stderr:
            return "a traceback"
        if self.peak_bytes > BYTES or "not enough memory" in self.stderr:
            return "too much memory"
        if self.code == 2:
            if self._lines != 1 or not self.stderr.endswith("\n"):
                return "not one line"
            if not self.stderr.replace("\n", "").isprintable():
                return "a line that a terminal would obey"
            if len(self.stderr) > 2000:
                return "a line that nobody reads to its end"
            return None
        if self.code != 0:
            return f"exit code {self.code}"
        if "Warning" in self.stderr:
            return "a warning of Python's"
        return None

    @property
    def _lines(self) -> int:
        """How many were printed, without the one of a kernel that this machine had not compiled."""
        lines = self.stderr.splitlines()
        return sum(not line.endswith(ANNOUNCEMENT) for line in lines)


class Sandbox:
    """Runs commands; a context manager, as it holds a process.

    Args:
        experiments: modules with experiments that studies and campaigns are to know.
        variables: of the processes' environment, beside what this process has.
    """

    def __init__(
        self, experiments: Sequence[str] = (), variables: Mapping[str, str] | None = None
    ) -> None:
        environment = (
            os.environ
            | (variables or {})
            | {
                "PYTHONPATH": os.pathsep.join([str(_PACKAGE), str(_ROOT)]),
                "OMP_NUM_THREADS": "1",
                "OPENBLAS_NUM_THREADS": "1",
                "NUMBA_THREADING_LAYER": "workqueue",  # which alone may be forked
                "NUMBA_NUM_THREADS": "1",
            }
        )
        self._process = subprocess.Popen(
            [sys.executable, "-m", "fuzzing.forking", *experiments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
            text=True,
        )

    def warm_up(self, commands: Sequence[Sequence[object]], folder: Path) -> None:
        """Runs commands in `folder` once, so that what they load is there for all."""
        for arguments in commands:
            words = [str(word) for word in arguments]
            code = self._ask({"warm_up": words, "folder": str(folder)})["code"]
            if code != 0:
                raise RuntimeError(f"{' '.join(words)} ended with {code}")

    def run(
        self,
        arguments: Sequence[object],
        folder: Path,
        seconds: float = SECONDS,
        bytes_more: int = BYTES,
        bytes_of_file: int | None = None,
        draws: bool = True,
        end: tuple[float, int, bool] | None = None,
    ) -> Ending:
        """Runs `wrenchsight` with these arguments in `folder`.

        Args:
            bytes_of_file: no file can grow beyond; stands for a full disk.
            draws: whether figures are drawn, which takes most of a short command's time; else
                their files stay empty.
            end: after so many seconds it gets a signal of this number, alone or (True) with all
                processes that it has started.
        """
        answer = self._ask(
            {
                "run": [os.fsencode(str(a)).decode("latin-1") for a in arguments],
                "folder": str(folder),
                "seconds": seconds,
                "bytes": bytes_more,
                "file": bytes_of_file,
                "draws": draws,
                "end": end,
            }
        )
        return Ending(**answer)

    def __enter__(self) -> "Sandbox":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()

    def _ask(self, question: dict[str, Any]) -> Any:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(question) + "\n")
        self._process.stdin.flush()
        answer = self._process.stdout.readline()
        if not answer:
            raise RuntimeError("the process that forks has died")
        return json.loads(answer)
