"""Hypothesis: a hand leads the arm. No fault of the log: its force is read.

The drives of an arm that is led hold it against gravity. Friction, and what accelerates the links,
is the hand's to overcome; the drives take over a share of each, the same at all joints. A force for
each row explains that, too, at the price of one for each row; an average of the currents explains a
part of it.
"""

import math
from dataclasses import replace

import numpy as np

from wrenchsight.models.hypotheses.case import Case
from wrenchsight.models.hypotheses.explanation import Explanation

NAME = "hand that leads the arm"
_SHARE_SD = 0.5  # of the drives' share of friction, and of inertial torque, about none


def explain(case: Case) -> Explanation:
    """The log with gravity's torque, and the shares of the others that explain it best.

    Args:
        case: the log, its model and the fit of the log as it is.
    """
    base, at = case.base, case.at
    gravity = case.gravity(base.rows.q)
    inertial = base.expected - base.friction - gravity
    led = replace(base, expected=gravity, friction=np.zeros_like(gravity))
    columns = np.stack([base.friction[at], inertial[at]], axis=2)
    fitted = case.fitted(led.with_columns(columns, np.full(2, _SHARE_SD)))
    # What `with_columns` adds comes first in theta.
    friction_share, inertial_share = fitted.fit.theta[:2].tolist()
    return Explanation(
        name=NAME,
        fitted=fitted,
        # Half as likely beforehand as the log as it is.
        log_prior=-math.log(2.0),
        cause="a hand that leads the arm",
        remedy="nothing is to be mended",
        values={"friction_share": friction_share, "inertial_share": inertial_share},
        is_fault=False,
    )
