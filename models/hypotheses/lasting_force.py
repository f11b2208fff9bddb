"""Hypothesis: forces at the tool that last, each for seconds. No fault of the log: they are read.

The evidence charges each row in contact for a force of its own. A push that lasts for seconds is
one force: here each stretch of contact has one wrench, constant in the axes of W or of E, and one
force along the motion of E, as sliding along something makes it, beside the rows' own kinds. So a
tilt, a zero or a gain competes with what is as simple.

A stretch begins as rows that the model without corrections does not leave free. Then wrench and
stretch take turns: the stretch is the interval over which the wrench raises the likelihood most.

A fault of the log may hide behind such a force, or beside one (`with_force`).
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wrenchsight.models.hypotheses.case import Case, FittedView, View
from wrenchsight.models.hypotheses.evidence import KIND_PRIOR, Fit
from wrenchsight.models.hypotheses.explanation import Explanation
from wrenchsight.models.numerics.arrays import Array, Flags

NAME = "force that lasts"
MAX_FREE_PROBABILITY = 0.5  # of a row of a stretch
MIN_DURATION = 1.0  # s, of a force
MAX_GAP = 0.5  # s, within one force
SLOWEST_SLIDING = 0.005  # m/s of E, below which a force along its motion fades
MAX_FORCES = 4  # of a log, the longest ones
_NUM_PASSES = 2  # of new stretches, after the fit within the first ones
_NUM_FORMS = 2  # axes
_SHARE = KIND_PRIOR / KIND_PRIOR.sum()


class _Stretch(NamedTuple):
    """Begin and end of a force, s."""

    begin: float
    end: float


def explain(case: Case) -> Explanation | None:
    """The log with one force for each of the longest stretches; None: there is none."""
    fitted = _fitted_beside(case, case.base)
    if fitted is None:
        return None
    return Explanation(
        name=NAME,
        fitted=fitted,
        log_prior=-math.log(_NUM_FORMS),
        cause="a force at the tool that lasts",
        remedy="nothing is to be mended",
        is_fault=False,
        has_force=True,
    )


def with_force(case: Case, explanation: Explanation) -> Explanation:
    """The explanation with forces that last beside it, if that is likelier; else as it is."""
    if not explanation.may_hide_force:
        return explanation
    fitted = _fitted_beside(case, explanation.fitted.view)
    if fitted is None:
        return explanation
    beside = replace(
        explanation,
        fitted=fitted,
        log_prior=explanation.log_prior - math.log(_NUM_FORMS),
        has_force=True,
    )
    return beside if beside.log_evidence > explanation.log_evidence else explanation


def _fitted_beside(case: Case, view: View) -> FittedView | None:
    """A view with one force for each of its longest stretches; None: there is none.

    Args:
        case: the log.
        view: the log as a hypothesis sees it.
    """
    at = case.at
    kind, _ = view.kinds.of_rows(view.measured[at] - view.expected[at], _SHARE)
    first_stretches = _longest_stretches(case.rows.t[at], kind[0] < MAX_FREE_PROBABILITY)
    if not first_stretches:
        return None
    q, v = view.rows.q[at], view.rows.v[at]
    J = case.jacobian(q)
    R_EW = case.orientation(q).transpose(0, 2, 1)
    J_in_E = np.concatenate([R_EW @ J[:, :3], R_EW @ J[:, 3:]], axis=1)
    velocity = np.einsum("nij,nj->ni", J[:, 3:], v)  # of E
    size = np.sqrt((velocity**2).sum(axis=1, keepdims=True) + SLOWEST_SLIDING**2)
    along = np.einsum("nij,ni->nj", J[:, 3:], velocity / size)[:, None]
    forms = [np.concatenate([in_axes, along], axis=1).transpose(0, 2, 1) for in_axes in (J, J_in_E)]
    fits = [_fitted(case, view, columns, first_stretches) for columns in forms]
    return max(fits, key=lambda fitted: fitted.fit.log_evidence)


def _fitted(
    case: Case, base: View, columns: Array, first_stretches: Sequence[_Stretch]
) -> FittedView:
    """The view and the fit of forces, from a first guess of their stretches.

    The forces are fitted within the first stretches. Then, as long as the evidence grows and
    _NUM_PASSES times at most, the stretches are fitted to the forces and these within them.

    Args:
        case: the log.
        base: the view without a force.
        columns: (N, n, 7) torque of each component of a wrench, moment first, and of a force along
            the motion of E, at the rows `Case.at`.
        first_stretches: one for each force.
    """
    masks = [_rows_within(case, stretch) for stretch in first_stretches]
    fitted = _fitted_within(case, base, columns, masks)
    for _ in range(_NUM_PASSES):
        fit = fitted.fit
        # What `with_columns` adds comes first in theta: seven numbers a stretch.
        forces = fit.theta[: columns.shape[2] * len(masks)].reshape(len(masks), -1)
        masks = [
            _rows_within(case, _best_interval(case, base, fit, columns @ force, is_within))
            for force, is_within in zip(forces, masks, strict=True)
        ]
        following = _fitted_within(case, base, columns, masks)
        if following.fit.log_evidence <= fit.log_evidence:
            break
        fitted = following
    return fitted


def _rows_within(case: Case, stretch: _Stretch) -> Flags:
    """(N,) which of the rows `Case.at` lie in a stretch."""
    t = case.rows.t[case.at]
    begin, end = stretch
    return np.asarray((t >= begin) & (t <= end))


def _fitted_within(case: Case, base: View, columns: Array, masks: Sequence[Flags]) -> FittedView:
    """The view and the fit with a force in each of some stretches.

    Args:
        case: the log.
        base: the view without a force.
        columns: (N, n, 7) as `_fitted`.
        masks: (N,) rows of each stretch.
    """
    blocks = [columns * is_within[:, None, None] for is_within in masks]
    sd = base.kinds.wrench_sd
    prior_sd = np.tile([*sd, sd[-1]], len(masks))
    view = base.with_columns(np.concatenate(blocks, axis=2), prior_sd)
    return case.fitted(view)


def _best_interval(case: Case, base: View, fit: Fit, torque: Array, is_within: Flags) -> _Stretch:
    """The interval over which a force raises the likelihood most.

    Args:
        case: the log.
        base: the view without a force.
        fit: with the force where `is_within`, (N,).
        torque: (N, n) N m, of the force at all rows.
    """
    kinds, share = base.kinds, np.maximum(fit.kind_share, _SHARE / len(_SHARE))
    without = fit.residual + torque * is_within[:, None]
    gain = kinds.of_rows(without - torque, share)[1] - kinds.of_rows(without, share)[1]
    total = np.concatenate([[0.0], np.cumsum(kinds.weight * gain)])
    lowest = np.minimum.accumulate(total)
    end = int(np.argmax(total - lowest))
    begin = int(np.argmin(total[: end + 1]))
    t = case.rows.t[case.at]
    return _Stretch(float(t[min(begin, len(t) - 1)]), float(t[max(end - 1, 0)]))


def _longest_stretches(t: Array, is_touched: Flags) -> list[_Stretch]:
    """The longest stretches of rows (N,) that are touched."""
    times = t[is_touched]
    if not len(times):
        return []
    spans = np.split(times, np.flatnonzero(np.diff(times) > MAX_GAP) + 1)
    stretches = [_Stretch(float(span[0]), float(span[-1])) for span in spans]
    stretches = [span for span in stretches if span.end - span.begin >= MIN_DURATION]
    return sorted(stretches, key=lambda span: span.begin - span.end)[:MAX_FORCES]
