"""A placement's postures: exactly on its path, and between its points."""

import numpy as np

from wrenchsight.models.motion.path_postures import correct_paths
from wrenchsight.models.placement.placement_program import Placement
from wrenchsight.models.robot.robot import Robot


def on_path(robot: Robot, placement: Placement, path_length: float) -> Placement | None:
    """The same placement with each posture moved onto its point exactly; None if one cannot be."""
    q = placement.q[np.newaxis].copy()
    reached = correct_paths(
        robot.chain,
        q,
        placement.n_W[np.newaxis],
        placement.p_WM[np.newaxis],
        placement.R_WE[np.newaxis],
        path_length,
    )
    if not reached[0]:
        return None
    return Placement(q[0], placement.n_W, placement.p_WM, placement.quaternion)


def between_points(
    robot: Robot, placement: Placement, path_length: float, parts: int = 10
) -> Placement | None:
    """The placement with `parts` times as many points; None where the postures do not continue.

    Each new posture is the one nearest to the straight line in the joints between two points. If
    from one to the next no joint takes more than three times its share of the step between the
    points (and a rounding), all of them lie on one branch.
    """
    k = len(placement.q) - 1
    at = np.linspace(0.0, k, parts * k + 1)
    left = np.minimum(at.astype(int), k - 1)
    share = (at - left)[:, np.newaxis]
    q = (1.0 - share) * placement.q[left] + share * placement.q[left + 1]
    fine = on_path(
        robot,
        Placement(q, placement.n_W, placement.p_WM, placement.quaternion),
        path_length,
    )
    if fine is None:
        return None
    steps = np.max(np.abs(np.diff(placement.q, axis=0)))
    if np.max(np.abs(np.diff(fine.q, axis=0))) > 3.0 * steps / parts + 1e-6:
        return None
    return fine
