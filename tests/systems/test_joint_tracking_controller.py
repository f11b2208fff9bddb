import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, Demultiplexer, LogVectorOutput

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.rigid_body.rigid_body_terms import RigidBodyTerms
from wrenchsight.systems.joint_tracking_controller import (
    JointTrackingConfig,
    JointTrackingController,
)
from wrenchsight.systems.rigid_body_terms import RigidBodyTermsSystem

T = 1e-3
NO_FRICTION = SemiParametricFriction(CoulombViscous.zero(6))
FRICTION = SemiParametricFriction(
    CoulombViscous(np.arange(1.0, 7.0), np.linspace(3.0, 0.5, 6), np.full(6, 0.2))
)


def torque(block, terms, reference, integral=None):
    context = block.CreateDefaultContext()
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    block.GetInputPort("reference").FixValue(context, reference)
    if integral is not None:
        context.SetDiscreteState(0, integral)
    return block.GetOutputPort("tau_command").Eval(context)


class ClosedLoop:
    """The arm without friction under the controller with its exact model; constant reference."""

    def __init__(self, robot, config, effort_limit=None, disturbance=None, tick=T):
        builder = DiagramBuilder()
        plant = builder.AddSystem(MultibodyPlant(tick))
        plant.SetUseSampledOutputPorts(False)
        parts = robot.add_to_plant(plant)
        plant.Finalize()
        terms = builder.AddSystem(RigidBodyTermsSystem(robot.chain))
        limit = robot.effort_limit if effort_limit is None else effort_limit
        self.block = builder.AddSystem(JointTrackingController(NO_FRICTION, limit, tick, config))
        reference = builder.AddSystem(
            ConstantVectorSource(np.concatenate([robot.home, np.zeros(12)]))
        )
        push = builder.AddSystem(
            ConstantVectorSource(np.zeros(6) if disturbance is None else disturbance)
        )
        builder.Connect(push.get_output_port(), plant.get_applied_generalized_force_input_port())
        state = _split(builder, plant.get_state_output_port(parts.model_instance))
        builder.Connect(state[0], terms.GetInputPort("q"))
        builder.Connect(state[1], terms.GetInputPort("v"))
        builder.Connect(terms.GetOutputPort("terms"), self.block.GetInputPort("terms"))
        builder.Connect(reference.get_output_port(), self.block.GetInputPort("reference"))
        builder.Connect(self.block.GetOutputPort("tau_command"), plant.get_actuation_input_port())
        log = LogVectorOutput(plant.get_state_output_port(parts.model_instance), builder, tick)
        self._log, self._plant = log, plant
        self.simulator = Simulator(builder.Build())

    def run(self, duration, q_0):
        context = self.simulator.get_mutable_context()
        self._plant.SetPositions(self._plant.GetMyMutableContextFromRoot(context), q_0)
        self.simulator.AdvanceTo(duration)
        data = self._log.FindLog(context)
        return data.sample_times(), data.data()[:6].T


def _split(builder, port):
    split = builder.AddSystem(Demultiplexer([6, 6]))
    builder.Connect(port, split.get_input_port())
    return split.get_output_port(0), split.get_output_port(1)


def test_ports():
    block = JointTrackingController(NO_FRICTION, np.ones(6), T, JointTrackingConfig())
    assert block.GetInputPort("reference").size() == 18
    assert block.GetOutputPort("tau_command").size() == 6


@pytest.mark.parametrize("law", ["computed_torque", "feedforward_pd"])
def test_formula(sts, law):
    rng = np.random.default_rng(1)
    kp, kd, ki = rng.uniform(1, 20, (3, 6))
    config = JointTrackingConfig(law, list(kp), list(kd), list(ki), [1e6], friction_velocity=1e-9)
    block = JointTrackingController(FRICTION, np.full(6, 1e6), T, config)
    q, v, q_d, v_d, a_d, integral = rng.normal(size=(6, 6))
    terms = sts.chain.terms(q, v)
    feedback = kp * (q_d - q) + kd * (v_d - v) + ki * integral
    model = terms.Cv + terms.G + FRICTION.torque(v_d)
    if law == "computed_torque":
        expected = terms.M @ (a_d + feedback) + model
    else:
        expected = terms.M @ a_d + model + feedback
    got = torque(block, terms, np.concatenate([q_d, v_d, a_d]), integral)
    np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-12)


def test_friction_feedforward_fades_at_rest(sts):
    config = JointTrackingConfig(friction_velocity=0.01)
    block = JointTrackingController(FRICTION, sts.effort_limit, T, config)
    terms = sts.chain.terms(sts.home, np.zeros(6))
    still = np.concatenate([sts.home, np.zeros(12)])
    np.testing.assert_allclose(torque(block, terms, still), terms.G, atol=1e-12)
    for sign in (1, -1):
        creep = np.concatenate([sts.home, np.full(6, sign * 0.01), np.zeros(6)])
        feedback = terms.M @ np.full(6, 120.0 * sign * 0.01)
        friction = torque(block, terms, creep) - terms.G - feedback
        expected = FRICTION.torque(np.full(6, sign * 0.01)) / np.sqrt(2)
        np.testing.assert_allclose(friction, expected, atol=1e-12)


def test_error_dies_out_as_a_critically_damped_second_order(sts):
    loop = ClosedLoop(sts, JointTrackingConfig(kp=[400.0], kd=[40.0]))
    e_0 = np.array([0.1, -0.08, 0.06, 0.1, -0.1, 0.1])
    t, q = loop.run(0.4, sts.home - e_0)
    expected = e_0 * ((1 + 20 * t) * np.exp(-20 * t))[:, None]
    # A tick of 1 ms against a time constant of 50 ms: the semi-implicit step errs by about T/2
    # times the velocity, which is at most 0.1 * 20/e = 0.74 rad/s; and the torque lags by as much.
    np.testing.assert_allclose(sts.home - q, expected, atol=1.5e-3)


def test_integral_takes_a_constant_push_away(sts):
    push = np.array([5.0, -8.0, 6.0, 1.0, 1.0, 0.5])
    gains = {"kp": [400.0], "kd": [40.0]}
    _, q = ClosedLoop(sts, JointTrackingConfig(**gains), disturbance=push).run(1.0, sts.home)
    # Without it, the error is that of a spring M kp.
    M = sts.chain.terms(q[-1], 0.0 * q[-1]).M
    np.testing.assert_allclose(400 * M @ (q[-1] - sts.home), push, rtol=1e-3)
    config = JointTrackingConfig(**gains, ki=[1600.0], integral_limit=[1e4])
    _, q = ClosedLoop(sts, config, disturbance=push).run(4.0, sts.home)
    np.testing.assert_allclose(q[-1], sts.home, atol=1e-5)


def test_integral_does_not_wind_up_while_the_drive_is_at_its_limit(sts):
    # The push holds the arm away for good: more than the drive can do, in the first joint.
    limit = sts.effort_limit.copy()
    limit[0] = 20.0
    config = JointTrackingConfig(kp=[400.0], kd=[40.0], ki=[4000.0], integral_limit=[1e9])
    loop = ClosedLoop(sts, config, limit, disturbance=np.array([30.0, 0, 0, 0, 0, 0]))
    _, q = loop.run(0.6, sts.home)
    assert q[-1, 0] > sts.home[0] + 0.1
    context = loop.block.GetMyContextFromRoot(loop.simulator.get_context())
    wound = context.get_discrete_state(0).value()[0]
    unlimited = -np.sum(q[:, 0] - sts.home[0]) * T
    assert abs(wound) < 0.1 * abs(unlimited)


def test_effort_limit(sts):
    block = JointTrackingController(NO_FRICTION, sts.effort_limit, T, JointTrackingConfig(kp=[1e5]))
    terms = sts.chain.terms(sts.home, np.zeros(6))
    far = np.concatenate([sts.home + 1.0, np.zeros(12)])
    np.testing.assert_allclose(np.abs(torque(block, terms, far)), sts.effort_limit)


def test_gain_through_the_context(sts):
    block = JointTrackingController(NO_FRICTION, np.full(6, 1e6), T, JointTrackingConfig())
    terms = sts.chain.terms(sts.home, np.zeros(6))
    context = block.CreateDefaultContext()
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    block.GetInputPort("reference").FixValue(
        context, np.concatenate([sts.home + 0.1, np.zeros(12)])
    )
    before = block.GetOutputPort("tau_command").Eval(context) - terms.G
    gains = context.get_mutable_numeric_parameter(0)
    gains.SetFromVector(gains.value() * 2)
    after = block.GetOutputPort("tau_command").Eval(context) - terms.G
    np.testing.assert_allclose(after, 2 * before, rtol=1e-12)


def test_an_integral_gain_that_nothing_integrates_for_is_refused(sts):
    """Without a ki at the start the block has no integral: a later one would do nothing."""
    block = JointTrackingController(NO_FRICTION, np.full(6, 1e6), T, JointTrackingConfig())
    context = block.CreateDefaultContext()
    terms = sts.chain.terms(sts.home, np.zeros(6))
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    block.GetInputPort("reference").FixValue(context, np.concatenate([sts.home, np.zeros(12)]))
    gains = context.get_mutable_numeric_parameter(0)
    gains.SetAtIndex(2 * 6, 100.0)  # ki of the first joint
    with pytest.raises(ValueError, match="state ki in JointTrackingConfig"):
        block.GetOutputPort("tau_command").Eval(context)


def test_a_reference_ahead_pushes_forward(sts):
    config = JointTrackingConfig(law="feedforward_pd", kp=[100.0])
    block = JointTrackingController(NO_FRICTION, np.full(6, 1e6), T, config)
    terms = sts.chain.terms(sts.home, np.zeros(6))
    ahead = np.concatenate([sts.home + 0.1, np.zeros(12)])
    np.testing.assert_allclose(torque(block, terms, ahead) - terms.G, 10.0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"law": "pid"}, "pid"),
        ({"kp": [1.0, 2.0]}, "kp: 2 numbers, expected 1 or 6"),
        ({"kd": [-1.0]}, "kd"),
        ({"ki": [float("nan")]}, "ki"),
    ],
)
def test_bad_configuration(changes, words):
    with pytest.raises(InputError, match=words):
        JointTrackingController(NO_FRICTION, np.ones(6), T, JointTrackingConfig(**changes))


def test_limits_and_periods_that_are_none_are_refused():
    """Kernels read the limits and the friction of as many joints unchecked."""
    config = JointTrackingConfig(ki=[1.0])
    for limit in (-np.ones(6), np.full(6, np.nan), np.ones(4)):
        with pytest.raises(InputError, match=r"effort_limit: .* expected 6 above 0"):
            JointTrackingController(NO_FRICTION, limit, T, config)
    for time_step in (0.0, -T, np.nan, np.inf):
        with pytest.raises(ValueError, match="time_step must be positive"):
            JointTrackingController(NO_FRICTION, np.ones(6), time_step, config)


@pytest.mark.parametrize("gain", [np.nan, np.inf, -1.0])
def test_a_gain_of_the_context_that_is_none_is_refused(sts, gain):
    """It gave a torque that is no number, and counted as valid."""
    block = JointTrackingController(NO_FRICTION, np.full(6, 1e6), T, JointTrackingConfig())
    context = block.CreateDefaultContext()
    terms = sts.chain.terms(sts.home, np.zeros(6))
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    block.GetInputPort("reference").FixValue(context, np.concatenate([sts.home, np.zeros(12)]))
    context.get_mutable_numeric_parameter(0).SetAtIndex(0, gain)
    with pytest.raises(InputError, match=r"kp: .*expected 0 or more"):
        block.GetOutputPort("tau_command").Eval(context)


def test_terms_of_another_arm_are_refused(sts):
    """A kernel would read beyond their end."""
    block = JointTrackingController(NO_FRICTION, np.full(6, 1e6), T, JointTrackingConfig())
    of_seven = RigidBodyTerms.zeros(7)
    with pytest.raises(ValueError, match="must be of 6 joints, and are those of 7 joints"):
        torque(block, of_seven, np.zeros(18))
    with pytest.raises(ValueError, match="must be of 6 joints, and are dict"):
        torque(block, {}, np.zeros(18))


@pytest.mark.parametrize("name", ["terms", "reference"])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_one_tick_that_is_not_finite_leaves_no_trace(sts, name, bad):
    config = JointTrackingConfig(ki=[100.0])
    block = JointTrackingController(NO_FRICTION, sts.effort_limit, T, config)
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    good = np.concatenate([sts.home + 0.01, np.zeros(12)])
    for k in range(5):
        is_bad = k == 2
        q = np.full(6, np.nan) if name == "terms" and is_bad else sts.home
        terms = sts.chain.terms(q, np.zeros(6))
        reference = np.full(18, bad) if name == "reference" and is_bad else good
        block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
        block.GetInputPort("reference").FixValue(context, reference)
        tau = block.GetOutputPort("tau_command").Eval(context)
        assert block.GetOutputPort("valid").Eval(context)[0] == float(not is_bad)
        if is_bad:
            held = np.zeros(6) if name == "terms" else terms.G
            np.testing.assert_allclose(tau, held, atol=1e-12)
        simulator.AdvanceTo((k + 0.5) * T)  # between ticks: what the tick has left
        assert block.GetOutputPort("valid").Eval(context)[0] == float(not is_bad)
        simulator.AdvanceTo((k + 1) * T)
    integral = context.get_discrete_state(0).CopyToVector()
    np.testing.assert_allclose(integral, 4 * T * 0.01, rtol=1e-9)
