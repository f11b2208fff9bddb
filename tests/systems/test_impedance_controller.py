import numpy as np
import pytest
from block_ticks import memory_after_tick
from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint, SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, Demultiplexer, LogVectorOutput
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.systems.impedance_controller import (
    ForceControlConfig,
    ImpedanceConfig,
    ImpedanceController,
)
from wrenchsight.systems.rigid_body_terms import RigidBodyTermsSystem

T = 1e-3
ORDER = [3, 4, 5, 0, 1, 2]  # from translation first to rotation first


def no_friction(n):
    return SemiParametricFriction(CoulombViscous.zero(n))


def pose(R, p, V=None):
    return np.concatenate([np.asarray(R).ravel(), p, np.zeros(6) if V is None else V])


def torque(block, terms, desired, **inputs):
    context = block.CreateDefaultContext()
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    block.GetInputPort("pose_reference").FixValue(context, desired)
    for name, value in inputs.items():
        block.GetInputPort(name).FixValue(context, value)
    return block.GetOutputPort("tau_command").Eval(context)


def gantry(plant):
    """Three rails along x, y, z; 2, 3 and 5 kg carried one on the other: 10, 8, 5 kg move."""
    parent = plant.world_frame()
    instance = plant.AddModelInstance("gantry")
    for axis, mass in zip(np.eye(3), (2.0, 3.0, 5.0), strict=True):
        name = "xyz"[int(np.argmax(axis))]
        body = plant.AddRigidBody(
            name, instance, SpatialInertia(mass, [0, 0, 0], UnitInertia(0.1, 0.1, 0.1))
        )
        joint = plant.AddJoint(PrismaticJoint(name, parent, body.body_frame(), axis))
        plant.AddJointActuator(name, joint)
        parent = body.body_frame()
    return instance, parent


class Loop:
    """A plant without friction, its exact terms, the controller, and a constant pose to hold."""

    def __init__(self, add, config, desired, wall=None, setpoint=0.0, push=None):
        builder = DiagramBuilder()
        plant = builder.AddSystem(MultibodyPlant(T))
        plant.SetUseSampledOutputPorts(False)
        instance, frame_E = add(plant)
        plant.Finalize()
        chain = SerialChain.from_plant(plant, instance, frame_E)
        n = chain.num_joints
        terms = builder.AddSystem(RigidBodyTermsSystem(chain))
        self.block = builder.AddSystem(
            ImpedanceController(no_friction(n), np.full(n, 1e4), T, config)
        )
        port = plant.get_state_output_port(instance)
        split = builder.AddSystem(Demultiplexer([n, n]))
        hold = builder.AddSystem(ConstantVectorSource(desired))
        builder.Connect(port, split.get_input_port())
        builder.Connect(split.get_output_port(0), terms.GetInputPort("q"))
        builder.Connect(split.get_output_port(1), terms.GetInputPort("v"))
        builder.Connect(terms.GetOutputPort("terms"), self.block.GetInputPort("terms"))
        builder.Connect(hold.get_output_port(), self.block.GetInputPort("pose_reference"))
        builder.Connect(self.block.GetOutputPort("tau_command"), plant.get_actuation_input_port())
        force_port = plant.get_applied_generalized_force_input_port()
        if wall is not None:
            wall = builder.AddSystem(Wall(wall))
            value = builder.AddSystem(ConstantVectorSource([setpoint]))
            builder.Connect(port, wall.get_input_port())
            builder.Connect(wall.GetOutputPort("force"), force_port)
            builder.Connect(wall.GetOutputPort("wrench"), self.block.GetInputPort("wrench"))
            builder.Connect(value.get_output_port(), self.block.GetInputPort("force_setpoint"))
        else:
            push = builder.AddSystem(ConstantVectorSource(np.zeros(n) if push is None else push))
            builder.Connect(push.get_output_port(), force_port)
        self._log = LogVectorOutput(port, builder, T)
        self.plant, self.chain, self.n = plant, chain, n
        self.simulator = Simulator(builder.Build())
        self.context = self.simulator.get_mutable_context()

    def run(self, duration, q_0, v_0=None):
        context = self.plant.GetMyMutableContextFromRoot(self.context)
        v_0 = np.zeros(self.n) if v_0 is None else v_0
        self.plant.SetPositionsAndVelocities(context, np.concatenate([q_0, v_0]))
        self.simulator.AdvanceTo(duration)
        log = self._log.FindLog(self.context)
        return log.sample_times(), log.data()[: self.n].T, log.data()[self.n :].T


class Wall(LeafSystem):
    """A spring below z = 0 that pushes a gantry up."""

    def __init__(self, stiffness):
        LeafSystem.__init__(self)
        self._stiffness = stiffness
        self.DeclareVectorInputPort("state", 6)
        self.DeclareVectorOutputPort(
            "force", 3, lambda c, out: out.SetFromVector([0, 0, self._push(c)])
        )
        self.DeclareVectorOutputPort(
            "wrench", 6, lambda c, out: out.SetFromVector([0, 0, 0, 0, 0, self._push(c)])
        )

    def _push(self, context):
        state = self.get_input_port().Eval(context)
        return max(0.0, -self._stiffness * state[2] - 20.0 * state[5]) if state[2] < 0 else 0.0


def test_ports():
    block = ImpedanceController(no_friction(7), np.ones(7), T, ImpedanceConfig())
    sizes = {"pose_reference": 18, "reference": 21, "wrench": 6, "force_setpoint": 1}
    for name, size in sizes.items():
        assert block.GetInputPort(name).size() == size
    assert block.GetOutputPort("tau_command").size() == 7
    assert block.GetOutputPort("pose_error").size() == 6


@pytest.mark.parametrize("axes", ["W", "E"])
def test_formula(sts, axes):
    rng = np.random.default_rng(2)
    K, B = np.diag(rng.uniform(10, 100, 6)), np.diag(rng.uniform(1, 9, 6))
    config = ImpedanceConfig(axes, np.diag(K), np.diag(B), friction_velocity=1e-12)
    friction = SemiParametricFriction(CoulombViscous(*rng.uniform(0.1, 2, (3, 6))))
    block = ImpedanceController(friction, np.full(6, 1e6), T, config)
    q, v, v_d, a_d = rng.normal(size=(4, 6))
    terms = sts.chain.terms(q, v)
    # The same orientation, so that the rotation does not couple with the translation.
    desired = pose(terms.R_WE, terms.p_WE + np.array([0.1, -0.2, 0.05]), rng.normal(size=6))
    turn = np.eye(6) if axes == "W" else np.kron(np.eye(2), terms.R_WE)
    to_first = np.eye(6)[ORDER]
    K_W, B_W = (turn @ to_first @ X @ to_first.T @ turn.T for X in (K, B))
    e = np.concatenate([np.zeros(3), terms.p_WE - desired[9:12]])
    spring = -K_W @ e
    if axes == "E":
        e_t = terms.R_WE.T @ e[3:]
        spring[:3] += terms.R_WE @ np.cross(e_t, K[:3, :3] @ e_t)
    wrench = spring - B_W @ (terms.V_WE - desired[12:])
    expected = terms.J.T @ wrench + terms.Cv + terms.G + terms.M @ a_d + friction.torque(v_d)
    got = torque(block, terms, desired, reference=np.concatenate([q, v_d, a_d]))
    np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-9)
    alone = torque(block, terms, desired)
    np.testing.assert_allclose(alone, terms.J.T @ wrench + terms.Cv + terms.G, atol=1e-9)


def test_force_formula_and_direction_in_E(sts):
    config = ImpedanceConfig(
        stiffness=np.zeros(6),
        damping=np.zeros(6),
        force=ForceControlConfig(direction=[0, 0, -2.0], axes="E", proportional=0.5, integral=3.0),
    )
    block = ImpedanceController(no_friction(6), np.full(6, 1e6), T, config)
    terms = sts.chain.terms(sts.home, np.zeros(6))
    d = -terms.R_WE[:, 2]
    measured = np.array([0, 0, 0, 1.0, 2.0, 3.0])
    context = block.CreateDefaultContext()
    context.SetDiscreteState(0, [4.0])
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    block.GetInputPort("pose_reference").FixValue(context, pose(terms.R_WE, terms.p_WE))
    block.GetInputPort("wrench").FixValue(context, measured)
    block.GetInputPort("force_setpoint").FixValue(context, [30.0])
    error = 30.0 - d @ measured[3:]
    press = 30.0 + 0.5 * error + 3.0 * 4.0
    expected = terms.G + terms.J[3:].T @ (-press * d)
    tau = block.GetOutputPort("tau_command").Eval(context)
    np.testing.assert_allclose(tau, expected, atol=1e-10)


def test_gantry_is_a_mass_spring_damper():
    k, b, m = np.array([400.0, 900, 250]), np.array([30.0, 20, 60]), np.array([10.0, 8, 5])
    config = ImpedanceConfig(stiffness=np.r_[k, 1, 1, 1], damping=np.r_[b, 1, 1, 1])
    push = np.array([4.0, -9.0, 5.0])
    loop = Loop(gantry, config, pose(np.eye(3), np.zeros(3)), push=push)
    q_0 = np.array([0.05, -0.03, 0.02])
    t, q, _ = loop.run(1.5, q_0)

    def motion(_, x):
        return np.concatenate([x[3:], (push - k * x[:3] - b * x[3:]) / m])

    exact = solve_ivp(motion, (0, 1.5), np.r_[q_0, 0, 0, 0], t_eval=t, rtol=1e-9, atol=1e-12)
    # A held torque acts T/2 late: that takes k T/2 off the damping, 0.45 of 20 at most.
    np.testing.assert_allclose(q, exact.y[:3].T, atol=6e-4)
    assert loop.block.GetOutputPort("pose_error").Eval(
        loop.block.GetMyContextFromRoot(loop.context)
    )[3:] == pytest.approx(q[-1])


def test_arm_answers_a_push_as_its_impedance_says(sts):
    # Small motion about a well-conditioned posture: Lambda is as good as constant.
    q_0 = np.array([0.1, -0.6, 0.4, 0.2, 0.9, 0.3])
    terms = sts.chain.terms(q_0, np.zeros(6))
    k, b = np.r_[900.0, 1200, 800, 40, 50, 30], np.r_[250.0, 250, 250, 10, 10, 10]
    config = ImpedanceConfig(stiffness=k, damping=b)
    force = np.array([0.02, -0.03, 0.01, 0.3, -0.4, 0.5])

    def add(plant):
        parts = sts.add_to_plant(plant)
        return parts.model_instance, parts.frame_E

    loop = Loop(add, config, pose(terms.R_WE, terms.p_WE), push=terms.J.T @ force)
    t, q, _ = loop.run(0.8, q_0)
    Lambda = np.linalg.inv(terms.J @ np.linalg.solve(terms.M, terms.J.T))
    K, B = np.diag(k[ORDER]), np.diag(b[ORDER])

    def motion(_, x):
        return np.r_[x[6:], np.linalg.solve(Lambda, force - K @ x[:6] - B @ x[6:])]

    exact = solve_ivp(motion, (0, 0.8), np.zeros(12), t_eval=t, rtol=1e-9, atol=1e-12)
    R, p = sts.chain.pose(q)
    turned = Rotation.from_matrix(R @ terms.R_WE.T).as_rotvec()
    error = np.c_[turned, p - terms.p_WE]
    largest = np.abs(exact.y[:6]).max(axis=1)
    # Half a millimetre of motion changes J and Lambda by some per mille; the tick adds 1 %.
    for part in (slice(0, 3), slice(3, 6)):
        np.testing.assert_allclose(
            error[:, part], exact.y[part].T, atol=0.015 * largest[part].max()
        )
    # The tool gives way by K^-1 F, and is on its way there.
    assert np.all(error[-1] * force > 0)


def test_a_swing_from_far_loses_energy_at_every_tick(sts):
    q_0 = np.array([0.1, -0.6, 0.4, 0.2, 0.9, 0.3])
    R_WD, p_WD = sts.chain.pose(np.array([0.5, -0.3, 0.2, -0.2, 1.2, 1.3]))
    k = np.r_[300.0, 500, 400, 15, 20, 10]
    config = ImpedanceConfig("E", k, np.r_[80.0, 80, 80, 4, 4, 4])

    def add(plant):
        parts = sts.add_to_plant(plant)
        return parts.model_instance, parts.frame_E

    loop = Loop(add, config, pose(R_WD, p_WD))
    _, q, v = loop.run(4.0, q_0)
    R, p = sts.chain.pose(q)
    e_r = Rotation.from_matrix(np.swapaxes(R_WD[None], 1, 2) @ R).as_rotvec()
    e_t = np.einsum("tki,tk->ti", R, p - p_WD)
    spring = 0.5 * (np.c_[e_t, e_r] ** 2 @ k)
    energy = 0.5 * np.sum(sts.chain.momentum_terms(q, v)[0] * v, axis=1) + spring
    assert energy[0] > 5.0
    # A held torque may feed back T/2 of lag; the damper takes far more.
    assert np.diff(energy).max() < 1e-3
    assert energy[-1] < 0.02 * energy[0]


def test_seven_joints_come_to_rest_by_null_space_damping():
    # A gantry on a gantry, and once more along x: the tool's pose leaves four freedoms.
    def add(plant):
        instance = plant.AddModelInstance("long")
        parent = plant.world_frame()
        for i, axis in enumerate(np.r_[np.eye(3), np.eye(3), np.eye(3)[:1]]):
            body = plant.AddRigidBody(
                f"b{i}", instance, SpatialInertia(1.0, [0, 0, 0], UnitInertia(0.1, 0.1, 0.1))
            )
            joint = plant.AddJoint(PrismaticJoint(f"j{i}", parent, body.body_frame(), axis))
            plant.AddJointActuator(f"j{i}", joint)
            parent = body.body_frame()
        return instance, parent

    v_0 = np.array([0.5, 0, 0, -0.5, 0, 0, 0])
    for damping, rests in ((0.0, False), (8.0, True)):
        config = ImpedanceConfig(null_space_damping=damping)
        loop = Loop(add, config, pose(np.eye(3), np.zeros(3)))
        _, q, v = loop.run(2.0, np.zeros(7), v_0)
        assert (np.abs(v[-1]).max() < 1e-2) == rests
        tool = q[:, 0] + q[:, 3] + q[:, 6]
        # What the joints do behind the tool's back does not move it.
        assert np.abs(tool).max() < 1e-6


FORCE = ForceControlConfig(direction=[0, 0, 1], proportional=0.5, integral=8.0, integral_limit=40.0)


def test_contact_force_settles_at_the_set_point_and_reads_positive():
    config = ImpedanceConfig(force=FORCE)
    loop = Loop(gantry, config, pose(np.eye(3), [0.1, 0, 0]), wall=2e4, setpoint=30.0)
    _, q, _ = loop.run(3.0, np.array([0.0, 0, 0.005]))
    # Force control along z only: x follows the spring.
    assert -2e4 * q[-1, 2] == pytest.approx(30.0, abs=0.01)
    assert q[-1, 0] == pytest.approx(0.1, abs=1e-3)


def test_integral_is_limited_where_nothing_pushes_back():
    config = ImpedanceConfig(force=FORCE)
    loop = Loop(gantry, config, pose(np.eye(3), np.zeros(3)), wall=2e4, setpoint=30.0)
    loop.run(3.0, np.array([0.0, 0, 10.0]))
    integral = loop.block.GetMyContextFromRoot(loop.context).get_discrete_state(0).value()[0]
    assert 8.0 * integral == pytest.approx(40.0)


def test_effort_limit(sts):
    block = ImpedanceController(no_friction(6), sts.effort_limit, T, ImpedanceConfig())
    terms = sts.chain.terms(sts.home, np.zeros(6))
    tau = torque(block, terms, pose(terms.R_WE, terms.p_WE + np.array([0, 9.0, 0])))
    assert np.all(np.abs(tau) <= sts.effort_limit)
    assert np.any(np.abs(tau) == sts.effort_limit)


def test_stiffness_through_the_context(sts):
    block = ImpedanceController(no_friction(6), np.full(6, 1e6), T, ImpedanceConfig())
    terms = sts.chain.terms(sts.home, np.zeros(6))
    context = block.CreateDefaultContext()
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    desired = pose(terms.R_WE, terms.p_WE + np.array([0.01, 0, 0]))
    block.GetInputPort("pose_reference").FixValue(context, desired)
    before = block.GetOutputPort("tau_command").Eval(context) - terms.G
    stiffness = context.get_mutable_numeric_parameter(0)
    stiffness.SetFromVector(3 * stiffness.value())
    after = block.GetOutputPort("tau_command").Eval(context) - terms.G
    np.testing.assert_allclose(after, 3 * before, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"axes": "B"}, "expected W or E"),
        ({"stiffness": np.ones(5)}, "stiffness: expected 6 finite numbers"),
        ({"stiffness": np.triu(np.ones((6, 6)))}, "symmetric"),
        ({"damping": -np.ones(6)}, "damping: expected no negative"),
        ({"null_space_damping": -1.0}, "null_space_damping"),
        ({"force": ForceControlConfig(direction=[0, 0, 0])}, "direction"),
        ({"force": ForceControlConfig(integral=-1.0)}, "gains"),
        ({"force": ForceControlConfig(axes="tool")}, "force.axes"),
    ],
)
def test_bad_configuration(changes, words):
    with pytest.raises(InputError, match=words):
        ImpedanceController(no_friction(6), np.ones(6), T, ImpedanceConfig(**changes))


def test_limits_and_periods_that_are_none_are_refused():
    """Kernels read the limits and the friction of as many joints unchecked."""
    config = ImpedanceConfig(force=ForceControlConfig(integral=1.0))
    for limit in (-np.ones(6), np.full(6, np.nan), np.ones(4)):
        with pytest.raises(InputError, match=r"effort_limit: .* expected 6 above 0"):
            ImpedanceController(no_friction(6), limit, T, config)
    for time_step in (0.0, -T, np.nan, np.inf):
        with pytest.raises(ValueError, match="time_step must be positive"):
            ImpedanceController(no_friction(6), np.ones(6), time_step, config)


@pytest.mark.parametrize("index", [0, 1, 2])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -1e4])
def test_a_gain_of_the_context_that_is_none_is_refused(sts, index, bad):
    """Stiffness, damping and gains of the force: it gave a torque that is no number, as valid."""
    config = ImpedanceConfig(force=ForceControlConfig(integral=1.0))
    block = ImpedanceController(no_friction(6), np.full(6, 1e6), T, config)
    terms = sts.chain.terms(sts.home, np.zeros(6))
    context = block.CreateDefaultContext()
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    block.GetInputPort("pose_reference").FixValue(context, pose(terms.R_WE, terms.p_WE))
    block.GetInputPort("wrench").FixValue(context, np.zeros(6))
    block.GetInputPort("force_setpoint").FixValue(context, [0.0])
    context.get_mutable_numeric_parameter(index).SetAtIndex(0, bad)
    with pytest.raises(InputError, match=r"stiffness: exp|damping: exp|force: gains"):
        block.GetOutputPort("tau_command").Eval(context)


def test_force_control_takes_over_from_the_spring_without_a_jump(sts):
    """After a stretch under position control the torque is the same in the tick of the change."""
    force = ForceControlConfig(direction=[0.0, 0.0, 1.0], proportional=0.6, integral=60.0)
    config = ImpedanceConfig(force=force)
    block = ImpedanceController(no_friction(6), sts.effort_limit, T, config)
    context = block.CreateDefaultContext()
    terms = sts.chain.terms(sts.home, np.zeros(6))
    below = terms.p_WE - [0.0, 0.0, 0.01]
    pushed = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 7.0])
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    block.GetInputPort("pose_reference").FixValue(context, pose(terms.R_WE, below))
    block.GetInputPort("wrench").FixValue(context, pushed)
    # The force that is there, with which force control will begin.
    block.GetInputPort("force_setpoint").FixValue(context, [7.0])
    active = block.GetInputPort("force_active").FixValue(context, [0.0])
    before = block.GetOutputPort("tau_command").Eval(context).copy()
    # The spring presses with 2000 N/m times 10 mm.
    np.testing.assert_allclose(before - terms.G, terms.J[5] * -20.0, atol=1e-9)
    context.SetDiscreteState(0, memory_after_tick(block, context))
    active.GetMutableData().set_value([1.0])
    after = block.GetOutputPort("tau_command").Eval(context)
    np.testing.assert_allclose(after, before, atol=1e-9)


@pytest.mark.parametrize("valid", [None, 1.0, 0.0])
def test_without_valid_feedback_the_press_is_setpoint_and_integral(sts, valid):
    force = ForceControlConfig(direction=[0.0, 0.0, 1.0], proportional=0.6, integral=60.0)
    block = ImpedanceController(
        no_friction(6), np.full(6, 1e6), T, ImpedanceConfig(stiffness=np.zeros(6), force=force)
    )
    context = block.CreateDefaultContext()
    terms = sts.chain.terms(sts.home, np.zeros(6))
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    block.GetInputPort("pose_reference").FixValue(context, pose(terms.R_WE, terms.p_WE))
    block.GetInputPort("force_setpoint").FixValue(context, [40.0])
    if valid is not None:
        block.GetInputPort("feedback_valid").FixValue(context, [valid])
    context.SetDiscreteState(0, [0.1])
    for push in (0.0, 25.0, 300.0):
        block.GetInputPort("wrench").FixValue(context, [0.0, 0.0, 0.0, 0.0, 0.0, push])
        error = 0.0 if valid == 0.0 else 40.0 - push
        press = 40.0 + 0.6 * error + 60.0 * 0.1
        tau = block.GetOutputPort("tau_command").Eval(context)
        np.testing.assert_allclose(tau - terms.G, -press * terms.J[5], atol=1e-9)
        assert memory_after_tick(block, context).item() == pytest.approx(0.1 + T * error)


def forced(sts):
    """A controller of force at rest above a contact of 20 N, with its inputs by name."""
    config = ImpedanceConfig(force=ForceControlConfig())
    block = ImpedanceController(no_friction(6), sts.effort_limit, T, config)
    terms = sts.chain.terms(sts.home, np.zeros(6))
    values = {
        "pose_reference": pose(terms.R_WE, terms.p_WE),
        "reference": np.concatenate([sts.home, np.zeros(12)]),
        "wrench": np.array([0.0, 0.0, 0.0, 0.0, 0.0, 20.0]),
        "force_setpoint": np.array([40.0]),
        "force_active": np.array([1.0]),
    }
    return block, terms, values


@pytest.mark.parametrize(
    "name",
    [
        "terms",
        "pose_reference",
        "reference",
        "force_setpoint",
        "force_active",
    ],
)
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_one_tick_that_is_not_finite_leaves_no_trace(sts, name, bad):
    block, terms, values = forced(sts)
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    for k in range(5):
        is_bad = k == 2
        q = np.full(6, np.nan) if name == "terms" and is_bad else sts.home
        now = sts.chain.terms(q, np.zeros(6))
        block.GetInputPort("terms").FixValue(context, AbstractValue.Make(now))
        for key, value in values.items():
            number = value.copy()
            if key == name and is_bad:
                number[-1] = bad
            block.GetInputPort(key).FixValue(context, number)
        tau = block.GetOutputPort("tau_command").Eval(context)
        assert block.GetOutputPort("valid").Eval(context)[0] == float(not is_bad)
        if is_bad:  # the weight is held as long as the position is known
            held = np.zeros(6) if name == "terms" else terms.G
            np.testing.assert_allclose(tau, held, atol=1e-12)
        simulator.AdvanceTo((k + 1) * T)
    # Four good ticks of 20 N of error, as without the bad one.
    assert context.get_discrete_state(0).GetAtIndex(0) == pytest.approx(4 * T * 20.0, rel=1e-12)


def test_force_gains_through_the_context(sts):
    """They are parameters of a controller of force alone."""
    alone = ImpedanceController(no_friction(6), sts.effort_limit, T, ImpedanceConfig())
    assert alone.CreateDefaultContext().num_numeric_parameter_groups() == 2
    block, terms, values = forced(sts)
    context = block.CreateDefaultContext()
    block.GetInputPort("terms").FixValue(context, AbstractValue.Make(terms))
    for name, value in values.items():
        block.GetInputPort(name).FixValue(context, value)
    context.SetDiscreteState(0, [0.1])  # N s, the integral
    context.get_mutable_numeric_parameter(2).SetFromVector([2.0, 30.0, 60.0])
    tau = block.GetOutputPort("tau_command").Eval(context)
    press = 40.0 + 2.0 * (40.0 - 20.0) + 30.0 * 0.1
    np.testing.assert_allclose(tau - terms.G, -press * terms.J[5], atol=1e-9)


def test_a_wrench_that_is_not_finite_counts_as_no_feedback(sts):
    block, terms, values = forced(sts)
    blind = torque(block, terms, values.pop("pose_reference"), **values, feedback_valid=[0.0])
    values["wrench"] = np.array([0.0, 0.0, np.nan, 0.0, 0.0, np.inf])
    desired = pose(terms.R_WE, terms.p_WE)
    np.testing.assert_array_equal(torque(block, terms, desired, **values), blind)
