"""Arms in plants of anyone: turned and standing bases, prismatic joints, two arms, grippers."""

import re
from dataclasses import replace

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
)
from pydrake.multibody.tree import (
    JacobianWrtVariable,
    ModelInstanceIndex,
    PrismaticJoint,
    PrismaticSpring,
    RevoluteSpring,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantValueSource, ConstantVectorSource, LogVectorOutput
from sample_models import knowing_model, torque_error

from wrenchsight.diagrams.arm_in_plant import ArmInPlant
from wrenchsight.diagrams.estimator import add_estimator_to_ports, make_estimator
from wrenchsight.diagrams.estimator_in_plant import add_estimator
from wrenchsight.models.detection.contact_detector import ContactDetectionConfig
from wrenchsight.models.estimation.estimator import WrenchEstimatorConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.robot_config import DriveConfig
from wrenchsight.systems.declarations import torque_error_size

X_WB = RigidTransform(RollPitchYaw(0.4, -0.3, 1.2), [0.2, -0.5, 0.8])
LINK = """
  <link name="{name}"><inertial><origin xyz="0.05 0.02 {z}"/><mass value="{mass}"/>
    <inertia ixx="0.02" iyy="0.03" izz="0.01" ixy="0.001" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """
  <joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
    <origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>
    <limit lower="-2" upper="2" effort="100" velocity="3"/></joint>"""


def scara_with_gripper():
    """Two turning joints, a lift, and two fingers that are no part of the arm."""
    names = ("base", "upper", "fore", "lift", "left", "right")
    links = "".join(LINK.format(name=n, z=0.1, mass=1.0 + k) for k, n in enumerate(names))
    joints = [
        ("turn_1", "revolute", "base", "upper", "0 0 0.3", "0 0 0", "0 0 1"),
        ("turn_2", "revolute", "upper", "fore", "0.3 0 0", "0 0.2 0", "0 0 1"),
        ("slide", "prismatic", "fore", "lift", "0.25 0 0", "0.1 0 0", "0 0 1"),
        ("finger_1", "prismatic", "lift", "left", "0 0.05 0.1", "0 0 0", "0 1 0"),
        ("finger_2", "prismatic", "lift", "right", "0 -0.05 0.1", "0 0 0", "0 1 0"),
    ]
    keys = ("name", "kind", "parent", "child", "xyz", "rpy", "axis")
    text = "".join(JOINT.format(**dict(zip(keys, row, strict=True))) for row in joints)
    return f'<robot name="scara">{links}{text}</robot>'


def on_a_rail(time_step=1e-3):
    """The SCARA on a carriage that can move, with its fingers open; not finalized."""
    plant = MultibodyPlant(time_step)
    carriage = plant.AddRigidBody("carriage")
    rail = plant.AddJoint(
        PrismaticJoint("rail", plant.world_frame(), carriage.body_frame(), [1, 0, 0])
    )
    (arm,) = Parser(plant).AddModelsFromString(scara_with_gripper(), "urdf")
    plant.WeldFrames(carriage.body_frame(), plant.GetFrameByName("base"), X_WB)
    for name in ("turn_1", "turn_2", "slide"):
        plant.AddJointActuator(name, plant.GetJointByName(name))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    rail.set_translation(context, 0.7)
    plant.GetJointByName("finger_1").set_translation(context, 0.3)
    return plant, arm, context


def test_joints_that_stand_still_are_part_of_what_carries_them():
    plant, instance, context = on_a_rail()
    frame_E = plant.GetFrameByName("lift")
    arm = ArmInPlant(plant, instance, frame_E, context=context)
    assert arm.joint_names == ("turn_1", "turn_2", "slide")
    q, v = np.array([0.4, -0.7, 0.2]), np.array([0.5, 0.3, -0.2])
    for joint, position in zip(arm.joints, q, strict=True):
        turns = joint.type_name() == "revolute"
        (joint.set_angle if turns else joint.set_translation)(context, position)
    J = plant.CalcJacobianSpatialVelocity(
        context,
        JacobianWrtVariable.kV,
        frame_E,
        np.zeros(3),
        plant.world_frame(),
        plant.world_frame(),
    )
    columns = [joint.velocity_start() for joint in arm.joints]
    # Sums of a few products of numbers of order 1.
    np.testing.assert_allclose(arm.chain.jacobian(q), J[:, columns], atol=1e-13)
    gravity = -plant.CalcGravityGeneralizedForces(context)[columns]
    np.testing.assert_allclose(arm.chain.gravity_torque(q), gravity, atol=1e-11)
    _, p_WE = arm.chain.pose(q)
    np.testing.assert_allclose(p_WE, frame_E.CalcPoseInWorld(context).translation(), atol=1e-13)
    mass_matrix = plant.CalcMassMatrix(context)[np.ix_(columns, columns)]
    np.testing.assert_allclose(arm.chain.terms(q, v).M, mass_matrix, atol=1e-11)


@pytest.mark.parametrize("robot", ["ur5e", "panda"])
def test_base_axes_are_those_of_the_robot_file(robot):
    robot = Robot.load(robot)
    plant = MultibodyPlant(0.0)
    parts = robot.add_to_plant(plant, X_WB=X_WB)
    plant.Finalize()
    arm = ArmInPlant(plant, parts.model_instance, parts.frame_E)
    assert arm.kinematics_digest == robot.kinematics_digest
    assert IdentifiedModel.nominal(robot).chain(arm).num_joints == arm.num_joints
    np.testing.assert_array_equal(arm.gravity, [0.0, 0.0, -9.81])
    based = arm.in_base_axes()
    np.testing.assert_allclose(
        based.chain.jacobian(robot.home), robot.chain.jacobian(robot.home), atol=1e-14
    )
    R_WB = X_WB.rotation().matrix()
    np.testing.assert_allclose(R_WB @ based.gravity, [0.0, 0.0, -9.81], atol=1e-14)
    rotated = np.kron(np.eye(2), R_WB) @ based.chain.jacobian(robot.home)
    np.testing.assert_allclose(arm.chain.jacobian(robot.home), rotated, atol=1e-14)


def pushed(plant, bodies_and_forces):
    """What `applied_spatial_force` takes: forces (3,) N in World at points of bodies."""
    forces = []
    for frame, force in bodies_and_forces:
        push = ExternallyAppliedSpatialForce()
        push.body_index = frame.body().index()
        push.p_BoBq_B = frame.GetFixedPoseInBodyFrame().translation()
        push.F_Bq_W = SpatialForce(np.zeros(3), np.array(force, float))
        forces.append(push)
    return ConstantValueSource(Value[list[ExternallyAppliedSpatialForce]](forces))


EXACT = WrenchEstimatorConfig()
EXACT.reconstruction.method = "inverse"  # eq. 22: no prior draws the reading to zero


@pytest.mark.parametrize("in_base_axes", [False, True])
def test_two_arms_in_one_default_plant_read_their_own_forces(sts, in_base_axes):
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 1e-3)
    poses = {"left": RigidTransform(), "right": X_WB}
    arms = {name: sts.add_to_plant(plant, name, X_WB=X_WB) for name, X_WB in poses.items()}
    plant.Finalize()
    forces = {"left": [5.0, -8.0, 12.0], "right": [-20.0, 3.0, 1.0]}
    source = builder.AddSystem(
        pushed(plant, [(arms[name].frame_E, force) for name, force in forces.items()])
    )
    builder.Connect(source.get_output_port(), plant.get_applied_spatial_force_input_port())
    logs = {}
    for name, parts in arms.items():
        # Held by its weight's torque and what the force takes: the joints stand.
        arm = ArmInPlant(plant, parts.model_instance, parts.frame_E)
        J = arm.chain.jacobian(sts.home)
        tau = arm.chain.gravity_torque(sts.home) - J.T @ np.r_[np.zeros(3), forces[name]]
        hold = builder.AddSystem(ConstantVectorSource(tau))
        builder.Connect(
            hold.get_output_port(), plant.get_actuation_input_port(parts.model_instance)
        )
        estimator = add_estimator(
            builder,
            plant,
            parts.model_instance,
            frame_E=parts.frame_E,
            config=EXACT,
            in_base_axes=in_base_axes,
            name=f"estimator_{name}",
        )
        logs[name] = LogVectorOutput(estimator.GetOutputPort("wrench"), builder, 0.1)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(1.0)
    for name, log in logs.items():
        wrench = log.FindLog(simulator.get_context()).data()[:, -1]
        R = poses[name].rotation().matrix().T if in_base_axes else np.eye(3)
        # e^-20 of the force is still to come; the arms drift by what the plant rounds.
        np.testing.assert_allclose(wrench[3:], R @ forces[name], atol=1e-4)
        np.testing.assert_allclose(wrench[:3], 0.0, atol=1e-4)


class DoubledFriction(LeafSystem):
    """A friction of one's own: twice the model's viscous friction; it has only what it needs."""

    def __init__(self, viscous):
        LeafSystem.__init__(self)
        self.viscous = np.asarray(viscous)
        self._v = self.DeclareVectorInputPort("v", len(viscous))
        self.DeclareVectorOutputPort("tau_f", len(viscous), self._calc, {self._v.ticket()})

    def _calc(self, context, output: BasicVector):
        output.SetFromVector(2.0 * self.viscous * self._v.Eval(context))


@pytest.mark.parametrize("learnt", [False, True], ids=["plain", "learnt torque error"])
def test_a_friction_of_ones_own_takes_the_place_of_the_stage(sts, learnt):
    model = IdentifiedModel.nominal(sts)
    if learnt:
        model = replace(model, torque_error=torque_error())
    friction = DoubledFriction(np.full(6, 3.0))
    estimator = make_estimator(sts, model, stages={"friction": friction})
    assert estimator.GetSubsystemByName("friction") is friction
    context = estimator.CreateDefaultContext()
    v = np.full(6, 0.1)
    simulator = Simulator(estimator, context)
    gravity = sts.motor_current(sts.chain.gravity_torque(sts.home))
    for name, value in (("q", sts.home), ("v", 0.0 * v), ("current", gravity)):
        estimator.GetInputPort(name).FixValue(context, value)
    simulator.AdvanceTo(0.5)
    np.testing.assert_allclose(estimator.GetOutputPort("tau_ext").Eval(context), 0.0, atol=1e-9)
    port = friction.GetOutputPort("tau_f")
    inner = estimator.GetMutableSubsystemContext(friction, context)
    np.testing.assert_allclose(port.Eval(inner), 0.0)
    estimator.GetInputPort("v").FixValue(context, v)
    context.SetTime(0.6)
    np.testing.assert_allclose(port.Eval(inner), 2.0 * 3.0 * v)


class PoleAndError(LeafSystem):
    """A reconstruction of one's own, which reads pole and torque error, and puts both out."""

    def __init__(self, n):
        LeafSystem.__init__(self)
        self._pole = self.DeclareVectorInputPort("pole", n)
        self._error = self.DeclareVectorInputPort("torque_error", torque_error_size(n))
        for name, size in (("covariance", 36), ("condition_number", 1), ("valid", 1)):
            self.DeclareVectorOutputPort(
                name, size, lambda context, output: None, {self.nothing_ticket()}
            )
        self.DeclareVectorOutputPort("wrench", 6, self._calc_wrench, {self._pole.ticket()})
        self.DeclareVectorOutputPort("invalid", 1, self._calc_invalid, {self._error.ticket()})

    def _calc_wrench(self, context, output: BasicVector):
        output.SetFromVector(self._pole.Eval(context))

    def _calc_invalid(self, context, output: BasicVector):
        output.SetFromVector(self._error.Eval(context)[:1])


def test_a_reconstruction_of_ones_own_has_what_it_reads_of_a_model_without_a_learnt_error(sts):
    model = IdentifiedModel.nominal(sts)
    stages = {"reconstruction": PoleAndError(sts.num_joints)}
    estimator = make_estimator(sts, model, EXACT, stages=stages)
    context = estimator.CreateDefaultContext()
    for name, value in (("q", sts.home), ("v", np.zeros(6)), ("current", np.zeros(6))):
        estimator.GetInputPort(name).FixValue(context, value)
    K_0 = EXACT.observer.K_0[0]
    np.testing.assert_array_equal(estimator.GetOutputPort("wrench").Eval(context), K_0)
    sd = estimator.GetOutputPort("torque_error").Eval(context)[0]
    assert sd > 0.0 and estimator.GetOutputPort("invalid").Eval(context) == sd


class TurnedZero(LeafSystem):
    """A sample check of one's own: the first joint's zero is turned; nothing is left out."""

    def __init__(self, zero):
        LeafSystem.__init__(self)
        n = len(zero)
        ports = {name: self.DeclareVectorInputPort(name, n) for name in ("q", "v", "current")}
        for name, port in ports.items():
            self.DeclareVectorOutputPort(
                name,
                n,
                lambda context, output, name=name, port=port: output.SetFromVector(
                    port.Eval(context) + (zero if name == "q" else 0.0)
                ),
                {port.ticket()},
            )
        self.DeclareVectorOutputPort(
            "fault", 1, lambda context, output: output.SetFromVector([0.0]), {ports["q"].ticket()}
        )


class AboveTenNewton(LeafSystem):
    """A contact detector of one's own, of the wrench's force."""

    def __init__(self):
        LeafSystem.__init__(self)
        self._wrench = self.DeclareVectorInputPort("wrench", 6)
        self.DeclareVectorOutputPort("contact", 1, self._calc, {self._wrench.ticket()})

    def _calc(self, context, output: BasicVector):
        output.SetFromVector([float(np.linalg.norm(self._wrench.Eval(context)[3:]) > 10.0)])


def test_the_first_and_the_last_stage_may_be_ones_own(sts):
    zero = np.array([0.0, 0.3, -0.2, 0.0, 0.1, 0.0])
    stages = {"samples": TurnedZero(zero), "detection": AboveTenNewton()}
    estimator = make_estimator(sts, IdentifiedModel.nominal(sts), EXACT, stages=stages)
    assert not estimator.HasSubsystemNamed("torque_error")  # neither block reads it
    for force, is_contact in (([0.0, 0.0, 5.0], 0.0), ([0.0, 20.0, 0.0], 1.0)):
        tau = (
            sts.chain.gravity_torque(sts.home)
            - sts.chain.jacobian(sts.home).T @ (np.r_[np.zeros(3), force])
        )
        simulator = Simulator(estimator)
        context = simulator.get_mutable_context()
        for name, value in (("q", sts.home - zero), ("v", np.zeros(6))):
            estimator.GetInputPort(name).FixValue(context, value)
        estimator.GetInputPort("current").FixValue(context, sts.motor_current(tau))
        simulator.AdvanceTo(1.0)
        # e^-20 of the force is still to come.
        wrench = estimator.GetOutputPort("wrench").Eval(context)
        np.testing.assert_allclose(wrench[3:], force, atol=1e-4)
        assert estimator.GetOutputPort("contact").Eval(context) == is_contact


def test_an_estimator_of_a_name_that_is_taken_is_refused(sts):
    builder = DiagramBuilder()
    add_estimator_to_ports(builder, sts, IdentifiedModel.nominal(sts))
    with pytest.raises(ValueError, match="has a system of that name"):
        add_estimator_to_ports(builder, sts, IdentifiedModel.nominal(sts))


def test_stages_that_there_are_not_are_named(sts):
    model = IdentifiedModel.nominal(sts)
    with pytest.raises(ValueError, match="no stage 'frction'; there are samples, terms, motor"):
        make_estimator(sts, model, stages={"frction": DoubledFriction(np.ones(6))})
    with pytest.raises(ValueError, match="stage 'observer' needs an output 'tau_ext'"):
        make_estimator(sts, model, stages={"observer": DoubledFriction(np.ones(6))})
    with pytest.raises(ValueError, match="stage 'samples' needs an output 'q'"):
        make_estimator(sts, model, stages={"samples": DoubledFriction(np.ones(6))})
    with pytest.raises(ValueError, match="no stages to replace"):
        make_estimator(sts, model, fused=True, stages={"friction": DoubledFriction(np.ones(6))})


def test_what_cannot_be_told_is_asked_for():
    plant, instance, context = on_a_rail()
    with pytest.raises(InputError, match=r"links that carry no other: left, right.*frame_E"):
        ArmInPlant(plant, instance, context=context)
    unfinished = MultibodyPlant(0.0)
    with pytest.raises(InputError, match=r"not finalized"):
        ArmInPlant(unfinished)
    builder = DiagramBuilder()
    with pytest.raises(ValueError, match="is not in this builder"):
        add_estimator(builder, plant, instance, frame_E=plant.GetFrameByName("lift"))


def test_an_arm_without_effort_limits_may_turn_beyond_half_a_turn():
    """Its limits follow from gravity, ten times what 1 kg half a metre out weighs, all round."""
    text = f"""<robot name="crank">{LINK.format(name="base", z=0, mass=1.0)}
    <link name="crank"><inertial><origin xyz="0.5 0 0"/><mass value="1"/>
    <inertia ixx="0.02" iyy="0.03" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="turn" type="revolute"><parent link="base"/><child link="crank"/>
    <axis xyz="0 1 0"/><limit lower="3.5" upper="6.5" velocity="1"/></joint></robot>"""
    plant = MultibodyPlant(1e-3)
    Parser(plant).AddModelsFromString(text, "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.AddJointActuator("turn", plant.GetJointByName("turn"))
    plant.Finalize()
    arm = ArmInPlant(plant)
    # Of 200 postures in 3 rad one is within .05 rad of 2 pi, where the crank is horizontal.
    assert arm.effort_limit[0] == pytest.approx(10.0 * 0.5 * 9.81, rel=1e-3)


def test_what_would_be_ignored_is_refused(sts):
    """An arm and what describes one, an arm of another plant, torque and current."""
    builder, other = DiagramBuilder(), MultibodyPlant(1e-3)
    plant, _ = AddMultibodyPlantSceneGraph(builder, 1e-3)
    parts, elsewhere = sts.add_to_plant(plant), sts.add_to_plant(other)
    plant.Finalize()
    other.Finalize()
    arm = ArmInPlant(plant, parts.model_instance, parts.frame_E)
    with pytest.raises(ValueError, match="give an arm of this plant"):
        add_estimator(builder, plant, parts.model_instance, arm=arm)
    with pytest.raises(ValueError, match="give an arm of this plant"):
        of_other_plant = ArmInPlant(other, elsewhere.model_instance, elsewhere.frame_E)
        add_estimator(builder, plant, arm=of_other_plant)
    torque = builder.AddSystem(ConstantVectorSource(np.zeros(6))).get_output_port()
    with pytest.raises(ValueError, match="give actuation or current, not both"):
        add_estimator(builder, plant, arm=arm, actuation=torque, current=torque)
    assert add_estimator(builder, plant, arm=arm, current=torque) is not None


def test_a_controller_that_needs_the_estimator_is_wired_afterwards(sts):
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 1e-3)
    parts = sts.add_to_plant(plant)
    plant.Finalize()
    estimator = add_estimator(builder, plant, parts.model_instance, frame_E=parts.frame_E)
    hold = builder.AddSystem(ConstantVectorSource(sts.chain.gravity_torque(sts.home)))
    builder.Connect(hold.get_output_port(), plant.get_actuation_input_port(parts.model_instance))
    to_current = builder.GetSubsystemByName("estimator_current")
    builder.Connect(hold.get_output_port(), to_current.get_input_port())
    log = LogVectorOutput(estimator.GetOutputPort("valid"), builder, 0.1)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(1.0)
    assert log.FindLog(simulator.get_context()).data()[0, -1] == 1.0
    # The plant applies no more than its actuators can, whatever a controller asks for.
    context = diagram.CreateDefaultContext()
    limit = np.array([plant.get_joint_actuator(k).effort_limit()
                      for k in plant.GetJointActuatorIndices(parts.model_instance)])  # fmt: skip
    constant = hold.GetMyMutableContextFromRoot(context)
    hold.get_mutable_source_value(constant).SetFromVector(3.0 * limit)
    current = estimator.GetInputPort("current").Eval(estimator.GetMyContextFromRoot(context))
    np.testing.assert_allclose(current, limit)  # at 1 N m/A
    applied = plant.get_net_actuation_output_port(parts.model_instance)
    simulator = Simulator(diagram, context)
    simulator.AdvanceTo(2e-3)
    np.testing.assert_allclose(applied.Eval(plant.GetMyContextFromRoot(context)), limit)


def test_a_controller_gets_terms_of_an_impossible_sample_too(sts):
    """What is left out of the estimate must not leave the arm without its weight."""
    estimator = make_estimator(sts, IdentifiedModel.nominal(sts))
    context = estimator.CreateDefaultContext()
    q = sts.position_upper + 1.0
    for name, value in (("q", q), ("v", np.zeros(6)), ("current", np.zeros(6))):
        estimator.GetInputPort(name).FixValue(context, value)
    assert estimator.GetOutputPort("fault").Eval(context)[0] != 0.0
    terms = estimator.GetOutputPort("terms").Eval(context)
    np.testing.assert_array_equal(terms.G, sts.chain.terms(q, np.zeros(6)).G)


def test_a_part_of_the_arm_without_gravity_is_refused():
    """Drake lets gravity act by model instance: of a hand and not of its arm, or the reverse."""
    for weightless in ("scara", "hand"):
        plant = MultibodyPlant(1e-3)
        (instance,) = Parser(plant).AddModelsFromString(scara_with_gripper(), "urdf")
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
        hand = plant.AddRigidBody(
            "hand",
            plant.AddModelInstance("hand"),
            SpatialInertia(2.0, np.zeros(3), UnitInertia(0.1, 0.1, 0.1)),
        )
        plant.WeldFrames(plant.GetFrameByName("lift"), hand.body_frame())
        plant.set_gravity_enabled(plant.GetModelInstanceByName(weightless), False)
        plant.Finalize()
        with pytest.raises(InputError, match=rf"gravity acts on \w+ and not on {weightless}"):
            ArmInPlant(plant, instance, plant.GetFrameByName("lift"))


def test_a_joint_that_is_locked_stands_still():
    plant, instance, context = on_a_rail()
    frame_E = plant.GetFrameByName("lift")
    turn_2 = plant.GetJointByName("turn_2")
    turn_2.set_angle(context, 0.6)
    turn_2.Lock(context)
    arm = ArmInPlant(plant, instance, frame_E, context=context)
    assert arm.joint_names == ("turn_1", "slide")
    _, p_WE = arm.chain.pose(np.zeros(2))
    expected = frame_E.CalcPoseInWorld(context).translation()
    np.testing.assert_allclose(p_WE, expected, atol=1e-13)  # sums of numbers of order 1


def test_inertias_rotors_and_damping_are_those_of_the_context():
    plant, instance, context = on_a_rail()
    plant.GetBodyByName("fore").SetMass(context, 7.0)
    plant.GetJointByName("turn_2").SetDamping(context, 4.0)
    (actuator,) = (
        plant.get_joint_actuator(k)
        for k in plant.GetJointActuatorIndices()
        if plant.get_joint_actuator(k).name() == "turn_1"
    )
    actuator.SetRotorInertia(context, 1e-2)
    actuator.SetGearRatio(context, 10.0)
    arm = ArmInPlant(plant, instance, plant.GetFrameByName("lift"), context=context)
    columns = [joint.velocity_start() for joint in arm.joints]
    q = np.array([joint.GetOnePosition(context) for joint in arm.joints])
    mass_matrix = plant.CalcMassMatrix(context)[np.ix_(columns, columns)]
    model = arm.nominal_model()
    np.testing.assert_allclose(model.chain(arm).terms(q, np.zeros(3)).M, mass_matrix, atol=1e-11)
    np.testing.assert_array_equal(arm.reflected_inertia, [1.0, 0.0, 0.0])
    np.testing.assert_allclose(model.friction.torque(np.ones(3)), [0.0, 4.0, 0.0])


def test_what_is_no_part_of_the_plant_is_refused():
    """Most of it would end in Drake's own words, or end the program."""
    plant, instance, context = on_a_rail()
    other, _, _ = on_a_rail()
    lift = plant.GetFrameByName("lift")
    for part, arguments in {
        "model_instance: ModelInstanceIndex(77)": (ModelInstanceIndex(77), lift),
        "model_instance: 'scara'": ("scara", lift),
        "frame_E: 'lift' is no frame of this plant": (instance, other.GetFrameByName("lift")),
        "frame_E: 'upper' is no frame": (instance, plant.GetBodyByName("upper")),
    }.items():
        with pytest.raises(InputError, match=re.escape(part)):
            ArmInPlant(plant, *arguments, context=context)
    with pytest.raises(InputError, match="base: 'base' is no body of this plant"):
        ArmInPlant(plant, instance, lift, base=other.GetBodyByName("base"))
    for payload in (-1.0, np.nan):
        with pytest.raises(InputError, match=f"payload: {payload:g}, expected kg above 0"):
            ArmInPlant(plant, instance, lift, payload=payload)
    for number, problem in {
        "effort_limit": "drive of turn_1: effort_limit -1, expected N m above 0",
        "rotor_inertia": "drive of turn_1: a rotor inertia of -1 kg",
    }.items():
        drives = [
            DriveConfig(joint=name, torque_per_ampere=1.0, rotor_inertia_side="joint")
            for name in ("turn_1", "turn_2", "slide")
        ]
        setattr(drives[0], number, -1.0)
        with pytest.raises(InputError, match=problem):
            ArmInPlant(plant, instance, lift, drives, context=context)
    with pytest.raises(InputError, match=r"AutoDiffXd.*expected a MultibodyPlant of plain numbers"):
        ArmInPlant(plant.ToAutoDiffXd())


def test_a_joint_of_another_model_instance_cannot_be_wired():
    """Its chain is known; state and actuation of one instance do not hold the rail."""
    plant, instance, context = on_a_rail()
    base = plant.world_body()
    arm = ArmInPlant(plant, instance, plant.GetFrameByName("lift"), base=base, context=context)
    assert arm.joint_names == ("rail", "turn_1", "turn_2", "slide")
    builder = DiagramBuilder()
    builder.AddSystem(plant)
    with pytest.raises(InputError, match="rail of the chain are joints of other model instances"):
        add_estimator(builder, plant, arm=arm)


def test_an_arm_on_an_arm_of_the_same_names_needs_a_base_between_them():
    plant = MultibodyPlant(1e-3)
    parser = Parser(plant)
    parser.SetAutoRenaming(True)
    lower, upper = (parser.AddModelsFromString(scara_with_gripper(), "urdf")[0] for _ in range(2))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base", lower))
    plant.WeldFrames(plant.GetFrameByName("lift", lower), plant.GetFrameByName("base", upper))
    plant.Finalize()
    frame_E = plant.GetFrameByName("lift", upper)
    assert ArmInPlant(plant, upper, frame_E).joint_names == ("turn_1", "turn_2", "slide")
    with pytest.raises(InputError, match="two joints between base and E are named 'turn_1'"):
        ArmInPlant(plant, upper, frame_E, base=plant.world_body())


@pytest.mark.parametrize("stiffness", [20.0, 0.0])
def test_a_spring_on_a_joint_is_no_part_of_the_nominal_model(stiffness):
    """Its torque would be read as that of a contact."""
    plant = MultibodyPlant(1e-3)
    (instance,) = Parser(plant).AddModelsFromString(scara_with_gripper(), "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.AddForceElement(RevoluteSpring(plant.GetJointByName("turn_2"), 0.0, stiffness))
    finger = plant.GetJointByName("finger_1")  # which stands still
    plant.AddForceElement(PrismaticSpring(finger, 0.0, 100.0))
    plant.Finalize()
    arm = ArmInPlant(plant, instance, plant.GetFrameByName("lift"))
    if stiffness > 0.0:
        with pytest.raises(InputError, match=r"joint 'turn_2': a spring of the plant acts on it"):
            arm.nominal_model()
    else:
        assert arm.nominal_model() is not None


def test_each_actuator_of_a_joint_is_clipped_by_itself():
    builder = DiagramBuilder()
    plant = builder.AddSystem(MultibodyPlant(0.0))
    (instance,) = Parser(plant).AddModelsFromString(scara_with_gripper(), "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    for name, limit in (("turn_1", 30.0), ("turn_2", 10.0), ("slide", np.inf)):
        plant.AddJointActuator(name, plant.GetJointByName(name), limit)
    plant.AddJointActuator("turn_1_beside", plant.GetJointByName("turn_1"), 5.0)
    plant.Finalize()
    torque = builder.AddSystem(ConstantVectorSource([20.0, -40.0, 90.0, 20.0]))
    builder.Connect(torque.get_output_port(), plant.get_actuation_input_port(instance))
    frame_E = plant.GetFrameByName("lift")
    estimator = add_estimator(builder, plant, instance, frame_E=frame_E)
    context = builder.Build().CreateDefaultContext()
    current = estimator.GetInputPort("current").Eval(estimator.GetMyContextFromRoot(context))
    applied = plant.get_net_actuation_output_port(instance).Eval(
        plant.GetMyContextFromRoot(context)
    )
    np.testing.assert_array_equal(applied, [20.0, -10.0, 90.0, 5.0])
    np.testing.assert_array_equal(current, [25.0, -10.0, 90.0])  # at 1 N m/A


def test_a_simulated_torque_is_possible_whatever_it_is():
    """It acts: one that stays zero is no dead sensor, and a large one no spike."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 1e-3)
    (instance,) = Parser(plant).AddModelsFromString(scara_with_gripper(), "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    for name in ("turn_1", "turn_2", "slide"):
        plant.AddJointActuator(name, plant.GetJointByName(name))
    for name in ("finger_1", "finger_2"):  # they would slide
        plant.GetJointByName(name).set_default_damping_vector([1e4])
    plant.Finalize()
    frame_E = plant.GetFrameByName("lift")
    # About a vertical axis no gravity tells the torque that a motor may have.
    step = builder.AddSystem(StepFunction(0.3, 60.0))
    builder.Connect(step.get_output_port(), plant.get_actuation_input_port(instance))
    estimator = add_estimator(builder, plant, instance, frame_E=frame_E)
    log = LogVectorOutput(estimator.GetOutputPort("fault"), builder, 1e-3)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.31)
    assert not log.FindLog(simulator.get_context()).data().any()


class StepFunction(LeafSystem):
    """Torque of three joints: zero until a time, s, then so much, N m, of the first."""

    def __init__(self, time, torque):
        LeafSystem.__init__(self)
        self._time, self._torque = time, torque
        self.DeclareVectorOutputPort("torque", 3, self._calc)

    def _calc(self, context, output):
        is_over = context.get_time() >= self._time
        output.SetFromVector([self._torque * is_over, 0.0, 0.0])


def test_a_detector_that_would_find_no_contact_is_refused(sts):
    """Without a learnt torque error, as of what a plant states, nothing counts as contact."""
    model = IdentifiedModel.nominal(sts)
    for fused in (False, True):
        with pytest.raises(ValueError, match="no contact would be detected"):
            make_estimator(sts, model, fused=fused, detection=ContactDetectionConfig())
    assert make_estimator(sts, knowing_model(sts, 0.3, 0.2), detection=ContactDetectionConfig())


def test_a_call_that_is_refused_leaves_the_builder_as_it_was(sts):
    """It can be repeated, as in a notebook."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, 1e-3)
    parts = sts.add_to_plant(plant)
    plant.Finalize()
    of_five = builder.AddSystem(ConstantVectorSource(np.zeros(5))).get_output_port()
    systems = list(builder.GetSystems())
    arm = ArmInPlant(plant, parts.model_instance, parts.frame_E)
    of_no_number = WrenchEstimatorConfig()
    of_no_number.observer.time_step = np.nan
    for problem, request in {
        "actuation must have 6 entries, one an actuator of": {"actuation": of_five},
        "current must have 6 entries": {"current": of_five},
        "current must be an output port, and is a MultibodyPlant": {"current": plant},
        "the model is of robot": {"model": IdentifiedModel.nominal(Robot.load("ur5e"))},
        "no contact would be detected": {"detection": ContactDetectionConfig()},
        "time_step is nan s": {"config": of_no_number},
        "stage 'friction' must be a block, and is a ": {"stages": {"friction": LeafSystem}},
    }.items():
        with pytest.raises((ValueError, InputError), match=problem):
            add_estimator(builder, plant, arm=arm, **request)
        assert builder.GetSystems() == systems
    assert add_estimator(builder, plant, arm=arm) in builder.GetSystems()
