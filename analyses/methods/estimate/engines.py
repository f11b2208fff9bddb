"""Engines: run a log's chunks through the estimator, with the model as it is, or tracked.

The reading F is that of the model as it is, also where the log shows friction drift: a model that
trusts a drifted joint less also reads less of a contact. The model with the drift reads a mean F'
with a covariance Sigma'. The stated covariance is the second moment of that about F:

    Sigma' + (F - F') (F - F')^T
"""

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from wrenchsight.analyses.methods.estimate.estimate_config import EstimateConfig
from wrenchsight.analyses.methods.estimate.uniform_log import is_measured, marked_current
from wrenchsight.models.detection.contact_detector import ContactEstimator, Detection, Reader
from wrenchsight.models.detection.tracked_estimator import TrackedEstimator
from wrenchsight.models.estimation.contact_reading import ContactReader
from wrenchsight.models.estimation.estimator import (
    EstimateBatch,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.estimation.smoothing import WrenchSmoother
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.observers.observer_kinds import make_observer
from wrenchsight.models.recordings.recording import Recording, concatenated
from wrenchsight.models.robot.robot import Robot


class LogPart(NamedTuple):
    """A part of a log with its readings.

    Attributes:
        chunk: N samples of the log.
        batch: their wrenches.
        detection: of contact, sample by sample.
        tau_ext: (N, n) N m, as a controller would read it.
    """

    chunk: Recording
    batch: EstimateBatch
    detection: Detection
    tau_ext: Array

    def rows(self, rows: slice | Flags) -> "LogPart":
        """Some of the samples."""
        return LogPart(
            self.chunk[rows], self.batch.rows(rows), self.detection.rows(rows), self.tau_ext[rows]
        )

    def followed_by(self, later: "LogPart") -> "LogPart":
        """The samples of both parts."""
        return LogPart(
            concatenated([self.chunk, later.chunk]),
            EstimateBatch.joined([self.batch, later.batch]),
            Detection.joined([self.detection, later.detection]),
            np.concatenate([self.tau_ext, later.tau_ext]),
        )


class ReadingModels(NamedTuple):
    """Models of one arm that a log is read with.

    Attributes:
        model: that reads the wrench.
        model_with_drift: that judges contact and states the band; `model` itself where the log
            shows no drift.
    """

    model: IdentifiedModel
    model_with_drift: IdentifiedModel

    def distinct(self) -> list[IdentifiedModel]:
        """The first reads; the second, if any, states the band."""
        if self.model_with_drift is self.model:
            return [self.model]
        return [self.model, self.model_with_drift]


def estimates(
    settings: EstimateConfig,
    robot: Robot,
    models: ReadingModels,
    config: WrenchEstimatorConfig,
    chunks: Iterable[Recording],
    tracked: TrackedEstimator | None,
) -> Iterator[LogPart]:
    """Reads a log: causally, smoothed, or at a contact of known axis, as the settings say.

    Contact is always judged causally. Smoothed readings and those of a known axis come some samples
    later, and take the place of the causal ones.

    Args:
        settings: checked: `smooth` goes with neither `track` nor a contact's axis.
        models: the second, if another one, states the band.
        config: configuration of the estimator, with the log's time step.
        chunks: of the log, on its grid.
        tracked: estimator that follows friction and takes the place of the models; None: they read.
            It holds today's friction once all parts are taken.

    Yields:
        The log in parts, all its samples in order. Nothing is read before they are taken.
    """
    parts = _causal_parts(settings, robot, models.distinct(), config, chunks, tracked)
    if settings.contact.axis:
        return read_contact(parts, robot, settings, config)
    if not settings.smooth:
        return parts
    # Of two models the first gives the readings, the second their band (`_with_last_band`).
    smoothers = [WrenchSmoother(WrenchEstimator(robot, m, config)) for m in models.distinct()]

    def take(part: LogPart) -> EstimateBatch:
        q, v, current = part.chunk.q, part.chunk.v, marked_current(part.chunk)
        return _with_last_band([smoother.take(q, v, current) for smoother in smoothers])

    def finish() -> EstimateBatch:
        return _with_last_band([smoother.finish() for smoother in smoothers])

    return read_later(parts, take, finish)


def _causal_parts(
    settings: EstimateConfig,
    robot: Robot,
    models: list[IdentifiedModel],
    config: WrenchEstimatorConfig,
    chunks: Iterable[Recording],
    tracked: TrackedEstimator | None,
) -> Iterator[LogPart]:
    """The parts of a log, each sample read from those before it."""
    engines: list[Reader]
    if tracked is not None:
        engines = [tracked]
    else:
        engines = [
            ContactEstimator(WrenchEstimator(robot, model, config), settings.detection)
            for model in models
        ]
    for chunk in chunks:
        current = marked_current(chunk)
        runs = [engine.run(chunk.q, chunk.v, current) for engine in engines]
        batch = _with_last_band([run_batch for run_batch, _ in runs])
        _, detection = runs[-1]  # drift that the log shows is no contact
        yield LogPart(chunk, batch, detection, batch.tau_ext)


def covariance_about(wrench: Array, mean: Array, covariance: Array) -> Array:
    """Second moment (N, 6, 6) about `wrench` (N, 6) of a wrench of this mean and covariance."""
    difference = wrench - mean
    return np.asarray(covariance + difference[:, :, None] * difference[:, None, :])


def with_band_of(batch: EstimateBatch, batch_with_drift: EstimateBatch) -> EstimateBatch:
    """The readings of `batch` with the band of `batch_with_drift`, valid where both are."""
    covariance = covariance_about(
        batch.wrench, batch_with_drift.wrench, batch_with_drift.covariance
    )
    return batch._replace(
        covariance=covariance,
        invalid=batch.invalid | batch_with_drift.invalid,
        torque_sd=batch_with_drift.torque_sd,
    )


def _with_last_band(batches: list[EstimateBatch]) -> EstimateBatch:
    """The readings of the first batch with the band of the last, where there are two."""
    batch = batches[0]
    for batch_with_drift in batches[1:]:
        batch = with_band_of(batch, batch_with_drift)
    return batch


def read_later(
    parts: Iterable[LogPart],
    take: Callable[[LogPart], EstimateBatch],
    finish: Callable[[], EstimateBatch],
) -> Iterator[LogPart]:
    """The parts of a log again, with a reading that comes some samples after them.

    Args:
        parts: as a controller would read them.
        take: takes a part; returns the readings of the earliest samples without one.
        finish: returns the readings of the samples that remain.
    """
    unread: LogPart | None = None
    for part in parts:
        unread = part if unread is None else unread.followed_by(part)
        ready = take(part)
        count = len(ready.invalid)
        if count:
            yield unread.rows(slice(0, count))._replace(batch=ready)
        unread = unread.rows(slice(count, None))
    if unread is not None:
        yield unread._replace(batch=finish())


def read_contact(
    parts: Iterable[LogPart],
    robot: Robot,
    settings: EstimateConfig,
    config: WrenchEstimatorConfig,
) -> Iterator[LogPart]:
    """Reads the parts of a log again, with the known direction of the contact.

    The reader is given the motor torque, and the causal readings with what the observer read.

    Args:
        parts: as a controller would read them.
        settings: of the command, with the contact's axis.
        config: of the estimator: that of the settings, with what the log filled in.
    """
    # Made for its pole alone, by which the reader knows how late the causal readings are.
    observer = make_observer(config.observer, robot.num_joints)
    reader = ContactReader(
        robot,
        observer.pole,
        config.observer.time_step,
        settings.contact,
        config.reconstruction.max_force_sd,
    )

    def take(part: LogPart) -> EstimateBatch:
        chunk, batch = part.chunk, part.batch
        tau_J = robot.joint_torque(chunk.current)
        return reader.take(chunk.q, chunk.v, tau_J, is_measured(chunk, batch), batch)

    return read_later(parts, take, reader.finish)


def without_breaks(parts: Iterable[LogPart]) -> Iterator[LogPart]:
    """The parts of a log again, without the samples between the episodes of a data set."""
    for part in parts:
        row = part.chunk.row
        if row is None or row.all():
            yield part
        elif row.any():
            yield part.rows(row != 0)
