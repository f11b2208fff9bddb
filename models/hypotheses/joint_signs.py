"""Hypothesis: a joint counts its positions the other way, with or without its current."""

import math
from dataclasses import replace

import numpy as np

from wrenchsight.models.hypotheses.case import Case, View
from wrenchsight.models.hypotheses.explanation import Explanation, joint_remedy, likeliest
from wrenchsight.models.hypotheses.sign_search import best_signs
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.log_words import TURNED_WORD

NAME = "signs of the joints"


def explain(case: Case) -> Explanation | None:
    """The signs of the joints that explain the log best."""
    return likeliest(_explain(case, with_effort) for with_effort in (False, True))


def _explain(case: Case, with_effort: bool) -> Explanation | None:
    """The signs that explain the log best; None: those that it has.

    Args:
        case: the log, its model and the fit of the log as it is.
        with_effort: whether the drives' signals have the sign, too.
    """

    def score(signs: Array) -> float:
        """Log evidence of the log with its joints' signals times signs (n,) of 1 or -1."""
        return case.fit(_view(case, signs, with_effort), quick=True).log_evidence

    signs = best_signs(case.num_joints, score, case.quick_base_evidence)
    if signs is None:
        return None
    view = _view(case, signs, with_effort)
    fitted = case.fitted(view)
    turned = [int(j) + 1 for j in np.flatnonzero(signs < 0.0)]
    wrong = ", ".join(case.robot.joint_names[j - 1] for j in turned)
    signals = (
        f"positions, velocities and {case.word}s" if with_effort else "positions and velocities"
    )
    return Explanation(
        name=NAME,
        fitted=fitted,
        # All 2^n signs are equally likely beforehand, with or without the drives' signals.
        log_prior=-(case.num_joints + 1) * math.log(2.0),
        is_choice=True,
        cause=f"{signals} of the opposite sign at {wrong}",
        remedy=joint_remedy(case.key if with_effort else None, TURNED_WORD, f"{turned}", turned),
        values={"sign": signs.tolist()},
    )


def _view(case: Case, signs: Array, with_effort: bool) -> View:
    rows = case.rows
    effort = rows.effort * signs if with_effort else rows.effort
    return case.view(
        replace(
            rows,
            q=rows.q * signs,
            v=rows.v * signs,
            vdot=rows.vdot * signs,
            sliding=rows.sliding * signs,
            effort=effort,
        )
    )
