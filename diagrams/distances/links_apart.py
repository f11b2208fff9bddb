"""Links that never come near a plate while an arm machines it: contact need not look at them."""

import numpy as np
from pydrake.geometry import Role
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from diagrams.distances.machining_way import postures_of_pass
from diagrams.scenario import PlateConfig, Scenario
from diagrams.workpiece import add_plate
from models.arrays import Array
from models.files.input_error import InputError
from models.machining.machining_path import MachiningPath
from models.robot.robot import Robot

# Far more than the arm strays from its way, and moves between two postures that are looked at.
KEPT = 0.05  # m


def links_apart(scenario: Scenario, robot: Robot, plan: MachiningPath) -> frozenset[str]:
    """Names of the links that keep more than KEPT from the plate on the way of a pass.

    None where that does not settle what they meet: with a floor to touch, with a wrench that
    pushes the arm off its way, and where the way cannot be told. A blade meets the tool's tip alone
    in any case.
    """
    machining, plate = scenario.machining, scenario.workpiece
    if not isinstance(plate, PlateConfig) or machining is None or scenario.floor or scenario.wrench:
        return frozenset()
    try:
        parts = postures_of_pass(robot, plan, machining.phases)
    except InputError:
        return frozenset()
    nearest = link_distances(robot, plate, np.vstack(list(parts.values())))
    return frozenset(link for link, distance in nearest.items() if distance > KEPT)


def link_distances(robot: Robot, plate: PlateConfig, q: Array) -> dict[str, float]:
    """Smallest distance from the plate over q (N, n) of each link that has a shape, m."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    parts = robot.add_to_plant(plant)
    add_plate(plant, plate)
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    inspector = scene_graph.model_inspector()
    (piece,) = plant.GetCollisionGeometriesForBody(plant.world_body())
    bodies = {
        shape: plant.GetBodyFromFrameId(inspector.GetFrameId(shape)).name()
        for shape in inspector.GetAllGeometryIds(Role.kProximity)
        if shape != piece
    }
    order = [joint.position_start() for joint in parts.joints]
    positions, nearest = np.zeros(plant.num_positions()), dict.fromkeys(bodies.values(), np.inf)
    for row in q:
        positions[order] = row
        plant.SetPositions(plant_context, positions)
        query = plant.get_geometry_query_input_port().Eval(plant_context)
        for shape, body in bodies.items():
            pair = query.ComputeSignedDistancePairClosestPoints(shape, piece)
            nearest[body] = min(nearest[body], float(pair.distance))
    return nearest
