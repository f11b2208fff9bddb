"""Straight paths (section 4.3): the article's initial and optimised one, and the one found here."""

from dataclasses import replace

import numpy as np

from wrenchsight.analyses.methods.place.placement import PlacementRequest, place
from wrenchsight.analyses.study.shared_results import shared
from wrenchsight.models.identification.identified_model import IdentifiedModel
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.inverse_kinematics import follow_path
from wrenchsight.models.planning.motion.paths import StraightPath
from wrenchsight.models.planning.placement.placement_task import load_task
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.truth_config import SimulatedTruthConfig

_LIMIT_MARGIN = 2.0  # deg

INITIAL_PATH = StraightPath(
    n_W=np.array([0.0, 1.0, 0.0]),
    p_WM=np.array([0.5, 0.0, 0.45]),
    R_WE=np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]),
)
OPTIMISED_PATH = StraightPath(
    n_W=np.array([-0.1720, 0.9851, 0.0]),
    p_WM=np.array([0.2345, 0.0393, 0.3892]),
    R_WE=np.diag([1.0, -1.0, -1.0]),
)
# Midpoint postures that name a branch. The first two are the article's: the initial maximum of the
# condition number is met to all digits, the optimised mean to its printed rounding.
INITIAL_POSTURE = np.array([0.0, -0.26, -0.567, 0.0, 0.827, 0.0])
OPTIMISED_POSTURE = np.array([0.166, 0.395, -0.943, 0.0, -1.022, 0.166])
OTHER_ELBOW_POSTURE = np.array([0.166, -2.349, 3.663, 0.0, -2.885, 0.166])


def found_path(
    robot: Robot, seed: int = 0, model: IdentifiedModel | None = None
) -> tuple[StraightPath, Array]:
    """The path that `linear-path` finds, and its posture at the midpoint.

    A turn about the first axis does not change its condition numbers, but the axes of a wrench in
    W. The path is turned so that its midpoint lies straight ahead, like the article's.

    Args:
        model: with it, the path whose Bayesian reading has the least force sd for this model's
            residual covariance, instead of the one with the least mean condition number.
    """
    # The simulated truth has no part in it: the path is the same in all worlds.
    nominal_robot = robot.with_truth(SimulatedTruthConfig())
    arguments = nominal_robot, seed, model
    return shared(
        "found_path", arguments, lambda: _found_path(*arguments), everywhere=model is None
    )


def _found_path(
    robot: Robot, seed: int, model: IdentifiedModel | None
) -> tuple[StraightPath, Array]:
    task, source = load_task("linear_path")
    objective = "jcn"
    if model is not None:
        # The force's sd often leads to a joint's limit, which the arm would pass between points.
        objective, task = "force-sd", replace(task, limit_margin_deg=_LIMIT_MARGIN)
    request = PlacementRequest(objective, seed=seed, model=model, may_overlap=True)
    best = place(task, source, robot, request).best
    turn_angle = -float(np.arctan2(best.placement.p_WM[1], best.placement.p_WM[0]))
    c, s = np.cos(turn_angle), np.sin(turn_angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    n_W = turn @ best.placement.n_W
    posture = best.fine.q[len(best.fine.q) // 2].copy()
    posture[0] += turn_angle
    path = StraightPath(
        n_W=n_W if n_W[1] > 0.0 else -n_W,
        p_WM=turn @ best.placement.p_WM,
        R_WE=turn @ best.placement.R_WE,
        path_length=task.path_length,
        num_segments=task.num_segments,
    )
    return path, posture


def branch_start(robot: Robot, path: StraightPath, posture: Array) -> Array:
    """(n,) configuration at the start of the path, on the branch of `posture` at its midpoint."""
    return np.asarray(followed(robot, path, np.linspace(0.5, 0.0, 51), posture)[-1])


def followed(robot: Robot, path: StraightPath, shares: Array, q_seed: Array) -> Array:
    """`follow_path` at these shares (N,) of a path: (N, n). Within a study it is solved once."""
    arguments = robot.with_truth(SimulatedTruthConfig()), path, shares, q_seed
    return shared(
        "followed",
        arguments,
        lambda: follow_path(robot, *path.poses(shares), q_seed),
        everywhere=True,
    )
