"""Live readings of a contact whose direction is known: the filter of `estimate --contact-axis`.

It reads means over blocks. A reading is that of the last block that is over, and of no later one.
"""

import numpy as np

from wrenchsight.models.detection.contact_detector import Detection, Reader
from wrenchsight.models.estimation.contact_filter import ContactConfig
from wrenchsight.models.estimation.contact_reading import ContactReader
from wrenchsight.models.estimation.estimator import EstimateBatch, WrenchEstimator
from wrenchsight.models.numerics.arrays import Array


class KnownContactEstimator:
    """A `Reader` whose wrench is that at the contact; contact and tau_ext are the inner one's.

    Args:
        inner: that reads tau_ext.
        estimator: whose configuration it has.
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
        own = self._estimator
        self._contact = ContactReader(
            own.robot,
            own.observer.pole,
            own.observer.time_step,
            self._config,
            own.config.reconstruction.max_force_sd,
        )
        self._held: list[tuple[Array, Array, Array, EstimateBatch]] = []
        self._last: EstimateBatch | None = None  # of one sample

    def run(self, q: Array, v: Array, current: Array) -> tuple[EstimateBatch, Detection]:
        """As the protocol."""
        batch, found = self._inner.run(q, v, current)
        rows = [slice(k, k + 1) for k in range(len(q))]
        read = [self._read(q[own], v[own], current[own], batch.rows(own)) for own in rows]
        return EstimateBatch.joined(read), found

    def _read(self, q: Array, v: Array, current: Array, batch: EstimateBatch) -> EstimateBatch:
        self._held.append((q, v, current, batch))
        if len(self._held) == self._size:
            parts = list(zip(*self._held, strict=True))
            self._held = []
            block = EstimateBatch.joined(parts[3])
            tau_J = self._estimator.robot.joint_torque(np.concatenate(parts[2]))
            known = np.asarray(block.fresh & (block.fault == 0))
            signals = np.concatenate(parts[0]), np.concatenate(parts[1])
            ready = self._contact.take(*signals, tau_J, known, block)
            if len(ready.valid):
                self._last = ready.rows(slice(-1, None))
        last = self._last
        if last is None:
            return batch._replace(valid=np.zeros(1, np.bool_))
        valid = np.asarray(last.valid & batch.fresh)
        return batch._replace(wrench=last.wrench, covariance=last.covariance, valid=valid)
