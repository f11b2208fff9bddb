"""Hypothesis: what is logged as the drives' torque is the external torque already."""

import math
from dataclasses import replace

import numpy as np

from wrenchsight.models.hypotheses.case import OFFSET_SHARE, Case
from wrenchsight.models.hypotheses.explanation import Explanation

NAME = "external torque as effort"


def explain(case: Case) -> Explanation | None:
    """The log as external torque: zero but for contacts and an offset of each joint.

    None where it is below any noise of a torque.
    """
    if case.size_below_friction is not None:
        return None
    base, n = case.base, case.num_joints
    columns = np.broadcast_to(np.eye(n), (len(case.at), n, n))
    view = replace(
        base,
        expected=np.zeros_like(base.expected),
        friction=np.zeros_like(base.expected),
        columns=columns,
        prior_sd=OFFSET_SHARE * case.effort_limit,
    )
    fitted = case.fitted(view)
    return Explanation(
        name=NAME,
        fitted=fitted,
        # Half as likely beforehand as the log as it is.
        log_prior=-math.log(2.0),
        has_form=False,
        cause="external torque, without gravity and friction, in place of the drives' torque",
        remedy="read it as it is: add --torque external and leave --model out",
    )
