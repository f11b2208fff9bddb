"""Couplings of motors and joints: power, refusals, and what a plant knows of them."""

from pathlib import Path

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.robot.coupling import coupling_of, is_coupled, motor_rates, refuse_coupling

WRIST = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 1.0]]


def test_without_the_key_each_motor_moves_its_own_joint():
    C = coupling_of([], 3, Path("robot.yaml"))
    np.testing.assert_array_equal(C, np.eye(3))
    assert not is_coupled(C)


def test_rates_of_a_wrist_are_whole_numbers():
    D = motor_rates(coupling_of(WRIST, 3, Path("robot.yaml")))
    np.testing.assert_array_equal(D, [[1, 0, 0], [0, 1, 0], [0, 1, 1]])


def test_ones_and_zeros_are_inverted_without_rounding():
    """Four motors whose matrix LAPACK may invert with some 1e-16 in places."""
    C = np.array([[1.0, -1, 0, 0], [-1, -1, 1, -1], [-1, 0, -1, -1], [-1, 0, 1, 0]])
    D = motor_rates(C)
    np.testing.assert_array_equal(D, np.round(D))
    np.testing.assert_array_equal(C @ D, np.eye(4))


def test_any_ratio_has_its_inverse():
    C = np.array([[1.0, 0.0], [0.3, 0.7]])
    np.testing.assert_allclose(motor_rates(C) @ C, np.eye(2), atol=1e-15)


@pytest.mark.parametrize(
    "rows",
    [
        WRIST[:2],
        [[1.0, 0.0], [0.0, 1.0], [0.0, 1.0]],
        [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        [[1.0, 0.0, 0.0], [0.0, float("nan"), 0.0], [0.0, 0.0, 1.0]],
    ],
)
def test_an_invalid_coupling_is_refused(rows):
    with pytest.raises(InputError, match="coupling"):
        coupling_of(rows, 3, Path("robot.yaml"))


def test_motors_and_joints_have_one_power(coupled_wrist):
    rng = np.random.default_rng(1)
    current, v = rng.normal(size=(2, 20, 6))
    tau_J = coupled_wrist.joint_torque(current)
    tau_motor = current * coupled_wrist.torque_per_ampere * coupled_wrist.current_sign
    v_motor = np.linalg.solve(coupled_wrist.coupling, v.T).T
    # 1e-12 of some 100 N m times 1 rad/s: rounding.
    np.testing.assert_allclose((tau_J * v).sum(1), (tau_motor * v_motor).sum(1), rtol=1e-9)
    np.testing.assert_allclose(coupled_wrist.motor_current(tau_J), current, atol=1e-12)


def test_the_arm_says_which_motors_share_a_joint(coupled_wrist):
    (notice,) = (text for text in coupled_wrist.notices if "motors" in text)
    names = coupled_wrist.joint_names
    assert f"{names[4]} (also by that of {names[3]})" in notice
    assert f"{names[5]} (also by that of {names[4]})" in notice


def test_commands_for_single_joints_refuse_a_coupling(sts, coupled_wrist):
    refuse_coupling(sts.coupling, sts.source, "a refresh")
    with pytest.raises(InputError, match="a refresh is for joints"):
        refuse_coupling(coupled_wrist.coupling, coupled_wrist.source, "a refresh")
