import numpy as np
import pytest

from wrenchsight.models.observers.period_torque import (
    arrived_momentum,
    checked_period,
    motor_share,
    positive_per_joint,
)


@pytest.mark.parametrize("torque_samples", ["held", "trapezoidal"])
def test_both_ends_of_a_period_add_up_to_the_momentum_of_its_torque(torque_samples):
    """Under a torque that is linear in time, p(T) - p(0) is the mean of both ends times T."""
    T = 0.01
    begin, end = 0.3 - 2.0 - 0.7, 0.5 - 1.0 - 0.9  # C^T v - G - tau_f
    motor = 5.0 if torque_samples == "held" else 7.0  # between 5 and 9 N m
    momentum = 1.0 + T * (0.5 * (begin + end) + motor)
    before = motor_share(T, torque_samples)
    arrived = arrived_momentum(0.5 * T, before, momentum, end, 9.0)
    left = 1.0 + 0.5 * T * begin + (T - before) * 5.0
    assert arrived == pytest.approx(left, rel=1e-14)  # rounding of five additions


def test_held_torque_is_not_read_at_the_period_s_end():
    assert arrived_momentum(0.005, motor_share(0.01, "held"), 0.0, 0.0, np.nan) == 0.0
    share = motor_share(0.01, "trapezoidal")
    assert np.isnan(arrived_momentum(0.005, share, 0.0, 0.0, np.nan))


def test_an_invalid_period_is_refused():
    assert checked_period(0.002, "held") == 0.002
    with pytest.raises(ValueError, match="time_step must be positive"):
        checked_period(float("nan"), "held")
    with pytest.raises(ValueError, match="torque_samples must be held or trapezoidal, not 'x'"):
        checked_period(0.002, "x")


def test_one_value_serves_all_joints_and_others_are_refused():
    np.testing.assert_array_equal(positive_per_joint("K_0", 3.0, 2), [3.0, 3.0])
    np.testing.assert_array_equal(positive_per_joint("K_0", [3.0, 4.0], 2), [3.0, 4.0])
    with pytest.raises(ValueError, match="K_0 must have 1 or 2 values, not 3"):
        positive_per_joint("K_0", [1.0, 2.0, 3.0], 2)
    with pytest.raises(ValueError, match="K_0 must be positive"):
        positive_per_joint("K_0", [1.0, np.inf], 2)
