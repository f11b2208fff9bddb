"""Current, torque, quantisation."""

import numpy as np
import pytest

from wrenchsight.models.robot.motors import current_to_torque, motor_torque, torque_to_current

GAIN = np.array([11.976, 9.839, 2.5])
SIGN = np.array([1.0, -1.0, 1.0])


def test_torque_is_sign_times_gain_times_current() -> None:
    current = np.array([[1.0, 2.0, -4.0], [0.5, -1.0, 0.0]])
    expected = np.array([[11.976, -19.678, -10.0], [5.988, 9.839, 0.0]])
    np.testing.assert_allclose(current_to_torque(current, GAIN, SIGN), expected, rtol=1e-15)
    np.testing.assert_allclose(current_to_torque(current[0], GAIN, SIGN), expected[0], rtol=1e-15)


def test_there_and_back() -> None:
    tau = np.random.default_rng(1).normal(size=(50, 3)) * 100.0
    back = current_to_torque(torque_to_current(tau, GAIN, SIGN), GAIN, SIGN)
    np.testing.assert_allclose(back, tau, rtol=1e-14)


def test_kernel_is_the_same_law() -> None:
    current = np.array([0.3, -0.7, 12.0])
    tau = np.empty(3)
    motor_torque(GAIN * SIGN, current, tau)
    np.testing.assert_array_equal(tau, current_to_torque(current, GAIN, SIGN))


def test_bad_gain_or_sign_is_refused() -> None:
    with pytest.raises(ValueError, match="positive"):
        current_to_torque([1.0], [0.0])
    with pytest.raises(ValueError, match=r"\+1 or -1"):
        current_to_torque([1.0], [1.0], [0.5])
