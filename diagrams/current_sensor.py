"""What the drives of a scenario report of their current."""

from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import PassThrough

from wrenchsight.diagrams.scenario import Scenario
from wrenchsight.models.robot.robot import Robot
from wrenchsight.systems.motor_current_sensor import MotorCurrentSensor


def export_measured_current(
    builder: DiagramBuilder, scenario: Scenario, robot: Robot, current: OutputPort
) -> None:
    """Exports `current` (n,) A as the drives report it: behind the robot's sensors, or unchanged.

    Args:
        scenario: says whether there is noise, and its seed.
        current: of the motors, (n,) A.
    """
    sensor = drives_sensor(scenario, robot)
    if sensor is not None:
        builder.AddNamedSystem("current_sensor", sensor)
        builder.Connect(current, sensor.GetInputPort("current_true"))
        builder.ExportOutput(sensor.GetOutputPort("current"), "current")
    else:
        ideal = builder.AddNamedSystem("current_sensor", PassThrough(robot.num_joints))
        builder.Connect(current, ideal.get_input_port())
        builder.ExportOutput(ideal.get_output_port(), "current")


def drives_sensor(scenario: Scenario, robot: Robot) -> MotorCurrentSensor | None:
    """The robot's sensors of current, with the scenario's seed; None without noise."""
    if not scenario.current_noise:
        return None
    return MotorCurrentSensor(
        robot.num_joints,
        scenario.time_step,
        robot.current_bandwidth,
        robot.current_noise_sd,
        robot.current_resolution,
        scenario.seed,
    )
