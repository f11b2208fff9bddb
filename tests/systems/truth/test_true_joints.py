"""The true joints as a block: ports, the kernel through them, the tick that contact takes."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.gaussian_noise import gaussian_noise
from wrenchsight.models.truth.free_arm import VELOCITY_STREAM, WANDER_STREAM
from wrenchsight.models.truth.joint_kernels import (
    EXTERNAL,
    SIGNALS,
    encoder_reading,
    joint_tick,
    tick_work,
)
from wrenchsight.models.truth.true_joints import TrueJoints
from wrenchsight.models.truth.true_robot import with_truth_named
from wrenchsight.systems.truth.true_joints import TrueJointsSystem


@pytest.fixture(scope="module")
def robot():
    return with_truth_named(Robot.load("sts_sre4_600"), "hard")


@pytest.fixture(scope="module")
def joints(robot):
    return TrueJoints.of(robot, 1e-3)


COMMAND = np.array([0.3, -0.8, 0.4, -0.05, 0.1, 0.02])
TAU_EXT = np.array([5.0, -4.0, 3.0, 0.5, -0.4, 0.2])


def at_work(robot, joints, contact):
    """The block in a context with inputs at home, in motion."""
    block = TrueJointsSystem(joints, contact, 7)
    context = block.CreateDefaultContext()
    terms = robot.chain.terms(robot.home, 0.1 * np.arange(1, 7))
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    block.GetInputPort("current_command").FixValue(context, COMMAND)
    block.GetInputPort("tau_ext").FixValue(context, TAU_EXT)
    return block, context, terms


def by_kernel(joints, terms, state, tau_ext, tick=0):
    after, signals = np.empty_like(state), np.empty((SIGNALS, 6))
    noise = np.empty(12)
    gaussian_noise(7 + WANDER_STREAM, tick, noise)
    joint_tick(
        joints.table, 1e-3, terms.M, terms.Cv, terms.G, terms.q, terms.v, COMMAND,
        tau_ext, noise, state, after, signals, tick_work(state),
    )  # fmt: skip
    return after, signals


def test_ports(robot, joints):
    block, _, _ = at_work(robot, joints, False)
    assert [block.get_input_port(i).get_name() for i in range(block.num_input_ports())] == [
        "terms", "current_command", "tau_ext",
    ]  # fmt: skip
    sizes = {name: block.GetOutputPort(name).size() for name in ("signals", "encoders")}
    assert sizes == {"signals": 24, "encoders": 12}


@pytest.mark.parametrize("contact", [False, True])
def test_only_what_the_solver_does_not_need_feeds_through(robot, joints, contact):
    """With contact the torque may not depend on what comes of it in the same tick."""
    block, _, _ = at_work(robot, joints, contact)
    through = {
        (block.get_input_port(i).get_name(), block.get_output_port(o).get_name())
        for i in range(3)
        for o in range(2)
        if block.HasDirectFeedthrough(i, o)
    }
    expected = {("terms", "signals"), ("current_command", "signals"), ("terms", "encoders")}
    assert through == expected | (set() if contact else {("tau_ext", "signals")})


@pytest.mark.parametrize("contact", [False, True])
def test_a_tick_is_the_kernels(robot, joints, contact):
    block, context, terms = at_work(robot, joints, contact)
    state = joints.initial_state()
    after, signals = by_kernel(joints, terms, state, 0.0 * TAU_EXT if contact else TAU_EXT)
    np.testing.assert_array_equal(block.GetOutputPort("signals").Eval(context), signals.ravel())
    update = block.EvalUniquePeriodicDiscreteUpdate(context)
    after[EXTERNAL] = TAU_EXT
    np.testing.assert_array_equal(update.get_vector(0).value(), after.ravel())
    context.get_mutable_discrete_state(0).SetFromVector(after.ravel())
    _, later = by_kernel(joints, terms, after, TAU_EXT)
    np.testing.assert_array_equal(block.GetOutputPort("signals").Eval(context), later.ravel())


def test_encoders_read_with_the_noise_of_the_tick(robot, joints):
    block, context, terms = at_work(robot, joints, False)
    for tick in (0, 41):
        context.SetTime(tick * 1e-3)
        q, v = np.empty(6), np.empty(6)
        encoder_reading(
            joints.table,
            joints.initial_state(),
            terms.G,
            terms.q,
            terms.v,
            True,
            7 + VELOCITY_STREAM,
            tick,
            q,
            v,
        )
        np.testing.assert_array_equal(
            block.GetOutputPort("encoders").Eval(context), np.concatenate([q, v])
        )


def test_a_weaker_motor_through_the_context(robot, joints):
    block, context, _ = at_work(robot, joints, False)
    before = block.GetOutputPort("signals").Eval(context)[:6].copy()
    table = joints.table.copy()
    table[:, 24] *= 0.5  # gain
    context.get_mutable_numeric_parameter(0).SetFromVector(table.ravel())
    np.testing.assert_allclose(block.GetOutputPort("signals").Eval(context)[:6], 0.5 * before)


def test_it_runs_in_a_simulator(robot, joints):
    """Joints that nothing carries along: the springs take up the motor's torque, bounded."""
    builder = DiagramBuilder()
    block, _, terms = at_work(robot, joints, False)
    builder.AddSystem(block)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = block.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    block.GetInputPort("current_command").FixValue(context, COMMAND)
    block.GetInputPort("tau_ext").FixValue(context, TAU_EXT)
    simulator.AdvanceTo(0.05)
    state = joints.initial_state()
    for tick in range(50):
        state, _ = by_kernel(joints, terms, state, TAU_EXT, tick)
    np.testing.assert_array_equal(context.get_discrete_state(0).value().reshape(state.shape), state)
