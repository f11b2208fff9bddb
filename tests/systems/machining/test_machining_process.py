import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.multibody.tree import BodyIndex

from models.machining.machining_process import MachiningProcess, ProcessConfig
from systems.machining.machining_process import MachiningProcessSystem

CONFIG = ProcessConfig(cutting_ratio=0.2, speed_exponent=0.0, unbalance=1e-5)
T = 1e-3


@pytest.fixture(scope="module")
def terms(sts):
    return sts.chain.terms(sts.home, np.array([0.1, 0.0, 0.05, 0.0, 0.0, 0.0]))


def block_with(terms, **more):
    block = MachiningProcessSystem(MachiningProcess(CONFIG), BodyIndex(8), [0.0, 0.0, 0.07], T)
    context = block.CreateDefaultContext()
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    block.GetInputPort("contact").FixValue(context, np.zeros(4))
    for name, value in more.items():
        block.GetInputPort(name).FixValue(context, value)
    return block, context


def test_ports(terms):
    block, _ = block_with(terms)
    assert block.GetOutputPort("wrench").size() == 6
    assert block.GetOutputPort("wrench_unbalance").size() == 6
    assert not block.HasDirectFeedthrough(block.GetInputPort("contact").get_index(), 0)


def test_a_known_contact_cuts_against_the_feed(terms):
    block, context = block_with(terms)
    feed = np.array([0.0, 0.5, 0.0])
    context.SetDiscreteState(np.concatenate([[30.0], [0.0, 0.0, 1.0], feed]))
    wrench = block.GetOutputPort("wrench").Eval(context)
    np.testing.assert_allclose(wrench, [0, 0, 0, 0, -0.2 * 30.0, 0], atol=1e-3)


def test_what_is_applied_is_passed_on_and_all_of_it_acts_at_E(terms):
    pushed = np.array([0.1, 0.2, 0.3, 1.0, 2.0, 3.0])
    block, context = block_with(terms, wrench_applied=pushed)
    context.SetTime(0.003)
    np.testing.assert_allclose(block.GetOutputPort("wrench").Eval(context), pushed)
    unbalance = block.GetOutputPort("wrench_unbalance").Eval(context)
    assert np.linalg.norm(unbalance[3:]) == pytest.approx(1e-5 * (2 * np.pi * 50.0) ** 2)
    assert unbalance[3:] @ terms.R_WE[:, 2] == pytest.approx(0.0, abs=1e-12)
    (force,) = block.GetOutputPort("spatial_forces").Eval(context)
    np.testing.assert_allclose(force.F_Bq_W.get_coeffs(), pushed + unbalance)
    np.testing.assert_allclose(force.p_BoBq_B, [0.0, 0.0, 0.07])


def test_without_contact_the_force_ends_and_the_feed_follows(terms):
    block, context = block_with(terms)
    context.SetDiscreteState([30.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    values = block.EvalUniquePeriodicDiscreteUpdate(context)
    updated = values.get_vector(0).CopyToVector()
    assert updated[0] == 0.0
    share = 1.0 - np.exp(-T / CONFIG.lag)
    expected = share * terms.V_WE[3:] * [1.0, 1.0, 0.0]
    np.testing.assert_allclose(updated[4:], expected, atol=1e-12)


def test_contact_is_felt_a_tick_late(terms):
    n = np.array([0.0, 0.6, 0.8])
    contact = np.array([25.0, *n])
    block, context = block_with(terms, contact=contact)
    np.testing.assert_array_equal(block.GetOutputPort("wrench").Eval(context), np.zeros(6))
    values = block.EvalUniquePeriodicDiscreteUpdate(context)
    np.testing.assert_array_equal(values.get_vector(0).CopyToVector()[:4], [25.0, *n])
