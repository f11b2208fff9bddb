"""Hypothesis: positions are straight lines between samples that a slow source gave.

Between two of these nothing is known of the motion: the velocities that are made of such positions
jump from line to line, and the torques of turning round lie elsewhere.
"""

import math
from dataclasses import replace

import numpy as np

from wrenchsight.models.hypotheses.case import MIN_MOVING_SHARE, Case
from wrenchsight.models.hypotheses.explanation import Explanation
from wrenchsight.models.recordings.log_words import KEEP_EVERY

NAME = "positions between slow samples"
MIN_LINE_TIME = 0.15  # s, of a line; with shorter ones readings stay within their band


def explain(case: Case) -> Explanation | None:
    """The log with the expected torque where it moves; None where positions are no such lines.

    Args:
        case: the log, its model and the fit of the log as it is.
    """
    traits, base, rows = case.rows.traits, case.base, case.rows
    if traits is None or traits.line_time < MIN_LINE_TIME:
        return None
    moves = np.asarray((np.abs(rows.sliding) > MIN_MOVING_SHARE).any(axis=1))
    measured = np.where(moves[:, None], base.expected, base.measured)
    return Explanation(
        name=NAME,
        fitted=case.fitted(replace(base, measured=measured)),
        log_prior=-math.log(2.0),
        has_form=False,
        may_hide_force=False,
        is_small=True,
        cause=(
            f"positions that are straight lines between samples {traits.line_time:.3g} s apart "
            f"({1.0 / traits.line_time:.3g} a second)"
        ),
        remedy=(
            "log the positions as fast as the drives' signals, 50 times a second or more; the "
            f"log's own samples are the rows that --log-format {KEEP_EVERY}"
            f"{traits.line_samples} keeps"
        ),
        values={"line_time_s": traits.line_time},
    )
