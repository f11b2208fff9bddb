"""Hypothesis: what the drive of a joint reports stands still, at zero or at its last value."""

import math
from dataclasses import replace

import numpy as np

from wrenchsight.models.hypotheses.case import MIN_MOVING_ROWS, MIN_MOVING_SHARE, Case
from wrenchsight.models.hypotheses.explanation import Explanation

NAME = "drive that stands still"
LARGEST_RANGE = 1e-9  # of a drive's signal over the log, of its largest value: it is constant
MIN_CHANGE_SDS = 4.0  # of the model's error, by which the torque of its joint is to change


def explain(case: Case) -> Explanation | None:
    """The log with the expected torque at joints whose signal is constant while they move.

    None where there is no such joint, or none of which another torque is expected from row to row.
    Where all joints' signals are constant, the log has no drives' signal at all.

    Args:
        case: the log, its model and the fit of the log as it is.
    """
    at, base, rows = case.at, case.base, case.rows
    effort, expected = rows.effort[at], base.expected[at]
    size = np.abs(effort).max(axis=0)
    is_constant = np.ptp(effort, axis=0) <= LARGEST_RANGE * size
    moves = (np.abs(rows.sliding[at]) > MIN_MOVING_SHARE).sum(axis=0) >= MIN_MOVING_ROWS
    changes = np.ptp(expected, axis=0) > MIN_CHANGE_SDS * np.median(base.kinds.sd, axis=0)
    stands_still = is_constant & moves & changes
    if not stands_still.any() or is_constant.all():
        return None
    view = replace(base, measured=np.where(stands_still, base.expected, base.measured))
    fitted = case.fitted(view)
    unit = "N m" if rows.is_torque else "A"
    listed = ", ".join(
        f"{case.robot.joint_names[j]} (at {effort[0, j]:.3g} {unit})"
        for j in np.flatnonzero(stands_still)
    )
    return Explanation(
        name=NAME,
        fitted=fitted,
        # Half as likely beforehand as the log as it is; each set of joints as likely.
        log_prior=-math.log(2.0**case.num_joints),
        has_form=False,
        may_hide_force=False,
        cause=f"{case.word}s that stand still while the joint moves, of {listed},",
        remedy=(
            f"record the {case.word} of each joint, with a resolution of a hundredth of its limit; "
            "a wrench cannot be read without one of them"
        ),
        values={"joints": [float(j + 1) for j in np.flatnonzero(stands_still)]},
    )
