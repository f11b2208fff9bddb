"""The traces of wrong currents, and a push that crosses them."""

import numpy as np
import pytest
from numpy.typing import NDArray

from wrenchsight.models.observers.fault_signature import (
    REPORT_TIME,
    FaultConstants,
    fault_constants,
    initial_fault_state,
    is_believed,
)

Array = NDArray[np.float64]
_STEP = 0.002  # s
_SD = np.ones(6)  # N m
_ALONG_MOTOR_3 = np.array([1.0, -1.0, 10.0, 1.0, -1.0, 1.0])  # N m; 5 of |z|^2 beside its line


def _constants(K_0: float | None = 20.0, scale: float = 0.0) -> FaultConstants:
    rates = None if K_0 is None else np.full(6, K_0)
    return fault_constants(10.0 * np.eye(6), rates, _STEP, scale=scale)


def _time_until_disbelieved(
    constants: FaultConstants,
    unexplained: float,
    tau_ext: Array = _ALONG_MOTOR_3,
) -> float:
    """s of a constant torque, by default along the line of motor 3; inf: more than a second."""
    count = round(1.0 / _STEP)
    is_valid = _believed(
        constants, np.tile(tau_ext, (count, 1)), np.full((count, 6), 50.0), unexplained
    )
    return np.inf if is_valid.all() else float(np.argmin(is_valid)) * _STEP


def _believed(
    constants: FaultConstants,
    tau_ext: Array,
    tau_J: Array,
    unexplained: float,
) -> NDArray[np.bool_]:
    """(N,) whether each of N samples is believed."""
    state = initial_fault_state(constants)
    return np.array(
        [
            is_believed(constants, state, ext, _SD, motor, unexplained, True, False)
            for ext, motor in zip(tau_ext, tau_J, strict=True)
        ]
    )


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


@pytest.mark.parametrize(("load", "expected"), [(6.0, REPORT_TIME), (5.0, np.inf)])
def test_a_torque_is_a_trace_from_some_sds_on(load: float, expected: float) -> None:
    """Of one motor alone: 6 sd are 37 of |z|^2, 5 are 26, of 27 that six joints must have."""
    tau_ext = np.array([0.5, -0.5, load, 0.5, -0.5, 0.5])
    seconds = _time_until_disbelieved(_constants(), 40.0, tau_ext)
    assert seconds == pytest.approx(expected, abs=1.5 * _STEP)


def test_that_an_observer_of_the_wrench_explains_its_torque_says_nothing() -> None:
    seconds = _time_until_disbelieved(_constants(K_0=None), unexplained=0.1)
    assert seconds == pytest.approx(0.05, abs=1.5 * _STEP)


def test_push_and_line_are_compared_by_one_covariance() -> None:
    """Two currents exchanged, each torque off by 4 %: beside their line there is hardly an error.

    Single sds leave 7.1 beside the line, more than a wrench does; the scale's error leaves a tenth.
    """
    tau_ext = np.array([50.0, -46.24, 0.0, 0.0, 0.0, 0.0])
    seconds = _time_until_disbelieved(_constants(scale=0.2), 4.0, tau_ext)
    assert seconds == pytest.approx(REPORT_TIME, abs=1.5 * _STEP)


def _need(t: Array) -> Array:
    """(N, 6) N m that an arm in motion takes."""
    rates, phases = np.array([0.9, 0.7, 1.3, 1.6, 1.1, 1.9]), np.arange(6.0)
    return 40.0 * np.sin(1.5 * rates * t[:, None] + phases)


def _low_passed(x: Array, K_0: float) -> Array:
    """(N, 6) behind the observer's lag, from rest at the first sample."""
    pole, out = np.exp(-K_0 * _STEP), x.copy()
    for k in range(1, len(x)):
        out[k] = pole * out[k - 1] + (1.0 - pole) * x[k]
    return out


@pytest.mark.parametrize("delay", [0.2, 0.5, -0.2, -0.3])
def test_a_delay_is_doubted_though_a_wrench_explains_it(delay: float) -> None:
    """As soon as one that no wrench explains; late ones within .2 s, leads .2 s after their own."""
    t = _STEP * np.arange(1000)
    tau_J = _need(t - delay)
    tau_ext = _low_passed(_need(t) - tau_J, 20.0)
    is_valid = _believed(_constants(), tau_ext, tau_J, unexplained=0.0)
    is_valid_unexplained = _believed(_constants(), tau_ext, tau_J, unexplained=1e9)
    np.testing.assert_array_equal(is_valid, is_valid_unexplained)
    # Late currents have no past before the first sample: d passes for them, too.
    assert not is_valid[round((abs(delay) + 0.2) / _STEP) :].any()


@pytest.mark.parametrize("frequency", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("is_moving", [False, True])
def test_a_push_is_not_taken_for_early_currents(frequency: float, is_moving: bool) -> None:
    """Its torque is what tau_J has lost; what the arm takes does not change by it."""
    t = _STEP * np.arange(1500)
    phase = 2.0 * np.pi * frequency * t[:, None]
    push = np.array([15.0, 25.0, -20.0, 8.0, 12.0, 3.0]) * np.sin(phase)
    need = 0.3 * _need(t) if is_moving else np.full((len(t), 6), 40.0)
    is_valid = _believed(_constants(), _low_passed(push, 20.0), need - push, unexplained=1.0)
    assert is_valid.all()
