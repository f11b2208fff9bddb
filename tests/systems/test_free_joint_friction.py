import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput

from wrenchsight.diagrams.robot_cell import make_robot_cell
from wrenchsight.diagrams.scenario import Scenario
from wrenchsight.models.control.wrench_script import HandPush
from wrenchsight.models.friction.true_friction import DryFriction
from wrenchsight.models.rigid_body.rigid_body_terms import RigidBodyTerms
from wrenchsight.models.robot.robot import Robot
from wrenchsight.systems.free_joint_friction import FreeJointFriction
from wrenchsight.systems.joint_friction import HOLDING_DAMPING

T = 1e-3


def law(n=2, **changes):
    values = {
        "stiction": 6.0,
        "coulomb": 4.0,
        "stribeck_velocity": 0.05,
        "viscous": 2.0,
        "load_dependence": 0.0,
        "ripple_amplitude": 0.0,
        "ripple_periods": 30.0,
    } | changes
    return DryFriction(**{key: np.full(n, value) for key, value in values.items()})


def terms(M, v, q=None, G=None):
    result = RigidBodyTerms.zeros(len(v))
    result.M[:], result.v[:], result.momentum[:] = M, v, M @ v
    result.R_WE[:] = np.eye(3)
    if q is not None:
        result.q[:] = q
    if G is not None:
        result.G[:] = G
    return result


def evaluate(friction, motion, tau_J, tau_ext=None, change=None):
    block = FreeJointFriction(friction, T)
    context = block.CreateDefaultContext()
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(motion))
    block.GetInputPort("tau_J").FixValue(context, tau_J)
    block.GetInputPort("tau_ext").FixValue(
        context, np.zeros(len(tau_J)) if tau_ext is None else tau_ext
    )
    if change is not None:
        change(context)
    return (
        block.GetOutputPort("torque").Eval(context),
        block.GetOutputPort("tau_f_true").Eval(context),
    )


M = np.array([[2.0, 0.7], [0.7, 0.5]])


def test_ports():
    block = FreeJointFriction(law(3), T)
    names = [block.get_input_port(i).get_name() for i in range(block.num_input_ports())]
    assert names == ["terms", "tau_J", "tau_ext"]
    assert block.GetOutputPort("torque").size() == 3
    assert block.GetOutputPort("tau_f_true").size() == 3


@pytest.mark.parametrize("v", [[0.4, -0.3], [0.0, 0.0], [1e-3, 0.5], [-2.0, 1e-6]])
@pytest.mark.parametrize("tau", [[0.0, 0.0], [5.0, -5.9], [9.0, -3.0], [300.0, -80.0]])
def test_solves_the_tick_it_is_meant_for(v, tau):
    """Its torque makes v+ such that the brake's law holds at v+: checked by one tick by hand."""
    friction, v = law(stribeck_velocity=1e-3), np.array(v)
    torque, _ = evaluate(friction, terms(M, v, G=[1.0, -0.5]), tau)
    force = np.array(tau) - [1.0, -0.5] + torque
    after = np.linalg.solve(M / T + np.diag(friction.viscous), M @ v / T + force)
    x = v / 1e-3
    explicit = np.sign(v) * -np.expm1(-(x**2)) * (4.0 - 6.0)
    held = -torque - explicit
    expected = np.clip(HOLDING_DAMPING * after, -6.0, 6.0)
    np.testing.assert_allclose(held, expected, rtol=1e-7, atol=1e-7)


def test_sliding_level_and_sign():
    friction = law(load_dependence=0.1)
    for v in ([1.0, 2.0], [-1.0, -2.0]):
        v, tau_J = np.array(v), np.array([10.0, -20.0])
        _, tau_f = evaluate(friction, terms(M, v), tau_J)
        np.testing.assert_allclose(tau_f, friction.sliding_torque(v, tau_J), atol=1e-12)
        assert np.all(tau_f * v > 0)


def test_an_external_push_is_held_too():
    torque, tau_f = evaluate(law(), terms(M, np.zeros(2)), np.zeros(2), tau_ext=[3.0, -4.0])
    # The first tick gives way by M / T / damping, 2 %.
    np.testing.assert_allclose(torque, [-3.0, 4.0], atol=0.06)
    np.testing.assert_allclose(tau_f, -torque)


def test_parameter_through_the_context():
    def less(context):
        table = context.get_mutable_numeric_parameter(0).get_mutable_value().reshape(2, 7)
        table[:, 0] = table[:, 1] = 1.0  # stiction and Coulomb

    motion = terms(M, np.array([1.0, 1.0]))
    _, tau_f = evaluate(law(), motion, np.zeros(2), change=less)
    np.testing.assert_allclose(tau_f, 1.0 + 2.0, atol=1e-12)


@pytest.mark.parametrize("name", ["sts_sre4_600", "ur10e"])
def test_the_same_motion_as_with_brakes_in_the_plant(name):
    robot = Robot.load(name)
    G = robot.chain.gravity_torque(robot.home)
    # The push makes joints stick, break away, slide and stop again.
    push = HandPush(duration=1.0, bandwidth=3.0, force=[40.0, 40.0, 40.0], moment=[2.0, 2.0, 2.0])
    scenario = Scenario(current_noise=False, wrench=[push])
    runs = [run(robot, scenario, G, with_brakes) for with_brakes in (True, False)]
    v = np.abs(runs[0][0] - runs[1][0]).max(axis=0)
    moved = np.abs(runs[0][0]).max(axis=0)
    assert moved.max() > 0.1
    # The contact solver stops at a relative error of 1e-5 in momentum.
    assert np.all(v < 2e-4 * moved.max())
    # At the tick of a stop or a start a torque may come one tick sooner or later.
    assert np.percentile(np.abs(runs[0][1] - runs[1][1]), 99, axis=0).max() < 0.05


def run(robot, scenario, tau_J, with_brakes):
    cell = make_robot_cell(scenario, robot, robot.home, with_brakes=with_brakes)
    builder = DiagramBuilder()
    builder.AddSystem(cell.diagram)
    current = tau_J / (robot.torque_per_ampere * robot.current_sign)
    source = builder.AddSystem(ConstantVectorSource(current))
    builder.Connect(source.get_output_port(), cell.diagram.GetInputPort("current_command"))
    logs = [LogVectorOutput(cell.diagram.GetOutputPort(p), builder, T) for p in ("v", "tau_f_true")]
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(1.0)
    return [log.FindLog(simulator.get_context()).data().T for log in logs]
