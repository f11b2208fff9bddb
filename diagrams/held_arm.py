"""An arm held in place while a scripted wrench acts on its tool, in continuous time."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import (
    ConstantVectorSource,
    Demultiplexer,
    LogVectorOutput,
    VectorLogSink,
    ZeroOrderHold,
)

from wrenchsight.diagrams.drive_current import torque_to_current
from wrenchsight.diagrams.estimator import add_estimator_to_ports
from wrenchsight.models.control.wrench_script import WrenchScript
from wrenchsight.models.estimation.estimator import WrenchEstimatorConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot, RobotInPlant
from wrenchsight.systems.external_wrench_source import ExternalWrenchSource
from wrenchsight.systems.joint_tracking_controller import (
    JointTrackingConfig,
    JointTrackingController,
)
from wrenchsight.systems.motor_current_sensor import MotorCurrentSensor

# Critically damped at 100 rad/s: stiff enough that the arm hardly moves under the wrench, slow
# enough for a drive that holds its torque for 1 ms.
_HOLD_CONTROL = JointTrackingConfig(law="computed_torque", kp=[1e4], kd=[200.0])


@dataclass(frozen=True)
class HeldArm:
    """The diagram and its logs, one entry a tick.

    Attributes:
        diagram: diagram of arm, controller and estimators.
        q: log of the joint positions, (n,) rad.
        wrench_true: log of F_E_W, (6,) rotation first.
        tau_ext, wrench: logs of each estimator's outputs, by its name.
        time_step: s, of drives, sensors, estimators and logs.
    """

    diagram: Diagram
    q: VectorLogSink
    wrench_true: VectorLogSink
    tau_ext: dict[str, VectorLogSink]
    wrench: dict[str, VectorLogSink]
    time_step: float


@dataclass(frozen=True)
class _PlantOfArm:
    """The plant of an arm in continuous time, with its encoders.

    Attributes:
        plant: with the arm alone, without joint friction.
        parts: the arm's model instance, joints, actuators and frame E in it.
        q, v: ports of the encoders, (n,) rad and rad/s.
    """

    plant: MultibodyPlant
    parts: RobotInPlant
    q: OutputPort
    v: OutputPort


def make_held_arm(
    robot: Robot,
    estimators: Mapping[str, WrenchEstimatorConfig],
    script: WrenchScript,
    q: ArrayLike,
    *,
    current_noise: bool = False,
    seed: int = 0,
) -> HeldArm:
    """Builds an arm that a joint controller holds at `q`, with its estimators.

        reference --> controller --> drive_hold ------------> plant --> q, v --> estimators
                       ^  |                                     ^
                       |  +--> current sensor --> estimators    +-- external wrench
                       +-- terms of the first estimator

    The plant is continuous in time, so that the scripted wrench acts at every moment and not only
    at the ticks. It has no joint friction. The drives hold their torque from tick to tick, and
    encoders, current sensors and estimators sample at the ticks. Controller and estimators have the
    true rigid-body model, also without friction: their readings differ from the truth by the
    observer's dynamics and the current's noise alone.

    Args:
        robot: the arm.
        estimators: configurations by the names that the estimators get in diagram and logs; one or
            more, all with the same time step.
        script: the wrench on the tool at E.
        q: (n,) rad, at rest there from the start.
        current_noise: whether currents have the drives' noise, resolution and bandwidth.
        seed: seed of the noise, as MotorCurrentSensor's; not read without `current_noise`.

    Raises:
        ValueError: no estimator, or time steps that differ.
    """
    time_step = _common_time_step(estimators)
    # The inertias of the robot file, which are the plant's, and no friction.
    model = IdentifiedModel.nominal(robot)
    q_start = np.asarray(q, float)
    builder = DiagramBuilder()
    arm = _add_arm(builder, robot, q_start)
    wrench_true = _add_wrench(builder, script, arm)
    # The estimators read the sensor, the controller an estimator's terms, and the sensor what the
    # controller commands: its input is connected last.
    sensor = builder.AddSystem(_current_sensor(robot, time_step, current_noise, seed))
    current = sensor.GetOutputPort("current")
    estimator_diagrams = {
        name: add_estimator_to_ports(
            builder, robot, model, config, q=arm.q, v=arm.v, current=current, name=name
        )
        for name, config in estimators.items()
    }
    # The controller needs rigid-body terms at the measured q and v. All estimators have the same
    # model and read the same q and v, so that all put out the same terms.
    terms = next(iter(estimator_diagrams.values())).GetOutputPort("terms")
    tau_command = _add_holding_controller(builder, robot, model, q_start, terms, time_step)
    _add_drives(builder, robot, arm, tau_command, time_step)
    # The current that the commanded torque takes; the sensor samples it at the drives' ticks.
    current_true = _add_drive_current(builder, robot, tau_command)
    builder.Connect(current_true, sensor.GetInputPort("current_true"))

    def log(port: OutputPort) -> VectorLogSink:
        return LogVectorOutput(port, builder, time_step)

    def logs(signal: str) -> dict[str, VectorLogSink]:
        diagrams = estimator_diagrams.items()
        return {name: log(diagram.GetOutputPort(signal)) for name, diagram in diagrams}

    # Logs are systems, too: added before the diagram is built.
    q_log, wrench_true_log = log(arm.q), log(wrench_true)
    tau_ext_logs, wrench_logs = logs("tau_ext"), logs("wrench")
    diagram = builder.Build()
    diagram.set_name("held_arm")
    return HeldArm(
        diagram=diagram,
        q=q_log,
        wrench_true=wrench_true_log,
        tau_ext=tau_ext_logs,
        wrench=wrench_logs,
        time_step=time_step,
    )


def _common_time_step(estimators: Mapping[str, WrenchEstimatorConfig]) -> float:
    """The estimators' time step, s.

    Raises:
        ValueError: there is none, or there are several.
    """
    time_steps = {config.observer.time_step for config in estimators.values()}
    if len(time_steps) != 1:
        raise ValueError(f"the estimators must have one time step, not {sorted(time_steps)}")
    return float(time_steps.pop())


def _add_arm(builder: DiagramBuilder, robot: Robot, q_start: Array) -> _PlantOfArm:
    """Adds the arm at rest at q_start, and splits its state up into what encoders read."""
    plant = builder.AddNamedSystem("plant", MultibodyPlant(0.0))
    parts = robot.add_to_plant(plant)
    plant.Finalize()
    plant.SetDefaultPositions(parts.model_instance, q_start)
    n = robot.num_joints
    encoders = builder.AddNamedSystem("encoders", Demultiplexer([n, n]))
    builder.Connect(plant.get_state_output_port(parts.model_instance), encoders.get_input_port())
    return _PlantOfArm(plant, parts, encoders.get_output_port(0), encoders.get_output_port(1))


def _add_wrench(builder: DiagramBuilder, script: WrenchScript, arm: _PlantOfArm) -> OutputPort:
    """Lets the script's wrench act at E; returns the port of F_E_W, (6,) rotation first."""
    frame_E = arm.parts.frame_E
    p_BE = frame_E.GetFixedPoseInBodyFrame().translation()
    wrench = builder.AddNamedSystem(
        "external_wrench", ExternalWrenchSource(script, frame_E.body().index(), p_BE)
    )
    builder.Connect(
        wrench.GetOutputPort("spatial_forces"), arm.plant.get_applied_spatial_force_input_port()
    )
    return wrench.GetOutputPort("wrench_true")


def _add_drives(
    builder: DiagramBuilder,
    robot: Robot,
    arm: _PlantOfArm,
    tau_command: OutputPort,
    time_step: float,
) -> None:
    """Holds the commanded torque from tick to tick, and lets it act on the joints."""
    hold = builder.AddNamedSystem("drive_hold", ZeroOrderHold(time_step, robot.num_joints))
    builder.Connect(tau_command, hold.get_input_port())
    actuation = arm.plant.get_actuation_input_port(arm.parts.model_instance)
    builder.Connect(hold.get_output_port(), actuation)


def _add_drive_current(
    builder: DiagramBuilder, robot: Robot, tau_command: OutputPort
) -> OutputPort:
    """The port of the current that the commanded torque takes, (n,) A."""
    drive = builder.AddNamedSystem("drive_current", torque_to_current(robot))
    builder.Connect(tau_command, drive.get_input_port())
    return drive.get_output_port()


def _current_sensor(robot: Robot, time_step: float, noise: bool, seed: int) -> MotorCurrentSensor:
    """The sensor of the drives, or one without bandwidth, noise and resolution."""
    sensor = MotorCurrentSensor(robot.num_joints, time_step)
    if noise:
        sensor = MotorCurrentSensor(
            robot.num_joints,
            time_step,
            bandwidth=robot.current_bandwidth,
            noise_sd=robot.current_noise_sd,
            resolution=robot.current_resolution,
            seed=seed,
        )
    sensor.set_name("current_sensor")
    return sensor


def _add_holding_controller(
    builder: DiagramBuilder,
    robot: Robot,
    model: IdentifiedModel,
    q: Array,
    terms: OutputPort,
    time_step: float,
) -> OutputPort:
    """Adds a joint controller that keeps the arm at rest at q; returns the torque it commands."""
    controller = builder.AddNamedSystem(
        "controller",
        JointTrackingController(
            model.friction.feedforward, robot.effort_limit, time_step, _HOLD_CONTROL
        ),
    )
    at_rest = np.concatenate([q, np.zeros(2 * robot.num_joints)])
    reference = builder.AddNamedSystem("reference", ConstantVectorSource(at_rest))
    builder.Connect(reference.get_output_port(), controller.GetInputPort("reference"))
    builder.Connect(terms, controller.GetInputPort("terms"))
    return controller.GetOutputPort("tau_command")
