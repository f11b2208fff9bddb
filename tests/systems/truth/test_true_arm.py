"""The true arm as a block: ports, its kernels through them, what acts from outside, its motors."""

from dataclasses import replace

import numpy as np
import pytest
from block_ticks import memory_after_tick
from pydrake.common.value import Value
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    ProximityProperties,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    ContactResults,
    CoulombFriction,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import BodyIndex, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from wrenchsight.models.control.wrench_script import WrenchScript, WrenchStep
from wrenchsight.models.machining.machining_process import (
    MachiningProcess,
    ProcessConfig,
    ProcessTick,
    advance_process,
    advance_varying_process,
    joint_vibration,
)
from wrenchsight.models.machining.process_variations import WorkpieceContact
from wrenchsight.models.rigid_body.chain_kernels import JointDynamics
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.signals.current_measurement import measure_current
from wrenchsight.models.signals.gaussian_noise import gaussian_noise
from wrenchsight.models.signals.tool_contact import normal_parts
from wrenchsight.models.truth.free_arm import VELOCITY_STREAM, WANDER_STREAM
from wrenchsight.models.truth.joint_kernels import (
    EXTERNAL,
    SIGNALS,
    VIBRATION,
    EncoderSample,
    JointInputs,
    JointMemory,
    encoder_reading,
    joint_tick,
)
from wrenchsight.models.truth.true_joints import TrueJoints
from wrenchsight.models.truth.true_robot import with_truth_named
from wrenchsight.systems.truth.tool_contacts import ToolContacts
from wrenchsight.systems.truth.true_arm import ArmParts, TrueArm

T = 1e-3
SEED = 7
COMMAND = np.array([0.3, -0.8, 0.4, -0.05, 0.1, 0.02])
V = 0.1 * np.arange(1.0, 7.0)
PUSH = WrenchStep(force=[4.0, 5.0, 6.0], moment=[0.1, -0.2, 0.3])
PUSHED = np.array([0.1, -0.2, 0.3, 4.0, 5.0, 6.0])
PROCESS = ProcessConfig(cutting_ratio=0.2, speed_exponent=0.0, unbalance=1e-5)
RADIUS, DEPTH = 0.012, 5e-4


@pytest.fixture(scope="module")
def robot():
    return with_truth_named(Robot.load("sts_sre4_600"), "hard")


@pytest.fixture(scope="module")
def joints(robot):
    return TrueJoints.of(robot, T)


def arm_of(robot, joints, touching=False, **more):
    contacts = ToolContacts(BodyIndex(8)) if touching else None
    script = WrenchScript(more.pop("segments", []))
    parts = {"contacts": contacts, "script": script, "seed": SEED} | more
    return TrueArm(ArmParts(robot.chain, joints, BodyIndex(8), np.array([0.0, 0.0, 0.07]), **parts))


class AtWork:
    """The block in a context, at home in motion, with all its inputs fixed."""

    def __init__(self, robot, joints, tau_contact=None, results=None, **more):
        self.arm = arm = arm_of(robot, joints, tau_contact is not None, **more)
        self.context = arm.CreateDefaultContext()
        self.terms = robot.chain.terms(robot.home, V)
        self.sizes = {"drives": arm.drive_sizes}
        arm.GetInputPort("state").FixValue(self.context, np.concatenate([robot.home, V]))
        arm.GetInputPort("current_command").FixValue(self.context, COMMAND)
        if tau_contact is not None:
            self.sizes["truth"] = arm.truth_sizes
            arm.GetInputPort("tau_contact").FixValue(self.context, tau_contact)
            contact_results = Value(ContactResults() if results is None else results)
            arm.GetInputPort("contact_results").FixValue(self.context, contact_results)

    def parts(self, name):
        values = self.arm.GetOutputPort(name).Eval(self.context)
        sizes = list(self.sizes[name].values())
        return np.split(values, np.cumsum(sizes)[:-1])

    @property
    def motion(self):
        values = self.arm.GetOutputPort("motion").Eval(self.context)
        sizes = self.arm.motion_sizes
        return dict(zip(sizes, np.split(values, np.cumsum(list(sizes.values()))[:-1]), strict=True))

    @property
    def state(self):
        return self.context.get_discrete_state(0).value()

    def after(self):
        return memory_after_tick(self.arm, self.context)


def by_kernel(joints, terms, state, tau_ext, tick=0):
    after, signals, noise = np.empty_like(state), np.empty((SIGNALS, 6)), np.empty(12)
    gaussian_noise(SEED + WANDER_STREAM, tick, noise)
    joint_tick(
        joints.table,
        T,
        JointDynamics(terms.M, terms.Cv, terms.G, terms.q, terms.v),
        JointInputs(COMMAND, tau_ext, noise),
        JointMemory(state, after, signals),
    )
    return after, signals


def test_ports(robot, joints):
    arm = arm_of(robot, joints)
    names = [arm.get_input_port(i).get_name() for i in range(arm.num_input_ports())]
    assert names == ["state", "current_command"]
    assert [arm.get_output_port(i).get_name() for i in range(arm.num_output_ports())] == [
        "motion", "drives",
    ]  # fmt: skip
    arm = arm_of(robot, joints, True, segments=[PUSH], process=MachiningProcess(PROCESS))
    names = [arm.get_input_port(i).get_name() for i in range(arm.num_input_ports())]
    assert names == ["state", "current_command", "contact_results", "tau_contact"]
    outputs = {arm.get_output_port(i).get_name() for i in range(arm.num_output_ports())}
    assert outputs == {"motion", "drives", "truth", "spatial_forces", "wrench_unbalance"}
    with pytest.raises(ValueError, match="needs contact"):
        arm_of(robot, joints, process=MachiningProcess(PROCESS))


def test_nothing_that_the_solver_needs_depends_on_what_it_finds(robot, joints):
    """Nor does anything that a controller reads depend on its command."""
    arm = arm_of(robot, joints, True, segments=[PUSH])
    through = {
        (arm.get_input_port(i).get_name(), arm.get_output_port(o).get_name())
        for i in range(arm.num_input_ports())
        for o in range(arm.num_output_ports())
        if arm.HasDirectFeedthrough(i, o)
    }
    assert through == {
        *(("state", name) for name in ("motion", "drives", "truth", "spatial_forces")),
        ("current_command", "drives"),
        ("contact_results", "truth"),
        ("tau_contact", "truth"),
    }


@pytest.mark.parametrize("touching", [False, True])
def test_a_tick_is_the_kernels_and_contact_counts_a_tick_late(robot, joints, touching):
    tau = np.array([5.0, -4.0, 3.0, 0.5, -0.4, 0.2])
    work = AtWork(robot, joints, tau if touching else None, segments=[PUSH])
    scripted = work.terms.J.T @ PUSHED
    first = joints.initial_state()
    after, signals = by_kernel(joints, work.terms, first, 0.0 * tau if touching else scripted)
    for output, expected in zip(work.parts("drives")[:SIGNALS], signals, strict=True):
        np.testing.assert_allclose(output, expected, rtol=1e-13)
    known = scripted + (tau if touching else 0.0)
    after[EXTERNAL] = known
    np.testing.assert_allclose(work.after()[: first.size], after.ravel(), rtol=1e-12, atol=1e-15)
    work.context.SetDiscreteState(0, np.concatenate([after.ravel(), work.state[first.size :]]))
    _, later = by_kernel(joints, work.terms, after, known)
    for output, expected in zip(work.parts("drives")[:SIGNALS], later, strict=True):
        np.testing.assert_allclose(output, expected, rtol=1e-13)


def test_encoders_read_with_the_noise_of_the_tick(robot, joints):
    work = AtWork(robot, joints)
    for tick in (0, 41):
        work.context.SetTime(tick * T)
        q, v = np.empty(6), np.empty(6)
        encoder_reading(
            joints.table,
            joints.initial_state(),
            JointDynamics(work.terms.M, work.terms.Cv, work.terms.G, robot.home, V),
            EncoderSample(True, SEED + VELOCITY_STREAM, tick),
            q,
            v,
        )
        np.testing.assert_array_equal(work.motion["q_read"], q)
        np.testing.assert_array_equal(work.motion["v_read"], v)


def test_the_reported_current_is_the_sensor_s(robot, joints):
    table = np.array([np.full(6, 80.0), np.full(6, 0.02), np.full(6, 0.005)])
    work = AtWork(robot, joints, current=table)
    true = work.parts("drives")[3]
    noise, expected = np.empty(6), np.empty(6)
    for tick in (0, 1):
        work.context.SetTime(tick * T)
        lagged = work.state[joints.initial_state().size :][:6].copy()
        gaussian_noise(SEED, tick, noise)
        measure_current(table, T, work.parts("drives")[3], noise, lagged, expected)
        np.testing.assert_array_equal(work.parts("drives")[4], expected)
        work.context.SetDiscreteState(0, work.after())
    np.testing.assert_array_equal(AtWork(robot, joints).parts("drives")[4], true)


def test_a_script_pushes_at_E_and_along_the_motion_that_it_causes(robot, joints):
    work = AtWork(robot, joints, segments=[PUSH])
    wrench, torque, applied = (work.motion[name] for name in ("wrench", "torque", "applied"))
    np.testing.assert_array_equal(wrench, PUSHED)
    np.testing.assert_array_equal(applied, PUSHED)
    np.testing.assert_allclose(torque, work.terms.J.T @ PUSHED, atol=1e-14)
    (force,) = work.arm.GetOutputPort("spatial_forces").Eval(work.context)
    np.testing.assert_array_equal(force.F_Bq_W.get_coeffs(), PUSHED)
    np.testing.assert_array_equal(force.p_BoBq_B, [0.0, 0.0, 0.07])
    along = WrenchStep(force=list(work.terms.J[3:, 1]))  # the velocity that joint 2 gives to E
    assert AtWork(robot, joints, segments=[along]).motion["torque"][1] > 0.0


def test_contact_torque_adds_to_what_is_scripted(robot, joints):
    tau = np.arange(6.0)
    work = AtWork(robot, joints, tau, segments=[PUSH])
    wrench, torque, normal = work.parts("truth")
    np.testing.assert_array_equal(wrench, PUSHED)
    np.testing.assert_allclose(torque, work.terms.J.T @ PUSHED + tau, atol=1e-14)
    np.testing.assert_array_equal(normal, 0.0)


def test_a_process_cuts_against_the_feed_once_contact_is_known(robot, joints):
    """The block's contact through ToolContacts is tested below: here its row is put in by hand."""
    process = MachiningProcess(PROCESS)
    work = AtWork(robot, joints, np.zeros(6), process=process)
    law = slice(joints.initial_state().size + 6, joints.initial_state().size + 16)
    before = np.concatenate([[30.0, 0.0, 0.0, 1.0, 0.0, 0.5, 0.0], np.zeros(3)])
    state = work.state.copy()
    state[law] = before
    work.context.SetDiscreteState(0, state)
    expected = before.copy()
    advance_process(process.constants, T, normal_parts(np.zeros(4)), work.terms.V_WE, expected)
    after = work.after()
    np.testing.assert_array_equal(after[law], expected)
    # Without contact the force ends, and the lagged feed follows the tool.
    assert expected[0] == 0.0 and not expected[7:].any()
    np.testing.assert_array_equal(after[law.stop + 3 : law.stop + 6], expected[7:])
    after[law.stop + 3 : law.stop + 6] = [-4.0, 0.0, 0.5]
    work.context.SetDiscreteState(0, after)
    wrench, torque, applied = (work.motion[name] for name in ("wrench", "torque", "applied"))
    np.testing.assert_array_equal(wrench, [0.0, 0.0, 0.0, -4.0, 0.0, 0.5])
    np.testing.assert_allclose(torque, work.terms.J.T @ wrench, atol=1e-14)
    unbalance = work.arm.GetOutputPort("wrench_unbalance").Eval(work.context)
    assert np.linalg.norm(unbalance) == pytest.approx(1e-5 * (2 * np.pi * 50.0) ** 2)
    assert unbalance[3:] @ work.terms.R_WE[:, 2] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(applied, wrench + unbalance, atol=1e-14)


def test_a_varying_process_reads_time_and_place(robot, joints):
    ends = np.array([[-9.0, 0.0, 0.0], [9.0, 0.0, 0.0]])
    contact = WorkpieceContact(2e5, 1.0, 0.2, np.eye(3), np.zeros(3), ends)
    process = MachiningProcess(PROCESS, contact=contact)
    first = joints.initial_state().size + 6
    body, tip, _, results, _diagram = pressed_ball(patches=False, ball_first=True)
    touched = ToolContacts(body, [tip], RADIUS)
    work = AtWork(robot, joints, np.zeros(6), results, process=process, contacts=touched)
    work.context.SetTime(0.0123)
    touch = normal_parts(work.parts("truth")[2])
    assert touch.force > 1.0
    expected, varied = process.initial_state, process.variations
    advance_varying_process(
        process.constants,
        varied.tables,
        ProcessTick(0.0123, T, touch, work.terms.V_WE, work.terms.p_WE),
        expected,
    )
    np.testing.assert_array_equal(work.after()[first : first + expected.size], expected)
    assert not work.after()[VIBRATION * 6 : VIBRATION * 6 + 6].any()
    steady = process.initial_state[:10]
    advance_process(process.constants, T, touch, work.terms.V_WE, steady)
    assert np.linalg.norm(expected[7:10] - steady[7:]) > 0.01 * np.linalg.norm(steady[7:])


def test_a_tool_that_vibrates_shakes_the_joints_while_it_touches(robot, joints):
    process = MachiningProcess(replace(PROCESS, vibration=0.03))
    body, tip, _, results, _diagram = pressed_ball(patches=False, ball_first=True)
    for contacts in (ToolContacts(body, [tip], RADIUS), None):
        more = {} if contacts is None else {"contacts": contacts}
        work = AtWork(
            robot, joints, np.zeros(6), results if more else None, process=process, **more
        )
        touch, terms, expected = work.parts("truth")[2], work.terms, np.empty(6)
        joint_vibration(process.constants, terms.M, terms.J, touch[0], touch[1:], expected)
        np.testing.assert_array_equal(work.after()[VIBRATION * 6 : VIBRATION * 6 + 6], expected)
        assert expected.any() == (contacts is not None)


def pressed_ball(patches, ball_first):
    """A ball half a millimetre deep in the world's plate at z = 0: contact of either kind."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=1e-3,
            contact_model="hydroelastic" if patches else "point",
            use_sampled_output_ports=False,
        ),
        builder,
    )
    solid = SpatialInertia.SolidSphereWithMass(1.0, RADIUS)
    bodies = [plant.AddRigidBody(name, solid) for name in "ab"]
    ball, plate = bodies if ball_first else bodies[::-1]
    soft, hard = ProximityProperties(), ProximityProperties()
    for properties in (soft, hard):
        AddContactMaterial(
            dissipation=0.0,
            point_stiffness=2e5,
            friction=CoulombFriction(0.2, 0.2),
            properties=properties,
        )
    AddCompliantHydroelasticProperties(0.5 * RADIUS, 1e8, soft)
    AddRigidHydroelasticProperties(0.1, hard)
    tip = plant.RegisterCollisionGeometry(ball, RigidTransform(), Sphere(RADIUS), "tip", soft)
    X = RigidTransform([0, 0, -0.05])
    plant.RegisterCollisionGeometry(plate, X, Box(0.2, 0.2, 0.1), "plate", hard)
    plant.WeldFrames(plant.world_frame(), plate.body_frame())
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    mine = plant.GetMyMutableContextFromRoot(context)
    p = np.array([0.01, -0.02, RADIUS - DEPTH])
    plant.SetFreeBodyPose(mine, ball, RigidTransform(p))
    results = plant.get_contact_results_output_port().Eval(mine)
    return ball.index(), tip, p, results, diagram


@pytest.mark.parametrize("patches", [False, True])
@pytest.mark.parametrize("ball_first", [False, True])
def test_a_pressed_ball_is_pushed_out_of_the_plate(robot, joints, patches, ball_first):
    """The force at the contact and its moment about E, wherever E is."""
    body, tip, p, results, _diagram = pressed_ball(patches, ball_first)
    touched = ToolContacts(body, [tip], RADIUS)
    points, count = touched.touched(results)
    assert count == 1
    force, at = points["force"][0], points["point"][0]
    assert force[2] > 1.0
    np.testing.assert_allclose(force[:2], 0.0, atol=1e-6 * force[2])
    # Under the ball's centre, in the plate's surface or half the depth below it.
    np.testing.assert_allclose(at[:2], p[:2], atol=1e-4)
    assert -DEPTH <= at[2] <= 1e-4
    work = AtWork(robot, joints, np.zeros(6), results, segments=[PUSH], contacts=touched)
    wrench, torque, (normal_force, *n) = work.parts("truth")
    moment = points["moment"][0] + np.cross(at - work.terms.p_WE, force)
    np.testing.assert_allclose(wrench - PUSHED, [*moment, *force], atol=1e-10)
    np.testing.assert_allclose(torque, work.terms.J.T @ PUSHED, atol=1e-12)
    centre = work.terms.p_WE - RADIUS * work.terms.R_WE[:, 2]
    expected = (centre - at) / np.linalg.norm(centre - at)
    np.testing.assert_allclose(n, expected, atol=1e-12)
    assert normal_force == pytest.approx(max(0.0, expected @ force))


def test_contact_of_other_bodies_does_not_count():
    body, _, _, results, _diagram = pressed_ball(patches=False, ball_first=True)
    assert ToolContacts(body).touched(results)[1] == 1
    assert ToolContacts(BodyIndex(int(body) + 5)).touched(results)[1] == 0


def test_motors_that_share_joints_put_their_torque_on_them(coupled_wrist):
    """The robot's own map from currents to torque; each drive reports what it was told."""
    work = AtWork(coupled_wrist, TrueJoints.of(coupled_wrist, T))
    tau_J, _, _, current, reported, _ = work.parts("drives")
    np.testing.assert_allclose(tau_J, coupled_wrist.joint_torque(COMMAND), rtol=1e-13)
    assert np.abs(tau_J - COMMAND * coupled_wrist.torque_per_ampere).max() > 0.1
    np.testing.assert_allclose(current, COMMAND, rtol=1e-12)
    np.testing.assert_array_equal(reported, current)


def test_it_runs_in_a_simulator(robot, joints):
    """Joints that nothing carries along: the springs take up the motor's torque, bounded."""
    builder = DiagramBuilder()
    arm = builder.AddSystem(arm_of(robot, joints))
    simulator = Simulator(builder.Build())
    context = arm.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    arm.GetInputPort("state").FixValue(context, np.concatenate([robot.home, V]))
    arm.GetInputPort("current_command").FixValue(context, COMMAND)
    simulator.AdvanceTo(0.05)
    state, terms = joints.initial_state(), robot.chain.terms(robot.home, V)
    for tick in range(50):
        state, _ = by_kernel(joints, terms, state, np.zeros(6), tick)
    state_at_end = context.get_discrete_state(0).value()[: state.size]
    np.testing.assert_array_equal(state_at_end.reshape(state.shape), state)
