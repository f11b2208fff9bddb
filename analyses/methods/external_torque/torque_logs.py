"""What force acts at the tool of an arm that reports its external torque itself?

Some arms (Franka's, KUKA's) measure torque on the output side of their gears and report it less
that of their own model: tau_ext. With the Jacobian, logged or of a robot and its positions,
that is all a wrench needs: no model, friction law or observer of ours has a part in it, and its
error and lag are the arm's. Every row is read as it stands.

The prior and the torque's sd come from the torques of all logs together, unless they are given
(`force_readings`). Logs stream: memory does not grow with their length.
"""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from wrenchsight.analyses.methods.estimate.estimate_config import (
    FLOOR_SHARE,
    PRIORS,
    EstimateConfig,
    EstimateSettings,
    checked_config,
    stated_prior,
)
from wrenchsight.analyses.methods.estimate.estimate_summary import EstimateSummary
from wrenchsight.analyses.methods.external_torque.force_readings import (
    Knowledge,
    MethodReading,
    knowledge_by_evidence,
)
from wrenchsight.analyses.methods.external_torque.rows_beside_sensor import RowsBesideSensor
from wrenchsight.analyses.methods.external_torque.torque_log import TorqueLog
from wrenchsight.analyses.methods.external_torque.torque_touches import TorqueTouches
from wrenchsight.analyses.methods.reference_sensor.comparison import (
    SensorComparison,
    compare_with_sensor,
)
from wrenchsight.analyses.methods.reference_sensor.mounting import find_mounting, tare_of
from wrenchsight.analyses.methods.reference_sensor.reference_config import (
    REFERENCE,
    ReferenceConfig,
)
from wrenchsight.analyses.methods.reference_sensor.sensor_log import (
    SensorLogCollector,
    SensorSamples,
    joined_logs,
)
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.analyses.output.stream_summary import EvenSample
from wrenchsight.models.estimation.wrench import WrenchReconstruction, live_prior
from wrenchsight.models.estimation.wrench_bag import WrenchBagWriter
from wrenchsight.models.estimation.wrench_table import WrenchTableWriter
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import Validity
from wrenchsight.models.recordings.layouts.external_torque import TAU_EXT
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.resampling import plausible_step
from wrenchsight.models.rigid_body.spatial_vectors import FORCE_FIRST
from wrenchsight.models.robot.robot import Robot

ProgressCallback = Callable[[float, str], None]

_WRENCH_NUMBERS = 6
_ROWS = 1 << 16  # rows of all logs that the evidence, and of a log that the comparison looks at


@dataclass(frozen=True, eq=False)
class TorqueLogResult:
    """One log, read.

    Attributes:
        name: of the log; its table is wrench.csv, or wrench_<name>.csv where there are several.
        num_samples: rows.
        valid_share: of the rows that may be trusted.
        table: of the wrenches.
        metrics: as written to metrics.json.
        comparison: with the log's force sensor, where one is named.
        contacts: one sentence each, or one that there is none.
    """

    name: str
    num_samples: int
    valid_share: float
    table: Path
    metrics: dict[str, Any]
    comparison: SensorComparison | None
    contacts: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class TorqueLogsResult:
    """What was read of all logs.

    Attributes:
        logs: each.
        config: as used, with the prior and the torque's sd filled in.
        against_sensor: all logs row by row, where a sensor of three columns or more is named.
        notices: what reading the logs involved, one sentence each.
        warnings: what makes the result doubtful, one sentence each.
    """

    logs: tuple[TorqueLogResult, ...]
    config: EstimateConfig
    against_sensor: MethodReading | None
    notices: tuple[str, ...]
    warnings: tuple[str, ...]
    _metrics: dict[str, Any]

    def metrics(self) -> dict[str, Any]:
        """All figures, as written to metrics.json."""
        return self._metrics


def estimate_torque_logs(
    logs: Sequence[Path],
    robot_name: str | Path | None,
    out: Path,
    log_format: str | Path | None = None,
    config: EstimateConfig | None = None,
    progress: ProgressCallback = lambda fraction, what: None,
) -> TorqueLogsResult:
    """The command `estimate` for logs of external torque: wrenches and their uncertainty.

    Writes for each log a table (see `models.estimation.wrench_table`) and a figure; metrics.json
    and config.yaml.

    Args:
        logs: with the signals `tau_ext` and, unless there is a robot, `jacobian`
            (`models.recordings.layouts.external_torque`). What all have in common, prior, torque
            noise and how a sensor is mounted, is found from all together.
        robot_name: whose Jacobian is taken where a log holds none, and whose payload the prior
            rests on; None: the logs hold the Jacobian.
        log_format: description of the logs' columns.

    Raises:
        InputError: as `Robot.load`, `RecordingReader` and `result_folder`; a setting that makes no
            sense, or has no part in this.
    """
    config = config or EstimateConfig()
    with result_folder(out, "estimate") as folder:
        robot = None if robot_name is None else Robot.load(robot_name)
        config = _checked(config, robot)
        settings = EstimateSettings(
            log=str(logs[0]),
            further_logs=[str(log) for log in logs[1:]],
            robot="" if robot_name is None else str(robot_name),
            log_format=None if log_format is None else str(log_format),
            estimate=config,
        )
        sources = [
            TorqueLog(log, log_format, robot, config.check, config.reference, config.torque_sign)
            for log in logs
        ]
        result = _estimate(sources, robot, folder, settings, progress)
    return replace(
        result, logs=tuple(replace(log, table=out / log.table.name) for log in result.logs)
    )


def _checked(config: EstimateConfig, robot: Robot | None) -> EstimateConfig:
    checked_config(config, robot)
    plain = EstimateConfig()
    idle = [
        option
        for option, entry, default in (
            ("--smooth", config.smooth, plain.smooth),
            ("--max-gap", config.max_gap, plain.max_gap),
            ("--observer", config.estimator.observer, plain.estimator.observer),
            ("--false-alarms-per-hour", config.detection, plain.detection),
        )
        if entry != default
    ]
    if idle:
        problem = "is not used with the external torque that the arm reports"
        raise InputError("estimate", ", ".join(idle), problem, "leave it out")
    return config


def _estimate(
    logs: Sequence[TorqueLog],
    robot: Robot | None,
    out: OutputFolder,
    settings: EstimateSettings,
    progress: ProgressCallback,
) -> TorqueLogsResult:
    n = logs[0].num_joints
    for log in logs:
        if log.num_joints != n:
            problem = f"holds the torque of {log.num_joints} joints, {logs[0].path.name} of {n}"
            raise InputError(log.path, TAU_EXT, problem, "read logs of one arm together")
    progress(0.0, "prior and torque noise")
    warnings: list[str] = []
    config, knowledge, rule = _known(logs, robot, settings.estimate, warnings)
    entry = config.estimator.reconstruction
    if robot is not None:  # `valid` rests on the rated payload, else on the reading's own prior
        entry = entry.with_live(*live_prior(robot.payload))
    reading = WrenchReconstruction(entry, knowledge.torque_covariance)
    runs = []
    for k, (log, name) in enumerate(zip(logs, _names(logs), strict=True)):
        progress(0.3 + 0.6 * k / len(logs), f"reading {name}")
        runs.append(_Run(log, name, "" if len(logs) == 1 else f"_{name}", config))
        _read(log, runs[-1], reading, robot, out)
    results, notices = _compared(runs, config.reference, out)
    for run in runs:
        warnings += [sentence for sentence in run.summary.warnings() if sentence not in warnings]
        warnings += run.doubts
    common = {
        "prior": {
            "force_sd_n": knowledge.force_sd,
            "moment_sd_nm": knowledge.moment_sd,
            "rule": rule,
        },
        "torque_sd_nm": np.sqrt(np.diag(knowledge.torque_covariance)),
    }
    against = [run.rows.reading for run in runs if run.rows is not None]
    report = [one for one in against if one is not None and one.loaded.any()]
    together = None
    if report and len(report) == len(runs):
        together = MethodReading(tuple(report))
        for result, one in zip(results, together.logs, strict=True):
            result.metrics["reference"]["rows"] = {
                "sensor_above_n": config.reference.contact_force,
                "count": int(one.loaded.sum()),
                **MethodReading((one,)).of_one(),
            }
    if len(results) == 1:
        metrics = {**results[0].metrics, **common}
    else:
        metrics = {**common, "logs": {result.name: result.metrics for result in results}}
        if together is not None:
            metrics["reference"] = {
                "sensor_above_n": config.reference.contact_force,
                **together.metrics(),
            }
    out.write_settings("config.yaml", replace(settings, estimate=config))
    out.write_json("metrics.json", metrics)
    progress(1.0, "done")
    if against and not report:
        warnings.append(
            f"the sensor never reads more than {config.reference.contact_force:g} N, above which "
            "there is contact: lower it with --reference-contact"
        )
    return TorqueLogsResult(
        logs=tuple(results),
        config=config,
        against_sensor=together,
        notices=(*_notices(logs, runs), *notices),
        warnings=tuple(warnings),
        _metrics=metrics,
    )


def _names(logs: Sequence[TorqueLog]) -> list[str]:
    """Stems of the files' names; a repeated one gets a number."""
    names: list[str] = []
    for log in logs:
        stem, count = log.path.stem, 1
        name = stem
        while name in names:
            count += 1
            name = f"{stem}_{count}"
        names.append(name)
    return names


def _notices(logs: Sequence[TorqueLog], runs: Sequence["_Run"]) -> list[str]:
    report = [sentence for run in runs for sentence in run.notices]
    report.append(
        "read from the arm's own external torque: no model, friction law or observer has a part "
        "in it; its error and its lag are the arm's"
    )
    if all(log.has_jacobian for log in logs):
        report.append("the wrench is at the point and in the axes of the log's Jacobian")
    return list(dict.fromkeys(report))


def _known(
    logs: Sequence[TorqueLog], robot: Robot | None, config: EstimateConfig, warnings: list[str]
) -> tuple[EstimateConfig, Knowledge, str]:
    """The configuration with prior and torque sd, these as `Knowledge`, and the prior's rule."""
    n = logs[0].num_joints
    entry, rule = config.estimator.reconstruction, "given"
    sd = np.array(config.torque_sd)
    if sd.size not in (0, 1, n):
        problem = f"has {sd.size} numbers, expected 1 or {n}"
        raise InputError("estimate", "--torque-sd", problem, "give one for all joints or one each")
    stated = stated_prior(config, robot)
    if stated is not None and None in (entry.prior_force_sd, entry.prior_moment_sd):
        entry = entry.with_prior(*stated)
        rule = config.prior if config.prior in PRIORS else "given"
    if not sd.size and n <= _WRENCH_NUMBERS:
        warnings.append(
            f"a wrench explains any torque of {n} joints: the torque's error shows by the changes "
            "of posture alone; give --torque-sd"
        )
    if not sd.size or None in (entry.prior_force_sd, entry.prior_moment_sd):
        J, tau_ext = EvenSample(_ROWS), EvenSample(_ROWS)
        for log in logs:
            for _, J_rows, torque in log.chunks(log.reader()):
                J.add(J_rows)
                tau_ext.add(torque)
        stated_sd = np.broadcast_to(sd, n) if sd.size else None
        result = knowledge_by_evidence(J.values(), tau_ext.values(), stated_sd)
        sd = np.sqrt(np.diag(result.torque_covariance))
        if None in (entry.prior_force_sd, entry.prior_moment_sd):
            rule = "evidence of the log" + ("s" if len(logs) > 1 else "")
            least = (0.0, 0.0) if robot is None else live_prior(robot.payload)
            entry = entry.with_prior(
                max(result.force_sd, FLOOR_SHARE * least[0]),
                max(result.moment_sd, FLOOR_SHARE * least[1]),
            )
    sd = np.broadcast_to(sd, n)
    config = replace(
        config,
        torque="external",
        torque_sd=[float(x) for x in sd],
        estimator=replace(config.estimator, reconstruction=entry),
    )
    assert entry.prior_force_sd is not None and entry.prior_moment_sd is not None
    return config, Knowledge(entry.prior_force_sd, entry.prior_moment_sd, np.diag(sd**2)), rule


class _Run:
    """One log as it is read: its table is written, and what metrics and comparison need kept."""

    def __init__(self, log: TorqueLog, name: str, suffix: str, config: EstimateConfig) -> None:
        self.name, self.suffix, self.config = name, suffix, config
        self.table = f"wrench{suffix}.{config.table}"
        names = [f"joint {j + 1}" for j in range(log.num_joints)]
        self.summary = EstimateSummary(names, Validity(), 0.0)
        self.touches = TorqueTouches(log)
        self.beside: SensorLogCollector | None = None
        self.rows: RowsBesideSensor | None = None
        self.notices: tuple[str, ...] = ()
        self.doubts: list[str] = []

    def start(self, chunk: Recording) -> None:
        """Fills in what the first rows of the log tell."""
        step = float(plausible_step(chunk))
        estimator = self.config.estimator
        observer = replace(estimator.observer, time_step=step)
        self.config = replace(self.config, estimator=replace(estimator, observer=observer))
        if self.config.reference.columns:
            self.beside, self.rows = SensorLogCollector(step), RowsBesideSensor(_ROWS)


def _read(
    log: TorqueLog,
    run: _Run,
    reading: WrenchReconstruction,
    robot: Robot | None,
    out: OutputFolder,
) -> None:
    """Reads every row of a log, and writes its table and figure."""
    touches, reader, config = run.touches, log.reader(), run.config
    with ExitStack() as stack:
        writer = WrenchTableWriter(out / run.table, log.num_joints, config.covariance)
        table = stack.enter_context(writer)
        bag: WrenchBagWriter | None = None
        if config.mcap:
            bag = stack.enter_context(_bag(log, out / f"wrench{run.suffix}.mcap", robot))
        for chunk, J, tau_ext in log.chunks(reader):
            if not run.summary.count:
                run.start(chunk)
            batch = reading.reconstruct(J, tau_ext)
            detection, odds, may_be_valid = touches.take(chunk, J, tau_ext)
            batch = batch._replace(valid=batch.valid & may_be_valid)
            sd = batch.standard_deviation
            valid = run.summary.judge(chunk, batch, run.config.estimator)
            table.write(
                chunk.t,
                batch.wrench,
                sd,
                batch.condition_number,
                valid,
                np.nan_to_num(tau_ext),
                detection.statistic,
                {**detection._asdict(), "fault": np.zeros(chunk.num_samples, np.int8)},
                batch.covariance,
            )
            if bag is not None and robot is not None:
                _, p_WE = robot.chain.pose(np.nan_to_num(chunk.q))
                bag.write(chunk.t, batch.wrench, batch.covariance, p_WE)
            touches.episodes.add(chunk.t, detection, batch.wrench[:, 3:], valid, odds)
            run.summary.add(chunk, batch, sd, valid, tau_ext, detection.contact)
            if run.beside is not None and run.rows is not None:
                R_WE, sensor = log.axes(chunk), chunk.extra[REFERENCE]
                v = chunk.v if chunk.num_joints else np.zeros((chunk.num_samples, 1))
                run.beside.add(
                    SensorSamples(
                        t=chunk.t,
                        reading=batch.wrench[:, FORCE_FIRST],
                        sd=sd[:, FORCE_FIRST],
                        valid=np.asarray(valid, float),
                        R_WE=R_WE,
                        v=v,
                        sensor=sensor,
                    )
                )
                run.rows.add(chunk.t, batch, R_WE, sensor)
    touches.episodes.finish()
    run.notices = reader.notices
    if touches.sign.contradicts:
        run.doubts.append(touches.sign.sentence(log.path.name, log.exerted_on))
    reads_moments = config.estimator.reconstruction.method != "force_only"
    out.write_figure(f"wrench{run.suffix}", run.summary.figure(reads_moments))


def _bag(log: TorqueLog, path: Path, robot: Robot | None) -> WrenchBagWriter:
    if robot is None or not log.has_positions or log.has_jacobian:
        problem = "says where E is, which only a robot and its positions tell"
        raise InputError("estimate", "--mcap", problem, "leave it out")
    return WrenchBagWriter(path, robot.config.base_link)


def _compared(
    runs: Sequence[_Run], reference: ReferenceConfig, out: OutputFolder
) -> tuple[list[TorqueLogResult], tuple[str, ...]]:
    """Each log's result, compared with its sensor, which is mounted alike in all of them."""
    beside = [run.beside.log() for run in runs if run.beside is not None]
    sensor_logs = [log for log in beside if log is not None]
    if len(sensor_logs) != len(beside):
        problem = "a log is too short to compare with"
        raise InputError("estimate", "--reference", problem, "record a longer one")
    mounting, notices = None, tuple[str, ...]()
    if sensor_logs:
        mounting, notices = find_mounting(joined_logs(sensor_logs), reference)
    results = []
    for k, run in enumerate(runs):
        metrics = _own_metrics(run)
        comparison = None
        if mounting is not None:
            entry = mounting
            if reference.tare == "start":  # each log has its own
                own = sensor_logs[k]
                entry = replace(mounting, tare=tare_of(own.t, own.sensor, reference))
            comparison = compare_with_sensor(sensor_logs[k], reference, entry)
            metrics["reference"] = comparison.metrics()
            if run.rows is not None:
                run.rows.hold_against(entry, reference.contact_force)
            out.write_figure(f"reference{run.suffix}", comparison.figure("from external torque"))
        count, contacts = run.summary.count, tuple(run.touches.episodes.lines())
        of_log = run.name, count, run.summary.num_valid / count, out / run.table
        results.append(TorqueLogResult(*of_log, metrics, comparison, contacts))
    return results, notices


def _own_metrics(run: _Run) -> dict[str, Any]:
    """Of one log, without figures that need an observer or a model."""
    metrics = run.summary.metrics(run.config.estimator, "")
    for key in ("faults", "outside_model", "prior"):
        del metrics[key]
    del metrics["invalid"]["observer_settling_pct"]
    error, sign = run.touches.error, run.touches.sign
    metrics["contact"] = run.touches.episodes.metrics()
    metrics["free_torque_sd_nm"] = {"rest": error.rest_sd, "moving": error.moving_sd}
    metrics["torque_sign"] = {
        "contacts": sign.contacts,
        "correlation": sign.correlation if np.isfinite(sign.correlation) else None,
    }
    return metrics
