"""What runs a log's chunks through the estimator: the model as it is, or tracked."""

from collections.abc import Iterable, Iterator
from typing import Protocol

import numpy as np

from wrenchsight.analyses.methods.reading.drifted_band import with_band_of
from wrenchsight.analyses.methods.reading.estimate_config import EstimateConfig
from wrenchsight.analyses.methods.reading.known_contact import Read, read_contact, read_later
from wrenchsight.analyses.methods.reading.uniform_log import measured
from wrenchsight.models.arrays import Array
from wrenchsight.models.detection.contact_detector import (
    ContactDetectionConfig,
    ContactDetector,
    Detection,
)
from wrenchsight.models.detection.tracked_estimator import TrackedEstimator
from wrenchsight.models.estimation.estimator import (
    EstimateBatch,
    WrenchEstimator,
    WrenchEstimatorConfig,
)
from wrenchsight.models.estimation.smoothing import WrenchSmoother
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot


class Engine(Protocol):
    """Runs successive chunks of a log through the estimator's chain."""

    def run(self, q: Array, v: Array, current: Array) -> tuple[EstimateBatch, Detection]: ...


class BatchEngine:
    """The estimator, chunk after chunk."""

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
        engine: Engine
        if tracked is not None:
            engine, others = tracked, []
        else:
            engine, *others = (
                BatchEngine(robot, own, config, settings.detection) for own in models
            )
        for chunk in chunks:
            batch, found = engine.run(chunk.q, chunk.v, chunk.current)
            for other in others:
                batch = with_band_of(batch, other.run(chunk.q, chunk.v, chunk.current)[0])
            yield Read(chunk, batch, found, batch.tau_ext)

    if settings.contact.axis:
        return read_contact(causal(models), robot, settings, config, measured)
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
