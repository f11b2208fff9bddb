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

    None where a joint's signal has both signs (beyond NEGATIVE_SHARE of its largest value), or the
    model expects no sign that it lacks. A robot may count the currents of all drives the other way:
    their sizes are then negative.

    Args:
        case: the log, its model and the fit of the log as it is.
    """
    effort, base = case.rows.effort[case.at], case.base
    largest = np.abs(effort).max(axis=0)
    if (np.sign(np.median(effort, axis=0))[largest > 0.0] < 0.0).all():
        effort = -effort
    # Of `effort` here signs alone count; below, the sizes of `measured` do.
    if (effort.min(axis=0) < -NEGATIVE_SHARE * largest).any():
        return None
    expected = base.expected
    is_negative = expected[case.at] < -MIN_ERROR_SDS * base.kinds.sd
    if not is_negative.any():
        return None
    view = replace(base, measured=np.abs(base.measured) * np.where(expected < 0.0, -1.0, 1.0))
    fit = case.fit(view)
    return Explanation(
        name=NAME,
        # Half as likely beforehand as the log as it is.
        log_evidence=fit.log_evidence - math.log(2.0),
        explained=case.explained(view, fit),
        kind_share=fit.kind_share,
        cause=f"{case.word}s without sign (no value is negative)",
        remedy=(
            f"log the signed {case.word}: a force cannot be told from a size alone "
            "(Universal Robots: actual_current; CiA 402: 0x6077 or 0x6078 as int16)"
        ),
    )
