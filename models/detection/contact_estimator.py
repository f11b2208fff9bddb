"""The estimator with its contact detector."""

from typing import Protocol

from wrenchsight.models.arrays import Array
from wrenchsight.models.detection.contact_detector import (
    ContactDetectionConfig,
    ContactDetector,
    Detection,
)
from wrenchsight.models.estimation.estimator import EstimateBatch, WrenchEstimator


class Reader(Protocol):
    """What reads successive samples: `ContactEstimator`, or a `TrackedEstimator`."""

    def run(self, q: Array, v: Array, current: Array) -> tuple[EstimateBatch, Detection]:
        """Takes the next samples, (N, n) each: rad, rad/s and A."""
        ...

    def restart(self) -> None:
        """The next sample does not follow the last one."""
        ...


class ContactEstimator:
    """Reads one arm, sample by sample or chunk by chunk, from one thread; the result is the same.

    Args:
        estimator: that reads.
        detection: when a reading is contact.
    """

    def __init__(
        self, estimator: WrenchEstimator, detection: ContactDetectionConfig | None = None
    ) -> None:
        self._estimator = estimator
        self._detector = ContactDetector.of(estimator, detection)
        self.restart()

    def restart(self) -> None:
        """As the protocol."""
        self._state = self._estimator.initial_state()
        self._detector_state = self._detector.initial_state()

    def run(self, q: Array, v: Array, current: Array) -> tuple[EstimateBatch, Detection]:
        """As the protocol."""
        batch = self._estimator.run(self._state, q, v, current)
        return batch, self._detector.run(self._detector_state, batch)
