"""What is wrong with a stream: the hypotheses of `models.hypotheses`, tried while it runs.

All samples since the stream began are judged after LOOK_TIMES, as `estimate` judges a log. A look
takes seconds of a processor. At real time it runs in a process of its own: beside a thread that
holds the interpreter's lock, samples at 500 Hz came up to 65 ms late.

    python -m wrenchsight.analyses.methods.watch.stream_judgement

reads what to judge from standard input, and writes the judgement to standard output.
"""

import os
import pickle
import signal
import subprocess
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.hypotheses.judgement import Judgement, judge_log
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.live.samples import Sample
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot

LOOK_TIMES = (2.0, 5.0, 10.0, 20.0, 40.0)  # s since the stream began
_MODULE = "wrenchsight.analyses.methods.watch.stream_judgement"
_PROCESS_NICENESS = 5  # below the process that reads
LONGEST_GAP = 0.5  # s between samples, after which the stream begins anew


class StreamJudgement:
    """Gathers the samples of one stream, and judges them.

    Args:
        robot, model: of the arm.
        in_background: whether a look runs in a process of its own.
    """

    def __init__(self, robot: Robot, model: IdentifiedModel, in_background: bool) -> None:
        self._robot, self._model = robot, model
        self._in_background = in_background
        self._pool: ThreadPoolExecutor | None = None
        self._running: Future[Judgement | None] | None = None
        self._child: subprocess.Popen[bytes] | None = None
        self.seconds = 0.0
        """s of the stream that the last result is of."""
        self.restart()

    def restart(self) -> None:
        """The stream begins anew."""
        self._looks = list(LOOK_TIMES)
        self._rows: list[Array] = []  # of `_row`
        self._is_torque = False

    @property
    def is_over(self) -> bool:
        """Whether the search has ended."""
        return not self._looks and self._running is None

    def add(self, sample: Sample) -> None:
        """Takes the next sample of the stream; one that is late or incomplete is left out."""
        if not self._looks:
            return
        row = np.concatenate([[sample.t], sample.q, sample.v, sample.effort])
        if self._rows and sample.t - self._rows[-1][0] > LONGEST_GAP:
            self.restart()
        is_later = not self._rows or sample.t > self._rows[-1][0]
        if is_later and np.isfinite(row).all():
            self._rows.append(row)
            self._is_torque = sample.is_torque

    def look(self) -> None:
        """Begins a look where one is due."""
        if self._running is not None or not (self._looks and self._rows):
            return
        seconds = float(self._rows[-1][0] - self._rows[0][0])
        if seconds < self._looks[0]:
            return
        while self._looks and seconds >= self._looks[0]:
            self._looks.pop(0)
        self.seconds = seconds
        task = _Task(self._robot, self._model, np.array(self._rows), self._is_torque)
        if self._in_background:
            self._pool = self._pool or ThreadPoolExecutor(1)
            self._running = self._pool.submit(self._judge_in_child, pickle.dumps(task))
        else:
            self._running = Future()
            self._running.set_result(task.judgement())

    def result(self) -> Judgement | None:
        """What the last look has found, once it is over; None before, or where it is too short."""
        if self._running is None or not self._running.done():
            return None
        judgement, self._running = self._running.result(), None
        return judgement

    def close(self) -> None:
        """Ends a look that is not over."""
        self._looks = []
        if self._child is not None:
            self._child.kill()
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)

    def _judge_in_child(self, task: bytes) -> Judgement | None:
        command = [sys.executable, "-P", "-m", _MODULE]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
            self._child = child
            output, _ = child.communicate(task)
        self._child = None
        judgement: Judgement | None = pickle.loads(output) if child.returncode == 0 else None
        return judgement


@dataclass(frozen=True, eq=False)
class _Task:
    """What a look judges.

    Attributes:
        table: (N, 1 + 3 n) of t, q, v and effort.
        is_torque: whether the effort is in N m.
    """

    robot: Robot
    model: IdentifiedModel
    table: Array
    is_torque: bool

    def judgement(self) -> Judgement | None:
        """Tries the hypotheses; None where the stream is too short."""
        n = self.robot.num_joints
        t, q, v, effort = np.split(self.table, [1, 1 + n, 1 + 2 * n], axis=1)
        current = self.robot.motor_current(effort) if self.is_torque else effort
        tau_J = effort if self.is_torque else None
        log = Recording(t=t[:, 0], q=q, v=v, current=current, source="the stream", tau_J=tau_J)
        try:
            return judge_log([resampled(log, max_gap=LONGEST_GAP)], self.robot, self.model)
        except InputError:  # too few samples for a uniform grid
            return None


def main() -> int:
    """Judges what standard input holds; returns the exit code."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that started it ends it
    os.nice(_PROCESS_NICENESS)
    task = pickle.load(sys.stdin.buffer)
    sys.stdout.buffer.write(pickle.dumps(task.judgement()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
