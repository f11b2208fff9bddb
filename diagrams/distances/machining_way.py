"""Collision check of a machining pass, before anything moves.

Its parts are the approach from its start to the farthest point of the search for contact, the pass
itself, and the lift. The tool may touch the workpiece, other links may not.
"""

from dataclasses import dataclass

import numpy as np

from wrenchsight.diagrams.distances.clearance import Clearance, ClosestPair
from wrenchsight.diagrams.distances.moved_along import moved_along
from wrenchsight.diagrams.scenario import BladeConfig, PlateConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.machining.machining_path import MachiningPath
from wrenchsight.models.machining.machining_phases import PhasesConfig
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.robot.robot import Robot

_NUM_POSTURES = 60  # of one way along the path: 17 mm apart on a path of a metre


@dataclass(frozen=True)
class Overlap:
    """A part of the way on which two shapes overlap.

    Attributes:
        part: approach, pass or lift.
        pair: the two shapes that overlap most.
    """

    part: str
    pair: ClosestPair

    def sentence(self) -> str:
        """One line for the user."""
        depth = -1e3 * self.pair.distance
        return (
            f"the {self.part} overlaps: {self.pair.first} and {self.pair.second} by {depth:.0f} mm "
            "(meshes count as their convex hulls); move the workpiece"
        )


def postures_of_pass(robot: Robot, plan: MachiningPath, phases: PhasesConfig) -> dict[str, Array]:
    """Postures (N, n) by part: approach, pass and lift.

    The normals n_W point out of the workpiece. The approach goes from the plan's start against the
    normal to the end of the search for contact, the lift along the normal off the place where the
    pass ends. Postures of the pass are those of its first way along the path: all other ways go
    through the same ones.

    Args:
        robot: the arm.
        plan: the pass.
        phases: its distances of approach and lift.

    Raises:
        InputError: the arm cannot lift that far.
    """
    q, normals = plan.trajectory.q, plan.path.n_W  # of the trajectory's samples; of the path's
    approach = moved_along(robot, plan.q_start, normals[0], -(phases.standoff + phases.search))
    # `s` is the place on the path at each sample of the trajectory, 0 to 1. An even number of
    # passes ends at the path's beginning, 0.
    last_normal = normals[0] if plan.s[-1] < 0.5 else normals[-1]
    try:
        lift = moved_along(robot, q[-1], last_normal, phases.lift)
    except InputError as error:
        raise InputError(
            "machining",
            "phases.lift",
            f"{robot.name} cannot lift {phases.lift:g} m off the end of the pass",
            "move the workpiece, or lift less",
        ) from error
    end_of_first_way = int(np.argmax(plan.s))  # the first sample at the path's end
    rows = np.unique(np.linspace(0, end_of_first_way, _NUM_POSTURES).round().astype(int))
    return {"approach": approach, "pass": q[rows], "lift": lift}


def overlaps(
    robot: Robot,
    plan: MachiningPath,
    phases: PhasesConfig,
    workpiece: PlateConfig | BladeConfig,
) -> tuple[Overlap, ...]:
    """The parts of a pass on which shapes overlap; none where the arm has no shapes.

    Raises:
        InputError: as `postures_of_pass`.
    """
    parts = postures_of_pass(robot, plan, phases)
    clearance = Clearance(robot, 0.0, robot.floor, workpiece)
    overlapping = []
    for part, rows in parts.items():
        pairs = [pair for q in rows for pair in clearance.slacks(q, 0.0) if pair.slack < 0.0]
        if pairs:
            overlapping.append(Overlap(part, min(pairs, key=lambda pair: pair.distance)))
    return tuple(overlapping)
