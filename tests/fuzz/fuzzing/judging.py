"""What is a defect: how a command ended, what it left behind, and what it read."""

import csv
import hashlib
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from fuzzing.cases import Case
from fuzzing.clean_inputs import CleanInputs
from fuzzing.sandbox import Ending
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.sample_check import TORQUE_MARGIN
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.robot.robot import Robot

LOGS = ("csv", "parquet", "npz", "mcap")  # kinds of cases whose reading is compared

BAND = 1.96  # standard deviations: the 95 % that the reading states
_AXES = ("fx", "fy", "fz")
_STRAY = 0.001  # s between samples that are compared; a log's own step
_OUTPUTS = ("out/", "new/", "arm.html", "robot.yaml")


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
    columns = {}
    with table.open(newline="") as file:
        for row in csv.DictReader(file):
            force = [float(row[axis] or "nan") for axis in _AXES]
            sd = [float(row[f"sd_{axis}"] or "nan") for axis in _AXES]
            columns[round(float(row["t"]), 4)] = (force, sd, float(row["valid"]) == 1.0)
    return columns


def stray(clean: Path, spoilt: Path) -> tuple[float, float] | None:
    """The largest force that is valid and beyond its band about the clean log's reading, and when.

    Returns:
        Its distance in N and the time; None where all valid samples lie within.
    """
    clean_readings, other = readings(clean), readings(spoilt)
    worst: tuple[float, float] | None = None
    for t, (force, sd, valid) in other.items():
        if not valid:
            continue
        if not all(map(math.isfinite, (*force, *sd))):
            return math.inf, t
        if t not in clean_readings or not clean_readings[t][2]:
            continue
        for a, s, b, s_b in zip(force, sd, clean_readings[t][0], clean_readings[t][1], strict=True):
            distance = abs(a - b)
            if distance > BAND * math.hypot(s, s_b) and (worst is None or distance > worst[0]):
                worst = distance, t
    return worst


def beyond_its_band(
    case: Case, ending: Ending, folder: Path, reading: Path, clean: CleanInputs
) -> tuple[str | None, str | None]:
    """Compares the reading of a spoilt log with the clean one's.

    Args:
        folder: where the case was run.
        reading: the clean log's wrench.csv.

    Returns:
        Why it cannot be told that the reading is beyond its band, and what the defect is where it
        can; both None where it lies within, or there is no reading.
    """
    table = folder / "out" / "wrench.csv"
    if case.kind not in LOGS or not table.is_file():
        return None, None
    stray_samples = stray(reading, table)
    if stray_samples is None:
        return None, None
    if math.isfinite(stray_samples[0]):
        log = next(name for name in case.arguments if name.startswith("log."))
        reason = untellable(clean.log, folder / log, clean.robot, ending.stdout + ending.stderr)
        if reason is not None:
            return reason, None
    return None, f"{stray_samples[0]:.3g} N beyond the band at {stray_samples[1]} s, and valid"


def untellable(clean: Path, spoilt: Path, robot: Path, printed: str = "") -> str | None:
    """Why nothing in a log, or in what is known of its robot, contradicts it; None: something does.

    This is the list of what cannot be told, which docs/faults.md repeats:

    - a joint's signal is another joint's of the same log, at which both are possible;
    - positions and velocities are those of the clean log, and the currents others that the drives
      can give: a load, a contact or a hit takes such currents, and another gain looks like a load;
    - the command itself says that the signs of the currents are doubtful.

    Args:
        clean, spoilt: logs.
        robot: whose logs they are.
        printed: what the command said.
    """
    if "signs of the currents are doubtful" in printed:
        return "signs in doubt, and said so"
    a, b = read_recording(clean, check=False), read_recording(spoilt, check=False)
    _, clean_rows, other = np.intersect1d(
        np.round(a.t, 6), np.round(b.t, 6), assume_unique=True, return_indices=True
    )
    if len(clean_rows) < 0.5 * min(len(a.t), len(b.t)):
        return None
    signals = ("q", "v", "current")
    before = {name: getattr(a, name)[clean_rows] for name in signals}
    after = {name: getattr(b, name)[other] for name in signals}
    for name in signals:
        for j in range(after[name].shape[1]):
            spoilt_column = after[name][:, j]
            others = [
                k for k in range(after[name].shape[1]) if _same(spoilt_column, before[name][:, k])
            ]
            if others and j not in others:
                return "a signal of another joint"
    if not all(_same(after[name], before[name]) for name in ("q", "v")):
        return None
    within = np.abs(after["current"]) <= TORQUE_MARGIN * Robot.load(robot).current_limit
    return "currents that the drives can give" if within.all() else None


def _same(a: Array, b: Array) -> bool:
    """Whether they are equal wherever both are numbers."""
    return bool(np.all((np.abs(a - b) < 1e-9) | ~np.isfinite(a - b)))
