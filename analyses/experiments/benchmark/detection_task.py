"""Task `detection`: contacts of a moving UR10e, found from its currents.

Forces of 30 N for half a second, put into the currents of free motion; hand collisions of a log;
and free motion of other weeks and static postures, in which every alarm is false.

`ours` is the detector of the product at one false alarm an hour. All others, and `ours_by_level`,
compare the external torque of each joint with a level: the largest that this joint had in the three
fitted runs. Above it they raise an alarm. (A method of others that states a wrench alone has a
level for the force, in units of its covariance where it states one.) `quiet_missed` raises all
levels by one factor until no contact-free log has an alarm, and counts the pushes that are missed.
Alarms less than PUSH_GAP apart are one.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from wrenchsight.analyses.experiments.benchmark.arm import (
    CurrentLog,
    MethodReading,
    Reader,
    Ur10eArm,
)
from wrenchsight.analyses.experiments.benchmark.entrants import Entrant, reader_of
from wrenchsight.analyses.experiments.benchmark.scores import share
from wrenchsight.analyses.experiments.setups.ur10e_recordings.contact_trials import (
    COLLISION_LOG,
    COLLISION_TIMES,
    FALSE_ALARM_RATE,
    FREE_MOTION_LOGS,
    NUM_ROUNDS,
    OLDER_LOGS,
    REST_LOGS,
    SINGLE_JOINT_LOGS,
    TIME_STEP,
    Tally,
    TrialLog,
    false_alarm_metrics,
    onsets,
    put_in,
    samples_of,
    spans_of,
)
from wrenchsight.analyses.experiments.setups.ur10e_recordings.ur10e_logs import log_file
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.models.detection.contact_detector import Detection
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.stretches import stretches
from wrenchsight.models.recordings.recording_reader import read_recording

PUSH_FORCE: Final = 30.0  # N
PUSH_TIME: Final = 0.5  # s
PUSH_GAP: Final = 0.5  # s
SETTLING_TIME: Final = 1.0  # s after a log's begin
ALARM_TIME: Final = 1.0  # s after a collision in which an alarm is its own
_MIN_STATISTIC: Final = 1e-9
_DETECTED_RATIO: Final = 2.0
# Of a log's name, and a torque from outside (N, n) N m that is put into it (None: none): (N,) how
# far the method's reading goes, over its own level: an alarm where it is above 1.
Statistic = Callable[[str, Array | None], Array]


class DetectionTask:
    """Contacts found, contacts missed and false alarms."""

    def __init__(self, arm: Ur10eArm, quick: bool) -> None:
        self._arm, self._rounds = arm, 1 if quick else NUM_ROUNDS
        files = (
            FREE_MOTION_LOGS
            | SINGLE_JOINT_LOGS
            | OLDER_LOGS
            | REST_LOGS
            | {"collision_wrist": COLLISION_LOG}
        )
        paths = {name: log_file(arm.data, Path(file).stem) for name, file in files.items()}
        self._recordings = {
            name: read_recording(path, robot=arm.robot)
            for name, path in paths.items()
            if path.is_file()
        }
        self._logs = {
            name: CurrentLog.of(name, recording) for name, recording in self._recordings.items()
        }
        self._fitted = [
            CurrentLog.of(f"fitted {k}", recording)
            for k, recording in enumerate(arm.fitted, start=1)
        ]

    def built_in(self, progress: ProgressCallback) -> dict[str, dict[str, Any]]:
        """Scores by method."""
        scores = {}
        readers = self._arm.readers(self._arm.robot)
        for k, (method, reader) in enumerate(readers.items()):
            progress(k / len(readers), f"contacts, {method}")
            logs = list(self._logs)
            if method == "plain":  # which needs the controller's target
                logs = [name for name in logs if self._logs[name].target is not None]
            key = "ours_by_level" if method == "ours" else method
            scores[key] = self._counted(self._by_level(reader), logs)
        scores["ours"] = self._counted(self._by_detector(), list(self._logs))
        return scores

    def of(self, entrant: Entrant) -> dict[str, Any] | None:
        """Scores of a method of others; None: it does not enter.

        Raises:
            FaultError: it fails.
        """
        arm, model = self._arm, self._arm.models["ours"]
        made = entrant.made("detection", arm.robot, model, arm.fitted, TIME_STEP)
        if made is None:
            return None
        reader = reader_of(made, arm.robot, model, TIME_STEP)
        return self._counted(self._by_level(reader), list(self._logs))

    def _by_level(self, reader: Reader) -> Statistic:
        settled = round(SETTLING_TIME / TIME_STEP)
        sizes = [_sizes(reader(log))[settled:].max(axis=0) for log in self._fitted]
        level = np.maximum(np.max(sizes, axis=0), _MIN_STATISTIC)

        def statistic(name: str, tau: Array | None) -> Array:
            log = self._logs[name] if tau is None else self._with(name, tau)
            largest: Array = (_sizes(reader(log)) / level).max(axis=1)
            largest[:settled] = 0.0
            return largest

        return statistic

    def _with(self, name: str, tau: Array) -> CurrentLog:
        log = self._logs[name]
        return replace(log, current=log.current - self._arm.robot.motor_current(tau))

    def _by_detector(self) -> Statistic:
        trials = {
            name: TrialLog(recording, self._arm.robot, self._arm.models["ours"])
            for name, recording in self._recordings.items()
        }

        def statistic(name: str, tau: Array | None) -> Array:
            log = trials[name]
            return np.where(
                log.detect(log.detector(FALSE_ALARM_RATE), tau).contact, _DETECTED_RATIO, 0.0
            )

        return statistic

    def _counted(self, statistic: Statistic, names: list[str]) -> dict[str, Any]:
        """Counts a method's alarms in free motion, and what it finds of pushes and collisions.

        A statistic above 1 is an alarm, as 1 is the method's own level.

        Args:
            statistic: see `Statistic`; called with a torque that is put in, and with None.
            names: of the logs that the method reads, one or more free of contact; all are but
                collision_wrist.

        Returns:
            Keys of pushes begin with `pushes_` at the method's own level, with `quiet_` at one so
            high that no contact-free log alarms; those of hand collisions with `collisions_`.
        """
        num_alarms = 0
        hours = 0.0  # without contact
        hours_in_alarm = 0.0  # of these
        quiet_level = 1.0  # above which no contact-free log goes; at least the method's own
        for name in names:
            if name != "collision_wrist":
                values = statistic(name, None)
                alarm = np.asarray(values > 1.0)
                quiet_level = max(quiet_level, float(values.max()))
                num_alarms += len(onsets(_joined(alarm)))
                hours += len(alarm) * TIME_STEP / 3600.0
                hours_in_alarm += float(alarm.sum()) * TIME_STEP / 3600.0
        pushes = Tally()
        quiet_pushes = Tally()
        for number, name in enumerate(FREE_MOTION_LOGS):
            if name not in names:
                continue
            log = self._logs[name]
            J_linear = np.asarray(self._arm.robot.chain.jacobian(log.q))[:, 3:]
            for push_round in range(self._rounds):
                # The same pushes for every method.
                rng = np.random.default_rng((number, push_round))
                spans = spans_of(log.v, PUSH_TIME, push_round)
                values = statistic(name, put_in(spans, J_linear, PUSH_FORCE, rng))
                _tallied(pushes, np.asarray(values > 1.0), spans)
                _tallied(quiet_pushes, np.asarray(values > quiet_level), spans)
        scores = {"pushes": _shares(pushes), "quiet": _shares(quiet_pushes)}
        if "collision_wrist" in names:
            spans = samples_of(COLLISION_TIMES, self._logs["collision_wrist"].t)
            alarm = np.asarray(statistic("collision_wrist", None) > 1.0)
            collisions = Tally()
            _tallied(collisions, alarm, spans)
            alarms_between = _between(alarm, spans)  # apart from every collision
            scores["collisions"] = _shares(collisions) | {"alarms_between": alarms_between}
        return {
            **_flat(scores),
            **false_alarm_metrics(num_alarms, hours),
            "in_alarm_pct": 100.0 * hours_in_alarm / hours,
            "quiet_level": quiet_level,
            "logs": len(names),
        }


def _sizes(reading: MethodReading) -> Array:
    """(N, 1 or n), what a level is set for."""
    if reading.tau_ext is not None:
        return np.asarray(np.abs(reading.tau_ext))
    force = reading.wrench[:, 3:]
    if reading.covariance is None:
        return np.asarray(np.linalg.norm(force, axis=1, keepdims=True))
    inverse = np.linalg.pinv(reading.covariance[:, 3:, 3:], hermitian=True)
    square = np.einsum("ka,kab,kb->k", force, inverse, force)
    return np.asarray(np.sqrt(np.maximum(square, 0.0))[:, None])


def _tallied(tally: Tally, alarm: Flags, spans: list[tuple[int, int]]) -> None:
    nothing = np.zeros(len(alarm), bool)
    none = nothing.astype(np.int8)
    detection = Detection(alarm.astype(float), alarm, nothing, none, nothing, nothing)
    for begin, end in spans:
        tally.add(detection, begin, end, TIME_STEP, None)


def _shares(tally: Tally) -> dict[str, Any]:
    counted = tally.metrics()
    keys = ("contacts", "missed", "delay_median_s", "delay_p95_s", "delay_max_s")
    scores = {key: counted[key] for key in keys}
    if tally.contacts:
        scores |= share("missed", tally.missed, tally.contacts)
        prompt = round(0.01 * counted["within_50ms_pct"] * tally.contacts)
        scores |= share("within_50ms", prompt, tally.contacts)
    return scores


def _joined(alarm: Flags) -> Flags:
    """The alarm with pauses shorter than PUSH_GAP filled."""
    joined = alarm.copy()
    for pause in stretches(~alarm):
        inner = pause.start > 0 and pause.stop < len(alarm)
        if inner and (pause.stop - pause.start) * TIME_STEP < PUSH_GAP:
            joined[pause] = True
    return joined


def _between(alarm: Flags, spans: list[tuple[int, int]]) -> int:
    """Alarms that begin apart from any contact."""
    apart = np.ones(len(alarm), bool)
    for begin, end in spans:
        apart[begin : end + round(ALARM_TIME / TIME_STEP)] = False
    begins: NDArray[np.intp] = onsets(_joined(alarm))
    return int(apart[begins].sum())


def _flat(scores: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    return {
        f"{kind}_{key}": value
        for kind, kind_scores in scores.items()
        for key, value in kind_scores.items()
    }
