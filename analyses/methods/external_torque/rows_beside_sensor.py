"""Rows of a log beside its force sensor, without averages."""

import numpy as np

from wrenchsight.analyses.methods.external_torque.force_readings import LogReading
from wrenchsight.analyses.methods.reference_sensor.mounting import Mounting
from wrenchsight.analyses.output.stream_summary import EvenSample
from wrenchsight.models.estimation.wrench import WrenchEstimate
from wrenchsight.models.numerics.arrays import Array

_SENSOR_COLUMN = 22  # numbers of a row before the sensor's: t, force, covariance, axes
_FORCE_COLUMNS = 3


class RowsBesideSensor:
    """Gathers rows from a stream, at most `capacity`, evenly spread.

    Attributes:
        has_contact: whether the sensor reads a contact on any row; set by `hold_against`.
        reading: set by `hold_against`; None for a sensor of a single force.
    """

    def __init__(self, capacity: int) -> None:
        self._rows = EvenSample(capacity)
        self._condition = EvenSample(capacity)
        self.has_contact = False
        self.reading: LogReading | None = None

    def add(self, t: Array, batch: WrenchEstimate, R_WE: Array, sensor: Array) -> None:
        """Takes the next rows.

        Args:
            t: (N,) s.
            batch: their wrenches.
            R_WE: (N, 3, 3) axes of the tool.
            sensor: (N, k) as logged.
        """
        size = len(t)
        covariance = batch.covariance[:, 3:, 3:].reshape(size, 9)
        parts = [t[:, None], batch.wrench[:, 3:], covariance, R_WE.reshape(size, 9), sensor]
        self._rows.add(np.concatenate(parts, axis=1))
        self._condition.add(batch.condition_number)

    def hold_against(self, mounting: Mounting, force: float) -> None:
        """Compares the forces where the sensor's is larger than `force` (N)."""
        rows = self._rows.values()
        t, estimate, covariance, R_WE, sensor = np.split(rows, (1, 4, 13, _SENSOR_COLUMN), axis=1)
        truth = mounting.on_robot(t[:, 0], sensor, R_WE.reshape(-1, 3, 3))[:, :_FORCE_COLUMNS]
        is_sensed = np.asarray(np.isfinite(truth).all(axis=1))
        truth = np.where(is_sensed[:, None], truth, 0.0)
        loaded = np.asarray(is_sensed & (np.linalg.norm(truth, axis=1) > force))
        self.has_contact = bool(loaded.any())
        if sensor.shape[1] < _FORCE_COLUMNS:
            return
        self.reading = LogReading(
            force=estimate,
            covariance=covariance.reshape(-1, 3, 3),
            condition_number=self._condition.values(),
            error=estimate - truth,
            loaded=loaded,
        )
