import numpy as np
from pydrake.common.value import AbstractValue

from models.robot import Robot
from systems.environment_truth import EnvironmentTruth


def block_with(terms, wrench, **more):
    block = EnvironmentTruth(6)
    context = block.CreateDefaultContext()
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    block.GetInputPort("wrench_applied").FixValue(context, wrench)
    for name, value in more.items():
        block.GetInputPort(name).FixValue(context, value)
    return block, context


def terms():
    robot = Robot.load("sts_sre4_600")
    return robot.chain.terms(robot.home, np.zeros(6))


def test_ports():
    block = EnvironmentTruth(6)
    assert block.GetOutputPort("wrench_true").size() == 6
    assert block.GetOutputPort("tau_ext_true").size() == 6
    assert block.GetOutputPort("truth").size() == 12


def test_without_contact_it_is_what_is_applied():
    t, F = terms(), np.array([0.1, -0.2, 0.3, 4.0, 5.0, 6.0])
    block, context = block_with(t, F)
    np.testing.assert_array_equal(block.GetOutputPort("wrench_true").Eval(context), F)
    tau = block.GetOutputPort("tau_ext_true").Eval(context)
    np.testing.assert_allclose(tau, t.J.T @ F, atol=1e-14)


def test_contact_torque_is_added():
    t, F, tau_contact = terms(), np.ones(6), np.arange(6.0)
    block, context = block_with(t, F, tau_contact=tau_contact)
    tau = block.GetOutputPort("tau_ext_true").Eval(context)
    np.testing.assert_allclose(tau, t.J.T @ F + tau_contact, atol=1e-14)


def test_contact_of_the_tool_is_added_to_the_wrench():
    t, F = terms(), np.arange(1.0, 7.0)
    contact = np.array([0.1, 0.2, 0.3, 10.0, 20.0, 30.0, 36.0, 0.0, 0.0, 1.0])
    tau_contact = t.J.T @ contact[:6]
    block, context = block_with(t, F, contact=contact, tau_contact=tau_contact)
    wrench = block.GetOutputPort("wrench_true").Eval(context)
    tau = block.GetOutputPort("tau_ext_true").Eval(context)
    np.testing.assert_allclose(wrench, F + contact[:6], rtol=1e-14)
    np.testing.assert_allclose(tau, t.J.T @ wrench, atol=1e-12)
    truth = block.GetOutputPort("truth").Eval(context)
    np.testing.assert_array_equal(truth, np.concatenate([wrench, tau]))


def test_a_push_along_a_joints_motion_is_positive():
    t = terms()
    # Along the velocity that the second joint gives to E.
    F = np.concatenate([np.zeros(3), t.J[3:, 1]])
    block, context = block_with(t, F)
    assert block.GetOutputPort("tau_ext_true").Eval(context)[1] > 0
