"""What force acts at the tool? A log and a model in, the wrench with its uncertainty out.

The log is streamed: its memory does not grow with its length. Without a given prior there are two
passes. The first runs the observer over the whole log and keeps some thousand samples, evenly
spread, of external torque and Jacobian; the prior is what explains those best
(`models.estimation.evidence_prior.evidence_prior`). The second one writes the wrenches.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from wrenchsight.analyses.methods.reading.contact_episodes import ContactEpisodes
from wrenchsight.analyses.methods.reading.contact_places import judge_places, of_contacts
from wrenchsight.analyses.methods.reading.drifted_band import with_band_of
from wrenchsight.analyses.methods.reading.estimate_config import (
    FLOOR_SHARE,
    EstimateConfig,
    EstimateSettings,
    checked_config,
    stated_prior,
)
from wrenchsight.analyses.methods.reading.estimate_summary import EstimateSummary
from wrenchsight.analyses.methods.reading.friction_watch import FrictionWatch
from wrenchsight.analyses.methods.reading.known_contact import (
    Read,
    read_contact,
    read_later,
    with_known_tool,
)
from wrenchsight.analyses.methods.reading.sample_screen import FAULT, SampleScreen
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
from wrenchsight.models.detection.contact_detector import (
    ContactDetectionConfig,
    ContactDetector,
    Detection,
)
from wrenchsight.models.estimation.estimator import (
    EstimateBatch,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.estimation.evidence_prior import evidence_prior
from wrenchsight.models.estimation.smoothing import WrenchSmoother
from wrenchsight.models.estimation.uncertain_force import UncertainForce
from wrenchsight.models.estimation.wrench import live_prior
from wrenchsight.models.estimation.wrench_bag import WrenchBagWriter
from wrenchsight.models.estimation.wrench_table import WrenchTableWriter
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.observers.observer_kinds import kind_name, kind_of, make_observer
from wrenchsight.models.observers.sample_check import BEYOND
from wrenchsight.models.recordings.position_resolution import position_resolution
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_reader import RecordingReader
from wrenchsight.models.recordings.resampling import plausible_step, resample_chunks
from wrenchsight.models.rigid_body.spatial_vectors import FORCE_FIRST
from wrenchsight.models.robot.robot import Robot

ProgressCallback = Callable[[float, str], None]

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


class _Engine(Protocol):
    """Runs successive chunks of a log through the estimator's chain."""

    def run(self, q: Array, v: Array, current: Array) -> tuple[EstimateBatch, Detection]: ...


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
        config = checked_config(config or EstimateConfig(), robot)
        if model_path is None:
            robot.require_inertias("estimate without --model")
            model = IdentifiedModel.nominal(robot)
        else:
            model = IdentifiedModel.load(Path(model_path), robot, config.other_robot)
            model = with_known_tool(model, robot, config, Path(model_path))

        def read() -> RecordingReader:
            reader = RecordingReader(
                *(
                    log,
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
    read: Callable[[], RecordingReader],
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
    if not model.provenance.logs:
        warnings.append(
            "the model is not identified from logs: its friction and its noise are assumed"
            + ("" if settings.model else ", so that no reading is valid; run identify first")
        )
    else:
        warnings += model.fitted_robot.doubts(robot)
    other = model.fitted_robot.differences(robot)
    warnings += [f"read as asked for with another robot: {key}: {what}" for key, what in other]
    if model.provenance.logs and model.torque_error is None:
        warnings.append(
            "the model does not state its torque error at rest and in motion: one covariance "
            "stands for both; identify it again"
        )
    elif model.provenance.logs and model.contact_noise is None:
        warnings.append(
            "the model does not state its readings without contact: how often contact is reported "
            "where nothing touches the arm is not known; identify it again"
        )
    if settings.estimate.drift is not None:
        if model.torque_error is None:
            raise InputError(
                "estimate",
                "drift",
                "model.yaml states no torque error",
                "identify it again, or leave --drift out",
            )
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
    # A joint's friction is that of several motors where joints are coupled, and an observer of the
    # wrench leaves no friction in tau_ext.
    watches = not robot.is_coupled and (kind is None or kind.kernels.wrench is None)
    passes, shown, error, wide = 0.0, None, model.torque_error, model
    if watches and settings.estimate.drift is None and model.provenance.logs and error is not None:
        part = _Part(progress, 0.0, 0.3, "looking at friction")
        shown, passes = _shown_drift(read(), robot, model, config, settings.estimate, part), 0.3
        if shown is not None:
            wide = replace(model, torque_error=replace(error, drift_shown=shown))
    if not _has_prior(config):
        part = _Part(progress, passes, passes + 0.3, "finding the prior")
        config, rule = _with_evidence(read(), robot, model, config, max_gap, part, warnings)
        passes += 0.3
    reader = read()
    part = _Part(progress, passes, 1.0, "estimating")
    screen = _screen(robot, config)
    chunks = _uniform(reader, screen, config, max_gap, part)
    first = next(chunks)
    config = _timed(config, first)
    detection = settings.estimate.detection
    samples = chain([first], chunks)
    estimates = _estimates(settings.estimate, robot, model, wide, config, samples)
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
    watch: FrictionWatch | None = None
    if watches:
        watch = FrictionWatch(model, model.chain(robot), observer.pole, config.observer.time_step)
    with ExitStack() as stack:
        table = stack.enter_context(WrenchTableWriter(path, robot.num_joints, with_covariance))
        bag: WrenchBagWriter | None = None
        if settings.estimate.mcap:
            bag = stack.enter_context(WrenchBagWriter(out / "wrench.mcap", robot.config.base_link))
        for chunk, batch, found, tau_ext in estimates:
            if settings.model is None:  # nothing holds the stated band to the arm
                batch = batch._replace(valid=np.zeros_like(batch.valid))
            fault = _fault(chunk, batch)
            found = found.without(chunk.dropout | (fault != 0))
            odds: Array | None = None
            if places:
                alone, error = of_contacts(found.contact, chunk.t, tau_ext), model.torque_error
                found, odds, trusted = judge_places(
                    *(found, chunk.t, batch.J, alone, batch.torque_sd),
                    None if error is None else error.correlation,
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
            there = _there(chunk, fault, tau_ext, settled)
            if watch is not None:
                watch.add(chunk.t, chunk.q, chunk.v, tau_ext, there, ~found.contact)
            upright.add(chunk.q, tau_ext, there)
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
    if watch is not None:
        fitted = _fitted_on(model, settings.log)
        warnings += watch.sentences(settings.log, settings.robot, settings.model, shown, fitted)
    reads_moments = config.reconstruction.method != "force_only"
    out.write_figure("wrench", summary.figure(reads_moments, settings.estimate.smooth))
    used = replace(settings.estimate, estimator=config)
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
        contacts=tuple(episodes.lines()) if model.torque_error is not None else (),
        _metrics=metrics,
        comparison=comparison,
    )


def _fitted_on(model: IdentifiedModel, log: str) -> bool:
    """Whether the model was fitted on this very file."""
    path = Path(log)
    names = {own.name for own in model.provenance.logs}
    if path.name not in names or not path.is_file():
        return False
    sums = {own.sha256 for own in model.provenance.logs}
    return file_checksum(path) in sums


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


def _timed(config: WrenchEstimatorConfig, chunk: Recording) -> WrenchEstimatorConfig:
    """The configuration with the time step that the log suggests, unless it states one."""
    step = config.observer.time_step or float(plausible_step(chunk))
    return replace(config, observer=replace(config.observer, time_step=step))


class _BatchEngine:
    """The kernels, chunk after chunk."""

    def __init__(
        self,
        robot: Robot,
        model: IdentifiedModel,
        config: WrenchEstimatorConfig,
        detection: ContactDetectionConfig,
    ) -> None:
        self._estimator = WrenchEstimator(robot, model, config)
        self._state = self._estimator.initial_state()
        self._detector = ContactDetector.of(self._estimator, detection)
        self._detector_state = self._detector.initial_state()

    def run(self, q: Array, v: Array, current: Array) -> tuple[EstimateBatch, Detection]:
        batch = self._estimator.run(self._state, q, v, current)
        missing = np.isnan(batch.J[:, :1]).any(axis=2)
        q, v = np.where(missing, np.nan, q), np.where(missing, np.nan, v)
        return batch, self._detector.run(self._detector_state, q, v, batch)


class _DiagramEngine:
    """The same chain as a Drake diagram that replays the log, stretch after stretch."""

    def __init__(
        self,
        robot: Robot,
        model: IdentifiedModel,
        config: WrenchEstimatorConfig,
        detection: ContactDetectionConfig,
    ) -> None:
        from pydrake.systems.analysis import Simulator

        from wrenchsight.diagrams.replay import make_replay

        self._replay = make_replay(robot, model, config, detection)
        self._simulator = Simulator(self._replay.diagram)

    def run(self, q: Array, v: Array, current: Array) -> tuple[EstimateBatch, Detection]:
        context = self._simulator.get_mutable_context()
        self._replay.load(context, q, v, current)
        self._simulator.AdvanceTo(self._replay.stop_time(context))
        detection = self._replay.take_detection(context)
        return self._replay.take(context), detection


_ENGINES: dict[str, type[_BatchEngine | _DiagramEngine]] = {
    "batch": _BatchEngine,
    "diagram": _DiagramEngine,
}


def _estimates(
    settings: EstimateConfig,
    robot: Robot,
    model: IdentifiedModel,
    wide: IdentifiedModel,
    config: WrenchEstimatorConfig,
    chunks: Iterable[Recording],
) -> Iterator[Read]:
    """The log's samples, what is read of them, contact and tau_ext as a controller would see it.

    Wrench and contact are those that `model` reads, the band is that of `wide`.
    """
    models = [model] if wide is model else [model, wide]
    kind = _ENGINES[settings.engine]

    def causal(models: list[IdentifiedModel]) -> Iterator[Read]:
        engine, *others = (kind(robot, own, config, settings.detection) for own in models)
        for chunk in chunks:
            batch, found = engine.run(chunk.q, chunk.v, chunk.current)
            for other in others:
                batch = with_band_of(batch, other.run(chunk.q, chunk.v, chunk.current)[0])
            yield Read(chunk, batch, found, batch.tau_ext)

    if settings.contact.axis:
        return read_contact(causal(models), robot, settings, config, _measured)
    if not settings.smooth:
        return causal(models)
    smoother, *wider = (WrenchSmoother(WrenchEstimator(robot, own, config)) for own in models)

    def take(part: Read) -> EstimateBatch:
        q, v, current = part.chunk.q, part.chunk.v, part.chunk.current
        ready = smoother.take(q, v, current)
        for own in wider:
            ready = with_band_of(ready, own.take(q, v, current))
        return ready

    def finish() -> EstimateBatch:
        ready = smoother.finish()
        for own in wider:
            ready = with_band_of(ready, own.finish())
        return ready

    return read_later(causal(models[:1]), take, finish)


def _measured(chunk: Recording, batch: EstimateBatch) -> Flags:
    return np.asarray(~chunk.dropout & (_fault(chunk, batch) == 0))


def _there(chunk: Recording, fault: NDArray[np.int64], tau_ext: Array, settled: int) -> Flags:
    """(N,) samples that were measured and, from index `settled` on, are read."""
    there = ~chunk.dropout & (fault == 0) & (np.arange(chunk.num_samples) >= settled)
    return np.asarray(there & np.isfinite(chunk.q + chunk.v + tau_ext).all(axis=1))


def _shown_drift(
    reader: RecordingReader,
    robot: Robot,
    model: IdentifiedModel,
    config: WrenchEstimatorConfig,
    settings: EstimateConfig,
    part: "_Part",
) -> Array | None:
    """`FrictionWatch.drifts` of a log."""
    watch: FrictionWatch | None = None
    for chunk in _uniform(reader, _screen(robot, config), config, settings.max_gap, part):
        if watch is None:
            timed = _timed(config, chunk)
            engine = _BatchEngine(robot, model, timed, settings.detection)
            observer = make_observer(timed.observer, robot.num_joints)
            begin = chunk.t[0] + observer.settling_time
            watch = FrictionWatch(
                model, model.chain(robot), observer.pole, timed.observer.time_step
            )
        batch, found = engine.run(chunk.q, chunk.v, chunk.current)
        fault = _fault(chunk, batch)
        free = ~found.without(chunk.dropout | (fault != 0)).contact
        there = _there(chunk, fault, batch.tau_ext, int(np.searchsorted(chunk.t, begin)))
        watch.add(chunk.t, chunk.q, chunk.v, batch.tau_ext, there, free)
    return None if watch is None else watch.drifts()


def _screen(robot: Robot, config: WrenchEstimatorConfig) -> SampleScreen | None:
    return SampleScreen(robot) if config.check_samples else None


def _fault(chunk: Recording, batch: EstimateBatch) -> NDArray[np.int64]:
    """(N,) as `EstimateBatch.fault`, with what was found before the log was resampled."""
    found = chunk.extra.get(FAULT)
    if found is None:
        return batch.fault
    # An interpolated sample beside a missing one is missing, too.
    return np.asarray(batch.fault | np.where(found == 0.0, 0, BEYOND))


def _torque(chunk: Recording, robot: Robot) -> Array:
    """(N, n) motor torque on the joint side, N m."""
    return np.asarray(robot.joint_torque(chunk.current))


def _uniform(
    reader: RecordingReader,
    screen: SampleScreen | None,
    config: WrenchEstimatorConfig,
    max_gap: float,
    part: "_Part",
) -> Iterator[Recording]:
    """The log on its uniform grid, some ten thousand samples at a time."""
    step = config.observer.time_step or None
    chunks = reader.chunks() if screen is None else screen.screened(reader.chunks())
    for chunk in resample_chunks(chunks, step, max_gap or None):
        for begin in range(0, chunk.num_samples, CHUNK_SAMPLES):
            yield chunk[begin : begin + CHUNK_SAMPLES]
        part(reader.progress)


def _with_evidence(
    reader: RecordingReader,
    robot: Robot,
    model: IdentifiedModel,
    config: WrenchEstimatorConfig,
    max_gap: float,
    part: "_Part",
    warnings: list[str],
) -> tuple[WrenchEstimatorConfig, str]:
    """The configuration with the prior that explains the log best, and the rule's name."""
    J, tau_ext = EvenSample(_PRIOR_SAMPLES), EvenSample(_PRIOR_SAMPLES)
    estimator: WrenchEstimator | None = None
    kind = kind_of(config.observer)
    plain = config
    if kind is not None and kind.kernels.wrench is not None:
        # An observer that reads the wrench by a prior cannot tell which prior explains the torque.
        observer = MomentumObserverConfig(
            time_step=config.observer.time_step, torque_samples=config.observer.torque_samples
        )
        plain = replace(config, observer=observer)
    for chunk in _uniform(reader, _screen(robot, config), config, max_gap, part):
        if estimator is None:
            estimator = WrenchEstimator(robot, model, _timed(plain, chunk))
            state = estimator.initial_state()
        batch = estimator.run(state, chunk.q, chunk.v, chunk.current)
        measured = ~chunk.dropout & (batch.fault == 0)
        sd = np.ones_like(batch.tau_ext) if model.torque_error is None else batch.torque_sd
        J.add((batch.J / sd[:, None, :])[measured])
        tau_ext.add((batch.tau_ext / sd)[measured])
    noise = model.residual_covariance
    if model.torque_error is not None:
        noise = model.torque_error.correlation
    force_sd, moment_sd = evidence_prior(J.values(), tau_ext.values(), noise)
    prior = config.reconstruction
    live_force, live_moment = live_prior(robot.payload)
    if force_sd < FLOOR_SHARE * live_force and prior.prior_force_sd is None:
        warnings.append(
            f"the prior that explains the log best is {force_sd:.3g} N; "
            f"{FLOOR_SHARE * live_force:.3g} N are taken, so that a short contact still reads"
        )
    force_sd = max(force_sd, FLOOR_SHARE * live_force)
    moment_sd = max(moment_sd, FLOOR_SHARE * live_moment)
    given = [
        name
        for name, value in (("force", prior.prior_force_sd), ("moment", prior.prior_moment_sd))
        if value is not None
    ]
    rule = "evidence of the log" + (f", {given[0]} given" if given else "")
    return replace(config, reconstruction=prior.with_prior(float(force_sd), float(moment_sd))), rule


class _Part:
    """Progress of one pass within the whole."""

    def __init__(self, report: ProgressCallback, begin: float, end: float, what: str) -> None:
        self._report, self._begin, self._end, self._what = report, begin, end, what

    def __call__(self, fraction: float) -> None:
        self._report(self._begin + fraction * (self._end - self._begin), self._what)
