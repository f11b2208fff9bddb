"""The robot cell: the true robot with drives and sensors, and its surroundings."""

import copy
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
    ProximityProperties,
    Role,
    RoleAssign,
    SceneGraph,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import ModelDirectives, Parser, ProcessModelDirectives
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    ApplyMultibodyPlantConfig,
    ExternallyAppliedSpatialForceMultiplexer,
    MultibodyPlant,
)
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import ConstantVectorSource, Demultiplexer, MatrixGain, Saturation

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
from wrenchsight.models.planning.placement.placement_task import FLOOR
from wrenchsight.models.robot.robot import Robot, RobotInPlant
from wrenchsight.models.truth.true_joints import TrueJoints
from wrenchsight.models.truth.true_robot import true_robot, with_true_friction
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


@dataclass(frozen=True)
class _CellParts:
    """The builder of a cell, and what its true arm is made from.

    Attributes:
        builder: builder of the cell's diagram; the plant is in it.
        scenario: as given.
        robot_of_joints: what the true joints, drives, sensors and the tool's tip are made from: the
            robot as it is described, with the part of its true friction that the scenario has.
        robot_of_links: what the true links are made from, the plant and the chain: the same robot
            with its true joint frames and tool weight.
        plant: plant of the arm, the workpiece and the floor.
        scene_graph: scene graph of the plant's shapes; None where nothing touches or is drawn.
        arm: the robot's model instance, joints, actuators and frame E in the plant.
    """

    builder: DiagramBuilder
    scenario: Scenario
    robot_of_joints: Robot
    robot_of_links: Robot
    plant: MultibodyPlant
    scene_graph: SceneGraph | None
    arm: RobotInPlant

    @property
    def has_contact(self) -> bool:
        """Whether there is something to touch."""
        return _has_contact(self.scenario)

    @property
    def has_sensor(self) -> bool:
        """Whether there is a force/torque sensor."""
        return self.scenario.force_torque_sensor is not None


def _has_contact(scenario: Scenario) -> bool:
    return scenario.workpiece is not None or scenario.floor or bool(scenario.directives)


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
                               |            | --> ft_wrench        (6,) F_E_W of the sensor
      current_command       -->|            | --> state            (2n,) q and v
        (n,) A                 | robot_cell | --> plant_state      of all bodies of the plant
      applied_spatial_force -->|            | --> tau_J_true       (n,) N m
                               |            | --> tau_f_true       (n,) N m
                               |            | --> tau_ext_true     (n,) N m
                               |            | --> wrench_true      (6,) F_E_W, N m, N
                               |            | --> wrench_unbalance (6,) of a spindle
                               +------------+ --> contact_results  of the plant

    Only some cells have: ft_wrench, with a force/torque sensor; wrench_unbalance, when machining;
    contact_results, with something to touch; applied_spatial_force, where the scenario asks for it:
    list[ExternallyAppliedSpatialForce] in World, forces on any body besides those of the scenario.

    The ports `*_true` are for measuring errors: no estimator may see them. Every 6-vector is
    rotation first. The plant is discrete at the scenario's time step. All blocks see the state
    before the step, and a force at time t acts from t to t + time_step. The drives saturate at the
    robot's effort limits.

    Args:
        scenario: what stands in the cell, and what acts on the tool.
        robot: the arm as it is described, with its truth: what it really is follows from that here.
        q_0: (n,) rad, where its encoders are at the start, at rest.
        meshcat: draws the cell into it; without it there are no pictures.
        clear_links: names of links that never touch anything: they are left out of contact.

    Returns:
        The diagram with what is asked of its parts while it runs.

    Raises:
        InputError: a sensor without a tool to sit on, true friction out of range, or directives
            that Drake cannot follow.
    """
    cell = _add_surroundings_and_arm(scenario, robot, is_drawn=meshcat is not None)
    # The plant is finalized. Its default positions and shapes are changed here, which has to be
    # done before the diagram's first Context.
    # Of the described robot with its true friction; the links are those of `robot_of_links`.
    joints = TrueJoints.of(cell.robot_of_joints, scenario.time_step)
    _put_encoders_at(cell, joints, np.asarray(q_0, dtype=np.float64))
    if cell.scene_graph is not None:  # there is none where nothing touches or is drawn
        _prepare_contact(cell, cell.scene_graph, clear_links)
        if meshcat is None:
            _remove_pictures(cell.plant, cell.scene_graph)
    script = WrenchScript(scenario.wrench, scenario.seed, "scenario")
    true_arm = cell.builder.AddNamedSystem("true_arm", TrueArm(_arm_parts(cell, joints, script)))
    _connect_inputs(cell, true_arm)  # exports current_command
    _connect_spatial_forces(cell, true_arm)  # exports applied_spatial_force, if the cell has it
    for name, port in _connect_outputs(cell, true_arm).items():
        cell.builder.ExportOutput(port, name)
    if meshcat is not None and cell.scene_graph is not None:
        parameters = MeshcatVisualizerParams(publish_period=1.0 / scenario.recording.fps)
        MeshcatVisualizer.AddToBuilder(cell.builder, cell.scene_graph, meshcat, parameters)
    diagram = cell.builder.Build()
    diagram.set_name("robot_cell")
    return RobotCell(
        diagram=diagram, plant=cell.plant, parts=cell.arm, joints=joints, script=script
    )


def _put_encoders_at(cell: _CellParts, joints: TrueJoints, q_0: Array) -> None:
    """Makes the plant start where the encoders read q_0 (n,), gears bent by the arm's weight."""
    q_start = joints.links_at(q_0, cell.robot_of_links.chain)
    cell.plant.SetDefaultPositions(cell.arm.model_instance, q_start)


def _arm_parts(cell: _CellParts, joints: TrueJoints, script: WrenchScript) -> ArmParts:
    """What the true arm is made of: true links, joints, drives, sensors, and what it touches."""
    scenario = cell.scenario
    return ArmParts(
        chain=cell.robot_of_links.chain,
        joints=joints,
        tool_body=cell.arm.tool_body(cell.plant).index(),
        p_BE=_p_BE(cell.plant, cell.arm),
        script=script,
        contacts=_tool_contacts(cell) if cell.has_contact else None,
        process=_machining_process(scenario),
        current=_current_sensor(cell.robot_of_joints) if scenario.current_noise else None,
        sensor=_force_torque_sensor(cell),
        seed=scenario.seed,
    )


def _add_surroundings_and_arm(scenario: Scenario, robot: Robot, is_drawn: bool) -> _CellParts:
    """Adds the plant with the true arm, the workpiece and the floor, to a new builder.

    Args:
        scenario: what stands in the cell.
        robot: the arm as it is described, with its truth: what it really is follows from that.
        is_drawn: whether pictures are needed.

    Returns:
        The builder with the plant, finalized, and what it holds.

    Raises:
        InputError: the truth is out of range, or Drake cannot follow the directives.
    """
    # True joints, drives and sensors are made from the first. The plant and its chain are made from
    # the second, whose joint frames and tool weight are the true ones as well.
    robot_of_joints = with_true_friction(robot, scenario.friction)
    robot_of_links = true_robot(robot_of_joints)
    builder = DiagramBuilder()
    plant, scene_graph = _add_plant(builder, scenario, _has_contact(scenario) or is_drawn)
    arm = robot_of_links.add_to_plant(plant)
    for joint in arm.joints:
        joint.set_default_damping(0.0)  # `TrueArm` puts viscous friction on them, too
    if scenario.workpiece is not None:
        add_workpiece(plant, scenario.workpiece)
    if scene_graph is not None:
        _add_floor(plant, solid=scenario.floor)
    # After all else, as directives may name what is in the plant already.
    _follow_directives(plant, scenario)
    plant.Finalize()
    return _CellParts(
        builder=builder,
        scenario=scenario,
        robot_of_joints=robot_of_joints,
        robot_of_links=robot_of_links,
        plant=plant,
        scene_graph=scene_graph,
        arm=arm,
    )


def _connect_inputs(cell: _CellParts, true_arm: TrueArm) -> None:
    """Connects what the true arm takes, and exports the cell's input current_command.

    current_command --> drives --> true_arm
                                     ^ state, contacts, reaction forces of the plant
    """
    plant, instance = cell.plant, cell.arm.model_instance
    limit = cell.robot_of_joints.current_limit
    drives = cell.builder.AddNamedSystem("drives", Saturation(-limit, limit))
    cell.builder.ExportInput(drives.get_input_port(), "current_command")
    sources = {
        "state": plant.get_state_output_port(instance),
        "current_command": drives.get_output_port(),
    }
    if cell.has_contact:
        sources["contact_results"] = plant.get_contact_results_output_port()
        sources["tau_contact"] = plant.get_generalized_contact_forces_output_port(instance)
    if cell.has_sensor:
        sources["reaction_forces"] = plant.get_reaction_forces_output_port()
        sources["vdot"] = plant.get_generalized_acceleration_output_port(instance)
    for name, port in sources.items():
        cell.builder.Connect(port, true_arm.GetInputPort(name))


def _connect_outputs(cell: _CellParts, true_arm: TrueArm) -> dict[str, OutputPort]:
    """Connects the true arm's torques with the plant; returns the cell's outputs by name.

    true_arm --> actuation, generalized force --> plant
    """
    builder, instance = cell.builder, cell.arm.model_instance
    # Two outputs of the true arm hold many signals each. Here each signal is a port, by its name:
    # what encoders, force/torque sensor and environment say, and torques and currents.
    motion = _add_demultiplexer(builder, true_arm, "motion", true_arm.motion_sizes)
    drives = _add_demultiplexer(builder, true_arm, "drives", true_arm.drive_sizes)
    builder.Connect(drives["tau_J"], cell.plant.get_actuation_input_port(instance))
    _connect_generalized_force(cell, drives["generalized_force"])
    return _cell_outputs(cell, true_arm, motion, drives)


def _cell_outputs(
    cell: _CellParts,
    true_arm: TrueArm,
    motion: dict[str, OutputPort],
    drives: dict[str, OutputPort],
) -> dict[str, OutputPort]:
    """Those of the cell's outputs that it has, by name. They are found by name: any order will do.

    Args:
        cell, true_arm: connected.
        motion: ports of the signals in the true arm's output of this name: q_read and v_read of the
            encoders, sensed of the force/torque sensor; wrench and torque of script and process,
            which are the true ones in a cell where nothing can be touched.
        drives: likewise tau_J, tau_f and current, as the drives report it.
    """
    plant, instance = cell.plant, cell.arm.model_instance
    outputs = {
        "q": motion["q_read"],
        "v": motion["v_read"],
        "state": plant.get_state_output_port(instance),
        "plant_state": plant.get_state_output_port(),
        "current": drives["current"],
        "tau_J_true": drives["tau_J"],
        "tau_f_true": drives["tau_f"],
    }
    outputs |= _truth_outputs(cell, true_arm, motion)  # wrench_true and tau_ext_true
    if true_arm.HasOutputPort("wrench_unbalance"):
        outputs["wrench_unbalance"] = true_arm.GetOutputPort("wrench_unbalance")
    if cell.has_sensor:
        outputs["ft_wrench"] = motion["sensed"]
    if cell.has_contact:
        outputs["contact_results"] = plant.get_contact_results_output_port()
    return outputs


def _connect_generalized_force(cell: _CellParts, arm_force: OutputPort) -> None:
    """Connects what friction and gears put on the arm's joints, (n,) N m, with the plant.

    The plant's port takes the generalized force of all bodies: those that are not the arm's get
    none.
    """
    to_plant = np.zeros((cell.plant.num_velocities(), cell.robot_of_joints.num_joints))
    for i, joint in enumerate(cell.arm.joints):
        to_plant[joint.velocity_start(), i] = 1.0
    spread = cell.builder.AddNamedSystem("generalized_force", MatrixGain(to_plant))
    cell.builder.Connect(arm_force, spread.get_input_port())
    cell.builder.Connect(
        spread.get_output_port(), cell.plant.get_applied_generalized_force_input_port()
    )


def _connect_spatial_forces(cell: _CellParts, true_arm: TrueArm) -> None:
    """Connects what acts on the tool with the plant; exports the input applied_spatial_force.

    The input is for forces of a user, and there only where the scenario asks for it.
    """
    builder = cell.builder
    sources = [true_arm.GetOutputPort("spatial_forces")] if true_arm.has_spatial_forces else []
    target = cell.plant.get_applied_spatial_force_input_port()
    if not cell.scenario.applied_spatial_force:
        for source in sources:
            builder.Connect(source, target)
        return
    joined = builder.AddNamedSystem(
        "spatial_forces", ExternallyAppliedSpatialForceMultiplexer(len(sources) + 1)
    )
    builder.ExportInput(joined.get_input_port(0), "applied_spatial_force")
    for k, source in enumerate(sources):
        builder.Connect(source, joined.get_input_port(k + 1))
    builder.Connect(joined.get_output_port(), target)


def _follow_directives(plant: MultibodyPlant, scenario: Scenario) -> None:
    """Adds what the scenario's model directives name."""
    if not scenario.directives:
        return
    try:
        ProcessModelDirectives(ModelDirectives(directives=scenario.directives), Parser(plant))
    except RuntimeError as error:
        raise InputError("scenario", "directives", f"Drake cannot follow them: {error}") from error


def _add_demultiplexer(
    builder: DiagramBuilder, true_arm: TrueArm, name: str, sizes: dict[str, int]
) -> dict[str, OutputPort]:
    """The parts of an output of the true arm, each a port, by their names.

    Split up by Drake: a port of its own for each signal is as many calls into Python at a tick.
    """
    demultiplexer = builder.AddNamedSystem(f"{name}_parts", Demultiplexer(list(sizes.values())))
    builder.Connect(true_arm.GetOutputPort(name), demultiplexer.get_input_port())
    return {part: demultiplexer.get_output_port(i) for i, part in enumerate(sizes)}


def _truth_outputs(
    cell: _CellParts, true_arm: TrueArm, motion: dict[str, OutputPort]
) -> dict[str, OutputPort]:
    """The ports of the cell with the true wrench and the true external torque.

    Of contact, script and process where something can be touched, else of the script; where nothing
    acts, of constants, which are added.
    """
    builder = cell.builder
    if cell.has_contact:
        truth = _add_demultiplexer(builder, true_arm, "truth", true_arm.truth_sizes)
        return {"wrench_true": truth["wrench"], "tau_ext_true": truth["tau_ext"]}
    if true_arm.has_spatial_forces:
        return {"wrench_true": motion["wrench"], "tau_ext_true": motion["torque"]}
    # Zero, without a call into Python.
    ports = {}
    for name, size in (("wrench_true", 6), ("tau_ext_true", cell.robot_of_joints.num_joints)):
        zero_source = builder.AddNamedSystem(f"no_{name}", ConstantVectorSource(np.zeros(size)))
        ports[name] = zero_source.get_output_port()
    return ports


def _tool_contacts(cell: _CellParts) -> ToolContacts:
    tool = cell.arm.tool_body(cell.plant)
    geometries = cell.plant.GetCollisionGeometriesForBody(tool)
    radius = tip_radius(cell.robot_of_joints) if cell.scenario.machining is not None else 0.0
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
    config = copy.copy(scenario.plant_config)
    config.time_step = scenario.time_step
    if with_scene:
        plant, scene_graph = AddMultibodyPlant(config, builder)
        scene_graph.set_name("scene_graph")
    else:
        plant, scene_graph = builder.AddSystem(MultibodyPlant(config.time_step)), None
        ApplyMultibodyPlantConfig(config, plant)
    plant.set_name("plant")
    return plant, scene_graph


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
    X_WB = parts.tool_body(plant).EvalPoseInWorld(context)
    X_BE = X_WB.InvertAndCompose(parts.frame_E.CalcPoseInWorld(context))
    return np.array(X_BE.translation())


def _add_floor(plant: MultibodyPlant, solid: bool) -> None:
    """Adds the floor as a picture; a solid one can be touched as well."""
    body = plant.world_body()
    slab, X_WV = Box(1.6, 1.6, 0.02), RigidTransform([0.0, 0.0, -0.01])
    plant.RegisterVisualGeometry(body, X_WV, slab, FLOOR, _FLOOR_COLOUR)
    if solid:
        X_WG = RigidTransform([0.0, 0.0, -0.1])
        material = contact_material(FLOOR_STIFFNESS, 100.0, 0.5)
        plant.RegisterCollisionGeometry(body, X_WG, Box(4.0, 4.0, 0.2), FLOOR, material)


def _remove_pictures(plant: MultibodyPlant, scene_graph: SceneGraph) -> None:
    """Removes shapes that are only drawn: the scene moves every shape at every tick."""
    inspector, source = scene_graph.model_inspector(), plant.get_source_id()
    solid = set(inspector.GetAllGeometryIds(Role.kProximity))
    for geometry in inspector.GetAllGeometryIds():
        if geometry not in solid and inspector.BelongsToSource(geometry, source):
            scene_graph.RemoveGeometry(source, geometry)


def _material_of(
    cell: _CellParts, body: RigidBody, shape: Shape, clear_links: Collection[str]
) -> ProximityProperties | None:
    """The contact material of a shape of the arm; None: it touches nothing."""
    if not cell.has_contact:
        return None
    workpiece = cell.scenario.workpiece
    if isinstance(workpiece, BladeConfig):
        # A mesh is touched by patches alone: only the tip has a shape that makes them.
        is_tool = body.index() == cell.arm.tool_body(cell.plant).index()
        is_tip = is_tool and isinstance(shape, Sphere)
        return soft_tip(workpiece, shape.radius()) if is_tip else None
    if body.name() in clear_links:
        return None
    # Without a workpiece the arm may touch floor or directives, in the material of a plate.
    plate = workpiece if isinstance(workpiece, PlateConfig) else PlateConfig()
    return contact_material(plate.stiffness, plate.dissipation, plate.friction)


def _prepare_contact(
    cell: _CellParts, scene_graph: SceneGraph, clear_links: Collection[str]
) -> None:
    """Says which shapes of the arm touch what stands around it, and in which material.

    They are none where there is nothing to touch, and at a blade only the ball at the tool's tip:
    the links pass through the blade. Shapes of the arm never touch each other.

    Args:
        cell: its plant is finalized, so that all shapes are there.
        scene_graph: of the plant; its shapes are changed, which is possible before any Context is
            made.
        clear_links: names of links that touch nothing.
    """
    plant, arm = cell.plant, cell.arm
    source, inspector = plant.get_source_id(), scene_graph.model_inspector()
    arm_shapes = GeometrySet()  # those that may touch something
    for index in plant.GetBodyIndices(arm.model_instance):
        body = plant.get_body(index)
        for geometry in plant.GetCollisionGeometriesForBody(body):
            material = _material_of(cell, body, inspector.GetShape(geometry), clear_links)
            if material is None:  # it touches nothing
                # Without this role a shape costs no time at a tick.
                scene_graph.RemoveRole(source, geometry, Role.kProximity)
            else:
                scene_graph.AssignRole(source, geometry, material, RoleAssign.kReplace)
                arm_shapes.Add(geometry)
    filters = scene_graph.collision_filter_manager()
    filters.Apply(CollisionFilterDeclaration().ExcludeWithin(arm_shapes))
    if cell.scenario.floor:  # a floor that can be touched: the robot always stands on it
        _exclude_foot_on_floor(cell, scene_graph)


def _exclude_foot_on_floor(cell: _CellParts, scene_graph: SceneGraph) -> None:
    """Leaves contact of the floor with the robot's foot out, the body before its first joint.

    That contact never ends, and moves nothing.
    """
    inspector = scene_graph.model_inspector()
    foot_body = cell.arm.joints[0].parent_body()
    foot = GeometrySet(cell.plant.GetCollisionGeometriesForBody(foot_body))
    floor = [
        geometry
        for geometry in inspector.GetAllGeometryIds(Role.kProximity)
        if inspector.GetName(geometry).endswith(FLOOR)  # Drake puts a model name before it
    ]
    scene_graph.collision_filter_manager().Apply(
        CollisionFilterDeclaration().ExcludeBetween(foot, GeometrySet(floor))
    )


def _force_torque_sensor(cell: _CellParts) -> ForceTorqueSensor | None:
    arm, robot, scenario = cell.arm, cell.robot_of_joints, cell.scenario
    config = scenario.force_torque_sensor
    if config is None:
        return None
    if arm.tool_weld is None:
        raise InputError(
            "scenario",
            "force_torque_sensor",
            f"needs a tool above it, and {robot.name} has none",
            "add a tool to robot.yaml, or leave the sensor out",
        )
    noisy = config.force_noise_sd > 0 or config.moment_noise_sd > 0
    return ForceTorqueSensor(
        cell.plant,
        arm.tool_weld,
        arm.frame_E,
        config,
        robot.num_joints,
        scenario.time_step,
        # Another stream than the drives': the same number would make the two noises one.
        scenario.seed + 2**32 if noisy else None,
    )
