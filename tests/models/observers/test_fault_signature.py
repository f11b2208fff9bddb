"""The trace of a wrong current, and a push that crosses it."""

import numpy as np
import pytest

from wrenchsight.models.observers.fault_signature import (
    FaultConstants,
    fault_constants,
    initial_fault_state,
    is_believed,
)

_STEP = 0.002  # s
_SD = np.ones(6)  # N m
_ALONG_MOTOR_3 = np.array([1.0, -1.0, 10.0, 1.0, -1.0, 1.0])  # N m; 5 of |z|^2 beside its line


def _constants(K_0: float | None = 20.0) -> FaultConstants:
    rates = None if K_0 is None else np.full(6, K_0)
    return fault_constants(10.0 * np.eye(6), rates, _STEP)


def _time_until_disbelieved(constants: FaultConstants, unexplained: float) -> float:
    """s of a torque along the line of motor 3; inf: more than a second."""
    state = initial_fault_state(6)
    for k in range(round(1.0 / _STEP)):
        tau_J = np.full(6, 50.0)
        if not is_believed(constants, state, _ALONG_MOTOR_3, _SD, tau_J, unexplained, True, False):
            return k * _STEP
    return np.inf


@pytest.mark.parametrize(
    ("unexplained", "expected"),
    [
        (40.0, 0.05),  # no wrench at E: REPORT_TIME
        (6.0, 0.05),
        # Less than the line leaves: a push may cross it, REPORT_TIME / AMBIGUOUS_SHARE.
        (4.0, 0.25),
        (0.1, 0.25),
    ],
)
def test_a_line_that_a_wrench_explains_as_well_is_doubted_later(
    unexplained: float, expected: float
) -> None:
    seconds = _time_until_disbelieved(_constants(), unexplained)
    assert seconds == pytest.approx(expected, abs=1.5 * _STEP)


def test_that_an_observer_of_the_wrench_explains_its_torque_says_nothing() -> None:
    seconds = _time_until_disbelieved(_constants(K_0=None), unexplained=0.1)
    assert seconds == pytest.approx(0.05, abs=1.5 * _STEP)
