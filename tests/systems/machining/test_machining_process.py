import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.multibody.tree import BodyIndex

from wrenchsight.models.machining.machining_process import (
    MachiningProcess,
    ProcessConfig,
    advance_varying_process,
)
from wrenchsight.models.machining.process_variations import WorkpieceContact
from wrenchsight.systems.machining.machining_process import MachiningProcessSystem

CONFIG = ProcessConfig(cutting_ratio=0.2, speed_exponent=0.0, unbalance=1e-5)
T = 1e-3


@pytest.fixture(scope="module")
def terms(sts):
    return sts.chain.terms(sts.home, np.array([0.1, 0.0, 0.05, 0.0, 0.0, 0.0]))


def block_with(terms, process=None, **more):
    process = process or MachiningProcess(CONFIG)
    scripted = "wrench_applied" in more
    block = MachiningProcessSystem(process, BodyIndex(8), [0.0, 0.0, 0.07], T, scripted)
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


def state_of(normal_force, n, feed):
    return np.concatenate([[normal_force], n, feed, np.zeros(3)])


def updated(block, context):
    return block.EvalUniquePeriodicDiscreteUpdate(context).get_vector(0).CopyToVector()


def test_a_known_contact_cuts_against_the_feed(terms):
    n = np.array([0.0, 0.0, 1.0])
    block, context = block_with(terms, contact=np.array([30.0, *n]))
    context.SetDiscreteState(0, state_of(30.0, n, [0.0, 0.5, 0.0]))
    feed = updated(block, context)[4:7]
    context.SetDiscreteState(block.EvalUniquePeriodicDiscreteUpdate(context))
    wrench = block.GetOutputPort("wrench").Eval(context)
    np.testing.assert_allclose(wrench[3:], -0.2 * 30.0 * feed / np.linalg.norm(feed), atol=1e-3)
    np.testing.assert_array_equal(wrench[:3], 0.0)


def test_a_varying_process_is_told_time_and_place(terms):
    """One tick of the block is one of its kernel; the force differs from the steady one."""
    contact = WorkpieceContact(
        2e5, 1.0, 0.2, np.eye(3), np.zeros(3), np.array([[-9.0, 0.0, 0.0], [9.0, 0.0, 0.0]])
    )
    process = MachiningProcess(CONFIG, contact=contact)
    touch = np.array([30.0, 0.0, 0.0, 1.0])
    block, context = block_with(terms, process, contact=touch)
    context.SetTime(0.0123)
    expected, variations = process.initial_state, process.variations
    advance_varying_process(
        *(process.table, variations.table, variations.waviness, variations.patches),
        *(variations.pose, variations.ends, T, 0.0123, touch, terms.V_WE, terms.p_WE, expected),
    )
    found = updated(block, context)
    np.testing.assert_array_equal(found, expected)
    steady = updated(*block_with(terms, contact=touch))
    assert np.linalg.norm(found[7:] - steady[7:]) > 0.1


def test_what_is_applied_and_what_the_process_does_add_up(terms):
    pushed = np.array([0.1, 0.2, 0.3, 1.0, 2.0, 3.0])
    block, context = block_with(terms, wrench_applied=pushed)
    own = np.array([0.0, 0.0, 0.0, -4.0, 0.0, 0.5])
    context.SetDiscreteState(1, own)
    total = pushed + own
    np.testing.assert_allclose(block.GetOutputPort("wrench").Eval(context), total)


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
    context.SetDiscreteState(0, state_of(30.0, [0.0, 0.0, 1.0], np.zeros(3)))
    state = updated(block, context)
    assert state[0] == 0.0
    share = 1.0 - np.exp(-T / CONFIG.lag)
    expected = share * terms.V_WE[3:] * [1.0, 1.0, 0.0]
    np.testing.assert_allclose(state[4:7], expected, atol=1e-12)
    np.testing.assert_array_equal(state[7:], 0.0)


def test_contact_is_felt_a_tick_late(terms):
    n = np.array([0.0, 0.6, 0.8])
    block, context = block_with(terms, contact=np.array([25.0, *n]))
    np.testing.assert_array_equal(block.GetOutputPort("wrench").Eval(context), np.zeros(6))
    np.testing.assert_array_equal(updated(block, context)[:4], [25.0, *n])
