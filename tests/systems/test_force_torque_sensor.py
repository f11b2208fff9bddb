import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import (
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
)
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    RevoluteJoint,
    RotationalInertia,
    SpatialInertia,
    UnitInertia,
    WeldJoint,
)
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, Demultiplexer, LogVectorOutput

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.signals.low_pass import LowPass
from wrenchsight.systems.force_torque_sensor import ForceTorqueSensor, ForceTorqueSensorConfig
from wrenchsight.systems.rigid_body_terms import RigidBodyTermsSystem

T = 1e-3
WRENCH = np.array([0.4, -0.7, 0.9, 5.0, -8.0, 12.0])


class Arm:
    """Two skew joints, a crooked mount, a lopsided tool; a wrench at E, fixed in W."""

    def __init__(self, config=None, wrench=WRENCH, tau=(3.0, -2.0), seed=None):
        builder = DiagramBuilder()
        plant = MultibodyPlant(T)
        plant.SetUseSampledOutputPorts(False)
        link = SpatialInertia(2.0, [0.1, 0, 0], UnitInertia(0.1, 0.2, 0.2))
        first, second = plant.AddRigidBody("first", link), plant.AddRigidBody("second", link)
        about_com = RotationalInertia(0.01, 0.02, 0.015, 0.001, -0.002, 0.003)
        tool = plant.AddRigidBody(
            "tool",
            SpatialInertia.MakeFromCentralInertia(
                mass=1.3, p_PScm_E=[0.02, -0.03, 0.08], I_SScm_E=about_com
            ),
        )
        joints = [
            plant.AddJoint(
                RevoluteJoint("a", plant.world_frame(), first.body_frame(), [0.6, 0, 0.8])
            ),
            plant.AddJoint(
                RevoluteJoint(
                    "b",
                    plant.AddFrame(
                        FixedOffsetFrame(
                            "elbow",
                            first.body_frame(),
                            RigidTransform(RollPitchYaw(0.3, 1.0, 0), [0.3, 0, 0]),
                        )
                    ),
                    second.body_frame(),
                    [0, 1, 0],
                )
            ),
        ]
        for joint in joints:
            plant.AddJointActuator(joint.name(), joint)
        child = plant.AddFrame(
            FixedOffsetFrame(
                "seat", tool.body_frame(), RigidTransform(RollPitchYaw(0.5, 0, 0.2), [0, 0.01, 0])
            )
        )
        weld = plant.AddJoint(
            WeldJoint(
                "mount",
                second.body_frame(),
                child,
                RigidTransform(RollPitchYaw(-0.4, 0.7, 0.1), [0.2, 0.05, 0]),
            )
        )
        frame_E = plant.AddFrame(
            FixedOffsetFrame("E", tool.body_frame(), RigidTransform([0.05, 0.1, 0.15]))
        )
        plant.Finalize()
        builder.AddSystem(plant)
        instance = tool.model_instance()
        chain = SerialChain.from_plant(plant, instance, frame_E)
        terms = builder.AddSystem(RigidBodyTermsSystem(chain))
        state = builder.AddSystem(Demultiplexer([2, 2]))
        config = config or ForceTorqueSensorConfig()
        self.block = builder.AddSystem(
            ForceTorqueSensor(plant, weld.index(), frame_E, config, 2, T, seed)
        )
        builder.Connect(plant.get_state_output_port(instance), state.get_input_port())
        builder.Connect(state.get_output_port(0), terms.GetInputPort("q"))
        builder.Connect(state.get_output_port(1), terms.GetInputPort("v"))
        for name, port in (
            ("reaction_forces", plant.get_reaction_forces_output_port()),
            ("terms", terms.GetOutputPort("terms")),
            ("vdot", plant.get_generalized_acceleration_output_port(instance)),
        ):
            builder.Connect(port, self.block.GetInputPort(name))
        torque = builder.AddSystem(ConstantVectorSource(list(tau)))
        builder.Connect(torque.get_output_port(), plant.get_actuation_input_port())
        self.log = LogVectorOutput(self.block.GetOutputPort("wrench"), builder, T)
        diagram = builder.Build()
        self.simulator = Simulator(diagram)
        context = self.simulator.get_mutable_context()
        force = ExternallyAppliedSpatialForce()
        force.body_index = tool.index()
        force.p_BoBq_B = np.array([0.05, 0.1, 0.15])
        force.F_Bq_W = SpatialForce(np.asarray(wrench, float))
        plant.get_applied_spatial_force_input_port().FixValue(
            plant.GetMyMutableContextFromRoot(context), [force]
        )
        self.plant = plant
        plant.SetPositionsAndVelocities(
            plant.GetMyMutableContextFromRoot(context), [0.3, -0.5, 1.5, -2.0]
        )

    def run(self, duration):
        self.simulator.AdvanceTo(duration)
        return self.log.FindLog(self.simulator.get_context()).data().T


def test_ports():
    block = Arm().block
    names = [block.get_input_port(i).get_name() for i in range(block.num_input_ports())]
    assert names == ["reaction_forces", "terms", "vdot"]
    assert block.GetOutputPort("wrench").size() == 6
    assert not block.HasAnyDirectFeedthrough()


def test_reads_the_applied_wrench_while_the_arm_tumbles():
    arm = Arm()
    wrench = arm.run(0.4)
    v = arm.plant.GetVelocities(arm.plant.GetMyContextFromRoot(arm.simulator.get_context()))
    assert np.abs(v).max() > 1.0  # so that weight and inertia of the tool do matter
    np.testing.assert_array_equal(wrench[0], 0)  # nothing sampled yet
    np.testing.assert_allclose(wrench[1:], np.tile(WRENCH, (400, 1)), atol=1e-9)


def test_without_compensation_the_tool_hangs_on_it():
    arm = Arm(ForceTorqueSensorConfig(compensation=0.0), wrench=np.zeros(6), tau=(0, 0))
    context = arm.plant.GetMyMutableContextFromRoot(arm.simulator.get_mutable_context())
    arm.plant.SetVelocities(context, [0, 0])
    for name in ("a", "b"):
        arm.plant.GetJointByName(name).Lock(context)
    wrench = arm.run(0.01)[-1]
    R = arm.plant.GetBodyByName("tool").EvalPoseInWorld(context).rotation().matrix()
    weight = np.array([0, 0, -1.3 * 9.81])
    lever = R @ (np.array([0.02, -0.03, 0.08]) - np.array([0.05, 0.1, 0.15]))
    np.testing.assert_allclose(wrench[3:], weight, atol=1e-9)
    np.testing.assert_allclose(wrench[:3], np.cross(lever, weight), atol=1e-9)


def test_low_pass_is_the_filter_of_models():
    config = ForceTorqueSensorConfig(cutoff=20.0, order=2)
    wrench = Arm(config).run(0.1)
    step = LowPass.butterworth(20.0, 2, T).filter(np.tile(WRENCH, (101, 1)))
    np.testing.assert_allclose(wrench, step, atol=1e-8)


def test_noise_has_the_stated_size():
    config = ForceTorqueSensorConfig(force_noise_sd=0.5, moment_noise_sd=0.02)
    error = Arm(config, seed=5).run(2.0)[1:] - WRENCH
    # 6,000 draws each: the standard deviation is known to 1 %
    assert error[:, 3:].std() == pytest.approx(0.5, rel=0.04)
    assert error[:, :3].std() == pytest.approx(0.02, rel=0.04)


def test_a_negative_seed_is_refused():
    """In the constants of the true arm it would stand for no noise."""
    with pytest.raises(ValueError, match="seed of the noise"):
        Arm(ForceTorqueSensorConfig(force_noise_sd=0.5), seed=-5)


def test_noise_parameter_through_the_context():
    arm = Arm(seed=5)
    context = arm.block.GetMyMutableContextFromRoot(arm.simulator.get_mutable_context())
    context.get_mutable_numeric_parameter(0).SetFromVector([0, 0, 0, 2.0, 0, 0])
    error = arm.run(0.5)[1:] - WRENCH
    assert error[:, 3].std() == pytest.approx(2.0, rel=0.2)
    np.testing.assert_allclose(error[:, [0, 1, 2, 4, 5]], 0, atol=1e-9)


def test_a_push_along_x_reads_positive_x():
    wrench = Arm(wrench=[0, 0, 0, 10.0, 0, 0]).run(0.01)
    assert wrench[-1, 3] == pytest.approx(10.0)


def test_bad_settings():
    with pytest.raises(InputError, match="expected 0 or more"):
        Arm(ForceTorqueSensorConfig(force_noise_sd=-1.0))
    with pytest.raises(InputError, match="half the sampling rate"):
        Arm(ForceTorqueSensorConfig(cutoff=900.0))
