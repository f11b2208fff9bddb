"""What force acts at the tool? A log and a model in, the wrench with its uncertainty out.

The log is streamed: its memory does not grow with its length. Without a given prior there are two
passes. The first runs the observer over the whole log and keeps some thousand samples, evenly
spread, of external torque and Jacobian; the prior is what explains those best
(`models.estimation.evidence_prior.evidence_prior`). The second one writes the wrenches.
"""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

from wrenchsight.analyses.methods.estimate.engines import estimates, without_breaks
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
from wrenchsight.analyses.methods.estimate.first_pass import first_pass
from wrenchsight.analyses.methods.estimate.log_readings import LogReadings
from wrenchsight.analyses.methods.estimate.uniform_log import (
    Part,
    ProgressCallback,
    completed,
    screen_of,
    uniform_chunks,
)
from wrenchsight.analyses.methods.reference_sensor.comparison import SensorComparison
from wrenchsight.analyses.methods.reference_sensor.reference_config import (
    reference_columns,
)
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.analyses.output.result_marker import file_checksum
from wrenchsight.models.calibration.known_tool import with_known_tool
from wrenchsight.models.detection.tracked_estimator import TrackedEstimator
from wrenchsight.models.estimation.wrench_bag import WrenchBagWriter
from wrenchsight.models.estimation.wrench_table import WrenchTableWriter
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.observer_kinds import kind_name, kind_of
from wrenchsight.models.recordings.episodes_reader import EpisodesReader, LogReader
from wrenchsight.models.recordings.lerobot.data_set import episode_paths, file_of
from wrenchsight.models.recordings.recording_reader import RecordingReader
from wrenchsight.models.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class EstimateResult:
    """What an estimate found, and where it wrote it.

    Attributes:
        num_samples: on the uniform grid.
        valid_share: of the samples that may be trusted.
        notices: what reading the log involved, one sentence each.
        warnings: what makes the result doubtful, one sentence each.
        config: as used, with the time step and the prior filled in.
        table: wrench.csv, or wrench.parquet.
        contacts: one sentence each, or one that there is none.
        comparison: with the log's force sensor, where one is named.
    """

    num_samples: int
    valid_share: float
    notices: tuple[str, ...]
    warnings: tuple[str, ...]
    config: EstimateConfig
    table: Path
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
    progress: ProgressCallback = lambda fraction, what: None,
) -> EstimateResult:
    """The command `estimate`: streams a log and writes what acted at the tool into `out`.

    Writes the table (see `models.estimation.wrench_table`), metrics.json, config.yaml and
    figures/wrench.png; with a force sensor in the log also figures/reference.png; wrench.mcap (see
    `wrenchsight.models.estimation.wrench_bag`) where it is asked for.

    Args:
        log: as `read_recording`.
        robot_name: a bundled robot or a robot.yaml.
        model_path: a model.yaml; None: what the robot's own files state, without friction.
        log_format: description of the log's columns.

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

        def opened(path: Path) -> RecordingReader:
            reader = RecordingReader(
                path,
                log_format,
                robot,
                config.check,
                reference_columns(config.reference),
                "estimate",
                accept_signs=config.accept_signs,
            )
            reader.require_joint_signals()
            return reader

        def read() -> LogReader:
            return opened(log) if data_set is None else episodes_reader(log, opened)

        settings = EstimateSettings(
            log=str(log),
            robot=str(robot_name),
            model=None if model_path is None else str(model_path),
            log_format=None if log_format is None else str(log_format),
            estimate=config,
        )
        result = estimate(read, robot, model, folder, settings, progress)
    return replace(result, table=out / result.table.name)


def estimate(
    read: Callable[[], LogReader],
    robot: Robot,
    model: IdentifiedModel,
    out: OutputFolder,
    settings: EstimateSettings,
    progress: ProgressCallback = lambda fraction, what: None,
) -> EstimateResult:
    """As `estimate_log`, of what is loaded.

    Args:
        read: opens the log for one pass.
        settings: what config.yaml is to hold; written with what the log filled in.

    Raises:
        InputError: something is wrong in the log.
    """
    warnings = _model_warnings(robot, model, settings)
    other = model.fitted_robot.differences(robot)
    model = _with_asked_drift(model, settings.estimate)
    before = first_pass(read, robot, model, settings.estimate, progress, warnings)
    asked = settings.estimate.estimator
    reader, screen = read(), screen_of(robot, asked)
    chunks = uniform_chunks(
        reader,
        screen,
        asked,
        settings.estimate.max_gap,
        Part(progress, before.passes, 1.0, "estimating"),
    )
    first = next(chunks)
    config = completed(asked, first, before.resolution, before.prior)
    tracked: TrackedEstimator | None = None
    if settings.estimate.track:
        tracked = TrackedEstimator(robot, model, config, settings.estimate.detection)
    samples = chain([first], chunks)
    read_parts = without_breaks(
        estimates(settings.estimate, robot, model, before.wide, config, samples, tracked)
    )
    readings = LogReadings(robot, model, settings, config, first.t[0])
    path = out / f"wrench.{settings.estimate.table}"
    with ExitStack() as stack:
        table = stack.enter_context(
            WrenchTableWriter(path, robot.num_joints, settings.estimate.covariance)
        )
        bag: WrenchBagWriter | None = None
        if settings.estimate.mcap:
            bag = stack.enter_context(WrenchBagWriter(out / "wrench.mcap", robot.config.base_link))
        for part in read_parts:
            readings.take(part, table, bag)
    summary, episodes = readings.summary, readings.episodes
    episodes.finish()
    metrics = {**summary.metrics(config, before.rule), "smoothed": settings.estimate.smooth}
    metrics["contact_axis"] = settings.estimate.contact.axis or None
    metrics["other_robot"] = [f"{key}: {what}" for key, what in other]
    signs = reader.sign_evidence
    metrics["drive_signs"] = None if signs is None else signs.metrics()
    metrics["contact"] = episodes.metrics(settings.estimate.detection.false_alarms_per_hour)
    comparison = readings.comparison()
    notices = reader.notices + (screen.notices if screen is not None else ())
    if comparison is not None:
        metrics["reference"] = comparison.metrics()
        notices += comparison.notices
        out.write_figure("reference", comparison.figure())
    doubts, gravity = readings.doubts(before.wide)
    warnings += doubts
    if gravity is not None:
        metrics["gravity"] = gravity
    metrics["drift_shown"] = before.drift_shown
    load = None if before.watch is None else before.watch.load()
    metrics["load"] = None if load is None else load.metrics()
    contacts = tuple(episodes.lines()) if model.torque_error is not None else ()
    if load is not None and load.is_shown:
        contacts = (load.sentence(), *contacts)
    if tracked is not None:
        metrics["friction_tracked"] = tracked.tracker.metrics()
        warnings += tracked.tracker.advice(model.joint_names)
    if before.watch is not None:
        warnings += before.watch.sentences(
            settings.log,
            settings.robot,
            settings.model,
            before.drift_shown,
            _fitted_on(model, settings.log),
        )
    reads_moments = config.reconstruction.method != "force_only"
    out.write_figure("wrench", summary.figure(reads_moments, settings.estimate.smooth))
    used = replace(settings.estimate, estimator=config)
    if isinstance(reader, EpisodesReader):
        progress(1.0, "copying the data set")
        copied = data_set_of(Path(settings.log))
        assert copied is not None
        write_data_set(copied, out, path, reader.begins, metrics["prior"])
    out.write_settings("config.yaml", replace(settings, estimate=used))
    out.write_json("metrics.json", metrics)
    progress(1.0, "done")
    return EstimateResult(
        num_samples=summary.count,
        valid_share=summary.num_valid / summary.count,
        notices=notices,
        warnings=tuple(warnings),
        config=used,
        table=path,
        contacts=contacts,
        _metrics=metrics,
        comparison=comparison,
    )


def _model_warnings(robot: Robot, model: IdentifiedModel, settings: EstimateSettings) -> list[str]:
    """What of the model makes every reading doubtful, one sentence each."""
    warnings: list[str] = []
    again = f"wrenchsight identify LOGS --robot {settings.robot}"
    if not model.provenance.logs:
        warnings.append(
            "the model is not identified from logs: its friction and its noise are assumed"
            + ("" if settings.model else f", so that no reading is valid; first: {again}")
        )
    else:
        warnings += model.fitted_robot.warnings(robot)
    warnings += [
        f"read as asked for with another robot: {key}: {what}"
        for key, what in model.fitted_robot.differences(robot)
    ]
    if model.provenance.logs and model.torque_error is None:
        warnings.append(
            "the model does not state its torque error at rest and in motion: one covariance "
            f"stands for both; identify it again: {again}"
        )
    elif model.provenance.logs and model.contact_noise is None:
        warnings.append(
            "the model does not state its readings without contact: how often contact is reported "
            f"where nothing touches the arm is not known; identify it again: {again}"
        )
    kind = kind_of(settings.estimate.estimator.observer)
    if kind is not None and kind.kernels.wrench is not None and model.torque_error is not None:
        warnings.append(
            f"contact and misfit are judged by what the {kind_name(kind)} observer reads; their "
            "levels were learnt from the momentum observer's readings"
        )
    return warnings


def _with_asked_drift(model: IdentifiedModel, config: EstimateConfig) -> IdentifiedModel:
    """The model with the drift of friction that is asked for.

    Raises:
        InputError: drift is asked for, or to be followed, and the model states no torque error.
    """
    option = "track" if config.track else "drift"
    if (config.track or config.drift is not None) and model.torque_error is None:
        problem = "model.yaml states no torque error"
        raise InputError("estimate", option, problem, f"identify it again, or leave --{option} out")
    if config.drift is None or model.torque_error is None:
        return model
    return replace(model, torque_error=model.torque_error.with_drift(config.drift))


def _fitted_on(model: IdentifiedModel, log: str) -> bool:
    """Whether the model was fitted on this very file."""
    logs = [path for path in episode_paths(Path(log)) if file_of(path).is_file()]
    names = {own.name for own in model.provenance.logs}
    if not any(path.name in names for path in logs):
        return False
    sums = {own.sha256 for own in model.provenance.logs}
    return any(file_checksum(file_of(path)) in sums for path in logs if path.name in names)
