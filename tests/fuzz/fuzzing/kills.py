"""`python -m fuzzing.kills --count 1000`: commands that are ended at random moments.

Each works over older results of its own and gets SIGKILL, SIGTERM, SIGINT or SIGHUP. The older
results must then be there, whole, or the new ones; no process may be left; and after the next run
of the command nothing that is not a result. Most run in a process that was forked, ready to begin;
every tenth is a program that starts.
"""

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from fuzzing.clean_inputs import make_clean_inputs, motion
from fuzzing.killed_results import (
    CampaignFolder,
    Draft,
    Folder,
    Page,
    Results,
    StudyResults,
    WatchRecording,
)
from fuzzing.sandbox import Ending, Sandbox
from wrenchsight.models.recordings.recording_writer import write_recording

_ROOT = Path(__file__).parents[3]
_ENDS = (signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
_EXPERIMENT = "quick-experiment"
_LOG = ("long.csv", "--robot", "robot")
EXPERIMENTS = ("fuzzing.quick_experiment",)
SECONDS = 120.0  # of a processor, until a run is given up
STARTS = "from its start"

# SEED, PRIOR and so on change with each run, so that older results can be told from new ones.
COMMANDS = {
    "jcn-map": ("jcn-map", "--samples", "2000", "--seed", "SEED"),
    "simulate": ("simulate", "--duration", "0.02", "--no-recording", "--seed", "SEED"),
    "estimate": ("estimate", "log.csv", "--robot", "robot", "--prior", "PRIOR,2", "--mcap"),
    "redundancy": ("redundancy", "--task", "redundancy.yaml"),
    "identify": ("identify", *_LOG, "--consistent", "--cutoff-hz", "CUTOFF"),
    "refresh": ("identify", *_LOG, "--refresh", "identified/model.yaml", "--part", "0,PART"),
    "payload": ("payload", *_LOG, "--model", "identified/model.yaml", "--gain-sd", "0.PART"),
    "place": ("place", "--task", "place.yaml", "--quick", "--seed", "SEED"),
    "excite": (
        "excite",
        "--robot",
        "robot",
        "--seed",
        "SEED",
        "--harmonics",
        "2",
        "--config",
        "excite.yaml",
        "--no-validation",
        "--no-record",
    ),
    "study": ("study", _EXPERIMENT, "--seed", "SEED", "--jobs", "1"),
    "campaign": (
        "campaign",
        _EXPERIMENT,
        "--worlds",
        "2",
        "--seed",
        "SEED",
        "--jobs",
        "1",
        "--fresh",
    ),
    "robot show": ("robot", "show", "ARM"),
    "robot": ("robot", "robot/robot.urdf"),
    "watch": ("watch", "replay://long.csv", *_LOG[1:], "--model", "model.yaml", "--view", "none"),
    STARTS: ("jcn-map", "--samples", "50", "--seed", "SEED"),
}
WEIGHTS = {"study": 0.5, "campaign": 0.3, "identify": 0.5, "watch": 0.3}  # of the others: 1


def make_kill_inputs(sandbox: Sandbox, folder: Path) -> None:
    """Writes what the commands read, and warms the process up that forks."""
    make_clean_inputs(folder)
    write_recording(motion(5200), folder / "long.csv")
    (folder / "excite.yaml").write_text("excitation: {num_starts: 2, iterations: 3}\n")
    warm = folder / "warm"
    sandbox.warm_up([(*_words(COMMANDS["identify"], 0), "--out", "identified")], folder)
    others = ("identify", "study", "campaign", "watch", STARTS)  # watch warms its own process up
    names = [name for name in COMMANDS if name not in others]
    runs = [(*_words(COMMANDS[name], 0), "--out", str(warm / name)) for name in names]
    sandbox.warm_up(runs, folder)
    shutil.rmtree(warm)


class Kills:
    """Ends one command again and again, in a folder that keeps its results.

    Args:
        name: of COMMANDS.
        folder: with what `make_kill_inputs` writes.
    """

    def __init__(self, name: str, sandbox: Sandbox, folder: Path) -> None:
        self._name, self._sandbox, self._folder = name, sandbox, folder
        self.results = _results(name, folder)
        self._seconds = 0.0
        for seed in (0, 1):
            began, ending = time.monotonic(), self._run(seed)
            if ending.code != 0:
                raise RuntimeError(f"{name} ended with {ending.code}: {ending.stderr}")
            self._seconds = time.monotonic() - began

    def fault(self, seed: int) -> tuple[str, str | None]:
        """Which signal ended the next run, and what went wrong; None if nothing did."""
        rng = random.Random(f"{seed} {self._name}")  # not the numbers that chose the command
        number = rng.choice(_ENDS)
        share = 0.3 if self._name == STARTS else 1.1
        after = rng.uniform(0.0, share) * self._seconds
        # A terminal tells all processes, `kill` one.
        group = number in (signal.SIGINT, signal.SIGHUP) and rng.random() < 0.5
        self.results.before(tidy_end=number != signal.SIGKILL)
        end = time.time() + after
        ending = self._run(seed + 2, (after, number, group))
        self.results.ended = min(end, time.time())
        description = f"{number.name}{' of all' if group else ''}"
        if "Traceback" in ending.stderr and "frozen" not in ending.stderr:
            return description, ending.stderr[-600:]
        if ending.left_running:
            return description, "a process is left running"
        if ending.code not in (0, -number, 128 + number) and "frozen" not in ending.stderr:
            return description, f"exit code {ending.code}: {ending.stderr[-300:]}"
        return description, self.results.fault()

    def left_behind(self) -> list[str]:
        """What there is after one more run that is no result."""
        ending = self._run(0)
        if ending.code != 0:
            return [ending.stderr]
        return self.results.hidden()

    def _run(self, seed: int, end: tuple[float, int, bool] | None = None) -> Ending:
        self.results.make_room()
        option = "--record" if self._name == "watch" else "--out"
        arguments = (*_words(COMMANDS[self._name], seed), option, str(self.results.path))
        if self._name == STARTS:
            return self._started(arguments, end)
        return self._sandbox.run(arguments, self._folder, SECONDS, end=end)

    def _started(self, arguments: Sequence[str], end: tuple[float, int, bool] | None) -> Ending:
        process = subprocess.Popen(
            [sys.executable, "-c", "from wrenchsight.__main__ import main; main()", *arguments],
            cwd=self._folder,
            env=os.environ | {"PYTHONPATH": str(_ROOT)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        if end is not None:
            time.sleep(end[0])
            process.send_signal(end[1])
        _, errors = process.communicate()
        return Ending(process.returncode, "", errors, 0.0, 0, False)


def _results(name: str, folder: Path) -> Results:
    out = folder / f"out {name}"
    if name == "study":
        return StudyResults(out, _EXPERIMENT)
    if name == "campaign":
        return CampaignFolder(out)
    if name == "watch":
        return WatchRecording(out)
    if name == "robot show":
        return Page(out / "arm.html")
    if name == "robot":
        return Draft(out / "robot.yaml")
    return Folder(out)


def _words(words: Sequence[str], seed: int) -> list[str]:
    values = {
        "SEED": str(seed),
        "PRIOR,2": f"{30 + seed % 7},2",
        "CUTOFF": f"{5 + 0.1 * (seed % 3)}",
        "0,PART": f"0,4.{seed % 7}",
        "0.PART": f"0.03{seed % 7}",
        "ARM": ("robot", "ur10e")[seed % 2],
    }
    return [values.get(word, word) for word in words]


def main() -> int:
    """Returns 1 if something was harmed or left."""
    parser = argparse.ArgumentParser(prog="fuzzing.kills", description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", choices=COMMANDS, default=list(COMMANDS))
    options = parser.parse_args()
    totals: Counter[str] = Counter()
    bad = 0
    with tempfile.TemporaryDirectory() as name:
        folder, temporary = Path(name) / "inputs", Path(name) / "temporary"
        temporary.mkdir()
        with Sandbox(EXPERIMENTS, {"TMPDIR": str(temporary)}) as sandbox:
            make_kill_inputs(sandbox, folder)
            runs = {command: Kills(command, sandbox, folder) for command in options.only}
            weights = [WEIGHTS.get(command, 1.0) for command in options.only]
            for seed in range(options.seed, options.seed + options.count):
                (command,) = random.Random(seed).choices(options.only, weights)
                number, fault = runs[command].fault(seed)
                totals[f"{command}: {number}"] += 1
                if fault is not None:
                    bad += 1
                    print(f"{seed} {command} {number}: {fault}", flush=True)
                if (seed - options.seed) % 50 == 49:
                    print(f"{seed - options.seed + 1} done", file=sys.stderr, flush=True)
            for command, run in runs.items():
                if left := run.left_behind():
                    bad += 1
                    print(f"{command} leaves {left}", flush=True)
        if left := sorted(path.name for path in temporary.iterdir()):
            bad += 1
            print(f"left among the temporary files: {left}", flush=True)
    for key, count in sorted(totals.items()):
        print(f"{count:6d}  {key}")
    print(f"{bad} faults in {options.count}")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
