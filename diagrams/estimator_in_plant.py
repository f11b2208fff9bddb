"""The wrench estimator of an arm in anyone's MultibodyPlant."""

from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, ModelInstanceIndex, RigidBody
from pydrake.systems.framework import (
    Diagram,
    DiagramBuilder,
    InputPort,
    LeafSystem,
    OutputPort,
)
from pydrake.systems.primitives import MatrixGain, Saturation

from wrenchsight.diagrams.arm_in_plant import ArmInPlant
from wrenchsight.diagrams.estimator import check_ports, make_estimator
from wrenchsight.models.detection.contact_detector import ContactDetectionConfig
from wrenchsight.models.estimation.estimator import WrenchEstimatorConfig
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot_config import DriveConfig

_MAX_ROUNDING = 1e-6
"""Largest part of a plant's step by which a period may miss a multiple of it: above what rounding
makes of steps such as 1/3 ms, far below a step."""
DEFAULT_TIME_STEP = 1e-3
"""s, period of the estimator of an arm in a continuous plant."""


def add_estimator(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    model_instance: ModelInstanceIndex | None = None,
    *,
    frame_E: Frame | None = None,
    arm: ArmInPlant | None = None,
    drives: Sequence[DriveConfig] | None = None,
    base: RigidBody | None = None,
    payload: float | None = None,
    in_base_axes: bool = False,
    model: IdentifiedModel | None = None,
    config: WrenchEstimatorConfig | None = None,
    actuation: OutputPort | None = None,
    current: OutputPort | None = None,
    name: str = "estimator",
    fused: bool = False,
    detection: ContactDetectionConfig | None = None,
    stages: Mapping[str, LeafSystem] | None = None,
) -> Diagram:
    """Adds the estimator of an arm in `plant`, wired to the plant's state and to what drives it.

        plant.state --------> q, v ----> +-----------+
                                         | estimator | --> wrench, covariance, valid, ...
        what drives it -----> current -> +-----------+

    The plant may have Drake's defaults (sampled output ports), sample nothing, or be continuous.
    The wrench F_E_W is what the environment exerts on the arm at E, [mx my mz fx fy fz], in axes of
    the plant's World.

    A simulated arm has no current: its motor torque, which drives the plant, takes the place. It is
    divided by the drives' torque per ampere where these are stated, and by 1 N m/A where they are
    not, and the estimator multiplies it by the same. It is the port that is connected to the
    plant's actuation when this function is called, or `actuation`. If neither exists, because the
    controller needs the estimator, connect the controller's torque afterwards to
    `builder.GetSubsystemByName(name + "_current")`.

    Besides the estimator, `builder` gets systems whose names begin with its own: they pick q and v
    out of the state, and turn the torque into the current and clip it at the effort limits.

    Args:
        builder: with the plant, and with what drives it if that is there already.
        plant: finalized, in `builder`.
        model_instance, frame_E, drives, base, payload: as `ArmInPlant`.
        arm: arm of this plant, in the place of those; with it none of them is given.
        in_base_axes: the wrench is in axes of the arm's base, F_E_B, as for a log.
        model: None: what the plant states, `ArmInPlant.nominal_model`.
        config: None: its defaults at the plant's time step (DEFAULT_TIME_STEP of a continuous one).
        actuation: (n_u,) N m of the instance's actuators, in the place of what drives the plant.
        current: (n,) A of the motors, such as of a MotorCurrentSensor, in the place of torque;
            `drives` or the arm state its torque per ampere, 1 N m/A otherwise.
        name, fused, detection, stages: as `make_estimator`.

    Returns:
        the estimator, a subsystem of `builder`.

    Raises:
        InputError: as `ArmInPlant`; the model belongs to another arm.
        ValueError: as `make_estimator` and `check_ports`; the plant is not in `builder`; the arm is
            of another plant, or given together with what describes one; actuation and current are
            both given, or actuation has not an entry for each actuator; the period is no multiple
            of the plant's time step.
    """
    # Only what this function adds to the request is checked here: `ArmInPlant` checks what
    # describes an arm, `check_ports` the name, `make_estimator` the model.
    _check_signals(builder, plant, actuation, current, name)
    description = (model_instance, frame_E, drives, base, payload)
    if arm is None:
        arm = ArmInPlant(plant, model_instance, frame_E, drives, base=base, payload=payload)
    elif arm.plant is not plant or any(part is not None for part in description):
        raise ValueError(
            f"{name}: give an arm of this plant, or model_instance, frame_E, drives, base and "
            "payload, not both"
        )
    # Of the same joints and drives: only the axes of its wrench are others.
    estimated_arm = arm.in_base_axes() if in_base_axes else arm
    _check_actuation(actuation, estimated_arm, name)
    check_ports(builder, estimated_arm, {"current": current}, name)
    # All that may be refused comes before a system is added: a call that failed can be repeated.
    selectors = estimated_arm.state_selector()
    to_current = _torque_to_current(estimated_arm) if current is None else None
    estimator = make_estimator(
        estimated_arm,
        estimated_arm.nominal_model() if model is None else model,
        _config_at_plant_rate(plant, config, name),
        name=name,
        fused=fused,
        detection=detection,
        stages=stages,
    )
    builder.AddSystem(estimator)
    state = plant.get_state_output_port(estimated_arm.model_instance)
    for signal, rows in zip(("q", "v"), selectors, strict=True):
        selected = _selected(builder, state, rows, f"{name}_{signal}")
        builder.Connect(selected, estimator.GetInputPort(signal))
    if to_current is not None:
        current = _motor_current(builder, estimated_arm, to_current, actuation, name)
    builder.Connect(current, estimator.GetInputPort("current"))
    return estimator


def _check_signals(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    actuation: OutputPort | None,
    current: OutputPort | None,
    name: str,
) -> None:
    """Raises ValueError where the plant is not in the builder, or torque and current are given."""
    if plant not in builder.GetSystems():
        raise ValueError(
            f"{name}: {plant.get_name() or 'the plant'} is not in this builder; give "
            "make_estimator(ArmInPlant(plant, ...), model) the ports that its diagram exports"
        )
    if actuation is not None and current is not None:
        raise ValueError(f"{name}: give actuation or current, not both")


def _check_actuation(actuation: OutputPort | None, arm: ArmInPlant, name: str) -> None:
    """Raises ValueError where a port of torque has not an entry for each actuator of the arm."""
    num_actuators = arm.plant.num_actuated_dofs(arm.model_instance)
    if actuation is not None and actuation.size() != num_actuators:
        raise ValueError(
            f"{name}: actuation must have {num_actuators} entries, one an actuator of "
            f"{arm.source}, and has {actuation.size()}"
        )


def _selected(builder: DiagramBuilder, state: OutputPort, rows: Array, name: str) -> OutputPort:
    """The entries of a state that rows (n, n_state) of zeros and ones pick, by a system `name`."""
    selector = builder.AddNamedSystem(name, MatrixGain(rows))
    builder.Connect(state, selector.get_input_port())
    return selector.get_output_port()


def _config_at_plant_rate(
    plant: MultibodyPlant, config: WrenchEstimatorConfig | None, name: str
) -> WrenchEstimatorConfig:
    """The configuration, at a period that is a multiple of the plant's time step.

    Args:
        config: checked; None: the default one, at the plant's time step.

    Raises:
        ValueError: its period is no multiple of the plant's time step.
    """
    time_step = plant.time_step()  # s; 0 of a continuous plant, which may be sampled at any period
    if config is None:
        period = time_step if time_step > 0.0 else DEFAULT_TIME_STEP
        return WrenchEstimatorConfig().with_time_step(period)
    ticks = config.observer.time_step / time_step if time_step > 0.0 else 1.0
    if not np.isfinite(ticks) or abs(ticks - max(round(ticks), 1)) > _MAX_ROUNDING:
        raise ValueError(
            f"{name}: the observer's time_step is {config.observer.time_step:g} s, and the plant "
            f"steps every {time_step:g} s: take a multiple of it"
        )
    return config


def _motor_current(
    builder: DiagramBuilder,
    arm: ArmInPlant,
    to_current: LeafSystem | Diagram,
    actuation: OutputPort | None,
    name: str,
) -> OutputPort:
    """The motors' current, from `actuation` or the torque that drives the plant, (n_u,) N m.

    Args:
        to_current: of `_torque_to_current`, added here.
    """
    builder.AddNamedSystem(f"{name}_current", to_current)
    source = _actuation_source(builder, arm) if actuation is None else actuation
    if source is not None:
        builder.Connect(source, to_current.get_input_port())
    return to_current.get_output_port()


def _torque_to_current(arm: ArmInPlant) -> LeafSystem | Diagram:
    """From the instance's actuation, (n_u,) N m, to the motors' current (n,) A.

    `ArmInPlant.current_selector` divides by the torque per ampere of the arm's drives, which the
    estimator multiplies by. A controller, also one that is connected afterwards, may ask for more
    than the plant applies: it is clipped as there, each actuator by itself (a joint may have
    several).
    """
    gain = MatrixGain(arm.current_selector())
    limit = arm.actuator_limits()
    if not np.isfinite(limit).any():
        return gain
    inner = DiagramBuilder()
    clipped = inner.AddNamedSystem("effort", Saturation(-limit, limit))
    to_current = inner.AddNamedSystem("current", gain)
    inner.Connect(clipped.get_output_port(), to_current.get_input_port())
    inner.ExportInput(clipped.get_input_port(), "actuation")
    inner.ExportOutput(to_current.get_output_port(), "current")
    return inner.Build()


def _actuation_source(builder: DiagramBuilder, arm: ArmInPlant) -> OutputPort | None:
    """The port that drives the arm's actuators; None: none is connected yet."""
    plant, instance = arm.plant, arm.model_instance
    if plant.get_desired_state_input_port(instance).size() > 0 and _source_of(
        builder, plant.get_desired_state_input_port(instance)
    ):
        # The plant's own controllers act, too.
        return plant.get_net_actuation_output_port(instance)
    of_instance = _source_of(builder, plant.get_actuation_input_port(instance))
    if of_instance is not None:
        return of_instance
    of_all = _source_of(builder, plant.get_actuation_input_port())
    if of_all is None:
        return None
    rows = np.zeros((plant.num_actuated_dofs(instance), plant.num_actuators()))
    for k, index in enumerate(plant.GetJointActuatorIndices(instance)):
        rows[k, plant.get_joint_actuator(index).input_start()] = 1.0
    selector = builder.AddSystem(MatrixGain(rows))
    builder.Connect(of_all, selector.get_input_port())
    return selector.get_output_port()


def _source_of(builder: DiagramBuilder, port: InputPort) -> OutputPort | None:
    """What an input port of a system in `builder` is connected to."""
    source = builder.connection_map().get((port.get_system(), port.get_index()))
    if source is None:
        return None
    system, index = source
    return system.get_output_port(index)
