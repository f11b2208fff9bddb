"""The block against its kernels: the right inputs at the right ports, tick by tick."""

import numpy as np
import pytest
from block_ticks import take_tick
from pydrake.common.value import AbstractValue

from wrenchsight.diagrams.machining import make_machining_path
from wrenchsight.diagrams.scenario import load_scenario
from wrenchsight.models.machining.machining_phases import Phase
from wrenchsight.models.machining.machining_reference import (
    PassProgress,
    advance_reference,
    initial_memory,
    machining_reference,
    plan_pass,
)
from wrenchsight.systems.machining.machining_reference import MachiningReference

T = 1e-3


@pytest.fixture(scope="module")
def parts(sts):
    scenario = load_scenario("Polishing")
    path = make_machining_path(scenario, sts)
    plan = plan_pass(sts, sts.chain, path, scenario.machining.phases, T)
    return plan, initial_memory(sts.chain, path), path.q_start


def test_ports_are_those_of_the_kernels_and_hold_between_ticks(sts, parts):
    plan, memory, q = parts
    block = MachiningReference(plan, memory)
    context = block.CreateDefaultContext()
    terms = sts.chain.terms(q, np.zeros(6))
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    state = initial_memory(sts.chain, _Path(q))
    for k in range(30):
        # A push from the tenth tick on, in a place where contact is looked for.
        t = (3000 + k) * T  # as Drake computes it
        wrench = np.concatenate([np.zeros(3), -40.0 * (k >= 10) * terms.R_WE[:, 2]])
        context.SetTime(t)
        block.GetInputPort("wrench").FixValue(context, wrench)
        pose, joints = np.empty(18), np.empty((3, 6))
        progress = machining_reference(plan, t, state, terms.record, pose, joints)
        expected = dict(zip(PassProgress._fields, progress, strict=True))
        expected |= {"pose_reference": pose, "reference": joints.ravel()}
        take_tick(block, context)
        context.SetTime(t + 0.5 * T)  # held
        assert set(expected) == set(block.output_sizes)
        for name, value in expected.items():
            shown = block.GetOutputPort(name).Eval(context)
            np.testing.assert_array_equal(shown, np.atleast_1d(value), err_msg=name)
        advance_reference(plan, t, terms.record, wrench, state)
    assert state.state["phase"] == Phase.TOUCH


def test_no_output_feeds_through_from_the_force_that_is_fed_back(parts):
    """Else an estimate, which depends on the reference, would close a loop."""
    plan, memory, _ = parts
    block = MachiningReference(plan, memory)
    wrench = int(block.GetInputPort("wrench").get_index())
    for k in range(block.num_output_ports()):
        assert not block.HasDirectFeedthrough(wrench, k)


class _Path:
    def __init__(self, q_start):
        self.q_start = q_start
