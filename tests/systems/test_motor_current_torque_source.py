"""MotorCurrentTorqueSource."""

import numpy as np
import pytest

from wrenchsight.systems.motor_current_torque_source import MotorCurrentTorqueSource

GAIN = np.array([12.0, 10.0, 0.5])
SIGN = np.array([1.0, -1.0, 1.0])


@pytest.fixture
def source():
    return MotorCurrentTorqueSource(GAIN, SIGN)


def torque(source, context, current):
    source.GetInputPort("current").FixValue(context, np.asarray(current, float))
    return source.GetOutputPort("tau_J").Eval(context)


def test_ports(source):
    assert source.num_input_ports() == source.num_output_ports() == 1
    assert source.GetInputPort("current").size() == source.GetOutputPort("tau_J").size() == 3
    assert source.HasDirectFeedthrough(0, 0)
    assert source.CreateDefaultContext().num_total_states() == 0


def test_formula(source):
    context = source.CreateDefaultContext()
    np.testing.assert_array_equal(torque(source, context, [1.0, 2.0, -4.0]), [12.0, -20.0, -2.0])


def test_the_torque_constant_changes_through_the_context(source):
    context = source.CreateDefaultContext()
    context.get_mutable_numeric_parameter(0).SetFromVector(2.0 * GAIN)
    np.testing.assert_array_equal(torque(source, context, [1.0, 2.0, -4.0]), [24.0, -40.0, -4.0])
    # Another context of the same block keeps its own.
    other = source.CreateDefaultContext()
    np.testing.assert_array_equal(torque(source, other, [1.0, 2.0, -4.0]), [12.0, -20.0, -2.0])


def test_sign(source):
    """A drive that counts backwards still gives a torque along positive motion."""
    assert torque(source, source.CreateDefaultContext(), [0.0, -3.0, 0.0])[1] > 0.0


def test_a_broken_current_is_seen_on_its_own_joint_only(source):
    tau_J = torque(source, source.CreateDefaultContext(), [1.0, np.nan, np.inf])
    np.testing.assert_array_equal(tau_J, [12.0, np.nan, np.inf])


@pytest.mark.parametrize(
    ("gain", "sign"), [([1.0, 0.0], 1.0), ([1.0, -2.0], 1.0), ([1.0, np.nan], 1.0), ([1.0], 0.5)]
)
def test_bad_arguments(gain, sign):
    with pytest.raises(ValueError, match=r"torque per ampere|current sign"):
        MotorCurrentTorqueSource(gain, sign)


def test_a_torque_constant_of_the_context_that_is_none_is_refused(source):
    context = source.CreateDefaultContext()
    context.get_mutable_numeric_parameter(0).SetFromVector([1.0, -2.0, 1.0])
    with pytest.raises(ValueError, match="torque per ampere must be positive and finite"):
        torque(source, context, np.ones(3))
