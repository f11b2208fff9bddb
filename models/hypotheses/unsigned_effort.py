"""Hypothesis: the drives report the size of their current, without its sign."""

import math
from dataclasses import replace

import numpy as np

from wrenchsight.models.hypotheses.case import Case
from wrenchsight.models.hypotheses.explanation import Explanation

NAME = "current without sign"
NEGATIVE_SHARE = 0.03  # of a drive's largest value: what the low-pass turns negative
MIN_ERROR_SDS = 2.0  # sds of the model's error, from which the expected sign is known


def explain(case: Case) -> Explanation | None:
    """The log with the signs that the model expects: sizes alone may have been logged.

    Of all joints, where none has both signs (beyond NEGATIVE_SHARE of its largest value); else of
    the joints of one sign at which the model expects the other one, too. A robot may count the
    currents of all drives the other way: their sizes are then negative.

    Args:
        case: the log, its model and the fit of the log as it is.

    Returns:
        None where there is no such joint.
    """
    effort, base, n = case.rows.effort[case.at], case.base, case.num_joints
    largest = np.abs(effort).max(axis=0)
    if (np.sign(np.median(effort, axis=0))[largest > 0.0] < 0.0).all():
        effort = -effort
    # Of `effort` here signs alone count; below, the sizes of `measured` do.
    has_one_sign = effort.min(axis=0) >= -NEGATIVE_SHARE * largest
    expected = base.expected
    its_sign = np.sign(np.median(base.measured[case.at], axis=0))
    is_opposite = expected[case.at] * its_sign < -MIN_ERROR_SDS * base.kinds.sd
    lacks_sign = has_one_sign & is_opposite.any(axis=0)
    if not lacks_sign.any():
        return None
    is_all = bool(has_one_sign.all())
    is_unsigned = np.ones(n, bool) if is_all else lacks_sign
    signed = np.abs(base.measured) * np.where(expected < 0.0, -1.0, 1.0)
    view = replace(base, measured=np.where(is_unsigned, signed, base.measured))
    fitted = case.fitted(view)
    names = [case.robot.joint_names[j] for j in np.flatnonzero(is_unsigned)]
    place = "" if is_all else f" at {', '.join(names)}"
    # Half as likely beforehand as the log as it is; of some joints, each set of them as likely.
    log_prior = -math.log(2.0) if is_all else -math.log(2.0**n)
    return Explanation(
        name=NAME,
        fitted=fitted,
        log_prior=log_prior,
        cause=f"{case.word}s without sign{place} (no value is negative)",
        remedy=(
            f"log the signed {case.word}: a force cannot be told from a size alone "
            "(Universal Robots: actual_current; CiA 402: 0x6077 or 0x6078 as int16)"
        ),
        values={"joints": [float(j + 1) for j in np.flatnonzero(is_unsigned)]},
    )
