"""The closed loop: robot cell, controller and estimator."""

from collections.abc import Collection, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import Meshcat
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import (
    Adder,
    ConstantValueSource,
    Demultiplexer,
    Gain,
    LogVectorOutput,
    Multiplexer,
    TrajectorySource,
    VectorLogSink,
)
from pydrake.trajectories import PiecewisePolynomial

from wrenchsight.diagrams.distances.links_apart import links_apart
from wrenchsight.diagrams.drive_current import torque_to_current
from wrenchsight.diagrams.estimator import add_estimator_to_ports
from wrenchsight.diagrams.machining import make_machining_path, with_planned_force
from wrenchsight.diagrams.outputs import split_outputs
from wrenchsight.diagrams.pages.run_page import add_wrench_arrows
from wrenchsight.diagrams.robot_cell import RobotCell, make_robot_cell
from wrenchsight.diagrams.scenario import ForceSetpoint, Scenario, check_scenario, make_trajectory
from wrenchsight.models.estimation.estimator import WrenchEstimator, WrenchEstimatorConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.machining.air_pass import AirPassCorrection
from wrenchsight.models.machining.machining_path import MachiningPath
from wrenchsight.models.machining.machining_reference import PassPlan, initial_memory, plan_pass
from wrenchsight.models.machining.tool_vibration import VibrationConstants, vibration_constants
from wrenchsight.models.numerics.arrays import Array, Record
from wrenchsight.models.planning.motion.paths import JointTrajectory
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot
from wrenchsight.systems.impedance_controller import ImpedanceConfig, ImpedanceController
from wrenchsight.systems.joint_tracking_controller import (
    JointTrackingConfig,
    JointTrackingController,
)
from wrenchsight.systems.machining.air_pass_correction import AirPassCorrectionSystem
from wrenchsight.systems.machining.freed_friction_feedforward import FreedFrictionFeedforward
from wrenchsight.systems.machining.machining_reference import MachiningReference
from wrenchsight.systems.machining.tool_vibration_tracker import ToolVibrationTracker
from wrenchsight.systems.path_reference import PathReference
from wrenchsight.systems.pose_reference import PoseReference
from wrenchsight.systems.rigid_body_terms import RigidBodyTermsSystem
from wrenchsight.systems.sampled_block import stepping_with_plant

_READING_SIGNALS = ("tau_ext", "wrench", "covariance", "condition_number", "valid", "invalid")
# Outputs of a machining pass's reference, and of the tracker after an air pass, that are logged.
_PASS_SIGNALS = ("reference", "force_setpoint", "phase", "fault", "progress", "feed_time")
_FREED_SIGNALS = ("freed_torque", "freed_sd", "tool_vibration")


@dataclass(frozen=True)
class ClosedLoop:
    """The closed loop and its parts.

    Attributes:
        diagram: everything; the subsystems are named robot_cell, estimator, controller, ...
        cell: the robot cell.
        estimator: the estimator's diagram; None in a loop without one.
        controller: JointTrackingController or ImpedanceController.
        trajectory: the reference motion of the joints.
        log: of all signals, one entry a tick; `signals` says where in an entry each signal is.
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
        """The logged times (T,) and each signal (T, size) of the diagram's context."""
        log = self.log.FindLog(context)
        data = log.data()
        signals = {name: data[columns].T.copy() for name, columns in self.signals.items()}
        return log.sample_times().copy(), signals


@dataclass(frozen=True)
class LogRequest:
    """The signals that a loop logs.

    Attributes:
        also: further output ports of the robot cell, such as tau_f_true.
        only: which of the signals; None: all. A signal that is not logged costs no time: a log of
            encoders and current, to be read by `WrenchEstimator.run` later, leaves the estimator's
            reading out.
        period: s, between two entries, a whole number of ticks; None: every tick. Signals that
            only the log reads are computed just then.
    """

    also: Sequence[str] = ()
    only: Sequence[str] | None = None
    period: float | None = None


@dataclass(frozen=True)
class LoopEstimator:
    """The estimator that a loop gets.

    Attributes:
        model: that it knows, and that its output `terms` is of; None: the controller's.
        fused: whether it is one block instead of its stages, with the same numbers.
        air_pass: correction of a machining scenario, learnt along the same path; None: none.
    """

    model: IdentifiedModel | None = None
    fused: bool = False
    air_pass: AirPassCorrection | None = None


@dataclass(frozen=True)
class _PlannedMotion:
    """The motion of a loop.

    Attributes:
        trajectory: of the joints.
        q_0: (n,) rad, at the start.
        machining_path: of a machining scenario; else None.
        clear_links: names of links that touch nothing on this motion.
    """

    trajectory: JointTrajectory
    q_0: Array
    machining_path: MachiningPath | None = None
    clear_links: Collection[str] = ()


@dataclass(frozen=True)
class _LoopParts:
    """The builder of a loop, and what its controller and estimator are made from.

    Attributes:
        builder: of the loop's diagram; the cell is in it.
        scenario, robot: as given.
        controller_model: of the controller.
        requested_estimator: that it gets; None: there is none.
        cell: the robot cell.
    """

    builder: DiagramBuilder
    scenario: Scenario
    robot: Robot
    controller_model: IdentifiedModel
    requested_estimator: LoopEstimator | None
    cell: RobotCell


@dataclass(frozen=True)
class _EstimatorParts:
    """What the estimator of a loop is made from, whose constants other blocks may need.

    Attributes:
        robot, model, config: as `make_estimator`.
    """

    robot: Robot
    model: IdentifiedModel
    config: WrenchEstimatorConfig

    def wrench_estimator(self) -> WrenchEstimator:
        """The mathematics in the diagram's blocks, to read constants of; nothing of it runs."""
        return WrenchEstimator(self.robot, self.model, self.config)


@dataclass(frozen=True)
class _ControlPorts:
    """A controller that is in the loop with its estimator, and ports that the loop goes on with.

    Attributes:
        controller: JointTrackingController or ImpedanceController.
        tau_command: (n,) N m.
        terms: RigidBodyTerms of the model.
        signals: of controller and reference, to be logged, by the names of the log.
        readings: of the estimator, to be logged, by the same.
        estimator: its diagram; None: there is none.
    """

    controller: LeafSystem
    tau_command: OutputPort
    terms: OutputPort
    signals: dict[str, OutputPort]
    readings: dict[str, OutputPort]
    estimator: Diagram | None = None


class _SignalLog(NamedTuple):
    """The log of a loop.

    Attributes:
        sink: of all signals, one entry a tick.
        columns: of an entry, by the name of the signal.
    """

    sink: VectorLogSink
    columns: dict[str, slice]


def make_closed_loop(
    scenario: Scenario,
    robot: Robot,
    model: IdentifiedModel,
    *,
    motion: JointTrajectory | MachiningPath | None = None,
    estimator: LoopEstimator | None = LoopEstimator(),
    log: LogRequest = LogRequest(),
    meshcat: Meshcat | None = None,
) -> ClosedLoop:
    """Builds the closed loop of a scenario. Controller and estimator know `model`, never the truth.

        reference --> controller --tau_command--> 1/K --current_command--> robot_cell
                         ^   ^                                              | q, v, current
                         |   +---------------- terms ---- estimator <-------+
                         +-- wrench: of the sensor or of the estimator

    K is the drives' torque per ampere. Logged at every tick, unless `log` says otherwise:

        reference, tau_command, q, v, current
        tau_ext, wrench, covariance, condition_number, valid, invalid   of the estimator
        tau_ext_true, wrench_true                                       of the truth
        ft_wrench                                                       with a force/torque sensor
        pose_error                                                      of impedance control
        force_setpoint                                                  of force control
        phase, fault, progress, feed_time                               of machining
        freed_torque, freed_sd, tool_vibration                          after an air pass

    Args:
        scenario: what runs; checked here.
        robot: the arm as it is described: the cell makes the true one of it.
        model: of the controller, and of the estimator where that has no other.
        motion: in the place of the scenario's: of the joints, or of a machining scenario the path
            that was planned before (the workpiece may stand elsewhere).
        estimator: None: the tracking controller has the model's terms from a separate block, and
            the signals of the estimator are not there. That is for the motion alone, in two thirds
            of the time.
        log: signals to be logged.
        meshcat: draws the cell and the force at the tool, true and estimated.

    Raises:
        ValueError: no estimator for impedance control or a drawing, which need its wrench; an
            air-pass correction without machining, or of an observer that it cannot correct; a
            motion that is not of the scenario's kind.
        InputError: the scenario does not fit the robot, the model is of another robot, the damper
            of an impedance would chatter, or force control feeds back an estimate that depends on
            the torque that it commands.
    """
    check_scenario(scenario)
    _check_estimator_request(scenario, estimator, is_drawn=meshcat is not None)
    planned = _planned_motion(scenario, robot, motion)
    # A block decides when it is made in which phase of a tick it updates. All of the loop are made
    # in here: where the plant's settings allow it they update together with the plant, and share
    # what is computed at a tick. One that is made outside has the same numbers, and lets Drake
    # compute the plant's contact twice at a tick.
    with _update_phase(scenario):
        builder = DiagramBuilder()
        cell = make_robot_cell(
            scenario, robot, planned.q_0, meshcat=meshcat, clear_links=planned.clear_links
        )
        builder.AddSystem(cell.diagram)
        if scenario.applied_spatial_force:  # the cell then has an input for them
            _connect_no_applied_force(builder, cell)
        parts = _LoopParts(
            builder=builder,
            scenario=scenario,
            robot=robot,
            controller_model=model,
            requested_estimator=estimator,
            cell=cell,
        )
        # Adds estimator, reference and controller; only the drives are left to be connected.
        control = _add_control(parts, planned)
        _connect_drives(builder, robot, control.tau_command, cell)
        signals = _logged_signals(control, cell, log)  # the controller's, the cell's, the readings
        signal_log = _add_log(builder, signals, period=log.period or scenario.time_step)
        if meshcat is not None:
            _add_force_arrows(parts, control, meshcat)
        diagram = builder.Build()
        diagram.set_name("closed_loop")
    return ClosedLoop(
        diagram=diagram,
        cell=cell,
        estimator=control.estimator,
        controller=control.controller,
        trajectory=planned.trajectory,
        log=signal_log.sink,
        signals=signal_log.columns,
    )


def _check_estimator_request(
    scenario: Scenario, estimator: LoopEstimator | None, is_drawn: bool
) -> None:
    """Raises ValueError where a scenario or its drawing does not go with the estimator."""
    if estimator is not None and estimator.air_pass is not None and scenario.machining is None:
        raise ValueError("closed loop: the correction of an air pass needs a machining scenario")
    has_impedance = isinstance(scenario.controller, ImpedanceConfig)
    if estimator is None and (has_impedance or is_drawn):
        raise ValueError("closed loop: impedance control and drawings need the estimator")


def _connect_no_applied_force(builder: DiagramBuilder, cell: RobotCell) -> None:
    """Connects the cell's input for forces of a user's diagram, which are none in a closed loop."""
    none = ConstantValueSource(Value[list[ExternallyAppliedSpatialForce]]())
    source = builder.AddNamedSystem("no_applied_force", none)
    port = cell.diagram.GetInputPort("applied_spatial_force")
    builder.Connect(source.get_output_port(), port)


def _update_phase(scenario: Scenario) -> AbstractContextManager[None]:
    """In which the blocks of a loop update: with the plant's step, unless that samples its outputs.

    Beside sampled outputs a block that updates with the plant would see the state after its step.
    """
    samples_outputs = scenario.plant_config.use_sampled_output_ports
    return nullcontext() if samples_outputs else stepping_with_plant()


def _planned_motion(
    scenario: Scenario, robot: Robot, motion: JointTrajectory | MachiningPath | None
) -> _PlannedMotion:
    """The motion of a scenario, as given or else planned here."""
    if scenario.machining is None:
        if isinstance(motion, MachiningPath):
            raise ValueError("closed loop: a machining path needs a machining scenario")
        trajectory = make_trajectory(scenario, robot) if motion is None else motion
        return _PlannedMotion(trajectory, trajectory.q[0])
    if isinstance(motion, JointTrajectory):
        raise ValueError("closed loop: a machining scenario needs a machining path")
    path = make_machining_path(scenario, robot) if motion is None else motion
    clear_links = links_apart(scenario, robot, path)
    return _PlannedMotion(path.trajectory, path.q_start, path, clear_links)


def _add_control(parts: _LoopParts, planned: _PlannedMotion) -> _ControlPorts:
    """Adds the scenario's controller, with the estimator and the reference motion."""
    if planned.machining_path is not None and parts.requested_estimator is not None:
        return _add_machining(parts, planned.machining_path)
    if isinstance(parts.scenario.controller, ImpedanceConfig):
        return _add_impedance(parts, planned.trajectory)
    return _add_tracking(parts, planned.trajectory)


def _add_force_arrows(parts: _LoopParts, control: _ControlPorts, meshcat: Meshcat) -> None:
    """Draws the force at the tool, true and estimated."""
    recording = parts.scenario.recording
    forces = {
        "force true": parts.cell.diagram.GetOutputPort("wrench_true"),
        "force estimated": control.readings["wrench"],
    }
    add_wrench_arrows(
        parts.builder, meshcat, control.terms, forces, recording.fps, recording.metres_per_newton
    )


def _estimator_config(scenario: Scenario) -> WrenchEstimatorConfig:
    """The scenario's estimator configuration, at the scenario's time step."""
    return scenario.estimator.with_time_step(scenario.time_step)


def _connect_drives(
    builder: DiagramBuilder, robot: Robot, tau_command: OutputPort, cell: RobotCell
) -> None:
    """Turns the commanded torque into the drives' current."""
    to_current = builder.AddNamedSystem("torque_to_current", torque_to_current(robot))
    builder.Connect(tau_command, to_current.get_input_port())
    builder.Connect(to_current.get_output_port(), cell.diagram.GetInputPort("current_command"))


def _logged_signals(
    control: _ControlPorts, cell: RobotCell, log: LogRequest
) -> dict[str, OutputPort]:
    """The ports that are logged, by the names of their signals."""
    signals = control.signals | {"tau_command": control.tau_command}
    for name in ("q", "v", "current", "tau_ext_true", "wrench_true", "ft_wrench", *log.also):
        if cell.diagram.HasOutputPort(name):
            signals[name] = cell.diagram.GetOutputPort(name)
    signals |= control.readings
    return signals if log.only is None else {name: signals[name] for name in log.only}


def _estimator_parts(
    parts: _LoopParts, requested: LoopEstimator, config: WrenchEstimatorConfig | None = None
) -> _EstimatorParts:
    """What a requested estimator is made from.

    Args:
        config: None: the scenario's.
    """
    return _EstimatorParts(
        robot=parts.robot,
        model=requested.model or parts.controller_model,
        config=config or _estimator_config(parts.scenario),
    )


def _add_loop_estimator(
    parts: _LoopParts, requested: LoopEstimator, made_from: _EstimatorParts
) -> Diagram:
    """Adds the estimator of a loop, which reads the cell's encoders and currents.

    With an air pass it has inputs for a correction, which are left open here.
    """
    cell = parts.cell.diagram
    return add_estimator_to_ports(
        parts.builder,
        made_from.robot,
        made_from.model,
        made_from.config,
        q=cell.GetOutputPort("q"),
        v=cell.GetOutputPort("v"),
        current=cell.GetOutputPort("current"),
        fused=requested.fused,
        corrected=requested.air_pass is not None,
    )


def _logged_estimator_ports(estimator: Diagram) -> dict[str, OutputPort]:
    """The estimator's outputs that are logged, by their names."""
    return {name: estimator.GetOutputPort(name) for name in _READING_SIGNALS}


def _add_tracking(parts: _LoopParts, trajectory: JointTrajectory) -> _ControlPorts:
    """Adds a joint tracking controller, with the estimator or, without it, the model's terms.

        trajectory --> path_reference --> controller --> tau_command
        terms -------------------------------^

    The terms are rigid-body terms (M, Cv, G...) at the measured q and v, and hold these as well.
    They are of the estimator's model where there is an estimator (`LoopEstimator.model`), as it
    computes them anyway, else of the controller's. Friction is always that of the controller's
    model.
    """
    builder, scenario, robot = parts.builder, parts.scenario, parts.robot
    assert isinstance(scenario.controller, JointTrackingConfig)
    estimator: Diagram | None = None
    readings: dict[str, OutputPort] = {}
    requested = parts.requested_estimator
    if requested is None:
        terms = _add_terms(parts)
    else:
        estimator = _add_loop_estimator(parts, requested, _estimator_parts(parts, requested))
        readings = _logged_estimator_ports(estimator)
        terms = estimator.GetOutputPort("terms")
    controller = builder.AddNamedSystem(
        "controller",
        JointTrackingController(
            friction=parts.controller_model.friction.feedforward,
            effort_limit=robot.effort_limit,
            time_step=scenario.time_step,
            config=scenario.controller,
        ),
    )
    reference = builder.AddNamedSystem("path_reference", PathReference(trajectory))
    builder.Connect(terms, controller.GetInputPort("terms"))
    builder.Connect(reference.get_output_port(), controller.GetInputPort("reference"))
    return _ControlPorts(
        controller=controller,
        tau_command=controller.GetOutputPort("tau_command"),
        terms=terms,
        signals={"reference": reference.get_output_port()},
        readings=readings,
        estimator=estimator,
    )


def _add_terms(parts: _LoopParts) -> OutputPort:
    """Adds the rigid-body terms of the controller's model at the measured q and v."""
    terms = RigidBodyTermsSystem(parts.controller_model.chain(parts.robot))
    parts.builder.AddNamedSystem("terms", terms)
    for name in ("q", "v"):
        source = parts.cell.diagram.GetOutputPort(name)
        parts.builder.Connect(source, terms.GetInputPort(name))
    return terms.get_output_port()


def _add_machining(parts: _LoopParts, plan: MachiningPath) -> _ControlPorts:
    """Adds the reference of a pass, the estimator and an impedance controller.

        encoders, currents --> estimator --> wrench, terms
                                                 v
                                             reference --> pose_reference, ... --> controller
                                                                                       v
                                                                                  tau_command

    The controller gets wrench and terms as well. After an air pass its correction goes into the
    estimator, and the command is changed (`_add_air_pass`).

    None of the loops is algebraic. The wrench that is fed back does not depend on the command of
    the same tick (`_fed_back_wrench`). The reference reads it in its update alone: its outputs
    depend on it from the next tick on.

    Args:
        plan: path and motion of the pass. The air pass of the requested estimator, if any, was
            learnt along the same path.

    Raises:
        InputError: as `_fed_back_wrench` and `_add_impedance_controller`.
        ValueError: an air pass with an observer that reads the wrench itself, or has no gain K_0.
    """
    requested = parts.requested_estimator
    assert requested is not None  # `_add_control`
    air_pass = requested.air_pass  # None: nothing was learnt beforehand, without contact
    made_from = _estimator_parts(parts, requested, _estimator_config_of_pass(parts, plan))
    estimator = _add_loop_estimator(parts, requested, made_from)
    terms = estimator.GetOutputPort("terms")
    wrench = _fed_back_wrench(parts, estimator)  # of sensor or estimator, by the scenario
    # After an air pass the plan's field `steady` is replaced by the times at which the correction
    # is valid; path and motion stay.
    plan_with_trust = _with_trusted_times(plan, air_pass)
    reference = _add_reference(parts, plan_with_trust, terms, wrench)
    controller = _add_pass_controller(parts, plan.q_start, reference, terms, wrench)
    controller_outputs = split_outputs(parts.builder, controller)
    tau_command = controller_outputs["tau_command"]
    signals = {name: reference[name] for name in _PASS_SIGNALS}
    signals["pose_error"] = controller_outputs["pose_error"]

    if air_pass is not None:
        freed_signals, tau_command = _add_air_pass(
            parts, air_pass, made_from, estimator, controller, reference, tau_command
        )
        signals |= freed_signals
    return _ControlPorts(
        controller=controller,
        tau_command=tau_command,
        terms=terms,
        signals=signals,
        readings=_logged_estimator_ports(estimator),
        estimator=estimator,
    )


def _add_air_pass(
    parts: _LoopParts,
    air_pass: AirPassCorrection,
    made_from: _EstimatorParts,
    estimator: Diagram,
    controller: ImpedanceController,
    reference: Mapping[str, OutputPort],
    tau_command: OutputPort,
) -> tuple[dict[str, OutputPort], OutputPort]:
    """Adds the correction that an air pass has taught, and what the tool's vibration frees.

        feed_time --> air_pass --> correction ----+
                      vibration --> freed_torque -+-> estimator
                          +-------> tool_vibration -> freed_friction --> tau_command

    The controller feeds friction forward in full, also what the vibration frees. A sensor's
    feedback makes up for that; without a sensor it is taken off the command.

    Args:
        made_from: what the estimator is made from.
        estimator: its inputs for a correction are open.
        controller: of the pass.
        reference: outputs of the block MachiningReference by their names.
        tau_command: (n,) N m of the controller.

    Returns:
        The signals of the vibration that are logged, by name; and the command, (n,) N m, which with
        a sensor is the given one.
    """
    # Constants are read of another, equal estimator: nothing of it is in the diagram.
    vibration = vibration_constants(made_from.wrench_estimator())
    tracked = _add_correction(parts, air_pass, vibration, estimator, reference)
    freed_signals = {name: tracked[name] for name in _FREED_SIGNALS}
    if uses_sensor(parts.scenario):
        return freed_signals, tau_command
    command_less_freed = _add_freed_friction(
        parts, controller.law, vibration.viscous, tau_command, reference, tracked
    )
    return freed_signals, command_less_freed


def _with_trusted_times(plan: MachiningPath, air_pass: AirPassCorrection | None) -> MachiningPath:
    """The plan whose `steady` (T,) is 1 where an estimate may be fed back, else 0.

    Without an air pass that is where the feed is steady, the plan's own `steady`; after one, where
    its correction is valid. The reference's output `feedback_valid` follows it.
    """
    if air_pass is None:
        return plan
    return replace(plan, steady=air_pass.steady_at(plan.trajectory.t))


def _add_pass_controller(
    parts: _LoopParts,
    q_start: Array,
    reference: Mapping[str, OutputPort],
    terms: OutputPort,
    wrench: OutputPort,
) -> ImpedanceController:
    """Adds the impedance controller of a pass and connects all of its inputs.

    Args:
        q_start: (n,) rad, where the controller's damper is checked.
        reference: outputs of the block MachiningReference by their names. Of these force_active and
            feedback_valid say what the controller makes of the wrench.
        terms: of the estimator's model at the measured q and v.
        wrench: (6,) of the force feedback.

    Raises:
        InputError: as `_add_impedance_controller`.
    """
    assert isinstance(parts.scenario.controller, ImpedanceConfig)
    controller = _add_impedance_controller(parts, parts.scenario.controller, q_start)
    of_reference = (
        "pose_reference",
        "reference",
        "force_setpoint",
        "force_active",
        "feedback_valid",
    )
    sources = {name: reference[name] for name in of_reference}
    sources |= {"terms": terms, "wrench": wrench}
    _connect_by_name(parts.builder, controller, sources)
    return controller


def _add_freed_friction(
    parts: _LoopParts,
    law: Record,
    viscous: Array,
    tau_command: OutputPort,
    reference: Mapping[str, OutputPort],
    tracked: Mapping[str, OutputPort],
) -> OutputPort:
    """Takes the friction that the tool's vibration frees off the command.

    A vibration frees dry friction alone. So the share that it frees is of the friction that was fed
    forward, `law`'s, without a viscous part. That part is the estimator's, with which the tracker
    found the vibration.

    Args:
        law: `ImpedanceController.law` of the controller, which has fed the friction forward.
        viscous: (n,) N m s/rad, of the estimator's friction law; it is not freed.
        tau_command: (n,) N m of the controller.
        reference, tracked: outputs of MachiningReference and ToolVibrationTracker by their names.

    Returns:
        The command that is left, (n,) N m.
    """
    less_freed = FreedFrictionFeedforward(law, viscous)
    parts.builder.AddNamedSystem("freed_friction", less_freed)
    sources = {name: reference[name] for name in ("reference", "phase", "feed_time")}
    sources |= {name: tracked[name] for name in ("joint_shares", "tool_vibration")}
    sources["tau_command"] = tau_command
    _connect_by_name(parts.builder, less_freed, sources)
    return less_freed.get_output_port()


def _estimator_config_of_pass(parts: _LoopParts, plan: MachiningPath) -> WrenchEstimatorConfig:
    """The scenario's; a prior that it does not state is the force that the pass presses with."""
    config = _estimator_config(parts.scenario)
    reconstruction = with_planned_force(config.reconstruction, parts.robot, plan)
    return replace(config, reconstruction=reconstruction)


def _add_reference(
    parts: _LoopParts, plan: MachiningPath, terms: OutputPort, wrench: OutputPort
) -> dict[str, OutputPort]:
    """Adds the reference of a pass: poses, set-point and phase over time, as the pass goes on.

    Args:
        plan: path, motion and forces; where it is steady the feedback of an estimate counts.
        terms: rigid-body terms of the model at the measured q and v.
        wrench: (6,) of the force feedback, by which the pass goes from phase to phase.

    Returns:
        The output ports of the block `MachiningReference` by their names.
    """
    chain = parts.controller_model.chain(parts.robot)
    block = MachiningReference(
        _tables_of_pass(parts, plan, chain),
        initial_memory(chain, plan),  # before the first phase, E where the arm is at plan.q_start
    )
    parts.builder.AddNamedSystem("reference", block)
    _connect_by_name(parts.builder, block, {"terms": terms, "wrench": wrench})
    return split_outputs(parts.builder, block)


def _tables_of_pass(parts: _LoopParts, plan: MachiningPath, chain: SerialChain) -> PassPlan:
    """The plan with the scenario's phases, as the kernels of `MachiningReference` read it.

    A sensor is right where joints rest (`reads_at_rest`), and its feedback always counts. An
    estimate is not: a joint at rest carries any torque within its stiction. Its feedback counts
    during the feed alone, where the plan is steady, and in the touch the friction of a push into
    the surface is fed forward.
    """
    assert parts.scenario.machining is not None
    return plan_pass(
        parts.robot,
        chain,
        plan,
        parts.scenario.machining.phases,
        parts.scenario.time_step,
        reads_at_rest=uses_sensor(parts.scenario),
    )


def _add_correction(
    parts: _LoopParts,
    air_pass: AirPassCorrection,
    vibration: VibrationConstants,
    estimator: Diagram,
    reference: Mapping[str, OutputPort],
) -> dict[str, OutputPort]:
    """Adds the air pass and the tracker of the tool's vibration, which correct the estimator.

    An air pass, along the same path without contact, has taught what torque the model lacks. The
    tool's vibration frees part of the joints' friction, which the model takes off in full. The
    tracker reads the tau_ext that it corrects, and takes its own freed_torque of the tick out of it
    again. It does so in its update alone, for the tick after, so that there is no algebraic loop.

        feed_time --> air_pass --> correction --+------------------> + --> tau_correction
                                                v                    ^ -
        reference, estimator ------------> vibration --> freed_torque
                                                +------> freed_sd -------> correction_sd

    `spread` of the air pass, how far its correction differs from itself along the path, becomes the
    correction's sd where joints depart from the plan. The tracker takes it into freed_sd, and that
    goes into the estimator's torque_error, out of which the tracker takes it again.

    Args:
        air_pass: what was learnt in it.
        vibration: constants of the estimator, `vibration_constants`.
        estimator: made with `corrected`; its inputs for a correction are connected here.
        reference: outputs of the block MachiningReference by their names.

    Returns:
        The tracker's output ports by their names.
    """
    builder = parts.builder
    air_pass_block = builder.AddNamedSystem("air_pass", AirPassCorrectionSystem(air_pass))
    builder.Connect(reference["feed_time"], air_pass_block.GetInputPort("feed_time"))
    correction = split_outputs(builder, air_pass_block)
    tracker = builder.AddNamedSystem(
        "vibration", ToolVibrationTracker(vibration, parts.scenario.time_step)
    )
    tracked = split_outputs(builder, tracker)
    # By the names of the tracker's inputs, none of them twice: `fault` is the estimator's, of the
    # sample, and not that of the reference, why a pass was broken off.
    sources = {
        "correction": correction["correction"],
        "correction_spread": correction["spread"],
        "correction_valid": correction["valid"],
    }
    for name in ("pose_reference", "reference", "phase", "feed_time"):
        sources[name] = reference[name]
    for name in ("terms", "tau_ext", "tau_ext_valid", "torque_error", "tau_f", "fault"):
        sources[name] = estimator.GetOutputPort(name)
    _connect_by_name(builder, tracker, sources)
    _connect_correction(parts, estimator, reference, correction, tracked)
    return tracked


def _connect_correction(
    parts: _LoopParts,
    estimator: Diagram,
    reference: Mapping[str, OutputPort],
    correction: Mapping[str, OutputPort],
    tracked: Mapping[str, OutputPort],
) -> None:
    """Connects the estimator's inputs for a correction.

        tau_correction   = correction - freed_torque
        correction_valid = the air pass's
        correction_sd    = freed_sd, which holds the sd of the air pass's correction already
        v_planned        = v_d of the reference

    Args:
        reference, correction, tracked: outputs of reference, air pass and tracker, by their names.
    """
    builder, n = parts.builder, parts.robot.num_joints
    minus_freed = builder.AddNamedSystem("less_freed", Gain(-1.0, n))
    builder.Connect(tracked["freed_torque"], minus_freed.get_input_port())
    total = builder.AddNamedSystem("tau_correction", Adder(2, n))
    builder.Connect(correction["correction"], total.get_input_port(0))
    builder.Connect(minus_freed.get_output_port(), total.get_input_port(1))
    builder.Connect(total.get_output_port(), estimator.GetInputPort("tau_correction"))
    builder.Connect(correction["valid"], estimator.GetInputPort("correction_valid"))
    builder.Connect(tracked["freed_sd"], estimator.GetInputPort("correction_sd"))
    # On the air pass, too, a friction law of speed alone was evaluated at the planned speed. An
    # estimator whose friction law has a memory has no such input: that law follows the measured
    # motion on both passes.
    if estimator.HasInputPort("v_planned"):
        planned_motion = builder.AddNamedSystem("reference_joints", Demultiplexer(3 * n, n))
        builder.Connect(reference["reference"], planned_motion.get_input_port())
        v_planned = planned_motion.get_output_port(1)  # of q_d, v_d, vdot_d
        builder.Connect(v_planned, estimator.GetInputPort("v_planned"))


def _connect_by_name(
    builder: DiagramBuilder, block: LeafSystem, sources: Mapping[str, OutputPort]
) -> None:
    """Connects all inputs of a block to the sources of their names; other sources are left over."""
    for k in range(block.num_input_ports()):
        port = block.get_input_port(k)
        builder.Connect(sources[port.get_name()], port)


def uses_sensor(scenario: Scenario) -> bool:
    """Whether force control feeds back a sensor's wrench; else the estimator's."""
    return scenario.feedback == "sensor" and scenario.force_torque_sensor is not None


def _fed_back_wrench(parts: _LoopParts, estimator: Diagram) -> OutputPort:
    """The wrench (6,) that force control feeds back: the sensor's, or else the estimator's.

    Neither depends on the command of the same tick, so that no loop through it is algebraic.

    Raises:
        InputError: the estimator's would depend on it (`_check_that_estimate_may_be_fed_back`).
    """
    if uses_sensor(parts.scenario):
        return parts.cell.diagram.GetOutputPort("ft_wrench")
    _check_that_estimate_may_be_fed_back(estimator)
    return estimator.GetOutputPort("wrench")


def _add_impedance(parts: _LoopParts, trajectory: JointTrajectory) -> _ControlPorts:
    """Adds an impedance controller along a motion of the joints, with its estimator.

    trajectory --> path_reference --> pose_reference --> controller --> tau_command
    terms of the estimator ---------------------------------^
    force_setpoint, wrench (of sensor or estimator) --------^   with a controlled force

    The terms (M, J, ...) are of the estimator's model. The pose reference and the friction that is
    fed forward are of the controller's: models differ in inertias and friction, not in kinematics.

    Raises:
        InputError: as `_add_impedance_controller` and `_connect_force_control`.
    """
    builder, config, requested = parts.builder, parts.scenario.controller, parts.requested_estimator
    assert isinstance(config, ImpedanceConfig)
    assert requested is not None  # `_check_estimator_request`
    estimator = _add_loop_estimator(parts, requested, _estimator_parts(parts, requested))
    terms = estimator.GetOutputPort("terms")
    reference = builder.AddNamedSystem("path_reference", PathReference(trajectory))
    chain = parts.controller_model.chain(parts.robot)
    pose = builder.AddNamedSystem("pose_reference", PoseReference(chain))
    builder.Connect(reference.get_output_port(), pose.get_input_port())
    controller = _add_impedance_controller(parts, config, q_start=trajectory.q[0])
    builder.Connect(pose.get_output_port(), controller.GetInputPort("pose_reference"))
    builder.Connect(reference.get_output_port(), controller.GetInputPort("reference"))
    builder.Connect(terms, controller.GetInputPort("terms"))
    # The pose follows from the joints' reference: it need not be in the log.
    signals = {"reference": reference.get_output_port()}
    if config.force is not None:
        signals["force_setpoint"] = _connect_force_control(parts, controller, estimator)
    controller_outputs = split_outputs(builder, controller)
    signals["pose_error"] = controller_outputs["pose_error"]
    return _ControlPorts(
        controller=controller,
        tau_command=controller_outputs["tau_command"],
        terms=terms,
        signals=signals,
        readings=_logged_estimator_ports(estimator),
        estimator=estimator,
    )


def _connect_force_control(
    parts: _LoopParts, controller: ImpedanceController, estimator: Diagram
) -> OutputPort:
    """Connects the fed back wrench and the set-point over time, which is added; returns the latter.

    The controller's switches, force_active and feedback_valid, stay open: force control is always
    on, and the fed back wrench always counts, also an estimate that is not valid. With `valid` as a
    switch the force would not be controlled wherever joints rest or turn round. A machining pass
    has a plan of where an estimate counts (`_with_trusted_times`); a motion of the joints has none.

    Returns:
        Port of the set-point, (1,) N.

    Raises:
        InputError: as `_fed_back_wrench`.
    """
    wrench = _fed_back_wrench(parts, estimator)
    parts.builder.Connect(wrench, controller.GetInputPort("wrench"))
    setpoint = TrajectorySource(_setpoint_trajectory(parts.scenario))
    source = parts.builder.AddNamedSystem("force_setpoint", setpoint).get_output_port()
    parts.builder.Connect(source, controller.GetInputPort("force_setpoint"))
    return source


def _add_impedance_controller(
    parts: _LoopParts, config: ImpedanceConfig, q_start: Array
) -> ImpedanceController:
    """Adds an impedance controller, unconnected.

    Raises:
        InputError: its damper would chatter at q_start (n,).
    """
    controller = ImpedanceController(
        friction=parts.controller_model.friction.feedforward,
        effort_limit=parts.robot.effort_limit,
        time_step=parts.scenario.time_step,
        config=config,
    )
    _check_that_damper_is_stable(controller, parts.robot, q_start)
    parts.builder.AddNamedSystem("controller", controller)
    return controller


def _check_that_damper_is_stable(controller: ImpedanceController, robot: Robot, q: Array) -> None:
    """Raises InputError where the damper would chatter at q.

    The stated inertias count: a wrist's, where rotors matter most, are identified poorly.
    """
    start = robot.chain.terms(q, np.zeros(robot.num_joints))
    share = controller.damping_per_tick(start.M, start.J, start.R_WE)
    if share > 1.0:
        raise InputError(
            "scenario",
            "controller.damping",
            f"removes {share:.1f} times the tool's velocity in one time step, expected at most 1",
            "lower the damping (for a light wrist the rotational one), or the time_step",
        )


def _check_that_estimate_may_be_fed_back(estimator: Diagram) -> None:
    """Raises InputError where the wrench depends on the present current, which it would make."""
    current = estimator.GetInputPort("current").get_index()
    wrench = estimator.GetOutputPort("wrench").get_index()
    if estimator.HasDirectFeedthrough(current, wrench):
        raise InputError(
            "scenario",
            "estimator.observer",
            "reads the present torque, which force control would make of its estimate",
            "write torque_samples: held, or feed back a sensor",
        )


def _add_log(builder: DiagramBuilder, signals: dict[str, OutputPort], period: float) -> _SignalLog:
    """Adds one sink for all signals: a sink each would be as many events at every tick."""
    sizes = [port.size() for port in signals.values()]
    multiplexer = builder.AddNamedSystem("signals", Multiplexer(sizes))
    for i, port in enumerate(signals.values()):
        builder.Connect(port, multiplexer.get_input_port(i))
    log = LogVectorOutput(multiplexer.get_output_port(), builder, period)
    log.set_name("log")
    ends = np.cumsum(sizes)
    starts = ends - sizes
    columns = {
        name: slice(int(start), int(end))
        for name, start, end in zip(signals, starts, ends, strict=True)
    }
    return _SignalLog(log, columns)


def _setpoint_trajectory(scenario: Scenario) -> PiecewisePolynomial:
    """The force set-point over the scenario's duration, N."""
    end = scenario.duration + scenario.time_step
    count = max(2, round(end / max(scenario.time_step, 1e-3)) + 1)
    t = np.linspace(0.0, end, count)
    values = setpoint_at(scenario.force_setpoint, t)
    return PiecewisePolynomial.FirstOrderHold(t, values[np.newaxis, :])


def setpoint_at(setpoint: ForceSetpoint, t: Array) -> Array:
    """The force set-point in N at times t (T,)."""
    elapsed = t - setpoint.start
    rise = np.clip(elapsed / setpoint.rise, 0.0, 1.0)
    sine = np.sin(2 * np.pi * setpoint.frequency * np.maximum(elapsed, 0.0))
    return np.asarray(rise * (setpoint.value + setpoint.amplitude * sine))
