"""Current and torque of motors."""

import numpy as np
import pytest

from wrenchsight.models.robot.motors import joint_torque, motor_gain

GAIN = motor_gain([11.976, 9.839, 2.5], [1.0, -1.0, 1.0])


def test_torque_is_sign_times_gain_times_current() -> None:
    tau = joint_torque(GAIN, np.empty((0, 3)), np.array([[1.0, 2.0, -4.0]]))[0]
    np.testing.assert_allclose(tau, [11.976, -19.678, -10.0], rtol=1e-15)


def test_motors_that_move_several_joints() -> None:
    rates = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.5, 1.0]])
    current = np.array([[0.3, -0.7, 12.0]])
    tau = joint_torque(GAIN, rates, current)
    np.testing.assert_allclose(tau, (GAIN * current) @ rates, rtol=1e-15)
    current[0, 2] = np.nan
    tau = joint_torque(GAIN, rates, current)
    np.testing.assert_array_equal(np.isnan(tau), [[False, True, True]])  # where that motor counts


def test_bad_gain_or_sign_is_refused() -> None:
    with pytest.raises(ValueError, match="positive"):
        motor_gain([0.0])
    with pytest.raises(ValueError, match=r"\+1 or -1"):
        motor_gain([1.0], [0.5])
