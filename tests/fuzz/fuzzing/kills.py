"""`python -m fuzzing.kills --count 1000`: commands that are ended at random moments.

Each runs as a process of its own over older results of its own, and gets SIGKILL, SIGTERM, SIGINT
or SIGHUP. The older results must then be there, whole, or the new ones; and after the next run of
the command nothing may be left that is not a result.
"""

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from analyses.output.result_folder import STAGING, recover
from analyses.output.result_marker import MARKER, ResultMarker, strangers, visible_files
from fuzzing.clean_inputs import make_clean_inputs, motion
from models.recordings.recording_writer import write_recording

_ROOT = Path(__file__).parents[3]
_ENDS = (signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
COMMANDS = {
    "jcn-map": ("jcn-map", "--samples", "2000", "--seed", "SEED"),
    "simulate": ("simulate", "--duration", "0.02", "--no-recording", "--seed", "SEED"),
    "estimate": ("estimate", "log.csv", "--robot", "robot", "--prior", "PRIOR,2", "--mcap"),
    "redundancy": ("redundancy", "--task", "redundancy.yaml"),
    "identify": ("identify", "long.csv", "--robot", "robot", "--consistent"),
}


class Kills:
    """Ends one command again and again, in a folder that keeps its results.

    Args:
        name: of COMMANDS.
        folder: with the clean inputs.
    """

    def __init__(self, name: str, folder: Path) -> None:
        self._arguments, self._folder = COMMANDS[name], folder
        self.out = folder / f"out {name}"
        began = time.monotonic()
        code, errors = self._run(0)
        if code != 0:
            raise RuntimeError(f"{name} ended with {code}: {errors}")
        began, code = time.monotonic(), self._run(0)[0]
        self._seconds = time.monotonic() - began

    def fault(self, seed: int) -> tuple[str, str | None]:
        """Which signal ended the next run, and what went wrong; None if nothing did."""
        rng = random.Random(seed)
        before, had_part = self._content(), (self.out / STAGING).exists()
        number = rng.choice(_ENDS)
        process = self._started(seed + 1)
        time.sleep(rng.uniform(0.0, 1.1) * self._seconds)
        process.send_signal(number)
        _, errors = process.communicate()
        if "Traceback" in errors and "__main__" in errors:  # else the interpreter's own beginning
            return number.name, errors[-300:]
        recover(self.out)  # what the next run does first
        after = self._content()
        marker = ResultMarker.read(self.out)
        if marker is None:
            return number.name, "no marker"
        found = next(strangers(self.out, marker), None)
        if found is not None:
            return number.name, f"{found.name} is not as it was written"
        if set(marker.files) != set(after):
            return number.name, "files that the marker does not know, or that are gone"
        changed = {name for name in after if before.get(name) != after[name]}
        if changed and before.get("config.yaml") == after.get("config.yaml"):
            return number.name, f"{sorted(changed)} beside the older config.yaml"
        if number != signal.SIGKILL and not had_part and (self.out / STAGING).exists():
            return number.name, "the part that was written is left behind"
        return number.name, None

    def left_behind(self) -> list[str]:
        """What there is after one more run that is no result."""
        code, errors = self._run(0)
        if code != 0:
            return [errors]
        hidden = {entry.name for entry in os.scandir(self.out) if entry.name.startswith(".")}
        return sorted(hidden - {MARKER})

    def _run(self, seed: int) -> tuple[int, str]:
        process = self._started(seed)
        _, errors = process.communicate()
        return process.returncode, errors

    def _started(self, seed: int) -> "subprocess.Popen[str]":
        words = {"SEED": str(seed), "PRIOR,2": f"{30 + seed % 7},2"}
        arguments = [words.get(word, word) for word in self._arguments]
        return subprocess.Popen(
            [sys.executable, "-m", "wrenchsight", *arguments, "--out", str(self.out)],
            cwd=self._folder,
            env=os.environ | {"PYTHONPATH": str(_ROOT)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )

    def _content(self) -> dict[str, bytes]:
        return {name: path.read_bytes() for name, path in visible_files(self.out)}


def main() -> int:
    """Returns 1 if something was harmed or left."""
    parser = argparse.ArgumentParser(prog="fuzzing.kills", description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    totals: Counter[str] = Counter()
    bad = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "inputs"
        make_clean_inputs(folder)
        write_recording(motion(6000), folder / "long.csv")
        runs = {command: Kills(command, folder) for command in COMMANDS}
        for seed in range(options.seed, options.seed + options.count):
            command = list(COMMANDS)[seed % len(COMMANDS)]
            number, fault = runs[command].fault(seed)
            totals[f"{command}: {number}"] += 1
            if fault is not None:
                bad += 1
                print(f"{seed} {command} {number}: {fault}", flush=True)
        for command, run in runs.items():
            if left := run.left_behind():
                bad += 1
                print(f"{command} leaves {left}", flush=True)
    for key, count in sorted(totals.items()):
        print(f"{count:6d}  {key}")
    print(f"{bad} faults in {options.count}")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
