"""Rows of a log beside its force sensor, without averages."""

import numpy as np

from wrenchsight.analyses.methods.external_torque.force_readings import LogReading
from wrenchsight.analyses.methods.reference_sensor.mounting import Mounting
from wrenchsight.analyses.output.stream_summary import EvenSample
from wrenchsight.models.estimation.wrench import WrenchEstimate
from wrenchsight.models.numerics.arrays import Array

_FORCE_SIZE = 3  # numbers of a force; a sensor of fewer columns reads it along its axis alone


class RowsBesideSensor:
    """Gathers rows from a stream, at most `capacity`, evenly spread.

    Attributes:
        has_contact: whether the sensor reads a contact on any row; set by `hold_against`.
        reading: set by `hold_against`; None for a sensor of a single force.
    """

    def __init__(self, capacity: int) -> None:
        # Each is given the same rows, and so keeps the same ones.
        self._t, self._R_WE, self._sensor = (EvenSample(capacity) for _ in range(3))
        self._force, self._covariance = EvenSample(capacity), EvenSample(capacity)
        self._condition_number = EvenSample(capacity)
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
        self._t.add(t)
        self._R_WE.add(R_WE)
        self._sensor.add(sensor)
        self._force.add(batch.wrench[:, 3:])
        self._covariance.add(batch.covariance[:, 3:, 3:])
        self._condition_number.add(batch.condition_number)

    def hold_against(self, mounting: Mounting, force: float) -> None:
        """Compares the forces where the sensor's is larger than `force` (N)."""
        estimate, sensor = self._force.values(), self._sensor.values()
        sensed = mounting.on_robot(self._t.values(), sensor, self._R_WE.values())
        truth = sensed[:, :_FORCE_SIZE]
        is_sensed = np.asarray(np.isfinite(truth).all(axis=1))
        truth = np.where(is_sensed[:, None], truth, 0.0)
        loaded = np.asarray(is_sensed & (np.linalg.norm(truth, axis=1) > force))
        self.has_contact = bool(loaded.any())
        if sensor.shape[1] < _FORCE_SIZE:
            return
        self.reading = LogReading(
            force=estimate,
            covariance=self._covariance.values(),
            condition_number=self._condition_number.values(),
            error=estimate - truth,
            loaded=loaded,
        )
