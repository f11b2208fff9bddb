"""Hypothesis: currents or torques of some joints, or of all, have the opposite sign."""

import math

import numpy as np

from wrenchsight.models.hypotheses.case import Case, View
from wrenchsight.models.hypotheses.explanation import Explanation
from wrenchsight.models.hypotheses.sign_search import best_signs
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.log_words import DRIVE_SIGNALS, TURNED_WORD, correction_word

NAME = "signs of the drives"


def explain(case: Case) -> Explanation | None:
    """The signs of the drives that explain the log best; None: those that it has.

    Args:
        case: the log, its model and the fit of the log as it is.
    """

    def score(signs: Array) -> float:
        """Log evidence of the log with the drives' signals times signs (n,) of 1 or -1."""
        return case.fit(_view(case, signs), quick=True).log_evidence

    signs = best_signs(case.num_joints, score, case.quick_base_evidence)
    if signs is None:
        return None
    view = _view(case, signs)
    fitted = case.fitted(view)
    turned = [int(j) + 1 for j in np.flatnonzero(signs < 0.0)]
    wrong = ", ".join(case.robot.joint_names[j - 1] for j in turned)
    word = case.word
    remedy = f"set {case.key}: {{turned: {turned}}} in a description"
    if not case.rows.is_torque:
        remedy += ", or turn current_sign of these joints in robot.yaml"
    option = correction_word(DRIVE_SIGNALS, TURNED_WORD, turned)
    return Explanation(
        name=NAME,
        fitted=fitted,
        # All 2^n signs are equally likely beforehand.
        log_prior=-case.num_joints * math.log(2.0),
        is_choice=True,
        cause=f"{word}s of the opposite sign at {wrong}",
        remedy=f"{remedy}, or try --log-format {option}",
        values={"sign": signs.tolist()},
    )


def _view(case: Case, signs: Array) -> View:
    return case.changed_effort(case.rows.effort * signs)
