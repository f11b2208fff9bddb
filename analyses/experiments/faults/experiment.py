"""Supports docs/faults.md, "damaged in each of 45 ways and read with the defaults".

Experiment `faults`: damage done to real recordings, and what is read then. Both tables of that
page are its own.

The model of the UR10e is fitted on its three unloaded runs. Five other contact-free logs are
damaged in each of the ways of `damages` and read by `estimate` with its defaults. Nothing touches
the arm, so that every reading beyond its band is wrong. For each kind, over all logs:

    named               share of the logs in which a hypothesis names a fault
    recognised_after_s  least length of the log with which it is named, of LOG_TIMES and the whole;
                        the longest of the logs in which it is named at all
    valid_and_wrong_s   longest time in which a valid reading is more than MAX_FORCE_ERROR outside
    its band
    largest_n           by how much it is outside, at most; None: no reading is valid
    valid_pct           of the readings
    invalid             shares of those that are not valid, by reason; a log that is refused has
                        none

`rows` has the same of the page's rows, each of several kinds, and the number of damaged logs.
`begun` and `pushes` are faults that begin in a log, and pushes, which are none (`beginnings`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from wrenchsight.analyses.experiments.faults.beginnings import MAX_FORCE_ERROR, measure_beginnings
from wrenchsight.analyses.experiments.faults.damages import DAMAGES
from wrenchsight.analyses.experiments.faults.page import ROWS, tables
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import (
    identify_ur10e,
    log_file,
)
from wrenchsight.analyses.methods.estimate.estimation import estimate_log
from wrenchsight.analyses.study.experiment import (
    ComparisonRow,
    Experiment,
    ExperimentContext,
    ExperimentResult,
)
from wrenchsight.models.estimation.invalid import WRONG_LOG, InvalidCodes
from wrenchsight.models.estimation.invalid_shares import invalid_pct
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.hypotheses.judgement import judge_log
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.stretches import stretches
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.recording_writer import write_recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.bands import SIGMA_95

LOGS = (
    "ur-20_02_05-20sec_8harm",  # the one log of a quick run
    "ur-20_02_19_15harm50sec",
    "ur-20_01_17-ptp_10_points",
    "ur-20_02_10-20sec_7harm",
    "ur-20_01_31-unload",
)
LOG_TIMES = (4.0, 10.0)  # s of a log, from its begin
NOTES = (
    "Longest time in which a valid reading is more than 10 N outside its band, of faults that "
    "begin in a log: <begun.sign.valid_and_wrong_s:.2f> s (sign of one current), "
    "<begun.late_500_ms.valid_and_wrong_s:.2f> and <begun.early_500_ms.valid_and_wrong_s:.2f> s "
    "(currents 0.5 s late, early), <begun.drift.valid_and_wrong_s:.2f> s (drift of 1 A/s in one "
    "motor). Pushes lose <pushes.all.wrong_signal_pct:.2f> % of their readings.",
)


def run(context: ExperimentContext) -> ExperimentResult:
    """Identifies, damages, reads, and compares with zero."""
    robot = Robot.load("ur10e")
    model = identify_ur10e(context.data, robot, progress=context.part(0.0, 0.05)).model
    begun_progress = context.part(0.05, 0.1)
    metrics = measure_beginnings(context.data, robot, model, context.quick, begun_progress)
    logs = LOGS[:1] if context.quick else LOGS
    recordings = [read_recording(log_file(context.data, log), robot=robot) for log in logs]
    for k, (kind, damage) in enumerate(DAMAGES.items()):
        context.progress(0.1 + 0.9 * k / len(DAMAGES), kind)
        damaged = [damage(resampled(recording), robot) for recording in recordings]
        metrics[kind] = _kind_metrics(damaged, robot, model, context.out)
    metrics["rows"] = {row: _row_metrics(metrics, kinds, len(logs)) for row, kinds in ROWS.items()}
    rows = [
        ComparisonRow("nothing wrong: logs called wrong, of one", "none.named"),
        ComparisonRow("currents 200 ms late: valid and wrong", "late_200_ms.valid_and_wrong_s"),
        ComparisonRow("currents 300 ms early: valid and wrong", "early_300_ms.valid_and_wrong_s"),
        ComparisonRow("joint 2 counts the other way", "joint_2_turned.valid_and_wrong_s"),
        ComparisonRow(
            "currents 500 ms early, from within a log on: valid and wrong",
            "begun.early_500_ms.valid_and_wrong_s",
        ),
        ComparisonRow(
            "readings of pushes taken for a wrong signal",
            "pushes.all.wrong_signal_pct",
        ),
    ]
    return ExperimentResult(
        metrics=metrics, comparison=tuple(rows), notes=NOTES, tables=tables(metrics)
    )


def _row_metrics(metrics: Mapping[str, Any], kinds: Sequence[str], num_logs: int) -> dict[str, Any]:
    """The figures of several kinds of damage together."""

    def largest(key: str) -> float | None:
        values = [metrics[kind][key] for kind in kinds]
        return max((value for value in values if value is not None), default=None)

    keys = ("recognised_after_s", "valid_and_wrong_s", "largest_n")
    num_named = round(sum(metrics[kind]["named"] for kind in kinds) * num_logs)
    return {"number": len(kinds) * num_logs, "named": num_named} | {k: largest(k) for k in keys}


def _kind_metrics(
    logs: list[Recording], robot: Robot, model: IdentifiedModel, out: Path
) -> dict[str, Any]:
    """The figures of one kind of damage over all logs.

    A log that is recognised as damaged, whole, has no valid reading. The others are read, and what
    is valid and wrong in them is measured.

    Args:
        logs: contact-free logs, damaged.
        out: folder in which they are written and read.

    Returns:
        `named` is the share of logs recognised when they are whole; `recognised_after_s` the time
        of a log, from its begin, that sufficed for each of those (None: none was recognised).
    """
    recognised_after: list[float] = []  # s, of each log that is recognised
    results: list[_Wrongness] = []  # of each log
    for log in logs:
        # The first seconds of the log, then all of it.
        lengths = [length for length in LOG_TIMES if length < log.duration]
        parts = [log[log.t - log.t[0] <= length] for length in lengths]
        are_recognised = [_is_named(part, robot, model) for part in (*parts, log)]
        if are_recognised[-1]:
            # The shortest part that suffices; a longer one may show the fault less clearly.
            recognised_after.append([*lengths, log.duration][are_recognised.index(True)])
            codes = np.full(log.num_samples, WRONG_LOG)
            results.append(_Wrongness(time=0.0, excess=0.0, valid_share=0.0, invalid=codes))
        else:
            results.append(_wrongness(log, robot, model, out))
    return {
        "named": len(recognised_after) / len(logs),
        "recognised_after_s": max(recognised_after) if recognised_after else None,
        "valid_and_wrong_s": max(result.time for result in results),
        "largest_n": max((r.excess for r in results if r.valid_share > 0.0), default=None),
        "valid_pct": float(np.mean([100.0 * result.valid_share for result in results])),
        "invalid": invalid_pct(np.concatenate([result.invalid for result in results])),
    }


def _is_named(log: Recording, robot: Robot, model: IdentifiedModel) -> bool:
    judgement = judge_log([log], robot, model)
    return judgement is not None and judgement.fault is not None


class _Wrongness(NamedTuple):
    """What is valid and wrong in a reading of a log without contact.

    Attributes:
        time: s, the longest in which a valid reading is more than MAX_FORCE_ERROR outside its band.
        excess: N, by how much a valid reading is outside at most.
        valid_share: of the readings.
        invalid: (N,) reasons of the readings.
    """

    time: float
    excess: float
    valid_share: float
    invalid: InvalidCodes


def _wrongness(log: Recording, robot: Robot, model: IdentifiedModel, out: Path) -> _Wrongness:
    """Reads a log with the defaults; nothing is wrong in one that is refused."""
    with TemporaryDirectory(dir=out) as folder:
        path, model_path = Path(folder) / "log.csv", Path(folder) / "model.yaml"
        write_recording(replace(log, extra={}, row=None), path)
        model.save(model_path)
        try:
            # Nobody looks at the figures of a damaged log.
            result = estimate_log(path, robot.name, model_path, Path(folder) / "out", draws=False)
        except InputError:
            return _Wrongness(0.0, 0.0, 0.0, np.zeros(0, np.int64))
        table = np.genfromtxt(result.table, delimiter=",", names=True)
    excess = np.max([np.abs(table[f"f{x}"]) - SIGMA_95 * table[f"sd_f{x}"] for x in "xyz"], axis=0)
    is_valid = table["valid"] > 0.0
    is_wrong = is_valid & (excess > MAX_FORCE_ERROR)
    lengths = [stretch.stop - stretch.start for stretch in stretches(is_wrong)]
    return _Wrongness(
        time=max(lengths, default=0) * float(np.median(np.diff(table["t"]))),
        excess=max(0.0, float(excess[is_valid].max(initial=0.0))),
        valid_share=float(is_valid.mean()),
        invalid=table["invalid"].astype(np.int64),
    )


EXPERIMENT = Experiment(
    name="faults",
    title="Damage done to real recordings, and what is read then",
    section="recordings of a UR10e",
    run=run,
    needs=("ur10e", "ur10e_more"),
    order=158,
    seconds=700,
)
