"""Hypothesis: what the drives report is no torque: a position error, or what a driver never fills.

It is below any friction at each joint that moves. Where it follows the torque that the arm needs it
is a torque in another unit, which `effort_gain` explains much better.
"""

import math
from dataclasses import replace

from wrenchsight.models.hypotheses.case import Case
from wrenchsight.models.hypotheses.explanation import Explanation

NAME = "no torque of the drives"


def explain(case: Case) -> Explanation | None:
    """The log as if nothing were expected of the drives; None where they may report friction."""
    size = case.size_below_friction
    if size is None:
        return None
    base = case.base
    view = replace(base, measured=base.measured + base.expected)
    fitted = case.fitted(view)
    return Explanation(
        name=NAME,
        fitted=fitted,
        # Half as likely beforehand as the log as it is.
        log_prior=-math.log(2.0),
        has_form=False,
        cause=(
            f"a quantity that is no {case.word} of the drives (at joints that move it is "
            f"{size:.2g} N m RMS at most, less than any friction)"
        ),
        remedy=(
            "look up what the driver writes there (a position error, say), and record the motor "
            "currents or joint torques"
        ),
    )
