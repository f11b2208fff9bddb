"""How far a reading of an arm that nothing touches is outside its band."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from wrenchsight.analyses.experiments.faults.beginnings import _excess
from wrenchsight.models.signals.bands import SIGMA_95


def test_excess_is_of_the_worst_axis_of_valid_readings() -> None:
    wrench = np.zeros((4, 6))
    wrench[:, 3:] = [[1.0, -30.0, 0.0], [1.0, -30.0, 0.0], [np.nan, 0.0, 0.0], [np.nan, 0.0, 0.0]]
    wrench[:, 0] = 500.0  # a moment counts for nothing
    batch: Any = SimpleNamespace(
        wrench=wrench,
        standard_deviation=np.full((4, 6), 2.0),
        valid=np.array([True, False, True, False]),
    )
    expected = [30.0 - 2.0 * SIGMA_95, 0.0, np.inf, 0.0]
    np.testing.assert_allclose(_excess(batch), expected)
