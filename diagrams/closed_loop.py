"""The robot cell under a controller, watched by the estimator."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import (
    Demultiplexer,
    Gain,
    LogVectorOutput,
    MatrixGain,
    Multiplexer,
    TrajectorySource,
    VectorLogSink,
)
from pydrake.trajectories import PiecewisePolynomial

from wrenchsight.diagrams.distances.links_apart import links_apart
from wrenchsight.diagrams.estimator import add_estimator
from wrenchsight.diagrams.machining import make_machining_path
from wrenchsight.diagrams.pages.run_page import add_wrench_arrows
from wrenchsight.diagrams.robot_cell import RobotCell, make_robot_cell
from wrenchsight.diagrams.scenario import ForceSetpoint, Scenario, check_scenario, make_trajectory
from wrenchsight.models.arrays import Array
from wrenchsight.models.estimation.estimator import WrenchEstimator
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.machining.air_pass import TaughtTorque
from wrenchsight.models.machining.machining_path import MachiningPath
from wrenchsight.models.machining.machining_reference import MachiningReference
from wrenchsight.models.motion.paths import JointTrajectory
from wrenchsight.models.robot.motors import motor_gain
from wrenchsight.models.robot.robot import Robot
from wrenchsight.systems.impedance_controller import ImpedanceConfig, ImpedanceController
from wrenchsight.systems.joint_tracking_controller import JointTrackingController
from wrenchsight.systems.machining.machining_controller import MachiningController
from wrenchsight.systems.path_reference import PathReference
from wrenchsight.systems.pose_reference import PoseReference
from wrenchsight.systems.rigid_body_terms import RigidBodyTermsSystem
from wrenchsight.systems.wrench_estimator import WrenchEstimatorSystem

_READINGS = ("tau_ext", "wrench", "covariance", "condition_number", "valid")
_PASS = ("reference", "force_setpoint", "phase", "fault", "progress", "feed_time", "pose_error")


@dataclass(frozen=True)
class ClosedLoop:
    """The closed loop, and the parts of it that a caller may want.

    Attributes:
        diagram: everything; the subsystems are named robot_cell, estimator, controller, ...
        cell: the robot cell.
        estimator: the estimator's diagram; None in a loop without one, or where it is in the
            MachiningController.
        controller: JointTrackingController, ImpedanceController or MachiningController.
        trajectory: the reference motion of the joints.
        log: what happened, one entry a tick; `signals` says where in an entry each signal is.
        signals: columns of the log by the name of the signal.
    """

    diagram: Diagram
    cell: RobotCell
    estimator: Diagram | None
    controller: LeafSystem
    trajectory: JointTrajectory
    log: VectorLogSink
    signals: dict[str, slice]

    def logged(self, context: Context) -> tuple[Array, dict[str, Array]]:
        """What is in the log of the diagram's context: times (T,), and each signal (T, size)."""
        log = self.log.FindLog(context)
        data = log.data()
        return log.sample_times().copy(), {
            name: data[columns].T.copy() for name, columns in self.signals.items()
        }


def make_closed_loop(
    scenario: Scenario,
    robot: Robot,
    model: IdentifiedModel,
    meshcat: Meshcat | None = None,
    also_log: Sequence[str] = (),
    trajectory: JointTrajectory | None = None,
    machining_path: MachiningPath | None = None,
    log_only: Sequence[str] | None = None,
    with_estimator: bool = True,
    taught: TaughtTorque | None = None,
    fused: bool = False,
    estimator_model: IdentifiedModel | None = None,
    log_period: float | None = None,
) -> ClosedLoop:
    """Builds the loop of a scenario. Controller and estimator know `model`, never the truth.

        reference --> controller --tau_command--> 1/K --current_command--> robot_cell
                         ^   ^                                              | q, v, current
                         |   +---------------- terms ---- estimator <-------+
                         +-- wrench: of the sensor or of the estimator

    Logged at every tick: reference, tau_command, q, v, current, tau_ext, wrench, covariance,
    condition_number, valid; of the truth tau_ext_true and wrench_true; where they exist ft_wrench,
    pose_error, force_setpoint; of a machining scenario phase, fault, progress and feed_time.

    Args:
        trajectory: of the joints, in the place of the scenario's motion.
        machining_path: of a machining scenario, planned before: the workpiece may stand elsewhere.
        also_log: further output ports of the robot cell to log, such as tau_f_true.
        log_only: which of the signals to log; None: all. What is not logged costs no time: a log of
            encoders and current, to be read by `WrenchEstimator.run` later, leaves the estimator's
            reading out.
        meshcat: draws the cell and the force at the tool, true and estimated.
        taught: of a machining scenario: what an air pass along the same path taught; the estimator
            reads with it.
        with_estimator: without it the tracking controller has the model's terms from a block of
            their own, and there is no tau_ext, wrench, covariance, condition_number and valid: for
            the motion alone, in two thirds of the time.
        fused: whether the estimator is one block instead of its stages: the same numbers, sooner.
            In machining it always is one block with reference and controller.
        estimator_model: what the estimator knows, and hands on as terms; None: `model`.
        log_period: s, between two entries of the log, a whole number of ticks; None: every tick.
            What nobody but the log asks for is computed then alone.

    Raises:
        ValueError: no estimator for impedance control or a drawing, which need its wrench; taught
            torque without machining.
        InputError: the scenario does not fit the robot, or the model is of another robot.
    """
    check_scenario(scenario)
    if taught is not None and scenario.machining is None:
        raise ValueError("closed loop: taught torque is of a machining scenario")
    if scenario.machining is not None:
        machining_path = machining_path or make_machining_path(scenario, robot)
        trajectory, q_0 = machining_path.trajectory, machining_path.q_start
    else:
        trajectory = trajectory or make_trajectory(scenario, robot)
        q_0 = trajectory.q[0]
    apart: Collection[str] = ()
    if machining_path is not None:
        apart = links_apart(scenario, robot, machining_path)
    builder = DiagramBuilder()
    cell = make_robot_cell(scenario, robot, q_0, meshcat, apart)
    builder.AddSystem(cell.diagram)
    out = cell.diagram.GetOutputPort
    config = replace(
        scenario.estimator,
        observer=replace(scenario.estimator.observer, time_step=scenario.time_step),
    )
    estimator, terms = None, None
    readings: dict[str, OutputPort] = {}
    in_one = with_estimator and machining_path is not None
    if in_one:
        pass
    elif with_estimator:
        estimator = add_estimator(
            builder,
            robot,
            estimator_model or model,
            config,
            q=out("q"),
            v=out("v"),
            current=out("current"),
            fused=fused,
        )
        terms = estimator.GetOutputPort("terms")
        readings = {name: estimator.GetOutputPort(name) for name in _READINGS}
    elif isinstance(scenario.controller, ImpedanceConfig) or meshcat is not None:
        raise ValueError("closed loop: impedance control and drawings need the estimator")
    else:
        model_terms = RigidBodyTermsSystem(model.chain(robot))
        builder.AddNamedSystem("terms", model_terms)
        for name in ("q", "v"):
            builder.Connect(out(name), model_terms.GetInputPort(name))
        terms = model_terms.get_output_port()
    signals: dict[str, OutputPort] = {}
    controller: LeafSystem
    if in_one:
        assert machining_path is not None
        read_by = WrenchEstimator(robot, estimator_model or model, config)
        controller, parts = _add_machining_controller(
            builder, scenario, robot, model, machining_path, read_by, taught, cell
        )
        tau_command, terms = parts["tau_command"], controller.GetOutputPort("terms")
        readings = {name: parts[name] for name in _READINGS}
        signals |= {name: parts[name] for name in _PASS}
    elif isinstance(scenario.controller, ImpedanceConfig):
        assert estimator is not None
        feedback = out("ft_wrench") if uses_sensor(scenario) else estimator.GetOutputPort("wrench")
        reference = builder.AddNamedSystem("path_reference", PathReference(trajectory))
        signals["reference"] = reference.get_output_port()
        _add_path(builder, scenario, robot, model, signals)
        controller, tau_command = _add_impedance(
            builder, scenario, robot, model, q_0, estimator, feedback, signals
        )
    else:
        controller = builder.AddNamedSystem(
            "controller",
            JointTrackingController(
                model.friction.feedforward,
                robot.effort_limit,
                scenario.time_step,
                scenario.controller,
            ),
        )
        reference = builder.AddNamedSystem("path_reference", PathReference(trajectory))
        signals["reference"] = reference.get_output_port()
        assert terms is not None
        builder.Connect(terms, controller.GetInputPort("terms"))
        builder.Connect(reference.get_output_port(), controller.GetInputPort("reference"))
        tau_command = controller.GetOutputPort("tau_command")
    drive_gain = motor_gain(robot.torque_per_ampere, robot.current_sign)
    to_motor = (
        MatrixGain(robot.coupling.T / drive_gain[:, None])
        if robot.is_coupled
        else Gain(1.0 / drive_gain)
    )
    to_current = builder.AddNamedSystem("torque_to_current", to_motor)
    builder.Connect(tau_command, to_current.get_input_port())
    builder.Connect(to_current.get_output_port(), cell.diagram.GetInputPort("current_command"))

    signals["tau_command"] = tau_command
    for name in ("q", "v", "current", "tau_ext_true", "wrench_true", "ft_wrench", *also_log):
        if cell.diagram.HasOutputPort(name):
            signals[name] = out(name)
    signals |= readings
    if log_only is not None:
        signals = {name: signals[name] for name in log_only}
    log, columns = _add_log(builder, signals, log_period or scenario.time_step)
    if meshcat is not None and terms is not None:
        add_wrench_arrows(
            builder,
            meshcat,
            terms,
            {
                "force true": out("wrench_true"),
                "force estimated": readings["wrench"],
            },
            scenario.recording.fps,
            scenario.recording.metres_per_newton,
        )
    diagram = builder.Build()
    diagram.set_name("closed_loop")
    return ClosedLoop(diagram, cell, estimator, controller, trajectory, log, columns)


def _add_machining_controller(
    builder: DiagramBuilder,
    scenario: Scenario,
    robot: Robot,
    model: IdentifiedModel,
    plan: MachiningPath,
    estimator: WrenchEstimator,
    taught: TaughtTorque | None,
    cell: RobotCell,
) -> tuple[MachiningController, dict[str, OutputPort]]:
    """Adds a MachiningController and takes its port apart; returns it and the parts by their names.

    Raises:
        ValueError: an air pass for an observer that reads the wrench itself; as
            MachiningController.
    """
    assert scenario.machining is not None and isinstance(scenario.controller, ImpedanceConfig)
    if taught is not None and estimator.observed_size:
        raise ValueError("an observer that reads the wrench itself has no use for an air pass")
    # Force feedback counts where the lesson does.
    trusted = plan.steady if taught is None else taught.steady_at(plan.trajectory.t)
    period, senses = estimator.observer.time_step, uses_sensor(scenario)
    law = model.friction.feedforward
    block = MachiningController(
        MachiningReference(
            robot,
            model.chain(robot),
            replace(plan, steady=trusted),
            scenario.machining.phases,
            period,
            reads_at_rest=senses,
        ),
        WrenchEstimatorSystem(estimator, taught is not None),
        ImpedanceController(law, robot.effort_limit, period, scenario.controller),
        taught,
        period,
        senses,
    )
    _check_damping(block.impedance, robot, plan.q_start)
    builder.AddNamedSystem("controller", block)
    for name in ("q", "v", "current", *(["ft_wrench"] if senses else [])):
        port = block.GetInputPort("wrench" if name == "ft_wrench" else name)
        builder.Connect(cell.diagram.GetOutputPort(name), port)
    split = builder.AddNamedSystem("action", Demultiplexer(list(block.sizes.values())))
    builder.Connect(block.GetOutputPort("action"), split.get_input_port())
    return block, {name: split.get_output_port(i) for i, name in enumerate(block.sizes)}


def uses_sensor(scenario: Scenario) -> bool:
    """Whether force control feeds back a sensor's wrench; else the estimator's."""
    return scenario.feedback == "sensor" and scenario.force_torque_sensor is not None


def _add_path(
    builder: DiagramBuilder,
    scenario: Scenario,
    robot: Robot,
    model: IdentifiedModel,
    signals: dict[str, OutputPort],
) -> None:
    """What an impedance controller follows along a motion of the joints."""
    pose = builder.AddNamedSystem("pose_reference", PoseReference(model.chain(robot)))
    builder.Connect(signals["reference"], pose.get_input_port())
    signals["pose_reference"] = pose.get_output_port()
    assert isinstance(scenario.controller, ImpedanceConfig)
    if scenario.controller.force is not None:
        setpoint = builder.AddNamedSystem(
            "force_setpoint", TrajectorySource(_setpoint_trajectory(scenario))
        )
        signals["force_setpoint"] = setpoint.get_output_port()


def _add_impedance(
    builder: DiagramBuilder,
    scenario: Scenario,
    robot: Robot,
    model: IdentifiedModel,
    q_0: Array,
    estimator: Diagram,
    feedback: OutputPort,
    signals: dict[str, OutputPort],
) -> tuple[ImpedanceController, OutputPort]:
    """Adds the controller and its signals; returns it and the torque that it commands."""
    config = scenario.controller
    assert isinstance(config, ImpedanceConfig)
    controller = ImpedanceController(
        model.friction.feedforward, robot.effort_limit, scenario.time_step, config
    )
    builder.AddNamedSystem("controller", controller)
    _check_damping(controller, robot, q_0)
    # The pose is known from the joints' reference: it need not be in the log.
    builder.Connect(signals.pop("pose_reference"), controller.GetInputPort("pose_reference"))
    builder.Connect(signals["reference"], controller.GetInputPort("reference"))
    builder.Connect(estimator.GetOutputPort("terms"), controller.GetInputPort("terms"))
    # Split up by Drake: a port of its own for each signal is as many calls into Python at a tick.
    action = builder.AddNamedSystem("action", Demultiplexer(controller.sizes(robot.num_joints)))
    builder.Connect(controller.GetOutputPort("action"), action.get_input_port())
    signals["pose_error"] = action.get_output_port(1)
    if config.force is not None:
        builder.Connect(signals["force_setpoint"], controller.GetInputPort("force_setpoint"))
        builder.Connect(feedback, controller.GetInputPort("wrench"))
    return controller, action.get_output_port(0)


def _check_damping(controller: ImpedanceController, robot: Robot, q: Array) -> None:
    """Raises InputError where the damper would chatter at q."""
    # By the stated inertias: those of a wrist, where rotors count most, are identified poorly.
    start = robot.chain.terms(q, np.zeros(robot.num_joints))
    share = controller.damping_per_tick(start.M, start.J, start.R_WE)
    if share > 1.0:
        raise InputError(
            "scenario",
            "controller.damping",
            f"takes off {share:.1f} times the tool's velocity in one time step: it would chatter",
            "lower the damping (for a light wrist the rotational one), or the time_step",
        )


def _add_log(
    builder: DiagramBuilder, signals: dict[str, OutputPort], period: float
) -> tuple[VectorLogSink, dict[str, slice]]:
    """One sink for all signals: a sink each would be as many events at every tick."""
    sizes = [port.size() for port in signals.values()]
    together = builder.AddNamedSystem("signals", Multiplexer(sizes))
    for i, port in enumerate(signals.values()):
        builder.Connect(port, together.get_input_port(i))
    log = LogVectorOutput(together.get_output_port(), builder, period)
    log.set_name("log")
    ends = np.cumsum(sizes)
    starts = ends - sizes
    return log, {
        name: slice(int(start), int(end))
        for name, start, end in zip(signals, starts, ends, strict=True)
    }


def _setpoint_trajectory(scenario: Scenario) -> PiecewisePolynomial:
    end = scenario.duration + scenario.time_step
    count = max(2, round(end / max(scenario.time_step, 1e-3)) + 1)
    t = np.linspace(0.0, end, count)
    values = setpoint_at(scenario.force_setpoint, t)
    return PiecewisePolynomial.FirstOrderHold(t, values[np.newaxis, :])


def setpoint_at(setpoint: ForceSetpoint, t: Array) -> Array:
    """The force set-point in N at times t (T,)."""
    since = t - setpoint.start
    rise = np.clip(since / setpoint.rise, 0.0, 1.0)
    sine = np.sin(2 * np.pi * setpoint.frequency * np.maximum(since, 0.0))
    return np.asarray(rise * (setpoint.value + setpoint.amplitude * sine))
