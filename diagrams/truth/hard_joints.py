"""Joints of the true robot with the effects of real ones, between the command and the plant."""

from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Demultiplexer, Saturation

from wrenchsight.diagrams.current_sensor import export_measured_current
from wrenchsight.diagrams.scenario import Scenario
from wrenchsight.models.robot.robot import Robot, RobotInPlant
from wrenchsight.models.truth.joint_kernels import SIGNALS
from wrenchsight.models.truth.true_joints import TrueJoints
from wrenchsight.systems.truth.true_joints import TrueJointsSystem


def hard_joints(scenario: Scenario, robot: Robot) -> TrueJoints | None:
    """The joints of a robot whose truth has mechanisms; None where friction is plain or idealised.

    Raises:
        InputError: a value of the truth is out of range.
    """
    if scenario.friction != "full" or robot.config.simulated_truth.mechanisms is None:
        return None
    return TrueJoints.of(robot, scenario.time_step)


def add_hard_joints(
    builder: DiagramBuilder, scenario: Scenario, joints: TrueJoints, contact: bool
) -> TrueJointsSystem:
    """Adds the joints and their encoders; exports q and v as they are read.

    Args:
        contact: whether the true external torque depends on the plant's solver.
    """
    block = TrueJointsSystem(joints, contact, scenario.seed)
    builder.AddNamedSystem("true_joints", block)
    n = joints.num_joints
    readings = builder.AddNamedSystem("encoder_readings", Demultiplexer([n, n]))
    builder.Connect(block.GetOutputPort("encoders"), readings.get_input_port())
    for i, name in enumerate(("q", "v")):
        builder.ExportOutput(readings.get_output_port(i), name)
    return block


def connect_hard_joints(
    builder: DiagramBuilder,
    scenario: Scenario,
    robot: Robot,
    plant: MultibodyPlant,
    parts: RobotInPlant,
    block: TrueJointsSystem,
    terms: OutputPort,
    tau_ext: OutputPort,
) -> None:
    """From the commanded current to plant and measured current; exports them and the truth."""
    n = robot.num_joints
    limit = robot.effort_limit / robot.torque_per_ampere
    drives = builder.AddNamedSystem("drives", Saturation(-limit, limit))
    builder.ExportInput(drives.get_input_port(), "current_command")
    builder.Connect(drives.get_output_port(), block.GetInputPort("current_command"))
    builder.Connect(terms, block.GetInputPort("terms"))
    builder.Connect(tau_ext, block.GetInputPort("tau_ext"))
    split = builder.AddNamedSystem("joint_signals", Demultiplexer([n] * SIGNALS))
    builder.Connect(block.GetOutputPort("signals"), split.get_input_port())
    tau_J, torque, tau_f, current_true = (split.get_output_port(i) for i in range(SIGNALS))
    builder.Connect(tau_J, plant.get_actuation_input_port(parts.model_instance))
    builder.Connect(torque, plant.get_applied_generalized_force_input_port())
    builder.ExportOutput(tau_J, "tau_J_true")
    builder.ExportOutput(tau_f, "tau_f_true")
    export_measured_current(builder, scenario, robot, current_true)
