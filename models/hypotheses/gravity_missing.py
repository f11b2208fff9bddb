"""Hypothesis: the drives' torque is without gravity, as some controllers report it."""

import math
from dataclasses import replace

import numpy as np

from wrenchsight.models.hypotheses.case import Case
from wrenchsight.models.hypotheses.explanation import Explanation
from wrenchsight.models.recordings.log_words import WITHOUT_GRAVITY

NAME = "gravity missing from the effort"
# Of the effort limit: friction of a joint that moves is 1 % or more of it.
_LEAST_FRICTION_SHARE = 5e-4
_MIN_MOVING_SHARE = 0.5  # of a row's time
_LEAST_MOVING_ROWS = 10  # of a joint that counts


def explain(case: Case) -> Explanation | None:
    """The log with the model's gravity added."""
    base = case.base
    gravity = case.gravity(base.rows.q)
    view = replace(base, measured=base.measured + gravity)
    fit = case.fit(view)
    cause = f"a {case.word} from which the controller has taken gravity"
    remedy = (
        f"set {case.key}: {{without_gravity: true}} in a description, or add --log-format "
        f"{WITHOUT_GRAVITY}, which adds the model's gravity torque"
    )
    size = _size_below_friction(case)
    if size is not None:
        cause = (
            f"a quantity that is no {case.word} of the drives (at joints that move it is "
            f"{size:.2g} N m RMS at most, less than any friction)"
        )
        remedy = (
            "look up what the driver writes there (a position error, say), and record the motor "
            "currents or joint torques"
        )
    return Explanation(
        name=NAME,
        # Half as likely beforehand as the log as it is.
        log_evidence=fit.log_evidence - math.log(2.0),
        explained=case.explained(view, fit),
        kind_share=fit.kind_share,
        has_form=False,
        cause=cause,
        remedy=remedy,
    )


def _size_below_friction(case: Case) -> float | None:
    """The largest RMS of what the drives report at joints that move, in N m.

    None: some joint's may be friction, or none moves.
    """
    torque = case.base.measured[case.at]
    moves = np.abs(case.rows.sliding[case.at]) > _MIN_MOVING_SHARE
    is_moving = moves.sum(axis=0) >= _LEAST_MOVING_ROWS
    if not is_moving.any():
        return None
    mean_square = np.where(moves, torque**2, 0.0).sum(axis=0) / np.maximum(moves.sum(axis=0), 1)
    size = np.sqrt(mean_square)
    if (size > _LEAST_FRICTION_SHARE * case.effort_limit)[is_moving].any():
        return None
    return float(size[is_moving].max())
