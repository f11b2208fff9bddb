"""What runs a log's chunks through the estimator: the model as it is, or tracked.

A reading whose joints err by more than the model that read it knew stays that of the model as it
was: one that trusts a drifted joint less also reads less of a contact. What is known afterwards,
that friction may be further off, gives the wrench a mean F' and a covariance Sigma' of its own;
about the reading F its second moment is

    Sigma' + (F - F') (F - F')^T
"""

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from wrenchsight.analyses.methods.estimate.estimate_config import EstimateConfig
from wrenchsight.analyses.methods.estimate.uniform_log import marked_current, measured
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


class Read(NamedTuple):
    """A part of a log, what is read of it, contact, and tau_ext as a controller would see it."""

    chunk: Recording
    batch: EstimateBatch
    found: Detection
    tau_ext: Array


def estimates(
    settings: EstimateConfig,
    robot: Robot,
    model: IdentifiedModel,
    wide: IdentifiedModel,
    config: WrenchEstimatorConfig,
    chunks: Iterable[Recording],
    tracked: TrackedEstimator | None = None,
) -> Iterator[Read]:
    """The log's samples, what is read of them, contact and tau_ext as a controller would see it.

    Wrench and contact are those that `model` reads, the band is that of `wide`; or all is what
    `tracked` reads.
    """
    models = [model] if wide is model else [model, wide]

    def causal(models: list[IdentifiedModel]) -> Iterator[Read]:
        engine: Reader
        if tracked is not None:
            engine, others = tracked, []
        else:
            engine, *others = (
                ContactEstimator(WrenchEstimator(robot, own, config), settings.detection)
                for own in models
            )
        for chunk in chunks:
            signals = chunk.q, chunk.v, marked_current(chunk)
            batch, found = engine.run(*signals)
            for other in others:
                batch = with_band_of(batch, other.run(*signals)[0])
            yield Read(chunk, batch, found, batch.tau_ext)

    if settings.contact.axis:
        return read_contact(causal(models), robot, settings, config, measured)
    if not settings.smooth:
        return causal(models)
    smoother, *wider = (WrenchSmoother(WrenchEstimator(robot, own, config)) for own in models)

    def take(part: Read) -> EstimateBatch:
        q, v, current = part.chunk.q, part.chunk.v, marked_current(part.chunk)
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


def covariance_about(wrench: Array, mean: Array, covariance: Array) -> Array:
    """Second moment (N, 6, 6) about `wrench` (N, 6) of a wrench of this mean and covariance."""
    off = wrench - mean
    return np.asarray(covariance + off[:, :, None] * off[:, None, :])


def with_band_of(known: EstimateBatch, wide: EstimateBatch) -> EstimateBatch:
    """The readings of `known` with the band, and the samples that are valid, of `wide`."""
    covariance = covariance_about(known.wrench, wide.wrench, wide.covariance)
    return known._replace(
        covariance=covariance, valid=known.valid & wide.valid, torque_sd=wide.torque_sd
    )


def read_later(
    parts: Iterable[Read],
    take: Callable[[Read], EstimateBatch],
    finish: Callable[[], EstimateBatch],
) -> Iterator[Read]:
    """The parts of a log again, with a reading that comes some samples after them.

    Args:
        parts: as a controller would read them.
        take: takes a part, and returns what is read of the earliest samples without a reading.
        finish: returns what is left.
    """
    ahead: Read | None = None
    for part in parts:
        whole = part if ahead is None else _joined(ahead, part)
        ready = take(part)
        count = len(ready.valid)
        if count:
            yield _rows(whole, slice(0, count))._replace(batch=ready)
        ahead = _rows(whole, slice(count, None))
    if ahead is not None:
        yield ahead._replace(batch=finish())


def read_contact(
    parts: Iterable[Read],
    robot: Robot,
    settings: EstimateConfig,
    config: WrenchEstimatorConfig,
    is_known: Callable[[Recording, EstimateBatch], Flags],
) -> Iterator[Read]:
    """The parts of a log again, read by what is known of the contact's direction.

    Args:
        parts: as a controller would read them.
        settings: with the contact's axis.
        config: with the log's time step.
        is_known: (N,) samples that were measured.
    """
    observer = make_observer(config.observer, robot.num_joints)
    reader = ContactReader(
        robot,
        observer.pole,
        config.observer.time_step,
        settings.contact,
        config.reconstruction.max_force_sd,
    )

    def take(part: Read) -> EstimateBatch:
        chunk, batch = part.chunk, part.batch
        tau_J = robot.joint_torque(chunk.current)
        return reader.take(chunk.q, chunk.v, tau_J, is_known(chunk, batch), batch)

    return read_later(parts, take, reader.finish)


def _joined(one: Read, other: Read) -> Read:
    return Read(
        concatenated([one.chunk, other.chunk]),
        EstimateBatch.joined([one.batch, other.batch]),
        Detection.joined([one.found, other.found]),
        np.concatenate([one.tau_ext, other.tau_ext]),
    )


def without_breaks(reads: Iterable[Read]) -> Iterator[Read]:
    """The parts of a log again, without the samples between the episodes of a data set."""
    for read in reads:
        rows = read.chunk.row
        if rows is None or rows.all():
            yield read
        elif rows.any():
            yield _rows(read, rows != 0)


def _rows(read: Read, rows: slice | Flags) -> Read:
    return Read(read.chunk[rows], read.batch.rows(rows), read.found.rows(rows), read.tau_ext[rows])
