"""A log read by `estimate` with its defaults, and held against the truth.

The stated band is that of a causal reading, its observer's lag included: it is held against the
force of the same instant, not against a delayed one. In a log whose force steps, samples within
EDGE_SECONDS after an edge are left out of the band's figures: no band of a useful width holds them.
A reported contact is false where no true force lies within it, or CONTACT_SLACK around it.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv

from wrenchsight.analyses.experiments.foreign_physics.arms import MujocoArm
from wrenchsight.analyses.experiments.foreign_physics.mujoco_world import WorldLog
from wrenchsight.analyses.experiments.foreign_physics.plain_tools import PlainModel
from wrenchsight.analyses.methods.estimate.estimation import estimate_log
from wrenchsight.models.estimation.invalid import InvalidCodes
from wrenchsight.models.estimation.invalid_shares import invalid_pct
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.stretches import stretches
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.rigid_body.spatial_vectors import WRENCH_AXES
from wrenchsight.models.signals.bands import SIGMA_95
from wrenchsight.models.signals.root_mean_square import rms

EDGE_SECONDS = 0.25
EDGE_SHARE = 0.5  # of the largest force, by which it changes in a sample at an edge
SETTLED_SECONDS = 0.5  # at a log's start, left out
CONTACT_SLACK = 0.3  # s
TOUCH_SHARE = 0.02  # of the log's largest force: something touches
CONTACT_SHARE = 0.3  # of it: a true contact that may not be missed
LEAST_CONTACT = 0.2  # s
REFUSED_CODE = -1  # in the place of reasons


@dataclass(frozen=True, eq=False)
class EstimatedLog:
    """What `estimate` made of a log; N samples, force first.

    Attributes:
        refusal: the line with which the log was refused; empty: it was read.
        wrench, sd: (N, 6) N and N m.
        invalid: (N,) reasons; REFUSED_CODE: the log was refused.
        contacts: begin and end of each reported contact, s.
        sentences: notices, contacts and warnings for the user.
    """

    refusal: str
    wrench: Array
    sd: Array
    invalid: InvalidCodes
    contacts: tuple[tuple[float, float], ...]
    sentences: tuple[str, ...]

    @property
    def valid(self) -> Flags:
        """(N,)."""
        return np.asarray(self.invalid == 0)


def read_log(
    arm: MujocoArm,
    model: IdentifiedModel,
    log: WorldLog,
    folder: Path,
    draws: bool = True,
) -> EstimatedLog:
    """Reads a log as the command does, and leaves its files in the folder.

    A log that the command refuses has NaN readings, none valid, and the reason.

    Args:
        arm: whose robot.yaml is used.
        model: model of the arm.
        log: to read.
        folder: for log.parquet, model.yaml and estimate/.
        draws: whether figures are wanted.
    """
    path, model_path = folder / "log.parquet", folder / "model.yaml"
    write_recording(log.recording, path)
    model.save(model_path)
    N = log.recording.num_samples
    try:
        result = estimate_log(path, arm.robot_file, model_path, folder / "estimate", draws=draws)
    except InputError as error:
        nothing = np.full((N, 6), np.nan)
        return EstimatedLog(
            refusal=str(error),
            wrench=nothing,
            sd=nothing,
            invalid=np.full(N, REFUSED_CODE),
            contacts=(),
            sentences=(),
        )
    table = pyarrow.csv.read_csv(result.table)
    columns = {name: table[name].to_numpy() for name in table.column_names}
    if len(columns["t"]) != N:  # the log's clock is even, so that its grid is that of the truth
        raise RuntimeError(f"{log.recording.source}: {len(columns['t'])} rows for {N} samples")
    contacts = result.metrics()["contact"]["contacts"]
    return EstimatedLog(
        refusal="",
        wrench=np.column_stack([columns[axis] for axis in WRENCH_AXES]),
        sd=np.column_stack([columns[f"sd_{axis}"] for axis in WRENCH_AXES]),
        invalid=columns["invalid"].astype(np.int64),
        contacts=tuple((contact["begin_s"], contact["end_s"]) for contact in contacts),
        sentences=(*result.notices, *result.contacts, *result.warnings),
    )


def figures(
    log: WorldLog,
    reading: EstimatedLog,
    plain: PlainModel | None = None,
    steps: bool = True,
) -> dict[str, Any]:
    """The figures of a log; lists are of fx fy fz mx my mz, those in newtons of fx fy fz.

    A log that was refused has no valid sample, and misses all its contacts. The first
    SETTLED_SECONDS count in nothing but contacts. RMSE is over valid and invalid samples: plain
    tools, beside which it stands, know no difference. The band's figures are of valid ones.

    Args:
        log: with its truth.
        reading: reading of it.
        plain: whose figures stand beside; None: they are left out (`plain`).
        steps: whether the force may step; else no sample is left out.
    """
    t = log.recording.t
    truth = np.roll(log.wrench, 3, axis=1)  # force first, as in the reading
    judged = t - t[0] >= SETTLED_SECONDS
    counted = judged & reading.valid  # for the band
    if steps:
        counted &= ~after_edges(truth)
    error = reading.wrench - truth
    ratio = np.abs(error[counted]) / reading.sd[counted]
    has_samples = bool(counted.any())
    none = np.full(6, np.nan)
    # Begin and end, s: where a contact may be reported, and where one must be.
    possible_contacts = _intervals(t, _is_above(truth, TOUCH_SHARE))
    true_contacts = _intervals(t, _is_above(truth, CONTACT_SHARE))
    false = [c for c in reading.contacts if not any(_meet(c, true) for true in possible_contacts)]
    missed = [true for true in true_contacts if not any(_meet(c, true) for c in reading.contacts)]
    result = {
        "inside_95_pct": 100.0 * np.mean(ratio <= SIGMA_95, axis=0) if has_samples else none,
        "beyond_3sd_pct": 100.0 * np.mean(ratio > 3.0, axis=0) if has_samples else none,
        "share_valid_pct": 100.0 * float(np.mean(reading.valid[judged])),
        "invalid": {} if reading.refusal else invalid_pct(reading.invalid[judged]),
        "sd_n": np.mean(reading.sd[counted, :3], axis=0) if has_samples else none[:3],
        "false_contacts": len(false),
        "seconds": float(t[-1] - t[0]),
        "missed": len(missed),
        "true_contacts": len(true_contacts),
        "refused": float(bool(reading.refusal)),
        "ours": {"rmse_n": rms(error[judged, :3])},
    }
    if plain is not None:
        plain_error = plain.read(log.recording) - truth[:, :3]
        result["plain"] = {"rmse_n": rms(plain_error[judged])}
    return result


def after_edges(truth: Array) -> Flags:
    """(N,) whether a force (N, 6) stepped within the last EDGE_SECONDS, at 100 Hz."""
    force = truth[:, :3]
    largest = np.linalg.norm(force, axis=1).max()
    change = np.linalg.norm(np.diff(force, axis=0, prepend=force[:1]), axis=1)
    is_edge = (change > EDGE_SHARE * largest) & (largest > 0.0)
    return np.convolve(is_edge, np.ones(round(EDGE_SECONDS / 0.01)))[: len(force)] > 0.0


def _is_above(truth: Array, share: float) -> Flags:
    """(N,) whether the force is above a share of the log's largest."""
    size = np.linalg.norm(truth[:, :3], axis=1)
    return np.asarray((size > share * size.max()) & (size > 0.0))


def _intervals(t: Array, is_on: Flags) -> list[tuple[float, float]]:
    """Begin and end of the stretches, joined over short gaps; without those below LEAST_CONTACT."""
    joined: list[tuple[float, float]] = []
    for stretch in stretches(is_on):
        span = float(t[stretch.start]), float(t[stretch.stop - 1])
        if joined and span[0] - joined[-1][1] < CONTACT_SLACK:
            span = joined.pop()[0], span[1]
        joined.append(span)
    return [span for span in joined if span[1] - span[0] >= LEAST_CONTACT]


def _meet(one: tuple[float, float], other: tuple[float, float]) -> bool:
    return one[0] <= other[1] + CONTACT_SLACK and other[0] <= one[1] + CONTACT_SLACK
