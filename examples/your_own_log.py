"""A log that was recorded elsewhere: its columns described, a model identified, a wrench read.

    python your_own_log.py [FOLDER]

The log here is written by this very script, in a layout that the program does not know: semicolons,
milliseconds, degrees, milliampere. Put your own in its place.
"""

import sys
from pathlib import Path

import numpy as np

from wrenchsight import EstimateConfig, Robot, estimate_log, load_scenario, simulate

DESCRIPTION = """\
separator: ";"
header: true
time: {columns: stamp, unit: ms}
position: {columns: "pos{1..6}", unit: deg}
velocity: {columns: "vel{1..6}", unit: deg/s}
current: {columns: "cur{1..6}", unit: mA}
"""


def write_a_foreign_log(path: Path, seconds: float) -> None:
    """Simulates some seconds and writes them as a controller of another maker might."""
    scenario = load_scenario("Default")
    scenario.duration = seconds
    run = simulate(scenario, Robot.load(scenario.robot))
    names = ["stamp", *(f"{kind}{j}" for kind in ("pos", "vel", "cur") for j in range(1, 7))]
    table = np.column_stack([1e3 * run.t, np.rad2deg(run.q), np.rad2deg(run.v), 1e3 * run.current])
    np.savetxt(path, table, delimiter=";", header=";".join(names), comments="", fmt="%.9g")


def main(folder: Path, seconds: float = 4.0) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    write_a_foreign_log(folder / "log.csv", seconds)
    (folder / "columns.yaml").write_text(DESCRIPTION, encoding="utf-8")
    result = estimate_log(
        folder / "log.csv",
        "sts_sre4_600",
        None,  # no model yet: what the robot's files say; `identify` makes a better one
        folder / "reading",
        log_format=folder / "columns.yaml",
        config=EstimateConfig(),
    )
    for sentence in (*result.notices, *result.warnings):
        print("-", sentence)
    print(f"{result.num_samples} samples, {100 * result.valid_share:.0f} % valid: {result.table}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "your_own_log"))
