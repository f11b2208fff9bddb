"""Links that never come near a plate while an arm machines it; they are left out of contact."""

import numpy as np

from wrenchsight.diagrams.distances.arm_shapes import ArmShapes
from wrenchsight.diagrams.distances.machining_way import postures_of_pass
from wrenchsight.diagrams.scenario import PlateConfig, Scenario
from wrenchsight.diagrams.workpiece import add_plate
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.machining.machining_path import MachiningPath
from wrenchsight.models.planning.placement.placement_task import WORKPIECE
from wrenchsight.models.robot.robot import Robot

# m. It is far more than the arm gets away from the nearest of the postures that are looked at, by
# moving to the next one and by straying from its plan: the tool of the bundled polishing 4 mm. A
# link that is wrongly left out would pass through the plate; one that is kept costs time alone.
CLEAR_DISTANCE = 0.05


def links_apart(scenario: Scenario, robot: Robot, plan: MachiningPath) -> frozenset[str]:
    """Names of the links that keep more than CLEAR_DISTANCE from the plate on the way of a pass.

    They keep it in the postures of `postures_of_pass`; it covers what the arm does between these
    and beside its plan.

    The set is empty without machining of a plate, if other contact is possible (a floor or bodies
    of directives to touch, a wrench that pushes the arm off its path), or if the path cannot be
    planned. A blade touches only the tool's tip in any case.

    Args:
        scenario: as it will be simulated.
        robot: its collision shapes count.
        plan: path of the pass over the plate.
    """
    machining, plate = scenario.machining, scenario.workpiece
    if not isinstance(plate, PlateConfig) or machining is None:
        return frozenset()
    if scenario.floor or scenario.directives or scenario.wrench:
        return frozenset()
    try:
        # (N, n) joint positions by the part of the pass: approach, pass and lift
        postures_by_part = postures_of_pass(robot, plan, machining.phases)
    except InputError:  # a part cannot be planned
        return frozenset()
    shapes = ArmShapes(robot, lambda plant: add_plate(plant, plate))
    # Names of the arm's links, its tool among them, that have shapes.
    links = {
        shapes.name(shape)
        for shape, body in shapes.body.items()
        if body.model_instance() == shapes.parts.model_instance
    }
    near_links: set[str] = set()
    for q in np.vstack(list(postures_by_part.values())):
        for pair in shapes.pairs(q, CLEAR_DISTANCE):
            names = {shapes.name(pair.id_A), shapes.name(pair.id_B)}
            if WORKPIECE in names:  # the plate's name in `add_plate`; the other is a link's
                near_links |= names
    return frozenset(links - near_links)
