"""The robot cell: the true robot with drives and sensors, and its surroundings."""

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
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, Demultiplexer, Saturation

from wrenchsight.diagrams.scenario import BladeConfig, PlateConfig, Scenario
from wrenchsight.diagrams.workpiece import (
    add_workpiece,
    contact_material,
    process_contact,
    soft_tip,
)
from wrenchsight.models.control.wrench_script import WrenchScript
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.machining.machining_process import MachiningProcess
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot, RobotInPlant
from wrenchsight.models.truth.true_joints import TrueJoints
from wrenchsight.models.truth.true_robot import true_robot, with_friction
from wrenchsight.systems.force_torque_sensor import ForceTorqueSensor
from wrenchsight.systems.truth.tool_contacts import ToolContacts
from wrenchsight.systems.truth.true_arm import ArmParts, TrueArm

FLOOR_STIFFNESS = 1e6  # N/m
_FLOOR_COLOUR = np.array([0.86, 0.87, 0.88, 1.0])


@dataclass(frozen=True)
class RobotCell:
    """The cell and its parts.

    Attributes:
        diagram: see make_robot_cell.
        plant: the plant in it.
        parts: the robot's model instance, joints, actuators and frame E.
        joints: the true joints.
        script: the wrench that acts on the tool, as a function of time.
    """

    diagram: Diagram
    plant: MultibodyPlant
    parts: RobotInPlant
    joints: TrueJoints
    script: WrenchScript


def make_robot_cell(
    scenario: Scenario,
    robot: Robot,
    q_0: ArrayLike,
    meshcat: Meshcat | None = None,
    clear_links: Collection[str] = (),
) -> RobotCell:
    """Builds the true robot with its tool, drives, sensors and surroundings.

                         +------------+ --> q, v             (n,) encoders, rad, rad/s
                         |            | --> current          (n,) A, as the drives report it
                         |            | --> ft_wrench        (6,) sensor, where there is one
      current_command -->| robot_cell | --> state            (2n,) q and v
        (n,) A           |            | --> tau_J_true       (n,) N m
                         |            | --> tau_f_true       (n,) N m
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
        clear_links: names of links that never touch anything: they are left out of contact.

    Raises:
        InputError: a sensor without a tool to sit on, or true friction out of range.
    """
    builder = DiagramBuilder()
    has_contact = scenario.workpiece is not None or scenario.floor
    robot = with_friction(robot, scenario.friction)
    joints = TrueJoints.of(robot, scenario.time_step)
    true_model = true_robot(robot)
    plant, scene_graph = _add_plant(builder, scenario, has_contact or meshcat is not None)
    parts = true_model.add_to_plant(plant)
    for joint in parts.joints:  # viscous friction is the true joints'
        joint.set_default_damping(0.0)
    if scenario.workpiece is not None:
        add_workpiece(plant, scenario.workpiece)
    if scene_graph is not None:
        _add_floor(plant, solid=scenario.floor)
    plant.Finalize()
    # The encoders read q_0, their gears bent by the arm's weight.
    q_start = joints.links_at(np.asarray(q_0, dtype=np.float64), true_model.chain)
    plant.SetDefaultPositions(parts.model_instance, q_start)
    if scene_graph is not None:
        _prepare_contact(plant, scene_graph, parts, scenario, clear_links)
        if meshcat is None:
            _remove_pictures(plant, scene_graph)

    script = WrenchScript(scenario.wrench, scenario.seed, "scenario")
    sensor = _force_torque_sensor(plant, parts, scenario, robot)
    arm = TrueArm(
        ArmParts(
            chain=true_model.chain,
            joints=joints,
            tool_body=tool_body(plant, parts).index(),
            p_BE=_p_BE(plant, parts),
            script=script,
            contacts=_tool_contacts(scenario, robot, plant, parts) if has_contact else None,
            process=_machining_process(scenario),
            current=_current_sensor(robot) if scenario.current_noise else None,
            sensor=sensor,
            seed=scenario.seed,
        )
    )
    _connect_arm(builder, robot, plant, parts, arm, has_contact, sensor is not None)
    if meshcat is not None and scene_graph is not None:
        parameters = MeshcatVisualizerParams(publish_period=1.0 / scenario.recording.fps)
        MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat, parameters)
    diagram = builder.Build()
    diagram.set_name("robot_cell")
    return RobotCell(diagram, plant, parts, joints, script)


def _connect_arm(
    builder: DiagramBuilder,
    robot: Robot,
    plant: MultibodyPlant,
    parts: RobotInPlant,
    arm: TrueArm,
    has_contact: bool,
    has_sensor: bool,
) -> None:
    """Adds the true arm, connects it with drives and plant, and exports the cell's ports.

    Args:
        has_contact: whether there is something to touch.
        has_sensor: whether there is a force/torque sensor.
    """
    n = robot.num_joints
    builder.AddNamedSystem("true_arm", arm)
    drives = builder.AddNamedSystem("drives", Saturation(-robot.current_limit, robot.current_limit))
    builder.ExportInput(drives.get_input_port(), "current_command")
    state = plant.get_state_output_port(parts.model_instance)
    arm_inputs = {"state": state, "current_command": drives.get_output_port()}
    if has_contact:
        arm_inputs["contact_results"] = plant.get_contact_results_output_port()
        arm_inputs["tau_contact"] = plant.get_generalized_contact_forces_output_port(
            parts.model_instance
        )
    if has_sensor:
        arm_inputs["reaction_forces"] = plant.get_reaction_forces_output_port()
        arm_inputs["vdot"] = plant.get_generalized_acceleration_output_port(parts.model_instance)
    for name, port in arm_inputs.items():
        builder.Connect(port, arm.GetInputPort(name))
    # Split up by Drake: a port of its own for each signal is as many calls into Python at a tick.
    parts_of = {}
    sizes = {"motion": list(arm.motion_sizes.values()), "drives": arm.drive_sizes}
    if has_contact:
        sizes["truth"] = arm.truth_sizes
    for name, part_sizes in sizes.items():
        demultiplexer = builder.AddNamedSystem(f"{name}_parts", Demultiplexer(part_sizes))
        builder.Connect(arm.GetOutputPort(name), demultiplexer.get_input_port())
        parts_of[name] = [demultiplexer.get_output_port(i) for i in range(len(part_sizes))]
    motion = dict(zip(arm.motion_sizes, parts_of["motion"], strict=True))
    wrench_true, tau_ext_true = motion["wrench"], motion["torque"]
    tau_J, torque, tau_f, _, current, _ = parts_of["drives"]
    builder.Connect(tau_J, plant.get_actuation_input_port(parts.model_instance))
    builder.Connect(torque, plant.get_applied_generalized_force_input_port())
    outputs = {"q": motion["q_read"], "v": motion["v_read"], "state": state, "current": current}
    outputs |= {"tau_J_true": tau_J, "tau_f_true": tau_f}
    if has_contact:
        wrench_true, tau_ext_true, _ = parts_of["truth"]
    elif not arm.pushed:  # zero, without a call into Python
        for name, size in (("wrench_true", 6), ("tau_ext_true", n)):
            zero_source = builder.AddNamedSystem(f"no_{name}", ConstantVectorSource(np.zeros(size)))
            outputs[name] = zero_source.get_output_port()
    outputs = {"wrench_true": wrench_true, "tau_ext_true": tau_ext_true} | outputs
    if arm.pushed:
        builder.Connect(
            arm.GetOutputPort("spatial_forces"), plant.get_applied_spatial_force_input_port()
        )
    if arm.HasOutputPort("wrench_unbalance"):
        outputs["wrench_unbalance"] = arm.GetOutputPort("wrench_unbalance")
    if has_sensor:
        outputs["ft_wrench"] = motion["sensed"]
    for name, port in outputs.items():
        builder.ExportOutput(port, name)


def _tool_contacts(
    scenario: Scenario, robot: Robot, plant: MultibodyPlant, parts: RobotInPlant
) -> ToolContacts:
    tool = tool_body(plant, parts)
    geometries = plant.GetCollisionGeometriesForBody(tool)
    radius = tip_radius(robot) if scenario.machining is not None else 0.0
    return ToolContacts(tool.index(), geometries, radius)


def _machining_process(scenario: Scenario) -> MachiningProcess | None:
    if scenario.machining is None:
        return None
    assert scenario.workpiece is not None
    ends = (scenario.machining.start, scenario.machining.end)
    return MachiningProcess(
        scenario.machining.process,
        contact=process_contact(scenario.workpiece, ends),
        time_step=scenario.time_step,
    )


def _current_sensor(robot: Robot) -> Array:
    """(3, n) bandwidth, noise and resolution, as `measure_current` reads them."""
    return np.stack([robot.current_bandwidth, robot.current_noise_sd, robot.current_resolution])


def _add_plant(
    builder: DiagramBuilder, scenario: Scenario, with_scene: bool
) -> tuple[MultibodyPlant, SceneGraph | None]:
    """Adds the plant, and a SceneGraph, which costs time, where something touches or is drawn."""
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


def _add_floor(plant: MultibodyPlant, solid: bool) -> None:
    """Adds the floor as a picture; a solid one can be touched as well."""
    body = plant.world_body()
    slab, X_WV = Box(1.6, 1.6, 0.02), RigidTransform([0.0, 0.0, -0.01])
    plant.RegisterVisualGeometry(body, X_WV, slab, "floor", _FLOOR_COLOUR)
    if solid:
        X_WG = RigidTransform([0.0, 0.0, -0.1])
        material = contact_material(FLOOR_STIFFNESS, 100.0, 0.5)
        plant.RegisterCollisionGeometry(body, X_WG, Box(4.0, 4.0, 0.2), "floor", material)


def _remove_pictures(plant: MultibodyPlant, scene_graph: SceneGraph) -> None:
    """Removes shapes that are only drawn: the scene moves every shape at every tick."""
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
    clear_links: Collection[str],
) -> None:
    """Gives the links the workpiece's contact material, and no contact among each other.

    At a blade only the ball at the tool's tip makes contact: the links pass through the blade.
    """
    inspector = scene_graph.model_inspector()
    has_contact = scenario.workpiece is not None or scenario.floor
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
            elif has_contact and body.name() not in clear_links:
                scene_graph.AssignRole(source, geometry, material, RoleAssign.kReplace)
                links.Add(geometry)
            else:
                # With nothing to touch, contact need not be computed at every tick.
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
            f"needs a tool above it, and {robot.name} has none",
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
