"""What is a defect: how a command ended, what it left behind, and what it read."""

import csv
import hashlib
import math
from collections.abc import Mapping
from pathlib import Path

from fuzzing.cases import Case
from fuzzing.sandbox import Ending

BAND = 1.96  # standard deviations: the 95 % that the reading states
_AXES = ("fx", "fy", "fz")
_STRAY = 0.001  # s between samples that are compared; a log's own step
_OUTPUTS = ("out/", "new/", "arm.html", "robot.yaml")

# Mutations after which another wrench is the right reading, or which no log can tell.
UNTELLABLE = {
    "a value that another joint, or the same arm with a load, could have had": (
        *("scaled_cell", "odd_cell", "scaled_column", "other_columns", "put_in", "flip_bits"),
        *("set_bytes", "cut_out", "repeat", "stuck_column", "shuffle_lines"),
    ),
}


def checksums(folder: Path) -> dict[str, str]:
    """SHA-256 of each file, by its name in the folder."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file() and not path.is_symlink()
    }


def fault_of(case: Case, ending: Ending, folder: Path, before: Mapping[str, str]) -> str | None:
    """What went wrong; None if nothing did."""
    fault = ending.fault()
    if fault == "not one line" and "Usage" in ending.stderr and len(case.arguments) == 0:
        fault = None
    if fault is not None:
        return fault
    after = checksums(folder)
    harmed = [name for name, digest in before.items() if after.get(name) != digest]
    if harmed:
        return f"harmed {harmed[0]}"
    left = [name for name in after if name not in before]
    partial = [name for name in left if ".partial" in name or name.endswith(".lock")]
    if partial:
        return f"left {partial[0]} behind"
    if ending.code == 2 and left and case.kind != "command line":
        return f"left {left[0]} of a refusal"
    return None


def readings(table: Path) -> dict[float, tuple[list[float], list[float], bool]]:
    """Force, its standard deviation and validity, by time."""
    found = {}
    with table.open(newline="") as file:
        for row in csv.DictReader(file):
            force = [float(row[axis] or "nan") for axis in _AXES]
            sd = [float(row[f"sd_{axis}"] or "nan") for axis in _AXES]
            found[round(float(row["t"]), 4)] = (force, sd, float(row["valid"]) == 1.0)
    return found


def stray(clean: Path, spoilt: Path) -> tuple[float, float] | None:
    """The largest force that is valid and beyond its band about the clean log's reading, and when.

    Returns:
        Its distance in N and the time; None where all valid samples lie within.
    """
    own, other = readings(clean), readings(spoilt)
    worst: tuple[float, float] | None = None
    for t, (force, sd, valid) in other.items():
        if not valid:
            continue
        if not all(map(math.isfinite, (*force, *sd))):
            return math.inf, t
        if t not in own or not own[t][2]:
            continue
        for a, s, b, s_b in zip(force, sd, own[t][0], own[t][1], strict=True):
            distance = abs(a - b)
            if distance > BAND * math.hypot(s, s_b) and (worst is None or distance > worst[0]):
                worst = distance, t
    return worst
