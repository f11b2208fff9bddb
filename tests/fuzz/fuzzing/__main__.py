"""`python -m fuzzing --count 1000 --seed 1`: that many spoilt inputs, and what went wrong."""

import argparse
import collections
import shutil
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from fuzzing.cases import make_case
from fuzzing.clean_inputs import make_clean_inputs
from fuzzing.judging import beyond_its_band, checksums, fault_of
from fuzzing.sandbox import Sandbox

_DRAWN = 10  # one case of so many draws its figures
WARM_UP = (
    ("estimate", "log.csv", "--robot", "robot", "--prior", "30,2", "--out", "clean"),
    ("watch", "replay://log.csv?rate=0", "--robot", "robot", "--model", "model.yaml"),
    ("jcn-map", "--samples", "50", "--out", "warm/map"),
    ("simulate", "--duration", "0.02", "--no-recording", "--out", "warm/simulate"),
    ("redundancy", "--task", "redundancy.yaml", "--out", "warm/redundancy"),
    ("place", "--task", "place.yaml", "--quick", "--out", "warm/place"),
    ("robot", "show", "robot", "--out", "arm.html"),
)


def main() -> int:
    """Returns 1 if a defect was found."""
    parser = argparse.ArgumentParser(prog="fuzzing", description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0, help="of the first input")
    parser.add_argument("--keep", type=Path, help="folder for the inputs of defects")
    options = parser.parse_args()
    totals: collections.Counter[str] = collections.Counter()
    outcomes: collections.Counter[str] = collections.Counter()
    defects = done = 0
    began = time.monotonic()
    with (
        suppress(KeyboardInterrupt),
        tempfile.TemporaryDirectory() as name,
        Sandbox() as sandbox,
    ):
        folder = Path(name)
        clean = make_clean_inputs(folder / "inputs")
        reading = folder / "reading"
        shutil.copytree(clean.folder, reading)
        sandbox.warm_up(WARM_UP, reading)
        for seed in range(options.seed, options.seed + options.count):
            work = folder / "case"
            case = make_case(seed, clean, work)
            before = checksums(work)
            ending = sandbox.run(case.arguments, work, draws=seed % _DRAWN == 0)
            fault = fault_of(case, ending, work, before)
            totals[f"{case.kind}: exit {ending.code}"] += 1
            if fault is None:
                reason, fault = beyond_its_band(
                    case, ending, work, reading / "clean" / "wrench.csv", clean
                )
                if reason is not None:
                    outcomes[f"{case.kind}, {reason}"] += 1
                    print(f"{seed} beyond its band, {case.what}: {reason}", flush=True)
            if fault is not None:
                defects += 1
                last = ending.stderr.strip().splitlines()[-1:] or [""]
                print(f"{seed} {case.kind}, {case.what}: {fault}: {last[0][:300]}", flush=True)
                print("   " + " ".join(case.arguments)[:300], flush=True)
                if options.keep:
                    shutil.copytree(work, options.keep / str(seed), dirs_exist_ok=True)
                    (options.keep / str(seed) / "stderr.txt").write_text(ending.stderr)
            shutil.rmtree(work, ignore_errors=True)
            done += 1
            if done % 100 == 0:
                print(f"{done} done, {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)
    for name, count in sorted(totals.items()):
        print(f"{count:6d}  {name}")
    for name, count in sorted(outcomes.items()):
        print(f"{count:6d}  beyond the band, which cannot be told: {name}")
    print(f"{defects} defects in {done}, {time.monotonic() - began:.0f} s")
    return int(defects > 0)


if __name__ == "__main__":
    sys.exit(main())
