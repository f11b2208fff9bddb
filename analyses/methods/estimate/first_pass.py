"""What is asked of a whole log before it is read: a load or drifted friction, and the prior."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from wrenchsight.analyses.methods.estimate.estimate_config import (
    FLOOR_SHARE,
    EstimateConfig,
    stated_prior,
)
from wrenchsight.analyses.methods.estimate.friction_watch import FrictionWatch
from wrenchsight.analyses.methods.estimate.uniform_log import (
    Part,
    ProgressCallback,
    completed,
    fault_of,
    screen_of,
    there,
    uniform_chunks,
)
from wrenchsight.analyses.output.stream_summary import EvenSample
from wrenchsight.models.detection.contact_detector import ContactEstimator
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.estimation.evidence_prior import evidence_prior
from wrenchsight.models.estimation.wrench import live_prior
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.momentum_observer import MomentumObserverConfig
from wrenchsight.models.observers.observer_kinds import kind_of, make_observer
from wrenchsight.models.recordings.episodes_reader import LogReader
from wrenchsight.models.recordings.position_resolution import position_resolution
from wrenchsight.models.robot.robot import Robot

_PRIOR_SAMPLES = 1 << 12


@dataclass(frozen=True, eq=False)
class FirstPass:
    """What a log said before it is read.

    Attributes:
        resolution: (n,) rad, of the encoders.
        prior: sds of force and moment, N and N m, where the configuration leaves them open; None:
            it states both.
        rule: by which the prior was found.
        watch: of its friction, and of a load; None: not looked at.
        drift_shown: (n,) share of the viscous torque; None: no drift shows.
        wide: the model whose band is stated: with the drift that shows.
        passes: share of the work that is done.
    """

    resolution: list[float]
    prior: tuple[float, float] | None
    rule: str
    watch: FrictionWatch | None
    drift_shown: Array | None
    wide: IdentifiedModel
    passes: float


def first_pass(
    read: Callable[[], LogReader],
    robot: Robot,
    model: IdentifiedModel,
    settings: EstimateConfig,
    progress: ProgressCallback,
    warnings: list[str],
) -> FirstPass:
    """Asks a log what reading it takes; `read` opens it for one pass, `warnings` gets more."""
    config = settings.estimator
    resolution = config.position_resolution
    if resolution is None:
        step = position_resolution(next(iter(read().chunks())).q)
        known = robot.position_resolution
        resolution = np.where(np.isfinite(known), known, step).tolist()
    prior, rule = None, "given"
    stated = stated_prior(settings, robot)
    if stated is None and settings.contact.axis:
        stated, rule = live_prior(robot.payload), "live"  # no pass over the log
    if stated is not None and not _has_prior(config):
        prior = stated
        if settings.prior == "live":
            rule = "live"
    passes, shown, error, wide = 0.0, None, model.torque_error, model
    watch: FrictionWatch | None = None
    # A joint's friction is that of several motors where joints are coupled.
    if model.provenance.logs and not robot.is_coupled and not settings.track:
        part = Part(progress, 0.0, 0.3, "looking at friction")
        watch = friction_of(read(), robot, model, settings, resolution, prior, part)
        passes = 0.3
    if watch is not None and settings.drift is None and error is not None:
        shown = watch.drifts()
        if shown is not None:
            wide = replace(model, torque_error=replace(error, drift_shown=shown))
    if prior is None and not _has_prior(config):
        part = Part(progress, passes, passes + 0.3, "finding the prior")
        prior, rule = evident_prior(read(), robot, model, settings, resolution, part, warnings)
        passes += 0.3
    return FirstPass(resolution, prior, rule, watch, shown, wide, passes)


def _has_prior(config: WrenchEstimatorConfig) -> bool:
    prior = config.reconstruction
    return prior.prior_force_sd is not None and prior.prior_moment_sd is not None


def friction_of(
    reader: LogReader,
    robot: Robot,
    model: IdentifiedModel,
    settings: EstimateConfig,
    resolution: list[float],
    prior: tuple[float, float] | None,
    part: Part,
) -> FrictionWatch | None:
    """What a log's contact-free stretches say of its friction, and of a load; None: no sample."""
    watch: FrictionWatch | None = None
    config = settings.estimator
    chunks = uniform_chunks(reader, screen_of(robot, config), config, settings.max_gap, part)
    for chunk in chunks:
        if watch is None:
            own = completed(_plain(config), chunk, resolution, prior)
            engine = ContactEstimator(WrenchEstimator(robot, model, own), settings.detection)
            observer = make_observer(own.observer, robot.num_joints)
            begin = chunk.t[0] + observer.settling_time
            step = own.observer.time_step
            watch = FrictionWatch(model, model.chain(robot), observer.pole, step, robot)
        batch, found = engine.run(chunk.q, chunk.v, chunk.current)
        fault = fault_of(chunk, batch)
        free = ~found.without(chunk.dropout | (fault != 0)).contact
        known = there(chunk, fault, batch.tau_ext, int(np.searchsorted(chunk.t, begin)))
        watch.add(chunk.t, chunk.q, chunk.v, batch.tau_ext, known, free)
    return watch


def evident_prior(
    reader: LogReader,
    robot: Robot,
    model: IdentifiedModel,
    settings: EstimateConfig,
    resolution: list[float],
    part: "Part",
    warnings: list[str],
) -> tuple[tuple[float, float], str]:
    """Force sd (N) and moment sd (N m) that explain the log best, and the rule's name."""
    J, tau_ext = EvenSample(_PRIOR_SAMPLES), EvenSample(_PRIOR_SAMPLES)
    estimator: WrenchEstimator | None = None
    config = settings.estimator
    chunks = uniform_chunks(reader, screen_of(robot, config), config, settings.max_gap, part)
    for chunk in chunks:
        if estimator is None:
            own = completed(_plain(config), chunk, resolution, None)
            estimator = WrenchEstimator(robot, model, own)
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
    return (float(force_sd), float(moment_sd)), rule


def _plain(config: WrenchEstimatorConfig) -> WrenchEstimatorConfig:
    """The configuration with an observer that leaves friction, and all that a prior is asked of,
    in tau_ext: one that reads the wrench itself does not."""
    kind = kind_of(config.observer)
    if kind is None or kind.kernels.wrench is None:
        return config
    own = config.observer
    observer = MomentumObserverConfig(time_step=own.time_step, torque_samples=own.torque_samples)
    return replace(config, observer=observer)
