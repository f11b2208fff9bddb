"""Hypothesis: a joint's position is the angle of its link, not that to the link before.

It then counts the joint before it, too: J3 of arms whose pendant shows it relative to the ground
(Fanuc), the third joint of a parallelogram, absolute angles of a camera. The position of the joint
before is to be subtracted, or added where the two count against each other.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wrenchsight.models.hypotheses.case import Case, View
from wrenchsight.models.hypotheses.explanation import Explanation
from wrenchsight.models.hypotheses.log_rows import slowest_sliding

NAME = "angle of a link for that of its joint"


class _Form(NamedTuple):
    """A joint, and the sign with which the position of the joint before it is to be added."""

    joint: int
    sign: float


def explain(case: Case) -> Explanation | None:
    """The joint that explains the log best; None where the log is good as it is."""
    if case.base_is_good:
        return None
    slides = case.robot.chain.prismatic
    forms = [
        _Form(j, sign)
        for j in range(1, case.num_joints)
        for sign in (-1.0, 1.0)
        if not slides[j] and not slides[j - 1]
    ]
    if not forms:
        return None
    best = max(forms, key=lambda form: case.fit(_view(case, form), quick=True).log_evidence)
    view = _view(case, best)
    fitted = case.fitted(view)
    names = case.robot.joint_names
    name, before = names[best.joint], names[best.joint - 1]
    change, of_what = ("subtract", "from") if best.sign < 0.0 else ("add", "to")
    return Explanation(
        name=NAME,
        fitted=fitted,
        # Half as likely beforehand as the log as it is, and each form as likely.
        log_prior=-math.log(2.0 * len(forms)),
        cause=(
            f"a position of {name} that counts {before}, too (the angle of the link to the ground, "
            "as some pendants show it),"
        ),
        remedy=(
            f"{change} the positions of {before} {of_what} those of {name} in the log, and its "
            "velocities alike, or log the angles of the joints"
        ),
        values={"joint": float(best.joint + 1), "sign": best.sign},
    )


def _view(case: Case, form: _Form) -> View:
    rows, j = case.rows, form.joint
    changed = {name: getattr(rows, name).copy() for name in ("q", "v", "vdot", "sliding")}
    for name in ("q", "v", "vdot"):
        changed[name][:, j] += form.sign * changed[name][:, j - 1]
    slowest = slowest_sliding(case.robot)[j]
    changed["sliding"][:, j] = np.tanh(changed["v"][:, j] / slowest)
    return case.view(replace(rows, **changed))
