"""First pass over a log: estimates load, friction drift and the force prior.

Without a stated prior the observer runs over the whole log. The prior is the one that explains best
some thousand samples of external torque and Jacobian, evenly spread
(`models.estimation.evidence_prior.evidence_prior`).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from wrenchsight.analyses.methods.estimate.estimate_config import (
    FLOOR_SHARE,
    EstimateConfig,
    stated_prior,
)
from wrenchsight.analyses.methods.estimate.friction_monitor import FrictionMonitor
from wrenchsight.analyses.methods.estimate.uniform_log import (
    PassProgress,
    completed,
    fault_of,
    is_measured,
    is_usable,
    screen_of,
    uniform_chunks,
)
from wrenchsight.analyses.output.progress import ProgressCallback
from wrenchsight.analyses.output.stream_summary import EvenSample
from wrenchsight.models.calibration.gear_ripple import GearRipple
from wrenchsight.models.calibration.load_or_drift import LoadOrDrift
from wrenchsight.models.detection.contact_detector import ContactEstimator
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.evidence_prior import evidence_prior
from wrenchsight.models.estimation.lever_prior import Lever, find_lever
from wrenchsight.models.estimation.wrench_prior import live_prior
from wrenchsight.models.friction.sliding_friction import with_sliding
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.observers.observer_kinds import kind_of, make_observer
from wrenchsight.models.recordings.episodes_reader import LogReader
from wrenchsight.models.recordings.position_resolution import position_resolution
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

_PRIOR_SAMPLES = 1 << 12  # at most: the likelihood's memory and time do not grow with the log
_LEVER_RATIO = 1.25  # of the moment of a lever to the evidence's, above which it is the prior
_PASS_WORK = 0.3  # share of the whole work, of one pass over the log


@dataclass(frozen=True, eq=False)
class FirstPassResult:
    """What the first pass estimates from a log.

    Attributes:
        resolution: (n,) rad, of the encoders.
        prior: sds of force and moment, N and N m, where the configuration leaves them open; None:
            it states both.
        prior_rule: by which the prior was found.
        friction_monitor: of the log's friction, and of a load; None: not looked at.
        drift_shown: (n,) share of the viscous torque; None: the log shows no drift.
        ripple_shown: ripple of the gears; None: the log shows none.
        model_with_drift: the model whose band is stated: with the drift and the ripple that the log
            shows.
        lever: of the force, where the moment's prior is that of a lever; None: it is not.
        warnings: one sentence each.
        work_done: share of the whole work, 0 to 1.
    """

    resolution: list[float]
    prior: tuple[float, float] | None
    prior_rule: str
    friction_monitor: FrictionMonitor | None
    drift_shown: Array | None
    ripple_shown: GearRipple | None
    model_with_drift: IdentifiedModel
    lever: Lever | None
    warnings: tuple[str, ...]
    work_done: float

    def load(self) -> LoadOrDrift | None:
        """The load, weighed against friction drift; None where it was not looked for."""
        return None if self.friction_monitor is None else self.friction_monitor.load()


class EvidencePrior(NamedTuple):
    """The prior that explains a log best.

    Attributes:
        sds: of force and moment, N and N m.
        rule: by which it was found.
        lever: whose moment gives the moment's sd; None: the evidence does.
        warnings: one sentence each.
    """

    sds: tuple[float, float]
    rule: str
    lever: Lever | None
    warnings: tuple[str, ...]


class _PassOverLog(NamedTuple):
    """What each pass over a log needs.

    Attributes:
        reader: of the log, at its begin.
        config: of the estimate.
        resolution: (n,) rad, of the encoders.
        progress: of this pass.
    """

    reader: LogReader
    robot: Robot
    model: IdentifiedModel
    config: EstimateConfig
    resolution: list[float]
    progress: PassProgress

    def chunks(self) -> Iterator[Recording]:
        """The log on its uniform grid."""
        estimator_config = self.config.estimator
        return uniform_chunks(
            self.reader,
            screen_of(self.robot, estimator_config),
            estimator_config,
            self.config.max_gap,
            self.progress,
        )


def first_pass(
    open_log: Callable[[], LogReader],
    robot: Robot,
    model: IdentifiedModel,
    config: EstimateConfig,
    progress: ProgressCallback,
) -> FirstPassResult:
    """Estimates encoder resolution, load, friction drift and the prior from the whole log.

    Friction and prior take a pass each, where they are looked for at all: friction of a model that
    logs were identified from, the prior where nothing states it. Both passes have the model as it
    is given, without the drift that the first of them shows.

    Args:
        open_log: opens the log for one pass.
    """
    resolution = _encoder_resolution(open_log, robot, config)
    work_done = 0.0  # share of the whole work

    def pass_over_log(title: str) -> _PassOverLog:
        """A pass to come; its progress goes on from the work done by then."""
        pass_progress = PassProgress(progress, work_done, work_done + _PASS_WORK, title)
        return _PassOverLog(open_log(), robot, model, config, resolution, pass_progress)

    # Sds of force and moment, N and N m; None: the configuration states both, or the log tells.
    prior, prior_rule = _prior_without_log(config, robot)
    monitor: FrictionMonitor | None = None
    # Not where joints are coupled: a joint's friction is then that of several motors. With `track`
    # the second pass follows friction itself.
    if model.provenance.logs and not robot.is_coupled and not config.track:
        monitor = _monitor_friction(pass_over_log("estimating friction drift"), prior)
        work_done += _PASS_WORK
    drift_shown, model_with_drift = _model_with_drift(model, monitor, config)
    ripple_shown = None if monitor is None else monitor.ripple()
    if ripple_shown is not None:
        model_with_drift = _with_ripple(model_with_drift, ripple_shown)
    lever: Lever | None = None
    warnings: tuple[str, ...] = ()
    if prior is None and not config.estimator.reconstruction.states_prior:
        evidence = _evidence_prior(pass_over_log("finding the prior"))
        prior, prior_rule = evidence.sds, evidence.rule
        lever, warnings = evidence.lever, evidence.warnings
        work_done += _PASS_WORK
    if ripple_shown is not None:
        warnings += (ripple_shown.sentence(model.joint_names),)
    return FirstPassResult(
        resolution=resolution,
        prior=prior,
        prior_rule=prior_rule,
        friction_monitor=monitor,
        drift_shown=drift_shown,
        ripple_shown=ripple_shown,
        model_with_drift=model_with_drift,
        lever=lever,
        warnings=warnings,
        work_done=work_done,
    )


def _encoder_resolution(
    open_log: Callable[[], LogReader], robot: Robot, config: EstimateConfig
) -> list[float]:
    """(n,) rad: the configuration's, else the robot's, else the smallest step of the log."""
    if config.estimator.position_resolution is not None:
        return config.estimator.position_resolution
    log_step = position_resolution(next(iter(open_log().chunks())).q)
    robot_step = robot.position_resolution
    return list(np.where(np.isfinite(robot_step), robot_step, log_step).tolist())


def _prior_without_log(
    config: EstimateConfig, robot: Robot
) -> tuple[tuple[float, float] | None, str]:
    """The prior that is stated without a pass over the log, if any, and its rule."""
    prior, rule = stated_prior(config, robot), "given"
    if prior is None and config.contact.axis:
        prior, rule = live_prior(robot.payload), "live"
    if prior is None or config.estimator.reconstruction.states_prior:
        return None, rule
    return prior, "live" if config.prior == "live" else rule


def _model_with_drift(
    model: IdentifiedModel, monitor: FrictionMonitor | None, config: EstimateConfig
) -> tuple[Array | None, IdentifiedModel]:
    """The drift (n,) that the log shows, or None, and the model with it in its torque error.

    Of a log in which something touches the model has today's friction, and the drift is its
    sd: a drift that is told from a force is known in its sign, too.
    """
    error = model.torque_error
    if monitor is None or config.drift is not None or error is None:
        return None, model
    drift_shown = monitor.drifts()
    if drift_shown is None:
        return None, model
    refresh, friction = monitor.refreshed(), model.friction
    if refresh is not None:
        friction = with_sliding(friction, refresh.after)
    with_drift = replace(error, drift_shown=drift_shown)
    return drift_shown, replace(model, friction=friction, torque_error=with_drift)


def _with_ripple(model: IdentifiedModel, ripple: GearRipple) -> IdentifiedModel:
    """The model with the ripple in its torque error: more of what does not depend on motion."""
    error = model.torque_error
    assert error is not None
    constant = np.hypot(error.constant, ripple.torque_sd)
    return replace(model, torque_error=replace(error, constant=constant))


def _monitor_friction(log_pass: _PassOverLog, prior: tuple[float, float] | None) -> FrictionMonitor:
    """Gathers friction and load from a log's contact-free stretches.

    Contact is judged causally. Samples before the observer has settled do not count.

    Args:
        prior: force sd in N and moment sd in N m, for the estimator behind the contact detector;
            None: what the configuration states, else none.
    """
    robot, model, config = log_pass.robot, log_pass.model, log_pass.config
    chunks = log_pass.chunks()
    first_chunk = next(chunks)  # gives the time step; a log has a sample or more
    estimator_config = completed(
        _with_torque_observer(config.estimator), first_chunk, log_pass.resolution, prior
    )
    engine = ContactEstimator(WrenchEstimator(robot, model, estimator_config), config.detection)
    observer = make_observer(estimator_config.observer, robot.num_joints)
    settled_from = first_chunk.t[0] + observer.settling_time
    step = estimator_config.observer.time_step
    monitor = FrictionMonitor(model, model.chain(robot), observer.pole, step, robot)
    for chunk in chain([first_chunk], chunks):
        batch, detection = engine.run(chunk.q, chunk.v, chunk.current)
        fault = fault_of(chunk, batch)
        # A missing or faulty sample shows no contact: it is no reason to drop its neighbours.
        is_free = ~detection.without(chunk.dropout | (fault != 0)).contact
        first_settled = int(np.searchsorted(chunk.t, settled_from))
        is_used = is_usable(chunk, fault, batch.tau_ext, first_settled)
        # All samples, for the monitor's low-pass; it gathers rows of the used ones alone.
        monitor.add(chunk.t, chunk.q, chunk.v, batch.tau_ext, is_used, is_free)
    return monitor


class _PriorSamples(NamedTuple):
    """Samples of a log, evenly spread, in units of the sds of their torque errors.

    Attributes:
        q: (M, n) rad.
        J, J_seen: (M, 6, n) of the sample, and as tau_ext saw it; columns over the sds.
        tau_ext: (M, n), over the sds.
        torque_covariance: (n, n) of the errors in these units.
        duration: s, of the whole log.
    """

    q: Array
    J: Array
    J_seen: Array
    tau_ext: Array
    torque_covariance: Array
    duration: float


def _evidence_prior(log_pass: _PassOverLog) -> EvidencePrior:
    """The prior that explains best some thousand samples of a log (`evidence_prior`).

    Both sds are found together, and raised to FLOOR_SHARE of the live prior at least. The moment's
    sd is that of a lever where the log shows one (`find_lever`) and it exceeds the evidence's by
    _LEVER_RATIO. An sd that the configuration states stays: `completed` fills in the open one
    alone, and warnings and the rule's words are of that. Of a log without a possible sample the
    prior is the live one.
    """
    samples = _prior_samples(log_pass)
    live = live_prior(log_pass.robot.payload)
    if not len(samples.q):
        return EvidencePrior(live, "live: every sample is impossible", None, ())
    stated = log_pass.config.estimator.reconstruction
    noise = samples.torque_covariance
    warnings: list[str] = []
    force_sd, moment_sd = evidence_prior(samples.J, samples.tau_ext, noise)
    least_force_sd, least_moment_sd = FLOOR_SHARE * live.force_sd, FLOOR_SHARE * live.moment_sd
    if force_sd < least_force_sd and stated.prior_force_sd is None:
        warnings.append(
            f"prior that explains the log best: force sd {force_sd:.3g} N; raised to "
            f"{least_force_sd:.3g} N for short contacts; state another with --prior"
        )
    force_sd, moment_sd = max(force_sd, least_force_sd), max(moment_sd, least_moment_sd)
    lever: Lever | None = None
    if stated.prior_moment_sd is None and stated.reads_moments:
        R_WE, _ = log_pass.robot.chain.pose(samples.q)
        # `evidence_prior` leaves out samples that are not finite itself, `find_lever` does not.
        J_seen, R_WE, tau_ext = _finite(samples.J_seen, R_WE, samples.tau_ext)
        lever = find_lever(J_seen, R_WE, tau_ext, noise, samples.duration)
        if lever is not None and lever.moment_sd <= _LEVER_RATIO * moment_sd:
            lever = None
        if lever is not None:
            moment_sd = lever.moment_sd
    rule = "evidence of the log"  # not both sds are stated: then no evidence is asked for
    if stated.prior_force_sd is not None:
        rule += ", force given"
    elif stated.prior_moment_sd is not None:
        rule += ", moment given"
    return EvidencePrior((float(force_sd), float(moment_sd)), rule, lever, tuple(warnings))


def _prior_samples(log_pass: _PassOverLog) -> _PriorSamples:
    """Takes the samples of a log that were measured and are possible, _PRIOR_SAMPLES at most.

    Torque, and the columns of J, are over the sds of the torque error; of a model without one they
    stay in N m, beside its residual covariance.
    """
    model, config = log_pass.model, _with_torque_observer(log_pass.config.estimator)
    chunks = log_pass.chunks()
    first_chunk = next(chunks)  # gives the time step; a log has a sample or more
    # Without a prior (None): tau_ext and J, which are taken, do not depend on it.
    completed_config = completed(config, first_chunk, log_pass.resolution, None)
    estimator = WrenchEstimator(log_pass.robot, model, completed_config)
    state = estimator.initial_state()
    # Each is given the same rows, and so keeps the same ones.
    q, J, J_seen, tau_ext = (EvenSample(_PRIOR_SAMPLES) for _ in range(4))
    duration = 0.0
    has_sds = model.torque_error is not None
    for chunk in chain([first_chunk], chunks):
        batch = estimator.run(state, chunk.q, chunk.v, chunk.current)
        duration += len(chunk.t) * estimator.observer.time_step
        measured = is_measured(chunk, batch)
        sd = batch.torque_sd if has_sds else np.ones_like(batch.tau_ext)
        q.add(chunk.q[measured])
        J.add((batch.J / sd[:, None, :])[measured])
        J_seen.add((batch.J_seen / sd[:, None, :])[measured])
        tau_ext.add((batch.tau_ext / sd)[measured])
    covariance = model.residual_covariance
    if model.torque_error is not None:
        covariance = model.torque_error.correlation
    return _PriorSamples(
        q=q.values(),
        J=J.values(),
        J_seen=J_seen.values(),
        tau_ext=tau_ext.values(),
        torque_covariance=covariance,
        duration=duration,
    )


def _finite(J: Array, R_WE: Array, tau_ext: Array) -> tuple[Array, Array, Array]:
    """The samples all of whose numbers are finite."""
    rows = np.isfinite(J).all(axis=(1, 2)) & np.isfinite(tau_ext).all(axis=1)
    rows &= np.isfinite(R_WE).all(axis=(1, 2))
    return J[rows], R_WE[rows], tau_ext[rows]


def _with_torque_observer(config: WrenchEstimatorConfig) -> WrenchEstimatorConfig:
    """The configuration with an observer of tau_ext.

    An observer that reads the wrench itself leaves neither friction nor the prior's evidence in
    tau_ext: the momentum observer takes its place.
    """
    kind = kind_of(config.observer)
    if kind is None or not kind.reads_wrench:
        return config
    momentum_observer = MomentumObserverConfig(
        time_step=config.observer.time_step, torque_samples=config.observer.torque_samples
    )
    return replace(config, observer=momentum_observer)
