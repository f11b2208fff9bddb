"""Hypothesis: currents or torques are cut off at a largest value, by a logger or a range of words.

A drive that saturates reports what it gives: the arm then needs no more than that. Here it needs
more.
"""

import math
from dataclasses import replace

import numpy as np

from wrenchsight.models.hypotheses.case import Case
from wrenchsight.models.hypotheses.explanation import Explanation

NAME = "drives cut off"
MIN_BEYOND_SDS = 3.0  # of the model's error, by which more than the largest value is needed


def explain(case: Case) -> Explanation | None:
    """The log with the expected torque where a drive's signal stands at an extreme and more is due.

    None where there is no such sample.

    Args:
        case: the log, its model and the fit of the log as it is.
    """
    traits, base, rows = case.rows.traits, case.base, case.rows
    if traits is None or not traits.ceilings:
        return None
    is_cut = np.zeros(base.measured.shape, bool)
    is_cut[case.at] = traits.at_ceiling(rows.t[case.at], case.num_joints)
    side = np.sign(base.measured - np.median(base.measured, axis=0))
    beyond = side * (base.expected - base.measured)
    is_cut[case.at] &= beyond[case.at] > MIN_BEYOND_SDS * base.kinds.sd
    if not is_cut.any():
        return None
    unit = "N m" if rows.is_torque else "A"
    joints = np.flatnonzero(is_cut.any(axis=0))
    runs = {j: [run for run in traits.ceilings if run.joint == j] for j in joints}
    listed = ", ".join(
        f"{case.robot.joint_names[j]} ("
        + " and ".join(f"{value:.4g}" for value in sorted({run.value for run in runs[j]}))
        + f" {unit} for {sum(run.end - run.begin for run in runs[j]):.2g} s)"
        for j in joints
    )
    return Explanation(
        name=NAME,
        fitted=case.fitted(replace(base, measured=np.where(is_cut, base.expected, base.measured))),
        # Half as likely beforehand as the log as it is; each set of joints as likely.
        log_prior=-math.log(2.0**case.num_joints),
        has_form=False,
        may_hide_force=False,
        is_small=True,
        cause=f"{case.word}s that are cut off at a largest value, of {listed},",
        remedy=(
            f"log the {case.word}s over their whole range (a larger scale, or wider words): what "
            "is cut off is lost"
        ),
        values={"joints": [j + 1.0 for j in joints.tolist()]},
    )
