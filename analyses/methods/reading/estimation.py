"""What force acts at the tool? A log and a model in, the wrench with its uncertainty out.

The log is streamed: its memory does not grow with its length. Without a given prior there are two
passes. The first runs the observer over the whole log and keeps some thousand samples, evenly
spread, of external torque and Jacobian; the prior is what explains those best
(`models.estimation.evidence_prior.evidence_prior`). The second one writes the wrenches.
"""

import math
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from wrenchsight.analyses.methods.reading.contact_episodes import ContactEpisodes
from wrenchsight.analyses.methods.reading.contact_places import judge_places, of_contacts
from wrenchsight.analyses.methods.reading.engines import estimates
from wrenchsight.analyses.methods.reading.estimate_config import (
    EstimateConfig,
    EstimateSettings,
    checked_config,
    stated_prior,
)
from wrenchsight.analyses.methods.reading.estimate_data_set import (
    data_set_of,
    episodes_reader,
    write_data_set,
)
from wrenchsight.analyses.methods.reading.estimate_summary import EstimateSummary
from wrenchsight.analyses.methods.reading.first_pass import friction_of, with_evidence
from wrenchsight.analyses.methods.reading.friction_watch import FrictionWatch
from wrenchsight.analyses.methods.reading.known_contact import (
    with_known_tool,
    without_breaks,
)
from wrenchsight.analyses.methods.reading.uniform_log import (
    Part,
    ProgressCallback,
    fault_of,
    screen_of,
    there,
    timed,
    uniform_chunks,
)
from wrenchsight.analyses.methods.sensors.comparison import SensorComparison, compare_with_sensor
from wrenchsight.analyses.methods.sensors.reference_config import (
    REFERENCE,
    ReferenceConfig,
    reference_columns,
)
from wrenchsight.analyses.methods.sensors.sensor_log import SensorLogCollector
from wrenchsight.analyses.output.outputs import OutputFolder
from wrenchsight.analyses.output.result_folder import result_folder
from wrenchsight.analyses.output.result_marker import file_checksum
from wrenchsight.analyses.output.stream_summary import EvenSample
from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.calibration.gravity_disagreement import GravityWatch
from wrenchsight.models.detection.pure_force import force_alone_explains
from wrenchsight.models.detection.tracked_estimator import TrackedEstimator
from wrenchsight.models.estimation.estimator import (
    EstimateBatch,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.estimation.uncertain_force import UncertainForce
from wrenchsight.models.estimation.wrench import live_prior
from wrenchsight.models.estimation.wrench_bag import WrenchBagWriter
from wrenchsight.models.estimation.wrench_table import WrenchTableWriter
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.observer_kinds import kind_name, kind_of, make_observer
from wrenchsight.models.recordings.episodes_reader import EpisodesReader, LogReader
from wrenchsight.models.recordings.lerobot.data_set import episode_paths, file_of
from wrenchsight.models.recordings.position_resolution import position_resolution
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import RecordingReader
from wrenchsight.models.rigid_body.spatial_vectors import FORCE_FIRST
from wrenchsight.models.robot.robot import Robot

CHUNK_SAMPLES = 1 << 16  # samples that are worked on at a time
_PRIOR_SAMPLES = 1 << 12
_SEEN_SAMPLES = 1 << 9  # of which it is told why they are not valid


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
            model = with_known_tool(model, robot, config, Path(model_path))

        def opened(path: Path) -> RecordingReader:
            reader = RecordingReader(
                *(
                    path,
                    log_format,
                    robot,
                    config.check,
                    reference_columns(config.reference),
                    "estimate",
                ),
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
    warnings: list[str] = []
    again = f"wrenchsight identify LOGS --robot {settings.robot}"
    if not model.provenance.logs:
        warnings.append(
            "the model is not identified from logs: its friction and its noise are assumed"
            + ("" if settings.model else f", so that no reading is valid; first: {again}")
        )
    else:
        warnings += model.fitted_robot.doubts(robot)
    other = model.fitted_robot.differences(robot)
    warnings += [f"read as asked for with another robot: {key}: {what}" for key, what in other]
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
    option = "track" if settings.estimate.track else "drift"
    if (settings.estimate.track or settings.estimate.drift is not None) and not model.torque_error:
        problem = "model.yaml states no torque error"
        raise InputError("estimate", option, problem, f"identify it again, or leave --{option} out")
    if settings.estimate.drift is not None and model.torque_error is not None:
        stated_error = model.torque_error.with_drift(settings.estimate.drift)
        model = replace(model, torque_error=stated_error)
    config, max_gap = settings.estimate.estimator, settings.estimate.max_gap
    if config.position_resolution is None:
        step = position_resolution(next(iter(read().chunks())).q)
        known = robot.position_resolution
        step = np.where(np.isfinite(known), known, step)
        config = replace(config, position_resolution=step.tolist())
    kind = kind_of(config.observer)
    if kind is not None and kind.kernels.wrench is not None and model.torque_error is not None:
        warnings.append(
            f"contact and misfit are judged by what the {kind_name(kind)} observer reads; their "
            "levels were learnt from the momentum observer's readings"
        )
    rule = "given"
    stated = stated_prior(settings.estimate, robot)
    if stated is None and settings.estimate.contact.axis:
        stated, rule = live_prior(robot.payload), "live"  # no pass over the log
    if stated is not None and not _has_prior(config):
        config = replace(config, reconstruction=config.reconstruction.with_prior(*stated))
        if settings.estimate.prior == "live":
            rule = "live"
    passes, shown, error, wide = 0.0, None, model.torque_error, model
    watch: FrictionWatch | None = None
    # A joint's friction is that of several motors where joints are coupled.
    if model.provenance.logs and not robot.is_coupled and not settings.estimate.track:
        part = Part(progress, 0.0, 0.3, "looking at friction")
        watch, passes = friction_of(read(), robot, model, config, settings.estimate, part), 0.3
    if watch is not None and settings.estimate.drift is None and error is not None:
        shown = watch.drifts()
        if shown is not None:
            wide = replace(model, torque_error=replace(error, drift_shown=shown))
    if not _has_prior(config):
        part = Part(progress, passes, passes + 0.3, "finding the prior")
        config, rule = with_evidence(read(), robot, model, config, max_gap, part, warnings)
        passes += 0.3
    reader = read()
    part = Part(progress, passes, 1.0, "estimating")
    screen = screen_of(robot, config)
    chunks = uniform_chunks(reader, screen, config, max_gap, part)
    first = next(chunks)
    config = timed(config, first)
    detection = settings.estimate.detection
    samples = chain([first], chunks)
    tracked: TrackedEstimator | None = None
    if settings.estimate.track:
        tracked = TrackedEstimator(robot, model, config, detection)
    readings = without_breaks(
        estimates(settings.estimate, robot, model, wide, config, samples, tracked)
    )
    observer = make_observer(config.observer, robot.num_joints)
    summary = EstimateSummary(model.joint_names, model.validity, observer.settling_time)
    reference = settings.estimate.reference
    beside = SensorLogCollector(config.observer.time_step) if reference.columns else None
    episodes = ContactEpisodes(robot.num_joints)
    # An observer of the wrench leaves no torque that a wrench at E does not explain.
    places = (kind is None or kind.kernels.wrench is None) and not settings.estimate.contact.axis
    seen_J, torque_sd = EvenSample(_SEEN_SAMPLES), EvenSample(_SEEN_SAMPLES)
    path = out / f"wrench.{settings.estimate.table}"
    with_covariance = settings.estimate.covariance
    sd_joints = np.sqrt(np.diag(model.residual_covariance))
    upright = GravityWatch(model.chain(robot), sd_joints, config.observer.time_step)
    with ExitStack() as stack:
        table = stack.enter_context(WrenchTableWriter(path, robot.num_joints, with_covariance))
        bag: WrenchBagWriter | None = None
        if settings.estimate.mcap:
            bag = stack.enter_context(WrenchBagWriter(out / "wrench.mcap", robot.config.base_link))
        for chunk, batch, found, tau_ext in readings:
            if settings.model is None:  # nothing holds the stated band to the arm
                batch = batch._replace(valid=np.zeros_like(batch.valid))
            fault = fault_of(chunk, batch)
            found = found.without(chunk.dropout | (fault != 0))
            odds: Array | None = None
            if places:
                alone, error = of_contacts(found.contact, chunk.t, tau_ext), model.torque_error
                found, odds, trusted = judge_places(
                    *(found, chunk.t, batch.J, alone, batch.torque_sd),
                    None if error is None else error.correlation,
                )
                if error is not None and config.reconstruction.method == "force_only":
                    trusted &= force_alone_explains(
                        chunk.t, batch.J, tau_ext, batch.torque_sd, error.correlation
                    )
                batch = batch._replace(valid=batch.valid & trusted)
            sd, valid = batch.standard_deviation, summary.judge(chunk, batch, config)
            table.write(
                *(chunk.t, batch.wrench, sd, batch.condition_number, valid, batch.tau_ext),
                *(found.statistic, {**found._asdict(), "fault": fault}, batch.covariance),
            )
            if bag is not None:
                _, p_WE = robot.chain.pose(np.nan_to_num(chunk.q))
                bag.write(chunk.t, batch.wrench, batch.covariance, p_WE)
            if isinstance(batch, EstimateBatch):  # a smoothed reading says neither
                whole = np.isfinite(batch.J).all(axis=(1, 2)) & ~valid
                seen_J.add(batch.J[whole])
                torque_sd.add(batch.torque_sd[whole])
            episodes.add(chunk.t, found, batch.wrench[:, 3:], valid, odds)
            settled = int(np.searchsorted(chunk.t, first.t[0] + observer.settling_time))
            upright.add(chunk.q, tau_ext, there(chunk, fault, tau_ext, settled))
            summary.add(chunk, batch, sd, valid, _torque(chunk, robot), found.contact)
            summary.add_faults(fault)
            if beside is not None:
                _collect(beside, chunk, batch, sd, valid, robot, settled)
    episodes.finish()
    metrics = {**summary.metrics(config, rule), "smoothed": settings.estimate.smooth}
    metrics["contact_axis"] = settings.estimate.contact.axis or None
    metrics["other_robot"] = [f"{key}: {what}" for key, what in other]
    signs = reader.sign_evidence
    metrics["drive_signs"] = None if signs is None else signs.metrics()
    metrics["contact"] = episodes.metrics(detection.false_alarms_per_hour)
    comparison = None if beside is None else _compared(beside, reference)
    notices = reader.notices + (screen.notices if screen is not None else ())
    if comparison is not None:
        metrics["reference"] = comparison.metrics()
        notices += comparison.notices
        out.write_figure("reference", comparison.figure())
    warnings += summary.warnings()
    unexplained = summary.mostly_unsure and settings.model is not None
    if settings.estimate.contact.axis:
        unexplained = False  # `valid` then rests on the contact's own sd
    if unexplained and settings.estimate.smooth:
        warnings.append("most readings are not valid: without --smooth it is told why")
    elif unexplained:
        by = WrenchEstimator(robot, wide, config)
        uncertain = UncertainForce.of(by, seen_J.values(), torque_sd.values())
        warnings.append(uncertain.sentence(summary.num_valid / summary.count))
    tilt = upright.disagreement()
    if tilt is not None:
        metrics["gravity"] = {"tilt_deg": math.degrees(tilt.tilt), "m_per_s2": list(tilt.gravity)}
        warnings += [tilt.sentence()]
    metrics["drift_shown"] = shown
    load = None if watch is None else watch.load()
    metrics["load"] = None if load is None else load.metrics()
    contacts = tuple(episodes.lines()) if model.torque_error is not None else ()
    if load is not None and load.is_told:
        contacts = (load.sentence(), *contacts)
    if tracked is not None:
        metrics["friction_tracked"] = tracked.tracker.metrics()
        warnings += tracked.tracker.advice(model.joint_names)
    if watch is not None:
        fitted = _fitted_on(model, settings.log)
        warnings += watch.sentences(settings.log, settings.robot, settings.model, shown, fitted)
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


def _fitted_on(model: IdentifiedModel, log: str) -> bool:
    """Whether the model was fitted on this very file."""
    logs = [path for path in episode_paths(Path(log)) if file_of(path).is_file()]
    names = {own.name for own in model.provenance.logs}
    if not any(path.name in names for path in logs):
        return False
    sums = {own.sha256 for own in model.provenance.logs}
    return any(file_checksum(file_of(path)) in sums for path in logs if path.name in names)


def _collect(
    beside: SensorLogCollector,
    chunk: Recording,
    batch: EstimateBatch,
    sd: Array,
    valid: Flags,
    robot: Robot,
    settled: int,
) -> None:
    """Hands over the samples from the one on at which the observer has settled."""
    R_WE, _ = robot.chain.pose(chunk.q)
    signals = (
        chunk.t,
        batch.wrench[:, FORCE_FIRST],
        sd[:, FORCE_FIRST],
        np.asarray(valid, float),
        R_WE,
        chunk.v,
        chunk.extra[REFERENCE],
    )
    beside.add(*(signal[settled:] for signal in signals))


def _compared(beside: SensorLogCollector, reference: ReferenceConfig) -> SensorComparison:
    log = beside.log()
    if log is None:
        raise InputError(
            "estimate", "--reference", "the log is too short to compare with", "record a longer one"
        )
    return compare_with_sensor(log, reference)


def _has_prior(config: WrenchEstimatorConfig) -> bool:
    prior = config.reconstruction
    return prior.prior_force_sd is not None and prior.prior_moment_sd is not None


def _torque(chunk: Recording, robot: Robot) -> Array:
    """(N, n) motor torque on the joint side, N m."""
    return np.asarray(robot.joint_torque(chunk.current))
