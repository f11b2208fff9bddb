"""The true arm at machining in one block, between the command and the plant."""

from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Demultiplexer, Saturation

from wrenchsight.models.robot.robot import Robot, RobotInPlant
from wrenchsight.systems.truth.environment_truth import EnvironmentTruth
from wrenchsight.systems.truth.machined_arm import MachinedArm


def add_machined_arm(
    builder: DiagramBuilder,
    robot: Robot,
    plant: MultibodyPlant,
    parts: RobotInPlant,
    block: MachinedArm,
    with_sensor: bool,
) -> None:
    """Adds the block, connects it with the plant and exports the ports of a robot cell.

    Args:
        with_sensor: whether the block has a force/torque sensor.
    """
    n = robot.num_joints
    builder.AddNamedSystem("machined_arm", block)
    state = plant.get_state_output_port(parts.model_instance)
    limit = robot.effort_limit / robot.torque_per_ampere
    drives = builder.AddNamedSystem("drives", Saturation(-limit, limit))
    builder.ExportInput(drives.get_input_port(), "current_command")
    for name, port in (
        ("state", state),
        ("current_command", drives.get_output_port()),
        ("contact_results", plant.get_contact_results_output_port()),
        (
            "tau_contact",
            plant.get_generalized_contact_forces_output_port(parts.model_instance),
        ),
        ("reaction_forces", plant.get_reaction_forces_output_port()),
        ("vdot", plant.get_generalized_acceleration_output_port(parts.model_instance)),
    ):
        builder.Connect(port, block.GetInputPort(name))
    split = {}
    for name, sizes in (
        ("motion", block.motion_sizes),
        ("drives", block.drive_sizes),
        ("truth", list(EnvironmentTruth.sizes(n))),
    ):
        demultiplexer = builder.AddNamedSystem(f"{name}_parts", Demultiplexer(sizes))
        builder.Connect(block.GetOutputPort(name), demultiplexer.get_input_port())
        split[name] = [demultiplexer.get_output_port(i) for i in range(len(sizes))]
    q, v, _, ft_wrench = split["motion"]
    tau_J, torque, tau_f, _, current, _ = split["drives"]
    wrench_true, tau_ext_true, _ = split["truth"]
    builder.Connect(tau_J, plant.get_actuation_input_port(parts.model_instance))
    builder.Connect(torque, plant.get_applied_generalized_force_input_port())
    builder.Connect(
        block.GetOutputPort("spatial_forces"), plant.get_applied_spatial_force_input_port()
    )
    exported = {
        "q": q,
        "v": v,
        "state": state,
        "current": current,
        "tau_J_true": tau_J,
        "tau_f_true": tau_f,
        "tau_ext_true": tau_ext_true,
        "wrench_true": wrench_true,
        "wrench_unbalance": block.GetOutputPort("wrench_unbalance"),
    }
    for name, port in (exported | ({"ft_wrench": ft_wrench} if with_sensor else {})).items():
        builder.ExportOutput(port, name)
