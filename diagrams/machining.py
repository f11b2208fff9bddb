"""Machining in the closed loop: plans the pass of a scenario."""

import math

import numpy as np

from wrenchsight.diagrams.robot_cell import tip_radius
from wrenchsight.diagrams.scenario import MachiningConfig, Scenario
from wrenchsight.diagrams.workpiece import pose_of_workpiece, surface_of
from wrenchsight.models.estimation.wrench import WrenchReconstructionConfig
from wrenchsight.models.estimation.wrench_prior import live_prior
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.machining.machining_path import (
    MachiningPath,
    PassSettings,
    check_curvature,
    plan_machining,
)
from wrenchsight.models.machining.machining_phases import RAMP_TIME, PhasesConfig
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.ties import better
from wrenchsight.models.planning.motion.branches import all_branches
from wrenchsight.models.planning.motion.inverse_kinematics import follow_path
from wrenchsight.models.planning.motion.joint_ranges import narrowed_limits
from wrenchsight.models.planning.motion.posture_cost import ForceSd
from wrenchsight.models.planning.motion.redundancy import (
    RedundancyProblem,
    best_on_grid,
    candidates,
    refine,
)
from wrenchsight.models.planning.motion.surface_path import SurfacePath
from wrenchsight.models.robot.robot import Robot

# Of the grid about the tool's axis, 10 degrees apart. The search's time grows with their square,
# and `refine` goes on between them.
NUM_ANGLES = 36
_TOOL_AXIS_E = (0.0, 0.0, 1.0)  # working direction of the tool, held into the surface
# rad, of a joint from one sample to the next: more is a jump to another branch, not a motion. Of a
# joint that slides it is the same number in m, 14 cm.
_MAX_STEP = math.radians(8.0)
# deg, kept from the limits of joints that turn, so that control stays off them: in the bundled
# polishing a joint strays by 1 deg at most. A joint that slides keeps none.
_LIMIT_MARGIN_DEG = 5.0
# N per rad^2: a smooth motion matters more here than the last millinewton
_SMOOTHNESS_WEIGHT = 0.05
REST_AFTER_PASS = 0.2  # s at rest, after the pass


def make_machining_path(
    scenario: Scenario, robot: Robot, source: str = "scenario: machining"
) -> MachiningPath:
    """Plans the pass of a scenario over its workpiece: path, postures and feed.

    The path is straight in the coordinates (u, v) of the workpiece's surface, each 0 to 1.

    Args:
        scenario: with machining and a workpiece, checked by `check_scenario`.
        robot: with a ball as its tool's tip.
        source: named in messages.

    Raises:
        InputError: a path off the workpiece, over too sharp an edge or out of reach; and as
            `plan_machining`.
    """
    machining = scenario.machining
    assert machining is not None and scenario.workpiece is not None
    X_WP = pose_of_workpiece(scenario.workpiece)
    path = SurfacePath.on_surface(
        surface_of(scenario.workpiece),
        start=(machining.start[0], machining.start[1]),  # u, v
        end=(machining.end[0], machining.end[1]),
        num_samples=machining.num_samples,
        R_WP=X_WP.rotation().matrix(),
        p_WP=X_WP.translation(),
        source=source,
    )
    settings = PassSettings(
        one_way=machining.one_way,
        passes=machining.passes,
        ramp=machining.ramp,
        force=machining.force,
        phases=machining.phases,
        tool_radius=tip_radius(robot),
    )
    # `plan_machining` checks it, too; here before the search for postures, which takes seconds.
    check_curvature(path, settings.tool_radius)
    q = postures(robot, path, machining, source)  # (N, n), one a sample of the path
    return plan_machining(robot, path, q, settings, source)


def posture_problem(
    robot: Robot, path: SurfacePath, machining: MachiningConfig, source: str
) -> RedundancyProblem:
    """The problem of the best postures along a path, which `best_on_grid` and `refine` solve.

    Postures differ by the angle about the tool's axis, which the work leaves free. Minimised is the
    mean over the path of the force's stated sd, N, plus _SMOOTHNESS_WEIGHT times (N - 1) sum dq^2,
    rad^2 (m^2 of slides), dq the steps of all joints between the N samples. The sd is that of the
    nominal model: what is planned must not depend on an identification. Bounds are hard: joint
    limits, less _LIMIT_MARGIN_DEG of joints that turn, and _MAX_STEP for each joint from one sample
    to the next.

    Args:
        robot: the arm.
        path: N samples, a posture each.
        machining: states narrower joint limits, if any. Its `angle_deg` (without one 0) is the
            first of the grid's angles, from which the others are even steps. Where it is stated
            `postures` keeps this angle and searches no grid: it then takes only cost and bounds
            from the problem.
        source: named in messages.

    Raises:
        InputError: a joint has no range beside the margin to its limits; narrower limits of a joint
            that the robot does not have, or that leave it no range within its own.
    """
    # A slide keeps no margin: its range, if it has one at all, is left.
    margins = np.where(robot.chain.prismatic, 0.0, math.radians(_LIMIT_MARGIN_DEG))
    lower, upper = robot.position_lower + margins, robot.position_upper - margins
    if np.any(lower >= upper):
        j = int(np.argmax(lower - upper))
        range_deg = math.degrees(robot.position_upper[j] - robot.position_lower[j])
        problem = (
            f"{robot.joint_names[j]} of {robot.name} turns by {range_deg:.3g} deg, and machining "
            f"keeps {_LIMIT_MARGIN_DEG:g} deg from each of its limits"
        )
        raise InputError(source, "", problem, "take a robot whose joints turn by more")
    # The stated ranges are in deg, of slides in m.
    lower, upper = narrowed_limits(robot, machining.joint_ranges_deg, lower, upper, source)
    if np.any(lower >= upper):
        joint = robot.joint_names[int(np.argmax(lower - upper))]  # the one that lacks most
        raise InputError(source, "joint_ranges_deg", f"leave {joint} of {robot.name} no range")
    return RedundancyProblem(
        robot=robot,
        path=path,
        tool_axis_E=np.array(_TOOL_AXIS_E),
        measure=ForceSd(
            robot.chain,
            IdentifiedModel.nominal(robot).residual_covariance,  # (n, n) N^2 m^2, of the torque
            # Without a prior, which would hide how poorly a posture tells the force.
            WrenchReconstructionConfig(method="inverse"),
        ),
        lower=lower,
        upper=upper,
        max_step=np.full(robot.num_joints, _MAX_STEP),  # rad (m), from sample to sample
        smoothness=_SMOOTHNESS_WEIGHT,
        num_angles=NUM_ANGLES,
        first_angle=math.radians(machining.angle_deg or 0.0),
    )


def postures(robot: Robot, path: SurfacePath, machining: MachiningConfig, source: str) -> Array:
    """(N, n) a posture at each sample: at the scenario's angle, or that with the least force sd.

    Raises:
        InputError: a sample is out of reach.
    """
    problem = posture_problem(robot, path, machining, source)
    if machining.angle_deg is None:  # the angle about the tool's axis is free
        best_of_grid = best_on_grid(problem, candidates(problem))
        return refine(problem, best_of_grid.q).q
    turn = math.radians(machining.turn_deg) * np.linspace(0.0, 1.0, path.num_samples)
    return _postures_at_angle(problem, problem.first_angle + turn, source)


def _postures_at_angle(problem: RedundancyProblem, angle: Array, source: str) -> Array:
    """(N, n) postures with stated angles (N,) about the tool's axis, rad.

    What is left to choose is the branch of the inverse kinematics (elbow up or down, ...) in which
    the path is followed: the cheapest of those that reach its end within the problem's bounds.

    Args:
        problem: robot, path, cost and bounds.
        angle: of each sample of the path.
        source: named in messages.

    Raises:
        InputError: no branch does.
    """
    robot, path = problem.robot, problem.path
    R_WE = path.orientations(angle, problem.tool_axis_E)  # (N, 3, 3)
    best_cost = math.inf
    best_q: Array | None = None
    first_postures = all_branches(robot, R_WE[:1], path.p_WS[:1])[0]  # (branches, n)
    for q_first in first_postures:
        if not np.all((q_first >= problem.lower) & (q_first <= problem.upper)):
            continue
        try:
            q = follow_path(robot, R_WE, path.p_WS, q_first)
        except InputError:  # the branch ends before the path does
            continue
        if problem.violation(q) > 0.0:  # beyond a limit, or a step that is too large
            continue
        cost = problem.cost(q)
        # Cheaper by more than rounding: of branches with one cost the first is taken, on every
        # machine.
        if best_q is None or better(cost, best_cost):
            best_cost, best_q = cost, q
    if best_q is None:
        raise InputError(
            source,
            "angle_deg",
            f"{robot.name} cannot keep this angle from one end of the path to the other",
            "leave angle_deg out, or move the workpiece",
        )
    return best_q


def with_planned_force(
    config: WrenchReconstructionConfig, robot: Robot, plan: MachiningPath
) -> WrenchReconstructionConfig:
    """Returns a copy whose missing prior is that of a pass: the largest planned force is its sd.

    The weight of the rated payload as a two-sigma force (`live_prior`) may be less than a pass
    presses with. Where the torques are uncertain, as at the start of the feed, such a prior pulls
    the reading towards zero, by more than the band holds: 20 N of 80 N while grinding. A reading is
    valid by `live_prior` all the same.

    Args:
        config: configuration of the scenario; a prior that it states is kept.
        plan: whose set-point is the force, N.
    """
    force_sd, moment_sd = live_prior(robot.payload)
    return config.with_prior(max(force_sd, float(plan.setpoint.max())), moment_sd)


def longest_duration(plan: MachiningPath, phases: PhasesConfig) -> float:
    """The longest time that a pass can take, s."""
    approach = (phases.standoff + phases.search) / phases.approach_speed
    lift = phases.lift / phases.lift_speed
    contact_time = phases.rise + phases.settle + plan.trajectory.duration + phases.release
    return approach + contact_time + lift + 2.0 * RAMP_TIME + REST_AFTER_PASS


def view_of(path: SurfacePath) -> Array:
    """(3,) direction of view on the tool's path: at the arm in profile, from over the surface."""
    middle = path.num_samples // 2
    n, p = path.n_W[middle], path.p_WS[middle]
    outward = np.array([p[0], p[1], 0.0])
    across = np.cross(outward, n)
    across = np.cross([0.0, 0.0, 1.0], outward) if np.linalg.norm(across) < 1e-3 else across
    return np.asarray(across / np.linalg.norm(across) + 0.5 * n + [0.0, 0.0, 0.3])
