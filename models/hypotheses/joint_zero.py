"""Hypothesis: the zero of a joint is off, by a small angle or by a quarter turn."""

import math
from dataclasses import replace

import numpy as np

from wrenchsight.models.hypotheses.case import Case, View
from wrenchsight.models.hypotheses.explanation import Explanation, likeliest
from wrenchsight.models.numerics.arrays import Array

NAME = "zero of a joint"
PRIOR_SD = 0.2  # rad (m) of an offset
MIN_OFFSET = 0.015  # rad (m); a smaller one is within what models of arms err by
MIN_STANDARD_ERRORS = 4.0  # standard errors that an offset is away from zero
MAX_PRIOR_SHARE = 0.5  # of the prior's sd, which the standard error must be below
_MAX_STEPS = 3  # of Newton
_MAX_CHANGE_SDS = 0.3  # of a step, below which it is the last one
_LEAST_STATED_SD = 5e-4  # rad (m), of an offset that is stated to three digits
_DIFFERENCE_STEP = 1e-3  # rad (m), of the derivative
_MOST_REFINED = 2  # first guesses that are fitted
_QUARTER_TURNS = (-0.5 * math.pi, 0.5 * math.pi, math.pi)


def explain(case: Case) -> Explanation | None:
    """The zero that explains the log best, with its standard error."""
    n = case.num_joints
    found: list[tuple[float, int, float]] = []
    for j in range(n):
        view = case.base.with_columns(_derivative(case, j, 0.0), np.array([PRIOR_SD]))
        fit = case.fit(view, quick=True)
        found.append((fit.log_evidence, j, float(fit.theta[0])))
        if case.base_is_good or case.robot.chain.prismatic[j]:
            continue
        for offset in _QUARTER_TURNS:
            score = case.fit(_view(case, j, offset), quick=True).log_evidence
            found.append((score, j, offset))
    return likeliest(
        _refined(case, j, offset) for _, j, offset in sorted(found, reverse=True)[:_MOST_REFINED]
    )


def _refined(case: Case, j: int, guess: float) -> Explanation | None:
    """The hypothesis at joint j, from a first guess of its offset; None where it is not sure.

    Newton's steps: the torque is linearised in the offset about the last one. The prior's PRIOR_SD
    is that of each step's change, so that a quarter turn may be a guess.

    Args:
        case: the log, its model and the fit of the log as it is.
        j: index of the joint.
        guess: rad (m), of the offset to be added to the log's positions.
    """
    offset = guess
    for _ in range(_MAX_STEPS):
        shifted = _view(case, j, offset)
        view = shifted.with_columns(_derivative(case, j, offset), np.array([PRIOR_SD]))
        fitted = case.fitted(view)
        fit = fitted.fit
        change = float(fit.theta[0])  # what `with_columns` adds comes first
        offset += change
        if abs(change) < _MAX_CHANGE_SDS * float(fit.sd[0]):
            break
    # View and fit are about the offset before the last step, which was small.
    sd = float(fit.sd[0])
    if abs(offset) < max(MIN_OFFSET, MIN_STANDARD_ERRORS * sd) or sd > MAX_PRIOR_SHARE * PRIOR_SD:
        return None
    name = case.robot.joint_names[j]
    unit = "m" if case.robot.chain.prismatic[j] else "rad"
    in_file = float(case.robot.q_offset[j]) + offset  # the log's positions have what is there now
    return Explanation(
        name=NAME,
        fitted=fitted,
        log_prior=-math.log(2.0 * case.num_joints),
        # Off by the opposite of what has to be added to positions.
        cause=f"a zero of {name} that is off by {-offset:.3f} +- "
        f"{max(sd, _LEAST_STATED_SD):.1g} {unit}",
        remedy=(
            f"set q_offset: {in_file:.4f} at {name} in robot.yaml (drives), which is added to its "
            "logged positions"
        ),
        is_small=True,
        values={"joint": float(j + 1), "q_offset": offset, "q_offset_sd": sd},
    )


def _view(case: Case, j: int, offset: float) -> View:
    q = case.rows.q.copy()
    q[:, j] += offset
    return case.view(replace(case.rows, q=q))


def _derivative(case: Case, j: int, offset: float) -> Array:
    """(N, n, 1) expected torque per rad of an offset of joint j, at the rows `Case.at`."""
    q = case.rows.q[case.at]
    q[:, j] += offset
    ahead, behind = q.copy(), q.copy()
    ahead[:, j] += _DIFFERENCE_STEP
    behind[:, j] -= _DIFFERENCE_STEP
    slope = (case.gravity(ahead) - case.gravity(behind)) / (2.0 * _DIFFERENCE_STEP)
    return np.asarray(slope)[:, :, None]
