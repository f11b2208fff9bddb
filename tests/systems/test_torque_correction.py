import numpy as np
import pytest

from wrenchsight.systems.torque_correction import TorqueCorrection

TAU, CORRECTION = np.array([1.0, -2.0, 3.0]), np.array([0.5, 0.25, -4.0])  # N m


def outputs(correction=CORRECTION, correction_valid=1.0, tau_ext_valid=1.0):
    block = TorqueCorrection(3)
    context = block.CreateDefaultContext()
    block.GetInputPort("tau_ext").FixValue(context, TAU)
    block.GetInputPort("tau_ext_valid").FixValue(context, [tau_ext_valid])
    block.GetInputPort("tau_correction").FixValue(context, correction)
    block.GetInputPort("correction_valid").FixValue(context, [correction_valid])
    names = ("tau_ext", "tau_ext_valid", "corrected")
    return [block.GetOutputPort(name).Eval(context).copy() for name in names]


@pytest.mark.parametrize("correction_valid", [0.0, 1.0])
@pytest.mark.parametrize("tau_ext_valid", [0.0, 1.0])
def test_it_adds_the_correction_and_says_whether_it_holds(correction_valid, tau_ext_valid):
    tau_ext, valid, corrected = outputs(CORRECTION, correction_valid, tau_ext_valid)
    np.testing.assert_array_equal(tau_ext, TAU + CORRECTION)
    assert corrected == correction_valid
    assert valid == (correction_valid and tau_ext_valid)


def test_a_correction_that_is_not_finite_is_not_added_and_does_not_hold():
    tau_ext, valid, corrected = outputs(np.array([0.5, np.nan, np.inf]))
    np.testing.assert_array_equal(tau_ext, [1.5, -2.0, 3.0])
    assert valid == 0.0 and corrected == 0.0
