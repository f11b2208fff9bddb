"""Hypothesis on a suspicious log: friction that is not the model's any more explains it.

That is no fault of the log, and the band holds it. Whether a usual log's friction has drifted is
judged by `models.calibration.friction_drift_criterion`.
"""

import math
from dataclasses import replace

import numpy as np

from wrenchsight.models.hypotheses.case import Case
from wrenchsight.models.hypotheses.explanation import Explanation

NAME = "drift of friction"
WIDER_RATIO = 5.0  # times the tolerance of the model's friction


def explain(case: Case) -> Explanation | None:
    """The log with any Coulomb and viscous friction."""
    base = case.base
    first, n = base.sliding_columns.start, case.num_joints
    prior_sd = base.prior_sd.copy()
    prior_sd[first : first + 2 * n] *= WIDER_RATIO
    view = replace(base, prior_sd=prior_sd)
    fitted = case.fitted(view)
    fit = fitted.fit
    change = fit.theta[first : first + n] / np.maximum(base.prior_sd[first : first + n], 1e-9)
    worst = int(np.argmax(np.abs(change)))
    return Explanation(
        name=NAME,
        fitted=fitted,
        # Half as likely beforehand as the log as it is.
        log_prior=-math.log(2.0),
        cause=f"friction that is not the model's, most of all of {case.robot.joint_names[worst]}",
        remedy="refresh it: wrenchsight identify --refresh",
        values={
            "coulomb_change_nm": fit.theta[first : first + n].tolist(),
            "viscous_change_nms_per_rad": fit.theta[first + n : first + 2 * n].tolist(),
        },
        is_fault=False,
    )
