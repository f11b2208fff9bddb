"""Hypothesis: the drives' torque is without gravity, as some controllers report it."""

import math
from dataclasses import replace

from wrenchsight.models.hypotheses.case import Case
from wrenchsight.models.hypotheses.explanation import Explanation
from wrenchsight.models.recordings.log_words import WITHOUT_GRAVITY

NAME = "gravity missing from the effort"


def explain(case: Case) -> Explanation | None:
    """The log with the model's gravity added; None where the effort is too small for friction."""
    if case.size_below_friction is not None:
        return None
    base = case.base
    gravity = case.gravity(base.rows.q)
    view = replace(base, measured=base.measured + gravity)
    fitted = case.fitted(view)
    return Explanation(
        name=NAME,
        fitted=fitted,
        # Half as likely beforehand as the log as it is.
        log_prior=-math.log(2.0),
        has_form=False,
        cause=f"a {case.word} from which the controller has taken gravity",
        remedy=(
            f"set {case.key}: {{without_gravity: true}} in a description, or add --log-format "
            f"{WITHOUT_GRAVITY}, which adds the model's gravity torque"
        ),
    )
