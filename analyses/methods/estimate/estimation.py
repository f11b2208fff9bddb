"""The command `estimate`: reads the wrench at the tool, with its uncertainty, from a log.

    log, model -> first pass -> second pass -> metrics, warnings, figures -> files
                  (load, drift, prior)  (wrench.csv)

The log is streamed: memory does not grow with its length.
"""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from wrenchsight.analyses.methods.estimate.engines import (
    ReadingModels,
    estimates,
    without_breaks,
)
from wrenchsight.analyses.methods.estimate.estimate_config import (
    EstimateConfig,
    EstimateSettings,
    checked_config,
)
from wrenchsight.analyses.methods.estimate.estimate_data_set import (
    data_set_of,
    episodes_reader,
    write_data_set,
)
from wrenchsight.analyses.methods.estimate.first_pass import FirstPassResult, first_pass
from wrenchsight.analyses.methods.estimate.log_readings import LogReadings
from wrenchsight.analyses.methods.estimate.model_checks import (
    is_fitted_on,
    model_warnings,
    with_requested_drift,
)
from wrenchsight.analyses.methods.estimate.uniform_log import (
    PassProgress,
    SampleScreen,
    completed,
    screen_of,
    uniform_chunks,
)
from wrenchsight.analyses.methods.reference_sensor.comparison import SensorComparison
from wrenchsight.analyses.methods.reference_sensor.reference_config import (
    reference_columns,
)
from wrenchsight.analyses.output.estimator_compilation import compile_estimator
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.models.calibration.known_tool import with_known_tool
from wrenchsight.models.calibration.load_or_drift import LoadOrDrift
from wrenchsight.models.detection.tracked_estimator import TrackedEstimator
from wrenchsight.models.estimation.estimator import WrenchEstimatorConfig
from wrenchsight.models.estimation.wrench_bag import WrenchBagWriter
from wrenchsight.models.estimation.wrench_table import WrenchTableWriter
from wrenchsight.models.hypotheses.judgement import Judgement, judge_log
from wrenchsight.models.hypotheses.log_rows import MIN_SAMPLES, SHORTEST_LOG
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.episodes_reader import EpisodesReader, LogReader
from wrenchsight.models.recordings.recording_reader import RecordingReader
from wrenchsight.models.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class EstimateResult:
    """Result of an estimate, and where it is written.

    Attributes:
        num_samples: on the uniform grid.
        valid_share: share of the samples that may be trusted.
        notices: what reading the log involved, one sentence each.
        warnings: what makes the result doubtful, one sentence each.
        config: as used, with the time step and the prior filled in.
        table: wrench.csv, or wrench.parquet.
        invalid: why readings are not valid, and what would help most; empty where all are.
        contacts: one sentence each, or one that there is none.
        comparison: with the log's force sensor, where one is named.
    """

    num_samples: int
    valid_share: float
    notices: tuple[str, ...]
    warnings: tuple[str, ...]
    config: EstimateConfig
    table: Path
    invalid: tuple[str, ...]
    contacts: tuple[str, ...]
    _metrics: dict[str, Any]
    comparison: SensorComparison | None = None

    def metrics(self) -> dict[str, Any]:
        """All figures, as written to metrics.json."""
        return self._metrics


def estimate_log(
    log: Path,
    robot_name: str | Path,
    model_path: Path | None,
    out: Path,
    log_format: str | Path | None = None,
    config: EstimateConfig | None = None,
    progress: ProgressCallback = lambda fraction, action: None,
    draws: bool = True,
) -> EstimateResult:
    """Streams a log and writes the wrench at the tool into `out`.

    Writes the table (see `models.estimation.wrench_table`), metrics.json, config.yaml and
    figures/wrench.png; with a force sensor in the log also figures/reference.png; wrench.mcap (see
    `wrenchsight.models.estimation.wrench_bag`) where it is requested.

    Args:
        log: as `read_recording`.
        robot_name: a bundled robot or a robot.yaml.
        model_path: a model.yaml; None: the model of the robot's files, without friction.
        out: folder of the result.
        log_format: description of the log's columns; None: found from their names.
        config: None: the defaults.
        progress: called with the share done, 0 to 1, and the current step.
        draws: whether figures are written.

    Raises:
        InputError: as `Robot.load`, `IdentifiedModel.load`, `RecordingReader` and `result_folder`;
            a setting that makes no sense.
    """
    with result_folder(out, "estimate") as folder:
        robot = Robot.load(robot_name)
        data_set = data_set_of(log)
        config = checked_config(config or EstimateConfig(), robot)
        if model_path is None:
            robot.require_inertias("estimate without --model")
            model = IdentifiedModel.nominal(robot)
        else:
            model = IdentifiedModel.load(Path(model_path), robot, config.other_robot)
            model = with_known_tool(model, robot, Path(model_path), config.tool, config.other_robot)

        def open_file(path: Path) -> RecordingReader:
            reader = RecordingReader(
                path,
                log_format,
                robot,
                config.check,
                reference_columns(config.reference),
                "estimate",
            )
            # An effort that the log holds without gravity gets the gravity of the model that reads.
            reader.gravity_torque = model.chain(robot).gravity_torque
            reader.require_joint_signals()
            return reader

        def open_log() -> LogReader:
            return open_file(log) if data_set is None else episodes_reader(log, open_file)

        settings = EstimateSettings(
            log=str(log),
            robot=str(robot_name),
            model=None if model_path is None else str(model_path),
            log_format=None if log_format is None else str(log_format),
            estimate=config,
        )
        result = estimate(open_log, robot, model, folder, settings, progress, draws)
    # The files were written beside `out` and have come to their places with the block's end.
    return replace(result, table=out / result.table.name)


def estimate(
    open_log: Callable[[], LogReader],
    robot: Robot,
    model: IdentifiedModel,
    out: OutputFolder,
    settings: EstimateSettings,
    progress: ProgressCallback = lambda fraction, action: None,
    draws: bool = True,
) -> EstimateResult:
    """As `estimate_log`, with robot and model loaded.

    The log is judged first, by the model as it is; then read to find what it must give itself (the
    prior, friction drift, the encoders' steps), and once more to read its wrenches with these.

    Args:
        open_log: opens the log for one pass.
        model: that reads; the drift that the settings request is put on it here.
        out: folder, to be filled.
        settings: as config.yaml holds them; written with the values that the log filled in.
        progress: called with the share done, 0 to 1, and the current step.
        draws: whether figures are written.

    Raises:
        InputError: something is wrong in the log.
    """
    config = settings.estimate
    compile_estimator(lambda share, left: progress(0.0, left))
    progress(0.0, "looking for what is wrong with the log")
    judgement = _judgement(open_log, robot, model, config)
    drifting_model = with_requested_drift(model, config)
    first_pass_result = first_pass(open_log, robot, drifting_model, config, progress)
    second_pass = _read_and_write(
        open_log(),
        robot,
        drifting_model,
        first_pass_result,
        settings,
        _Destination(out, progress),
        judgement,
    )
    outcome = _Outcome(
        model=drifting_model,
        judgement=judgement,
        first_pass_result=first_pass_result,
        second_pass=second_pass,
        comparison=second_pass.readings.comparison(),
        reading_warnings=second_pass.readings.warnings(first_pass_result.model_with_drift),
        load=first_pass_result.load(),
    )
    metrics = _metrics(outcome, robot, config)
    warnings = _warnings(outcome, robot, model, settings)
    used_settings = replace(
        settings, estimate=replace(config, estimator=second_pass.estimator_config)
    )
    if draws:
        _write_figures(outcome, config, out)
    if isinstance(second_pass.reader, EpisodesReader):
        progress(1.0, "copying the data set")
        _copy_data_set(settings.log, second_pass.reader, second_pass.table, metrics["prior"], out)
    out.write_settings("config.yaml", used_settings)
    out.write_json("metrics.json", metrics)
    progress(1.0, "done")
    summary = second_pass.readings.summary
    return EstimateResult(
        num_samples=summary.count,
        valid_share=summary.valid_share,
        invalid=second_pass.readings.invalid_sentences(),
        notices=outcome.notices,
        warnings=tuple(warnings),
        config=used_settings.estimate,
        table=second_pass.table,
        contacts=outcome.contact_sentences,
        _metrics=metrics,
        comparison=outcome.comparison,
    )


def _warnings(
    outcome: "_Outcome", robot: Robot, model: IdentifiedModel, settings: EstimateSettings
) -> list[str]:
    """What makes the result doubtful, one sentence each: the log, the model, the readings.

    Args:
        model: as loaded.
    """
    judgement = outcome.judgement
    warnings = [*model_warnings(robot, model, settings), *outcome.warnings(settings)]
    if judgement is not None and judgement.sentence():
        warnings.insert(0, judgement.sentence(settings.log_format))
    is_too_short = judgement is None and _tries_hypotheses(settings.estimate, robot)
    if is_too_short and not outcome.second_pass.readings.summary.valid_share:
        warnings.append(
            "no reading is valid, and the log is too short to try what may be wrong with it "
            f"(order, signs, units and others): that takes {SHORTEST_LOG:g} s and {MIN_SAMPLES} "
            "samples without gaps; record a longer log"
        )
    return warnings


def _tries_hypotheses(config: EstimateConfig, robot: Robot) -> bool:
    """Whether the hypotheses on what is wrong are held against a log that is long enough."""
    return config.check and robot.has_inertias


def _judgement(
    open_log: Callable[[], LogReader], robot: Robot, model: IdentifiedModel, config: EstimateConfig
) -> Judgement | None:
    """What the hypotheses say of the log; None where they are not tried, or it is too short."""
    if not _tries_hypotheses(config, robot):
        return None
    progress = PassProgress(lambda fraction, action: None, 0.0, 0.0, "")
    # Samples beyond the limits stay: a wrong unit puts all of them there.
    chunks = uniform_chunks(open_log(), None, config.estimator, config.max_gap, progress)
    return judge_log(chunks, robot, model)


class _Destination(NamedTuple):
    """Folder that a pass writes into, and where it reports its progress."""

    out: OutputFolder
    progress: ProgressCallback


@dataclass(frozen=True, eq=False)
class _SecondPass:
    """The pass over a log that reads and writes its wrenches.

    Attributes:
        reader: of the log, at its end.
        screen: of impossible samples; None: samples are not checked.
        estimator_config: with the time step and the prior filled in.
        tracked: estimator that follows friction; None: friction is not followed.
        readings: judged and summed up.
        table: path of the wrenches.
    """

    reader: LogReader
    screen: SampleScreen | None
    estimator_config: WrenchEstimatorConfig
    tracked: TrackedEstimator | None
    readings: LogReadings
    table: Path


def _read_and_write(
    reader: LogReader,
    robot: Robot,
    model: IdentifiedModel,
    first_pass_result: FirstPassResult,
    settings: EstimateSettings,
    destination: _Destination,
    judgement: Judgement | None,
) -> _SecondPass:
    """Second pass: reads every sample of the log, writes its wrench and sums it up.

    The log is streamed: but for the first chunk nothing is read before the loop takes the parts.
    What the reader, the screen and the tracked estimator have to tell is complete after it.

    Args:
        reader: of the log, at its begin; it gives one chunk or more.
        model: that reads; the model whose band is stated comes from the first pass.
        judgement: on the log; None: there is none. Where it names a fault, no reading is valid.
    """
    config = settings.estimate
    screen = screen_of(robot, config.estimator)
    chunks = uniform_chunks(
        reader,
        screen,
        config.estimator,
        config.max_gap,
        PassProgress(destination.progress, first_pass_result.work_done, 1.0, "estimating"),
    )
    first_chunk = next(chunks)  # gives the time step
    estimator_config = completed(
        config.estimator, first_chunk, first_pass_result.resolution, first_pass_result.prior
    )
    tracked: TrackedEstimator | None = None  # in the place of both models
    if config.track:
        tracked = TrackedEstimator(robot, model, estimator_config, config.detection)
    models = ReadingModels(model, first_pass_result.model_with_drift)
    all_chunks = chain([first_chunk], chunks)
    parts = estimates(config, robot, models, estimator_config, all_chunks, tracked)
    is_wrong = judgement is not None and judgement.fault is not None
    readings = LogReadings(robot, model, settings, estimator_config, first_chunk.t[0], is_wrong)
    path = destination.out / f"wrench.{config.table}"
    with ExitStack() as stack:
        table = stack.enter_context(WrenchTableWriter(path, robot.num_joints, config.covariance))
        bag: WrenchBagWriter | None = None
        if config.mcap:
            writer = WrenchBagWriter(destination.out / "wrench.mcap", robot.config.base_link)
            bag = stack.enter_context(writer)
        for part in without_breaks(parts):
            readings.take(part, table, bag)  # judges, writes and sums up
    readings.episodes.finish()  # the last contact may be open at the log's end
    return _SecondPass(reader, screen, estimator_config, tracked, readings, path)


@dataclass(frozen=True, eq=False)
class _Outcome:
    """Results of both passes, from which metrics, sentences and figures are made.

    Attributes:
        model: that read the log.
        judgement: of the hypotheses on what is wrong with the log; None: they were not tried.
        comparison: with the log's force sensor; None: none is named.
        reading_warnings: about the readings.
        load: weighed against friction drift; None: not looked for, or too few samples.
    """

    model: IdentifiedModel
    judgement: Judgement | None
    first_pass_result: FirstPassResult
    second_pass: _SecondPass
    comparison: SensorComparison | None
    reading_warnings: list[str]
    load: LoadOrDrift | None

    @property
    def notices(self) -> tuple[str, ...]:
        """What reading the log involved, one sentence each."""
        notices = self.second_pass.reader.notices
        if self.second_pass.screen is not None:
            notices += self.second_pass.screen.notices
        if self.comparison is not None:
            notices += self.comparison.notices
        return notices

    @property
    def contact_sentences(self) -> tuple[str, ...]:
        """The load and the contacts, one sentence each; none of a log that is wrong."""
        if self.judgement is not None and self.judgement.fault is not None:
            return ()
        sentences: tuple[str, ...] = ()
        if self.load is not None and self.load.is_shown:
            sentences = (self.load.sentence(),)
        if self.model.torque_error is not None:
            sentences += tuple(self.second_pass.readings.episodes.lines())
        return sentences

    def _may_show_lever(self) -> bool:
        """Whether something presses with a force that is read: else a model's error has a lever.

        Contacts are not looked for beside a model without a torque error: then it may be so.
        """
        if self.model.torque_error is None:
            return True
        contacts = self.second_pass.readings.episodes.contacts
        return any(contact.force is not None for contact in contacts)

    def warnings(self, settings: EstimateSettings) -> list[str]:
        """What makes the readings doubtful, one sentence each."""
        if self.judgement is not None and self.judgement.fault is not None:
            return []  # what else is to be said of a log that is wrong would mislead
        warnings = [*self.first_pass_result.warnings, *self.reading_warnings]
        if self.first_pass_result.lever is not None and self._may_show_lever():
            warnings.insert(0, self.first_pass_result.lever.sentence())
        if self.second_pass.tracked is not None:
            warnings += self.second_pass.tracked.tracker.advice(self.model.joint_names)
        monitor = self.first_pass_result.friction_monitor
        if monitor is not None:
            warnings += monitor.sentences(
                settings.log,
                settings.robot,
                settings.model,
                self.first_pass_result.drift_shown,
                is_fitted_on(self.model, settings.log),
            )
        return warnings


def _metrics(outcome: _Outcome, robot: Robot, config: EstimateConfig) -> dict[str, Any]:
    """All figures, as written to metrics.json."""
    first_pass_result, second_pass = outcome.first_pass_result, outcome.second_pass
    readings = second_pass.readings
    load, comparison, tracked = outcome.load, outcome.comparison, second_pass.tracked
    metrics = readings.summary.metrics(second_pass.estimator_config, first_pass_result.prior_rule)
    metrics["smoothed"] = config.smooth
    metrics["contact_axis"] = config.contact.axis or None
    metrics["other_robot"] = [
        f"{key}: {change}" for key, change in outcome.model.fitted_robot.differences(robot)
    ]
    judgement = outcome.judgement
    metrics["hypotheses"] = None if judgement is None else judgement.metrics()
    metrics["contact"] = readings.episodes.metrics(config.detection.false_alarms_per_hour)
    if comparison is not None:
        metrics["reference"] = comparison.metrics()
    metrics["drift_shown"] = first_pass_result.drift_shown
    ripple = first_pass_result.ripple_shown
    metrics["gear_ripple"] = None if ripple is None else ripple.metrics()
    metrics["load"] = None if load is None else load.metrics()
    if tracked is not None:
        metrics["friction_tracked"] = tracked.tracker.metrics()
    return metrics


def _write_figures(outcome: _Outcome, config: EstimateConfig, out: OutputFolder) -> None:
    """The figures of the wrench and of the comparison with a force sensor."""
    if outcome.comparison is not None:
        out.write_figure("reference", outcome.comparison.figure())
    second_pass = outcome.second_pass
    reads_moments = second_pass.estimator_config.reconstruction.reads_moments
    figure = second_pass.readings.summary.figure(reads_moments, config.smooth)
    out.write_figure("wrench", figure)


def _copy_data_set(
    log: str, reader: EpisodesReader, table: Path, prior: dict[str, Any], out: OutputFolder
) -> None:
    """The LeRobot data set of a log with the wrenches of the table beside its frames."""
    data_set = data_set_of(Path(log))
    assert data_set is not None
    write_data_set(data_set, out, table, reader.begins, prior)
