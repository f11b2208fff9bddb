"""How long faults that begin in a log are valid and wrong, and what they cost sound pushes.

Faults of currents, and pushes, are put into contact-free recordings for FAULT_TIME, LEAD_TIME after
the begin of a part of the recording. The part is read sample by sample, as a stream is, by the
estimator's defaults.

    number                      of parts
    valid_and_wrong_s           longest time in which a valid reading is more than MAX_FORCE_ERROR
                                outside its band, in any recording
    checked_valid_and_wrong_s   the same of CHECKED_LOGS
    too_long                    parts in which that time is above MAX_WRONG_TIME
    largest_n                   by how much a valid reading is outside its band, at most
    A valid reading that is no number counts as infinitely far outside.

Of pushes, and of parts without any:

    wrong_signal_pct            of their readings: not valid for no other reason
    checked_wrong_signal_pct    the same of CHECKED_LOGS
    worst_wrong_signal_pct      that of the push that loses most
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from wrenchsight.analyses.experiments.faults.begun_faults import BEGUN_FAULTS, COURSES, push
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import log_file
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.models.estimation.estimator import (
    EstimateBatch,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.estimation.invalid import WRONG_SIGNAL
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.stretches import stretches
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.recordings.position_resolution import position_resolution
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import read_recording
from wrenchsight.models.recordings.resampling import resampled
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.bands import SIGMA_95

SIGHTED_LOGS = {
    "ur-20_02_19_14harm50sec": (0.2, 0.45, 0.7),
    "ur-20_02_19_15harm50sec": (0.3, 0.6),
    "ur-20_01_17-ptp_10_points": (0.3, 0.6),
    "ur-20_02_10-20sec_7harm": (0.3, 0.6),
    "ur-19_12_23_free": (0.3, 0.6),
}
"""Recordings that were in sight when the rules and constants of late and early currents were
settled, and where in them, as a share of the log, a fault begins."""
CHECKED_LOGS = {
    "ur-20_02_06-20sec_10harm": (0.3, 0.6),
    "ur-20_01_31-unload": (0.3, 0.6),
    "ur-20_02_06-20sec_5harm": (0.3, 0.6),
    "ur-20_02_05-20sec_8harm": (0.3, 0.6),
}
"""The same of recordings from which no rule was taken."""
LEAD_TIME, FAULT_TIME, TAIL_TIME = 4.0, 4.0, 2.0  # s of a part before, in and after the fault
NUM_PUSHES = 36  # in a part
MAX_FORCE_ERROR = 10.0  # N beyond the band
MAX_WRONG_TIME = 0.5  # s


class _Part(NamedTuple):
    """A part of a recording.

    Attributes:
        log: the whole recording, at even times.
        whole: samples of the part in the log.
        fault: those of them in which something is wrong, or pushes.
        is_checked: whether the recording is one of CHECKED_LOGS.
    """

    log: Recording
    whole: slice
    fault: slice
    is_checked: bool

    @property
    def fault_in_part(self) -> slice:
        """The fault's samples, counted from the part's begin."""
        begin = self.whole.start
        return slice(self.fault.start - begin, self.fault.stop - begin)


@dataclass
class _Kind:
    """What is gathered of one kind, over all parts; entries are times or shares, and is_checked."""

    values: list[float] = field(default_factory=list)
    are_checked: list[bool] = field(default_factory=list)
    largest: float = 0.0  # N

    def take(self, value: float, is_checked: bool) -> None:
        """Adds what was measured in one part."""
        self.values.append(value)
        self.are_checked.append(is_checked)

    @property
    def checked(self) -> list[float]:
        """The values of CHECKED_LOGS."""
        return [x for x, is_in in zip(self.values, self.are_checked, strict=True) if is_in]


def measure_beginnings(
    data: Path | None,
    robot: Robot,
    model: IdentifiedModel,
    quick: bool,
    progress: ProgressCallback,
) -> dict[str, Any]:
    """The figures of faults and pushes, by kind.

    Args:
        data: folder of recordings; None: the default places.
        model: that reads.
        quick: whether one place of one recording must do.

    Raises:
        InputError: a recording is missing.
    """
    places = list((SIGHTED_LOGS | CHECKED_LOGS).items())
    if quick:
        places = [(name, shares[:1]) for name, shares in places[-1:]]
    faults = {kind: _Kind() for kind in BEGUN_FAULTS}
    pushes = {course: _Kind() for course in ("none", *COURSES)}
    for k, (name, shares) in enumerate(places):
        progress(k / len(places), name)
        recording = read_recording(log_file(data, name), robot=robot)
        log = resampled(recording)
        config = WrenchEstimatorConfig(
            MomentumObserverConfig(time_step=log.time_step),
            position_resolution=position_resolution(recording.q).tolist(),
        )
        estimator = WrenchEstimator(robot, model, config)
        for share in shares:
            part = _part(log, share, name in CHECKED_LOGS)
            _take_faults(estimator, part, faults)
            _take_pushes(estimator, part, pushes)
    return {
        "begun": {kind: _fault_metrics(gathered) for kind, gathered in faults.items()},
        "pushes": {course: _push_metrics(gathered) for course, gathered in pushes.items()}
        | {"all": _push_metrics(_together([pushes[course] for course in COURSES]))},
    }


def _part(log: Recording, share: float, is_checked: bool) -> _Part:
    """The part of a log whose fault begins at this share of it."""
    begin = int(share * log.num_samples)
    lead, length, tail = (int(time / log.time_step) for time in (LEAD_TIME, FAULT_TIME, TAIL_TIME))
    whole = slice(max(0, begin - lead), min(log.num_samples, begin + length + tail))
    return _Part(log, whole, slice(begin, min(begin + length, whole.stop)), is_checked)


def _read(estimator: WrenchEstimator, part: _Part, current: Array) -> EstimateBatch:
    """Reads a part with the currents (M, n) that the fault's samples have."""
    log = part.log
    currents = log.current[part.whole].copy()
    currents[part.fault_in_part] = current
    state = estimator.initial_state()
    return estimator.run(state, log.q[part.whole], log.v[part.whole], currents)


def _take_faults(estimator: WrenchEstimator, part: _Part, faults: dict[str, _Kind]) -> None:
    """Reads the part with each fault; adds how long it is valid and wrong."""
    T = part.log.time_step
    for kind, variants in BEGUN_FAULTS.items():
        for fault in variants:
            batch = _read(estimator, part, fault(part.log.current, part.fault, T))
            excess = _excess(batch)
            excess[: part.fault_in_part.start] = 0.0
            lengths = [s.stop - s.start for s in stretches(excess > MAX_FORCE_ERROR)]
            faults[kind].take(max(lengths, default=0) * T, part.is_checked)
            faults[kind].largest = max(faults[kind].largest, float(excess.max()))


def _excess(batch: EstimateBatch) -> Array:
    """(M,) N, by how much each reading of an arm that nothing touches is outside its band.

    0 where it is not valid, infinite where it is valid and no number.
    """
    beyond = np.abs(batch.wrench[:, 3:]) - SIGMA_95 * batch.standard_deviation[:, 3:]
    excess = beyond.max(axis=1)
    return np.where(batch.valid, np.where(np.isnan(excess), np.inf, excess), 0.0)


def _take_pushes(estimator: WrenchEstimator, part: _Part, pushes: dict[str, _Kind]) -> None:
    """Reads the part as it is and with each push; adds the share of the readings that is lost."""
    log, span = part.log, part.fault
    J = estimator.chain.jacobian(log.q[span])
    free = log.current[span]

    def take(course: str, current: Array) -> None:
        batch = _read(estimator, part, current)
        is_lost = batch.invalid[part.fault_in_part] == WRONG_SIGNAL
        pushes[course].take(100.0 * float(is_lost.mean()), part.is_checked)

    take("none", free)
    for seed in range(NUM_PUSHES):
        pushed = push(seed, len(free), log.time_step)
        tau = np.einsum("kaj,ka->kj", J, pushed.wrench)
        take(pushed.course, free - estimator.robot.motor_current(tau))


def _together(kinds: list[_Kind]) -> _Kind:
    """What was gathered of several kinds."""
    together = _Kind()
    for kind in kinds:
        together.values += kind.values
        together.are_checked += kind.are_checked
    return together


def _fault_metrics(gathered: _Kind) -> dict[str, Any]:
    return {
        "number": len(gathered.values),
        "valid_and_wrong_s": max(gathered.values),
        "checked_valid_and_wrong_s": max(gathered.checked, default=None),
        "too_long": sum(time > MAX_WRONG_TIME for time in gathered.values),
        "largest_n": gathered.largest,
    }


def _push_metrics(gathered: _Kind) -> dict[str, Any]:
    checked = gathered.checked
    return {
        "number": len(gathered.values),
        "wrong_signal_pct": float(np.mean(gathered.values)),
        "checked_wrong_signal_pct": float(np.mean(checked)) if checked else None,
        "worst_wrong_signal_pct": max(gathered.values),
    }
