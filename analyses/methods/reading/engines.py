"""What runs a log's chunks through the estimator: the model as it is, or tracked."""

from collections.abc import Iterable, Iterator

from wrenchsight.analyses.methods.reading.drifted_band import with_band_of
from wrenchsight.analyses.methods.reading.estimate_config import EstimateConfig
from wrenchsight.analyses.methods.reading.known_contact import Read, read_contact, read_later
from wrenchsight.analyses.methods.reading.uniform_log import marked_current, measured
from wrenchsight.models.detection.contact_estimator import ContactEstimator, Reader
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
