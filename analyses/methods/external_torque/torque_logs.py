"""The command `estimate` for logs of the controller's external torque.

Some arms (Franka's, KUKA's) measure torque on the output side of their gears and report it less the
torque of their own model: tau_ext. A wrench needs only tau_ext and the Jacobian, logged or of a
robot and its positions. No model, friction law or observer of this package has a part in it; its
error and lag are the controller's.

    logs -> prior and torque sd -> wrenches, contacts -> comparison with a sensor -> files

The prior and the torque's sd come from the torques of all logs together, unless they are stated
(`force_readings`). Logs stream: memory does not grow with their length.
"""

from collections.abc import Sequence
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
from wrenchsight.analyses.methods.estimate.log_readings import table_rows
from wrenchsight.analyses.methods.external_torque.force_readings import (
    Knowledge,
    LogReading,
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
from wrenchsight.analyses.methods.reference_sensor.mounting import Mounting, find_mounting, tare_of
from wrenchsight.analyses.methods.reference_sensor.reference_config import (
    REFERENCE,
    ReferenceConfig,
)
from wrenchsight.analyses.methods.reference_sensor.sensor_log import (
    BLOCK_TIME,
    SensorLog,
    SensorLogCollector,
    SensorSamples,
    joined_logs,
)
from wrenchsight.analyses.output.distinct_names import distinct_names
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.analyses.output.stream_summary import EvenSample
from wrenchsight.models.estimation.invalid import OTHER_LINK, SAMPLE_MISSING, marked
from wrenchsight.models.estimation.wrench import (
    ValidityLimits,
    WrenchEstimate,
    WrenchReconstruction,
)
from wrenchsight.models.estimation.wrench_bag import WrenchBagWriter
from wrenchsight.models.estimation.wrench_prior import live_prior
from wrenchsight.models.estimation.wrench_table import WrenchTableWriter
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import Validity
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.plausibility.effort_unit import NO_GRAVITY
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_format import TAU_EXT
from wrenchsight.models.recordings.resampling import plausible_step
from wrenchsight.models.rigid_body.spatial_vectors import FORCE_FIRST
from wrenchsight.models.robot.robot import Robot

_WRENCH_NUMBERS = 6
_MAX_ROWS = 1 << 16  # of all logs for the evidence, and of each log for the comparison


@dataclass(frozen=True, eq=False)
class TorqueLogResult:
    """Result of one log.

    Attributes:
        name: name of the log; its table is wrench.csv, or wrench_<name>.csv where there are
            several.
        num_samples: rows.
        valid_share: share of the rows that may be trusted.
        table: table of the wrenches.
        metrics: as written to metrics.json.
        comparison: with the log's force sensor, where one is named.
        contacts: one sentence each, or one that there is none.
        invalid: why rows are not valid, and what would help most; empty where all are valid.
    """

    name: str
    num_samples: int
    valid_share: float
    table: Path
    metrics: dict[str, Any]
    comparison: SensorComparison | None
    contacts: tuple[str, ...]
    invalid: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class TorqueLogsResult:
    """Result of all logs.

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
    progress: ProgressCallback = lambda fraction, action: None,
) -> TorqueLogsResult:
    """The command `estimate` for logs of external torque: wrenches and their uncertainty.

    Writes for each log a table (see `models.estimation.wrench_table`) and a figure; metrics.json
    and config.yaml.

    Args:
        logs: with the signals `tau_ext` and, unless there is a robot, `jacobian`
            (`models.recordings.layouts.external_torque`). Prior, torque noise and the sensor's
            mounting are found from all logs together.
        robot_name: whose Jacobian is taken where a log holds none, and whose payload the prior
            rests on; None: the logs hold the Jacobian.
        out: folder of the result.
        log_format: description of the logs' columns; None: found from their names.
        config: None: the defaults.
        progress: called with the share done, 0 to 1, and the current step.

    Raises:
        InputError: as `Robot.load`, `RecordingReader` and `result_folder`; a setting that makes no
            sense, or is not used here.
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
    """Returns the configuration.

    Raises:
        InputError: a setting that makes no sense, or is not used here.
    """
    checked_config(config, robot)
    defaults = EstimateConfig()
    unused = [
        option
        for option, entry, default in (
            ("--smooth", config.smooth, defaults.smooth),
            ("--max-gap", config.max_gap, defaults.max_gap),
            ("--observer", config.estimator.observer, defaults.estimator.observer),
            ("--false-alarms-per-hour", config.detection, defaults.detection),
        )
        if entry != default
    ]
    if unused:
        problem = "is not used with the controller's external torque"
        raise InputError("estimate", ", ".join(unused), problem, "leave it out")
    return config


def _estimate(
    logs: Sequence[TorqueLog],
    robot: Robot | None,
    out: OutputFolder,
    settings: EstimateSettings,
    progress: ProgressCallback,
) -> TorqueLogsResult:
    """Reads logs of one arm with one prior and one torque noise, and writes the results.

    Raises:
        InputError: logs of different numbers of joints, or a log that cannot be read.
    """
    n = logs[0].num_joints
    for log in logs:
        if log.num_joints != n:
            problem = f"holds the torque of {log.num_joints} joints, {logs[0].path.name} of {n}"
            raise InputError(log.path, TAU_EXT, problem, "read logs of one arm together")
    progress(0.0, "prior and torque noise")
    prior = _prior_and_noise(logs, robot, settings.estimate)
    config = prior.config
    reconstruction = config.estimator.reconstruction
    if robot is not None:  # `valid` rests on the rated payload, else on the reading's own prior
        reconstruction = reconstruction.with_live(*live_prior(robot.payload))
    reading = WrenchReconstruction(reconstruction, prior.knowledge.torque_covariance)
    runs = []
    for k, (log, name) in enumerate(zip(logs, _names(logs), strict=True)):
        progress(0.3 + 0.6 * k / len(logs), f"reading {name}")
        suffix = "" if len(logs) == 1 else f"_{name}"  # of the names of its files
        run = _Run(log, name, suffix, config)
        run.read(reading, robot, out)
        runs.append(run)
    # First all logs are read: the sensor's mounting is found from all of them. `_compared` then
    # holds the rows beside the sensors against it, on which `_against_sensor` and `_warnings` rest.
    results, mounting_notices = _compared(runs, config.reference, reading.limits, out)
    against_sensor = _against_sensor(runs, results, config.reference)
    metrics = _metrics(prior, results, against_sensor, config.reference)
    out.write_settings("config.yaml", replace(settings, estimate=config))
    out.write_json("metrics.json", metrics)
    progress(1.0, "done")
    return TorqueLogsResult(
        logs=tuple(results),
        config=config,
        against_sensor=against_sensor,
        notices=(*_notices(logs, runs), *mounting_notices),
        warnings=tuple(_warnings(prior, runs, config.reference)),
        _metrics=metrics,
    )


def _against_sensor(
    runs: Sequence["_Run"], results: Sequence[TorqueLogResult], reference: ReferenceConfig
) -> MethodReading | None:
    """All logs row by row beside their sensors, also into the metrics of each log's result.

    After `_compared`, which holds the rows against the sensors. None where the sensor of some log
    is absent, or never reads a contact.
    """
    readings = [run.loaded_rows() for run in runs]
    loaded = [reading for reading in readings if reading is not None]
    if not loaded or len(loaded) != len(runs):
        return None
    for result, reading in zip(results, loaded, strict=True):
        result.metrics["reference"]["rows"] = {
            "sensor_above_n": reference.contact_force,
            "count": int(reading.loaded.sum()),
            **MethodReading((reading,)).of_one(),
        }
    return MethodReading(tuple(loaded))


def _metrics(
    prior: "_PriorAndNoise",
    results: Sequence[TorqueLogResult],
    against_sensor: MethodReading | None,
    reference: ReferenceConfig,
) -> dict[str, Any]:
    """All figures, as written to metrics.json; those of a single log stand on top.

    Args:
        against_sensor: the rows of all logs beside the sensor; None: there is no such row.
    """
    knowledge = prior.knowledge
    common = {
        "prior": {
            "force_sd_n": knowledge.force_sd,
            "moment_sd_nm": knowledge.moment_sd,
            "rule": prior.rule,
        },
        "torque_sd_nm": np.sqrt(np.diag(knowledge.torque_covariance)),
    }
    if len(results) == 1:
        return {**results[0].metrics, **common}
    metrics = {**common, "logs": {result.name: result.metrics for result in results}}
    if against_sensor is not None:
        metrics["reference"] = {
            "sensor_above_n": reference.contact_force,
            **against_sensor.metrics(),
        }
    return metrics


def _warnings(
    prior: "_PriorAndNoise", runs: Sequence["_Run"], reference: ReferenceConfig
) -> list[str]:
    """What makes the result doubtful, one sentence each."""
    warnings = list(prior.warnings)
    for run in runs:
        warnings += [sentence for sentence in run.summary.warnings() if sentence not in warnings]
        warnings += run.warnings
    beside_sensor = [run.rows for run in runs if run.rows is not None]
    if beside_sensor and not any(rows.has_contact for rows in beside_sensor):
        warnings.append(
            f"the sensor never reads more than {reference.contact_force:g} N, the threshold of "
            "contact; lower it with --reference-contact"
        )
    return warnings


def _names(logs: Sequence[TorqueLog]) -> list[str]:
    """Stems of the files' names; a repeated one gets a number."""
    return distinct_names([log.path.stem for log in logs])


def _as_external(notice: str) -> str:
    """A notice of the reader, of which an effort without gravity is the external torque here."""
    if not notice.startswith(NO_GRAVITY):
        return notice
    return f"{notice.partition(': ')[0]}: it is read as the external torque"


def _notices(logs: Sequence[TorqueLog], runs: Sequence["_Run"]) -> list[str]:
    """What reading the logs involved, one sentence each."""
    notices = [sentence for run in runs for sentence in run.notices]
    notices.append(
        "read from the controller's external torque, without a model, friction law or observer: "
        "its error and lag are the controller's"
    )
    if all(log.has_jacobian for log in logs):
        notices.append("the wrench is at the point and in the axes of the log's Jacobian")
    return list(dict.fromkeys(notices))


@dataclass(frozen=True, eq=False)
class _PriorAndNoise:
    """Prior and torque noise of all logs.

    Attributes:
        config: with both filled in.
        knowledge: both.
        rule: rule of the prior.
        warnings: one sentence each.
    """

    config: EstimateConfig
    knowledge: Knowledge
    rule: str
    warnings: tuple[str, ...]


def _prior_and_noise(
    logs: Sequence[TorqueLog], robot: Robot | None, config: EstimateConfig
) -> _PriorAndNoise:
    """Prior and torque noise, as stated or as the torques of all logs show them.

    The first of these that is stated gives the prior:

        sds in the estimator's configuration   these; of one alone the other is found as below
        `prior` of the command                 the live one, or its two numbers
        nothing (`prior` is log)               the evidence of the logs, raised to FLOOR_SHARE of
                                               the live one at least

    The torque's sds are `torque_sd`; where it is empty, those of the evidence.

    Raises:
        InputError: sds of the torque that are neither one nor one each joint.
    """
    n = logs[0].num_joints
    stated_sd = _stated_torque_sd(config, n)
    reconstruction, rule = config.estimator.reconstruction, "given"
    prior_without_log = stated_prior(config, robot)  # None: `prior` leaves it to the log
    # Sds in the estimator's own configuration go before the rule of `prior`; where only one of them
    # stands there, `with_prior` fills in the other alone.
    if prior_without_log is not None and not reconstruction.states_prior:
        reconstruction = reconstruction.with_prior(*prior_without_log)
        rule = config.prior if config.prior in PRIORS else "given"
    warnings: tuple[str, ...] = ()
    if stated_sd is None and n <= _WRENCH_NUMBERS:
        warnings = (
            f"a wrench explains any torque of {n} joints: only changes of posture show the "
            "torque's error; state it with --torque-sd",
        )
    if stated_sd is not None and reconstruction.states_prior:
        sd = stated_sd  # nothing is left to find: no pass over the logs
    else:
        evidence = _evidence(logs, stated_sd)
        sd = np.sqrt(np.diag(evidence.torque_covariance))  # the stated one, if it is
        if not reconstruction.states_prior:
            rule = "evidence of the log" + ("s" if len(logs) > 1 else "")
            least_force, least_moment = (0.0, 0.0) if robot is None else live_prior(robot.payload)
            reconstruction = reconstruction.with_prior(
                max(evidence.force_sd, FLOOR_SHARE * least_force),
                max(evidence.moment_sd, FLOOR_SHARE * least_moment),
            )
    config_filled_in = replace(
        config,
        torque="external",
        torque_sd=[float(x) for x in sd],
        estimator=replace(config.estimator, reconstruction=reconstruction),
    )
    force_sd, moment_sd = reconstruction.prior_force_sd, reconstruction.prior_moment_sd
    assert force_sd is not None and moment_sd is not None  # stated, or found above
    knowledge = Knowledge(force_sd, moment_sd, np.diag(sd**2))
    return _PriorAndNoise(config_filled_in, knowledge, rule, warnings)


def _stated_torque_sd(config: EstimateConfig, n: int) -> Array | None:
    """(n,) N m, sd of the torque's error that the configuration states; None: it states none.

    Raises:
        InputError: it has neither one number nor one each joint.
    """
    stated_sd = np.array(config.torque_sd)
    if stated_sd.size not in (0, 1, n):
        problem = f"has {stated_sd.size} numbers, expected 1 or {n}"
        raise InputError("estimate", "--torque-sd", problem, "give one for all joints or one each")
    return np.broadcast_to(stated_sd, n) if stated_sd.size else None


def _evidence(logs: Sequence[TorqueLog], torque_sd: Array | None) -> Knowledge:
    """Prior and torque noise that the torques of all logs show; `torque_sd` as stated, if it is."""
    J, tau_ext = EvenSample(_MAX_ROWS), EvenSample(_MAX_ROWS)
    for log in logs:
        for _, J_rows, torque in log.chunks(log.reader()):
            J.add(J_rows)
            tau_ext.add(torque)
    return knowledge_by_evidence(J.values(), tau_ext.values(), torque_sd)


class _Run:
    """Readings of one log, as its metrics and comparison need them; filled by `read`.

    Args:
        suffix: suffix of the names of its files.
        config: with prior and torque noise; `read` fills in the log's time step.

    Attributes:
        table: name of its file.
        summary: sums over the readings.
        touches: contacts, their places, and the torque's sign.
        sensor_log, rows: beside the sensor, as averages and row by row; None: no sensor is named.
        notices, warnings: one sentence each.
    """

    def __init__(self, log: TorqueLog, name: str, suffix: str, config: EstimateConfig) -> None:
        self._log, self.name, self.suffix, self.config = log, name, suffix, config
        self.table = f"wrench{suffix}.{config.table}"
        names = [f"joint {j + 1}" for j in range(log.num_joints)]
        self.summary = EstimateSummary(names, Validity())
        self.touches = TorqueTouches(log)
        self.sensor_log: SensorLogCollector | None = None
        self.rows: RowsBesideSensor | None = None
        self.notices: tuple[str, ...] = ()
        self.warnings: list[str] = []

    def read(self, reading: WrenchReconstruction, robot: Robot | None, out: OutputFolder) -> None:
        """Reads every row of the log, and writes its table, its figure and, if wanted, a bag.

        Args:
            robot: None: the log's own Jacobian is all there is, and no bag is written.
        """
        log, touches, reader = self._log, self.touches, self._log.reader()
        with ExitStack() as stack:
            writer = WrenchTableWriter(out / self.table, log.num_joints, self.config.covariance)
            table = stack.enter_context(writer)
            bag: WrenchBagWriter | None = None
            if self.config.mcap:
                bag = stack.enter_context(_bag(log, out / f"wrench{self.suffix}.mcap", robot))
            for chunk, J, tau_ext in log.chunks(reader):
                if not self.summary.count:  # the first rows
                    self._start(chunk)
                batch = reading.reconstruct(J, tau_ext)
                detection, odds, may_be_valid = touches.take(chunk, J, tau_ext)
                # The reading's own reasons, and two that it does not know of.
                invalid = marked(batch.invalid, OTHER_LINK, ~may_be_valid)
                batch = batch._replace(invalid=marked(invalid, SAMPLE_MISSING, chunk.dropout))
                # What is missing stands as zero; samples are not checked here: none has a fault.
                no_fault = np.zeros(chunk.num_samples, np.int64)
                torque = np.nan_to_num(tau_ext)
                table.write(table_rows(chunk.t, batch, torque, detection, no_fault))
                if bag is not None and robot is not None:
                    _, p_WE = robot.chain.pose(np.nan_to_num(chunk.q))
                    bag.write(chunk.t, batch.wrench, batch.covariance, p_WE)
                touches.episodes.add(chunk.t, detection, batch.wrench[:, 3:], batch.valid, odds)
                self.summary.add(chunk, batch, tau_ext, detection.contact)
                self._add_beside_sensor(chunk, batch)
        touches.episodes.finish()  # the last contact may be open at the log's end
        self.notices = tuple(map(_as_external, reader.notices))  # complete after the last chunk
        if touches.sign.contradicts:
            self.warnings.append(touches.sign.sentence(log.path.name, log.exerted_on))
        reads_moments = self.config.estimator.reconstruction.reads_moments
        out.write_figure(f"wrench{self.suffix}", self.summary.figure(reads_moments))

    def _start(self, chunk: Recording) -> None:
        """Fills in the time step of the log's first rows, and begins what rests on it."""
        step = float(plausible_step(chunk))
        self.config = replace(self.config, estimator=self.config.estimator.with_time_step(step))
        if self.config.reference.columns:
            self.sensor_log, self.rows = SensorLogCollector(step), RowsBesideSensor(_MAX_ROWS)

    def _add_beside_sensor(self, chunk: Recording, batch: WrenchEstimate) -> None:
        """Takes the readings of a chunk beside the sensor's; nothing without a sensor."""
        if self.sensor_log is None or self.rows is None:
            return
        R_WE, sensor = self._log.axes(chunk), chunk.extra[REFERENCE]
        # A log without positions rests, as far as anyone knows.
        v = chunk.v if chunk.num_joints else np.zeros((chunk.num_samples, 1))
        self.sensor_log.add(
            SensorSamples(
                t=chunk.t,
                reading=batch.wrench[:, FORCE_FIRST],
                sd=batch.standard_deviation[:, FORCE_FIRST],
                valid=np.asarray(batch.valid, float),
                R_WE=R_WE,
                v=v,
                sensor=sensor,
            )
        )
        self.rows.add(chunk.t, batch, R_WE, sensor)

    def loaded_rows(self) -> LogReading | None:
        """The rows beside the sensor; None where no sensor is named or none is in contact."""
        reading = None if self.rows is None else self.rows.reading
        return reading if reading is not None and reading.loaded.any() else None


def _bag(log: TorqueLog, path: Path, robot: Robot | None) -> WrenchBagWriter:
    if robot is None or not log.has_positions or log.has_jacobian:
        problem = "needs the place of E, which only a robot and its positions give"
        raise InputError("estimate", "--mcap", problem, "leave it out")
    return WrenchBagWriter(path, robot.config.base_link)


def _compared(
    runs: Sequence[_Run],
    reference: ReferenceConfig,
    limits: ValidityLimits,
    out: OutputFolder,
) -> tuple[list[TorqueLogResult], tuple[str, ...]]:
    """Each log's result, compared with its sensor, and notices about the mounting.

    The sensor is mounted alike in all logs; either all of them have it, or none. Each run's rows
    beside the sensor are held against it here.

    Args:
        limits: those of a valid reading, for sentences.
    """
    sensor_logs = [_sensor_log(run) for run in runs]
    present_logs = [sensor_log for sensor_log in sensor_logs if sensor_log is not None]
    mounting: Mounting | None = None
    notices: tuple[str, ...] = ()
    if present_logs:
        mounting, notices = find_mounting(joined_logs(present_logs), reference)
    results = []
    for run, sensor_log in zip(runs, sensor_logs, strict=True):
        metrics = _log_metrics(run)
        comparison = None
        if sensor_log is not None and mounting is not None:
            log_mounting = mounting
            if reference.tare == "start":  # each log has a tare of its own
                tare = tare_of(sensor_log.t, sensor_log.sensor, reference)
                log_mounting = replace(mounting, tare=tare)
            comparison = compare_with_sensor(sensor_log, reference, log_mounting)
            metrics["reference"] = comparison.metrics()
            if run.rows is not None:
                run.rows.hold_against(log_mounting, reference.contact_force)
            out.write_figure(f"reference{run.suffix}", comparison.figure("from external torque"))
        results.append(
            TorqueLogResult(
                name=run.name,
                num_samples=run.summary.count,
                valid_share=run.summary.valid_share,
                table=out / run.table,
                metrics=metrics,
                comparison=comparison,
                contacts=tuple(run.touches.episodes.lines()),
                invalid=run.summary.invalid.sentences(limits),
            )
        )
    return results, notices


def _sensor_log(run: _Run) -> SensorLog | None:
    """A log beside its sensor, as averages; None: no sensor is named.

    Raises:
        InputError: the log is too short for an average.
    """
    if run.sensor_log is None:
        return None
    sensor_log = run.sensor_log.log()
    if sensor_log is None:
        problem = f"{run.name} is shorter than {BLOCK_TIME:g} s: too short to compare with"
        raise InputError("estimate", "--reference", problem, "record a longer log")
    return sensor_log


def _log_metrics(run: _Run) -> dict[str, Any]:
    """Figures of one log, without those that need an observer or a model."""
    metrics = run.summary.metrics(run.config.estimator, "")
    for key in ("faults", "outside_model", "prior"):
        del metrics[key]
    error, sign = run.touches.error, run.touches.sign
    metrics["contact"] = run.touches.episodes.metrics()
    metrics["free_torque_sd_nm"] = {"rest": error.rest_sd, "moving": error.moving_sd}
    metrics["torque_sign"] = {
        "contacts": sign.contacts,
        "correlation": sign.correlation if np.isfinite(sign.correlation) else None,
    }
    return metrics
