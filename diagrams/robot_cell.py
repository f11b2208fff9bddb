"""The robot cell: the true robot in its drives, and whatever stands around it."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from pydrake.geometry import (
    Box,
    CollisionFilterDeclaration,
    GeometrySet,
    Meshcat,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    Role,
    RoleAssign,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    ApplyMultibodyPlantConfig,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import (
    ConstantVectorSource,
    Demultiplexer,
    Gain,
    MatrixGain,
    Saturation,
)

from wrenchsight.diagrams.current_sensor import drives_sensor, export_measured_current
from wrenchsight.diagrams.scenario import BladeConfig, PlateConfig, Scenario
from wrenchsight.diagrams.truth.hard_joints import add_hard_joints, connect_hard_joints, hard_joints
from wrenchsight.diagrams.truth.machined_arm import add_machined_arm
from wrenchsight.diagrams.workpiece import (
    add_blade,
    add_plate,
    contact_material,
    process_contact,
    soft_tip,
)
from wrenchsight.models.arrays import Array
from wrenchsight.models.control.wrench_script import WrenchScript
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.friction.true_friction import DryFriction
from wrenchsight.models.machining.machining_process import MachiningProcess
from wrenchsight.models.robot.motors import motor_gain
from wrenchsight.models.robot.robot import Robot, RobotInPlant
from wrenchsight.models.truth.true_joints import TrueJoints
from wrenchsight.models.truth.true_robot import true_robot
from wrenchsight.systems.external_wrench_source import ExternalWrenchSource
from wrenchsight.systems.force_torque_sensor import ForceTorqueSensor
from wrenchsight.systems.free_joint_friction import FreeJointFriction
from wrenchsight.systems.joint_friction import JointFriction, add_holding_actuators
from wrenchsight.systems.machining.machining_process import MachiningProcessSystem
from wrenchsight.systems.rigid_body_terms import RigidBodyTermsSystem
from wrenchsight.systems.truth.environment_truth import EnvironmentTruth
from wrenchsight.systems.truth.machined_arm import MachinedArm

FLOOR_STIFFNESS = 1e6  # N/m
_FLOOR_COLOUR = np.array([0.86, 0.87, 0.88, 1.0])


@dataclass(frozen=True)
class RobotCell:
    """The cell and the parts of it that a caller may want.

    Attributes:
        diagram: see make_robot_cell.
        plant: the plant in it.
        parts: the robot's model instance, joints, actuators and frame E.
        friction: the true friction; None where the scenario has none.
        script: the wrench that acts on the tool, as a function of time.
    """

    diagram: Diagram
    plant: MultibodyPlant
    parts: RobotInPlant
    friction: DryFriction | None
    script: WrenchScript


def make_robot_cell(
    scenario: Scenario,
    robot: Robot,
    q_0: ArrayLike,
    meshcat: Meshcat | None = None,
    with_brakes: bool | None = None,
    fused: bool = False,
    apart: Collection[str] = (),
) -> RobotCell:
    """Builds the true robot with its tool, drives, sensors and surroundings.

                         +------------+ --> q, v             (n,) encoders, rad, rad/s
                         |            | --> current          (n,) A, as the drives report it
                         |            | --> ft_wrench        (6,) sensor, where there is one
      current_command -->| robot_cell | --> state            (2n,) q and v
        (n,) A           |            | --> tau_J_true       (n,) N m
                         |            | --> tau_f_true       (n,) N m, where there is friction
                         |            | --> tau_ext_true     (n,) N m
                         |            | --> wrench_true      (6,) F_E_W, N m, N
                         +------------+ --> wrench_unbalance (6,) of a spindle, when machining

    The ports `*_true` are for measuring errors: no estimator may see them. Every 6-vector is
    rotation first. The plant is discrete at the scenario's time step and does not sample its
    outputs: all blocks see the state before the step, and a force at time t acts from t to
    t + time_step. The drives saturate at the robot's effort limits.

    Args:
        scenario: what stands in the cell, and what acts on the tool.
        robot: the true robot.
        q_0: (n,) rad, where its encoders are at the start, at rest.
        meshcat: draws the cell into it; without it there are no pictures.
        with_brakes: whether dry friction is solved by the plant together with contact
            (`JointFriction`), or without it (`FreeJointFriction`), which is faster and the same
            where nothing touches; by default with brakes where there is something to touch.
        fused: whether machining, joints and sensors are one block where they can be: with the
            mechanisms of real joints and without a scripted wrench. The same numbers, sooner.
        apart: names of links that never come near anything: contact is not looked for at them.

    Raises:
        InputError: a sensor without a tool to sit on, or true friction out of range.
    """
    builder = DiagramBuilder()
    touches = scenario.workpiece is not None or scenario.floor
    with_brakes = touches if with_brakes is None else with_brakes
    joints = hard_joints(scenario, robot)
    true = robot if joints is None else true_robot(robot)
    plant, scene_graph = _add_plant(builder, scenario, touches or meshcat is not None)
    parts = true.add_to_plant(plant)
    friction = true_friction(scenario, robot)
    if friction is not None and with_brakes and joints is None:
        add_holding_actuators(plant, parts.joints, parts.actuators, friction)
    else:
        for i, joint in enumerate(parts.joints):
            # Joints with mechanisms have their viscous friction in themselves.
            damped = friction if joints is None else None
            joint.set_default_damping(0.0 if damped is None else damped.viscous[i])
    if isinstance(scenario.workpiece, BladeConfig):
        add_blade(plant, scenario.workpiece)
    elif scenario.workpiece is not None:
        add_plate(plant, scenario.workpiece)
    if scene_graph is not None:
        _add_floor(plant, solid=scenario.floor)
    plant.Finalize()
    q_0 = np.asarray(q_0, dtype=np.float64)
    if joints is not None:  # the encoders read q_0, their gears bent by the arm's weight
        q_0 = joints.links_at(q_0, true.chain)
    plant.SetDefaultPositions(parts.model_instance, q_0)
    if scene_graph is not None:
        _prepare_contact(plant, scene_graph, parts, scenario, apart)
        if meshcat is None:
            _remove_pictures(plant, scene_graph)

    script = WrenchScript(scenario.wrench, scenario.seed, "scenario")
    if fused and joints is not None and scenario.machining is not None and not script.segments:
        sensor = _force_torque_sensor(plant, parts, scenario, robot)
        block = MachinedArm(
            true.chain,
            joints,
            scenario.seed,
            _environment_truth(scenario, robot, plant, parts),
            _machining_process(scenario, plant, parts, scripted=False),
            drives_sensor(scenario, robot),
            sensor,
            scenario.seed,
        )
        add_machined_arm(builder, robot, plant, parts, block, sensor is not None)
    else:
        _add_blocks(
            builder, scenario, robot, true, plant, parts, joints, friction, script, with_brakes
        )
    if meshcat is not None and scene_graph is not None:
        parameters = MeshcatVisualizerParams(publish_period=1.0 / scenario.recording.fps)
        MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat, parameters)
    diagram = builder.Build()
    diagram.set_name("robot_cell")
    return RobotCell(diagram, plant, parts, friction, script)


def _add_blocks(
    builder: DiagramBuilder,
    scenario: Scenario,
    robot: Robot,
    true: Robot,
    plant: MultibodyPlant,
    parts: RobotInPlant,
    joints: TrueJoints | None,
    friction: DryFriction | None,
    script: WrenchScript,
    with_brakes: bool,
) -> None:
    """Joints, sensors and surroundings, each in a block of its own; exports their ports."""
    touches = scenario.workpiece is not None or scenario.floor
    n = robot.num_joints
    state = plant.get_state_output_port(parts.model_instance)
    split = builder.AddNamedSystem("encoders", Demultiplexer([n, n]))
    terms = builder.AddNamedSystem("true_terms", RigidBodyTermsSystem(true.chain))
    builder.Connect(state, split.get_input_port())
    for i, name in enumerate(("q", "v")):
        if joints is None:
            builder.ExportOutput(split.get_output_port(i), name)
        builder.Connect(split.get_output_port(i), terms.GetInputPort(name))
    builder.ExportOutput(state, "state")

    if joints is None:
        tau_J = _add_drives(builder, scenario, robot)
        builder.ExportOutput(tau_J, "tau_J_true")
    else:
        block = add_hard_joints(builder, scenario, joints, touches)
    tau_ext = _add_environment(builder, scenario, robot, plant, parts, script, terms, touches)
    if joints is not None:
        connect_hard_joints(
            builder, scenario, robot, plant, parts, block, terms.get_output_port(), tau_ext
        )
    elif friction is not None and with_brakes:
        _connect_with_brakes(builder, plant, parts, tau_J)
        _add_friction(builder, plant, parts, friction, tau_J)
    else:
        builder.Connect(tau_J, plant.get_actuation_input_port(parts.model_instance))
        if friction is not None:
            block = builder.AddNamedSystem(
                "joint_friction", FreeJointFriction(friction, scenario.time_step)
            )
            builder.Connect(terms.get_output_port(), block.GetInputPort("terms"))
            builder.Connect(tau_J, block.GetInputPort("tau_J"))
            builder.Connect(tau_ext, block.GetInputPort("tau_ext"))
            builder.Connect(
                block.GetOutputPort("torque"), plant.get_applied_generalized_force_input_port()
            )
            builder.ExportOutput(block.GetOutputPort("tau_f_true"), "tau_f_true")
    _add_force_torque_sensor(builder, plant, parts, scenario, robot, terms.get_output_port())


def _environment_truth(
    scenario: Scenario, robot: Robot, plant: MultibodyPlant, parts: RobotInPlant
) -> EnvironmentTruth:
    tool = tool_body(plant, parts)
    geometries = plant.GetCollisionGeometriesForBody(tool)
    radius = tip_radius(robot) if scenario.machining is not None else 0.0
    return EnvironmentTruth(len(parts.actuators), tool.index(), geometries, radius)


def _machining_process(
    scenario: Scenario, plant: MultibodyPlant, parts: RobotInPlant, scripted: bool
) -> MachiningProcessSystem:
    assert scenario.machining is not None and scenario.workpiece is not None
    ends = (scenario.machining.start, scenario.machining.end)
    return MachiningProcessSystem(
        MachiningProcess(
            scenario.machining.process,
            contact=process_contact(scenario.workpiece, ends),
            time_step=scenario.time_step,
        ),
        tool_body(plant, parts).index(),
        _p_BE(plant, parts),
        scenario.time_step,
        scripted,
    )


def _add_environment(
    builder: DiagramBuilder,
    scenario: Scenario,
    robot: Robot,
    plant: MultibodyPlant,
    parts: RobotInPlant,
    script: WrenchScript,
    true_terms: RigidBodyTermsSystem,
    touches: bool,
) -> OutputPort:
    """What acts on the robot from outside; exports the truth of it, and returns tau_ext_true."""
    n, terms = len(parts.actuators), true_terms.get_output_port()
    if not script.segments and not touches:
        for name, size in (("wrench_true", 6), ("tau_ext_true", n)):
            nothing = builder.AddNamedSystem(f"no_{name}", ConstantVectorSource(np.zeros(size)))
            builder.ExportOutput(nothing.get_output_port(), name)
        return nothing.get_output_port()
    tool = tool_body(plant, parts)
    source = builder.AddNamedSystem(
        "external_wrench", ExternalWrenchSource(script, tool.index(), _p_BE(plant, parts))
    )
    truth = builder.AddNamedSystem("truth", _environment_truth(scenario, robot, plant, parts))
    # Split up by Drake: a port of its own for each signal is as many calls into Python at a tick.
    parts_of_truth = builder.AddNamedSystem("truth_parts", Demultiplexer(truth.sizes(n)))
    builder.Connect(truth.GetOutputPort("truth"), parts_of_truth.get_input_port())
    wrench_true, tau_ext_true, contact = (parts_of_truth.get_output_port(i) for i in range(3))
    applied, forces = source.GetOutputPort("wrench_true"), source.GetOutputPort("spatial_forces")
    if scenario.machining is not None:
        process = builder.AddNamedSystem(
            "process", _machining_process(scenario, plant, parts, bool(script.segments))
        )
        builder.Connect(terms, process.GetInputPort("terms"))
        builder.Connect(contact, process.GetInputPort("contact"))
        if script.segments:
            builder.Connect(applied, process.GetInputPort("wrench_applied"))
        applied, forces = process.GetOutputPort("wrench"), process.GetOutputPort("spatial_forces")
        builder.ExportOutput(process.GetOutputPort("wrench_unbalance"), "wrench_unbalance")
    if script.segments or scenario.machining is not None:
        builder.Connect(forces, plant.get_applied_spatial_force_input_port())
    builder.Connect(terms, truth.GetInputPort("terms"))
    builder.Connect(applied, truth.GetInputPort("wrench_applied"))
    if touches:
        builder.Connect(
            plant.get_generalized_contact_forces_output_port(parts.model_instance),
            truth.GetInputPort("tau_contact"),
        )
        builder.Connect(
            plant.get_contact_results_output_port(), truth.GetInputPort("contact_results")
        )
    builder.ExportOutput(tau_ext_true, "tau_ext_true")
    builder.ExportOutput(wrench_true, "wrench_true")
    return tau_ext_true


def _add_plant(
    builder: DiagramBuilder, scenario: Scenario, with_scene: bool
) -> tuple[MultibodyPlant, SceneGraph | None]:
    """The plant; without a SceneGraph, which costs time, where nothing touches or is drawn."""
    config = MultibodyPlantConfig(
        time_step=scenario.time_step,
        discrete_contact_approximation="lagged",
        contact_model="hydroelastic_with_fallback",  # patches with a blade, else points
        use_sampled_output_ports=False,
    )
    if with_scene:
        plant, scene_graph = AddMultibodyPlant(config, builder)
        scene_graph.set_name("scene_graph")
    else:
        plant, scene_graph = builder.AddSystem(MultibodyPlant(config.time_step)), None
        ApplyMultibodyPlantConfig(config, plant)
    plant.set_name("plant")
    return plant, scene_graph


def tool_body(plant: MultibodyPlant, parts: RobotInPlant) -> RigidBody:
    """The body that the environment touches: the tool, or what E is fixed to without one."""
    if parts.tool_weld is None:
        return parts.frame_E.body()
    return plant.get_joint(parts.tool_weld).child_body()


def tip_radius(robot: Robot) -> float:
    """Radius of the ball at the tool's tip, m.

    Raises:
        InputError: the tool has none.
    """
    tool = robot.config.tool
    balls = [shape.sphere for shape in tool.collision if shape.sphere is not None] if tool else []
    if len(balls) != 1:
        raise InputError(
            robot.source,
            "tool.collision",
            f"holds {len(balls)} spheres, and machining needs one: the tool's tip",
            "give the tool a ball at E",
        )
    return float(balls[0])


def _p_BE(plant: MultibodyPlant, parts: RobotInPlant) -> Array:
    context = plant.CreateDefaultContext()
    X_WB = tool_body(plant, parts).EvalPoseInWorld(context)
    X_BE = X_WB.InvertAndCompose(parts.frame_E.CalcPoseInWorld(context))
    return np.array(X_BE.translation())


def true_friction(scenario: Scenario, robot: Robot) -> DryFriction | None:
    """The friction of the scenario's robot; None where it has none."""
    if scenario.friction == "none":
        return None
    truth = robot.truth
    none = np.zeros(robot.num_joints)
    full = scenario.friction == "full"
    return DryFriction(
        # A robot file may leave stiction out: then breakaway is at Coulomb level.
        stiction=np.maximum(truth.stiction, truth.coulomb) if full else truth.coulomb,
        coulomb=truth.coulomb,
        stribeck_velocity=truth.stribeck_velocity,
        viscous=truth.viscous,
        load_dependence=truth.load_dependence if full else none,
        ripple_amplitude=truth.ripple_amplitude if full else none,
        ripple_periods=truth.ripple_periods,
    )


def _add_floor(plant: MultibodyPlant, solid: bool) -> None:
    """The floor, as drawn; a solid one can be touched as well."""
    body = plant.world_body()
    slab, X_WV = Box(1.6, 1.6, 0.02), RigidTransform([0.0, 0.0, -0.01])
    plant.RegisterVisualGeometry(body, X_WV, slab, "floor", _FLOOR_COLOUR)
    if solid:
        X_WG = RigidTransform([0.0, 0.0, -0.1])
        material = contact_material(FLOOR_STIFFNESS, 100.0, 0.5)
        plant.RegisterCollisionGeometry(body, X_WG, Box(4.0, 4.0, 0.2), "floor", material)


def _remove_pictures(plant: MultibodyPlant, scene_graph: SceneGraph) -> None:
    """Takes shapes that are only seen out of the scene, which moves every shape at every tick."""
    inspector, source = scene_graph.model_inspector(), plant.get_source_id()
    solid = set(inspector.GetAllGeometryIds(Role.kProximity))
    for geometry in inspector.GetAllGeometryIds():
        if geometry not in solid and inspector.BelongsToSource(geometry, source):
            scene_graph.RemoveGeometry(source, geometry)


def _prepare_contact(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    parts: RobotInPlant,
    scenario: Scenario,
    apart: Collection[str],
) -> None:
    """Links do not touch each other; they meet the workpiece with the workpiece's own material.

    At a blade only the ball at the tool's tip makes contact: the links pass through the blade.
    """
    inspector = scene_graph.model_inspector()
    touches = scenario.workpiece is not None or scenario.floor
    workpiece = scenario.workpiece
    blade = workpiece if isinstance(workpiece, BladeConfig) else None
    plate = workpiece if isinstance(workpiece, PlateConfig) else PlateConfig()
    material = contact_material(plate.stiffness, plate.dissipation, plate.friction)
    source, links = plant.get_source_id(), GeometrySet()
    for index in plant.GetBodyIndices(parts.model_instance):
        body = plant.get_body(index)
        for geometry in plant.GetCollisionGeometriesForBody(body):
            if blade is not None:
                # A mesh is touched by patches alone: only the tip has a shape that makes them.
                shape = inspector.GetShape(geometry)
                if isinstance(shape, Sphere) and index == tool_body(plant, parts).index():
                    tip = soft_tip(blade, shape.radius())
                    scene_graph.AssignRole(source, geometry, tip, RoleAssign.kReplace)
                    links.Add(geometry)
                else:
                    scene_graph.RemoveRole(source, geometry, Role.kProximity)
            elif touches and body.name() not in apart:
                scene_graph.AssignRole(source, geometry, material, RoleAssign.kReplace)
                links.Add(geometry)
            else:
                # With nothing to touch, contact need not be looked for at every tick.
                scene_graph.RemoveRole(source, geometry, Role.kProximity)
    filters = scene_graph.collision_filter_manager()
    filters.Apply(CollisionFilterDeclaration().ExcludeWithin(links))
    if scenario.floor:
        # What the robot stands on always touches the floor.
        foot = GeometrySet(plant.GetCollisionGeometriesForBody(parts.joints[0].parent_body()))
        floor = [
            geometry
            for geometry in inspector.GetAllGeometryIds(Role.kProximity)
            if inspector.GetName(geometry).endswith("floor")
        ]
        filters.Apply(CollisionFilterDeclaration().ExcludeBetween(foot, GeometrySet(floor)))


def _add_drives(builder: DiagramBuilder, scenario: Scenario, robot: Robot) -> OutputPort:
    """From the commanded current to the motor torque; exports the measured current."""
    limit = robot.current_limit
    drives = builder.AddNamedSystem("drives", Saturation(-limit, limit))
    builder.ExportInput(drives.get_input_port(), "current_command")
    gain = motor_gain(robot.torque_per_ampere, robot.current_sign)
    motors = MatrixGain(robot.motor_rates.T * gain) if robot.is_coupled else Gain(gain)
    torque = builder.AddNamedSystem("motors", motors)
    builder.Connect(drives.get_output_port(), torque.get_input_port())
    export_measured_current(builder, scenario, robot, drives.get_output_port())
    return torque.get_output_port()


def _connect_with_brakes(
    builder: DiagramBuilder, plant: MultibodyPlant, parts: RobotInPlant, tau_J: OutputPort
) -> None:
    """The motors come first; the desired state of the brakes behind them is rest."""
    n = len(parts.actuators)
    spread = builder.AddNamedSystem("actuation", MatrixGain(np.eye(2 * n, n)))
    builder.Connect(tau_J, spread.get_input_port())
    builder.Connect(spread.get_output_port(), plant.get_actuation_input_port(parts.model_instance))
    desired = plant.get_desired_state_input_port(parts.model_instance)
    rest = builder.AddNamedSystem("rest", ConstantVectorSource(np.zeros(desired.size())))
    builder.Connect(rest.get_output_port(), desired)


def _add_friction(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    parts: RobotInPlant,
    friction: DryFriction,
    tau_J: OutputPort,
) -> None:
    n = len(parts.actuators)
    block = builder.AddNamedSystem("joint_friction", JointFriction(friction))
    net = plant.get_net_actuation_output_port(parts.model_instance)
    split = builder.AddNamedSystem("holding", Demultiplexer([n, n]))
    builder.Connect(net, split.get_input_port())
    builder.Connect(split.get_output_port(1), block.GetInputPort("tau_holding"))
    builder.Connect(tau_J, block.GetInputPort("tau_J"))
    state = plant.get_state_output_port(parts.model_instance)
    builder.Connect(state, block.GetInputPort("state"))
    builder.Connect(
        block.GetOutputPort("explicit_torque"), plant.get_applied_generalized_force_input_port()
    )
    builder.ExportOutput(block.GetOutputPort("tau_f_true"), "tau_f_true")


def _force_torque_sensor(
    plant: MultibodyPlant, parts: RobotInPlant, scenario: Scenario, robot: Robot
) -> ForceTorqueSensor | None:
    config = scenario.force_torque_sensor
    if config is None:
        return None
    if parts.tool_weld is None:
        raise InputError(
            "scenario",
            "force_torque_sensor",
            f"{robot.name} has no tool for it to sit under",
            "add a tool to robot.yaml, or leave the sensor out",
        )
    noisy = config.force_noise_sd > 0 or config.moment_noise_sd > 0
    return ForceTorqueSensor(
        plant,
        parts.tool_weld,
        parts.frame_E,
        config,
        robot.num_joints,
        scenario.time_step,
        # Another stream than the drives': the same number would make the two noises one.
        scenario.seed + 2**32 if noisy else None,
    )


def _add_force_torque_sensor(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    parts: RobotInPlant,
    scenario: Scenario,
    robot: Robot,
    terms: OutputPort,
) -> None:
    sensor = _force_torque_sensor(plant, parts, scenario, robot)
    if sensor is None:
        return
    builder.AddNamedSystem("force_torque_sensor", sensor)
    for name, port in (
        ("reaction_forces", plant.get_reaction_forces_output_port()),
        ("terms", terms),
        ("vdot", plant.get_generalized_acceleration_output_port(parts.model_instance)),
    ):
        builder.Connect(port, sensor.GetInputPort(name))
    builder.ExportOutput(sensor.GetOutputPort("wrench"), "ft_wrench")
