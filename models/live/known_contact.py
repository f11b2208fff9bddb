"""Live readings of a contact whose direction is known: the filter of `estimate --contact-axis`.

It reads means over blocks. A reading is that of the last complete block.
"""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.detection.contact_detector import Detection, Reader
from wrenchsight.models.estimation.contact_filter import ContactConfig
from wrenchsight.models.estimation.contact_reading import ContactReader
from wrenchsight.models.estimation.estimator import EstimateBatch, WrenchEstimator
from wrenchsight.models.estimation.invalid import SAMPLE_MISSING, SETTLING
from wrenchsight.models.numerics.arrays import Array


class KnownContactEstimator:
    """A `Reader` whose wrench is that at the contact; contact and tau_ext are the inner one's.

    Args:
        inner: reader of tau_ext and contact.
        estimator: whose robot, observer and configuration the filter uses.
        config: with the contact's axis.

    Raises:
        InputError: as `ContactReader`.
    """

    def __init__(self, inner: Reader, estimator: WrenchEstimator, config: ContactConfig) -> None:
        self._inner, self._estimator, self._config = inner, estimator, config
        self._size = max(round(config.block / estimator.observer.time_step), 1)
        self.restart()

    def restart(self) -> None:
        """As the protocol."""
        self._inner.restart()
        estimator = self._estimator
        self._contact_reader = ContactReader(
            estimator.robot,
            estimator.observer.pole,
            estimator.observer.time_step,
            self._config,
            estimator.config.reconstruction.max_force_sd,
        )
        self._block: list[_BlockSample] = []
        self._last_reading: EstimateBatch | None = None  # of one sample

    def run(self, q: Array, v: Array, current: Array) -> tuple[EstimateBatch, Detection]:
        """As the protocol."""
        batch, detection = self._inner.run(q, v, current)
        readings = []
        for k in range(len(q)):
            row = slice(k, k + 1)
            readings.append(self._read(_BlockSample(q[row], v[row], current[row], batch.rows(row))))
        return EstimateBatch.joined(readings), detection

    def _read(self, sample: "_BlockSample") -> EstimateBatch:
        """The next sample's batch with the reading of the last complete block."""
        self._block.append(sample)
        if len(self._block) == self._size:
            self._read_block()
        reading, batch = self._last_reading, sample.batch
        if reading is None:
            return batch.marked(SETTLING, True)
        batch = batch._replace(
            wrench=reading.wrench, covariance=reading.covariance, invalid=reading.invalid
        )
        return batch.marked(SAMPLE_MISSING, ~batch.fresh)

    def _read_block(self) -> None:
        """Passes the complete block to the filter."""
        block, self._block = self._block, []
        batch = EstimateBatch.joined([sample.batch for sample in block])
        current = np.concatenate([sample.current for sample in block])
        readings = self._contact_reader.take(
            np.concatenate([sample.q for sample in block]),
            np.concatenate([sample.v for sample in block]),
            self._estimator.robot.joint_torque(current),
            np.asarray(batch.fresh & (batch.fault == 0)),
            batch,
        )
        if len(readings.invalid):
            self._last_reading = readings.rows(slice(-1, None))


class _BlockSample(NamedTuple):
    """One sample: q, v and current (1, n), and the batch that the inner reader gives."""

    q: Array
    v: Array
    current: Array
    batch: EstimateBatch
