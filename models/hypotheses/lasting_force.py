"""Hypothesis: forces at the tool that last, each for seconds. No fault of the log: they are read.

The evidence charges each row in contact for a force of its own. A push that lasts for seconds is
one force: here each stretch of contact has one wrench, constant in the axes of W or of E, beside
the rows' own kinds. So a tilt, a zero or a gain competes with what is as simple.

A stretch begins as rows that the model without corrections does not leave free. Then wrench and
stretch take turns: the stretch is the interval over which the wrench raises the likelihood most.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wrenchsight.models.hypotheses.case import Case, View
from wrenchsight.models.hypotheses.evidence import KIND_PRIOR, Fit
from wrenchsight.models.hypotheses.explanation import Explanation
from wrenchsight.models.numerics.arrays import Array, Flags

NAME = "force that lasts"
MAX_FREE_PROBABILITY = 0.5  # of a row of a stretch
MIN_DURATION = 1.0  # s, of a force
MAX_GAP = 0.5  # s, within one force
MAX_FORCES = 4  # of a log, the longest ones
_NUM_PASSES = 2  # of new stretches, after the fit within the first ones
_NUM_FORMS = 2  # axes
_SHARE = KIND_PRIOR / KIND_PRIOR.sum()


class _Stretch(NamedTuple):
    """Begin and end of a force, s."""

    begin: float
    end: float


def explain(case: Case) -> Explanation | None:
    """The log with one wrench for each of the longest stretches; None: there is none."""
    at = case.at
    kind, _ = case.base.kinds.of_rows(case.base.measured[at] - case.base.expected[at], _SHARE)
    first_stretches = _longest_stretches(case.rows.t[at], kind[0] < MAX_FREE_PROBABILITY)
    if not first_stretches:
        return None
    q = case.rows.q[at]
    J = case.jacobian(q)
    R_EW = case.orientation(q).transpose(0, 2, 1)
    J_in_E = np.concatenate([R_EW @ J[:, :3], R_EW @ J[:, 3:]], axis=1)
    fits = [_fitted(case, in_axes.transpose(0, 2, 1), first_stretches) for in_axes in (J, J_in_E)]
    view, fit = max(fits, key=lambda pair: pair[1].log_evidence)
    return Explanation(
        name=NAME,
        log_evidence=fit.log_evidence - math.log(_NUM_FORMS),
        explained=case.explained(view, fit),
        kind_share=fit.kind_share,
        cause="a force at the tool that lasts",
        remedy="nothing is to be mended",
        is_fault=False,
    )


def _fitted(case: Case, columns: Array, first_stretches: Sequence[_Stretch]) -> tuple[View, Fit]:
    """The view and the fit of constant wrenches, from a first guess of their stretches.

    The wrenches are fitted within the first stretches. Then, as long as the evidence grows and
    _NUM_PASSES times at most, the stretches are fitted to the wrenches and these within them.

    Args:
        case: the log, its model and the fit of the log as it is.
        columns: (N, n, 6) torque of each component of a wrench, moment first, at the rows
            `Case.at`.
        first_stretches: one for each wrench.
    """
    masks = [_rows_within(case, stretch) for stretch in first_stretches]
    view, fit = _fitted_within(case, columns, masks)
    for _ in range(_NUM_PASSES):
        # What `with_columns` adds comes first in theta: six numbers a stretch.
        wrenches = fit.theta[: 6 * len(masks)].reshape(-1, 6)
        masks = [
            _rows_within(case, _best_interval(case, fit, columns @ wrench, is_within))
            for wrench, is_within in zip(wrenches, masks, strict=True)
        ]
        next_view, next_fit = _fitted_within(case, columns, masks)
        if next_fit.log_evidence <= fit.log_evidence:
            break
        view, fit = next_view, next_fit
    return view, fit


def _rows_within(case: Case, stretch: _Stretch) -> Flags:
    """(N,) which of the rows `Case.at` lie in a stretch."""
    t = case.rows.t[case.at]
    begin, end = stretch
    return np.asarray((t >= begin) & (t <= end))


def _fitted_within(case: Case, columns: Array, masks: Sequence[Flags]) -> tuple[View, Fit]:
    """The view and the fit with a constant wrench in each of some stretches.

    Args:
        case: the log, its model and the fit of the log as it is.
        columns: (N, n, 6) as `_fitted`.
        masks: (N,) rows of each stretch.
    """
    blocks = [columns * is_within[:, None, None] for is_within in masks]
    prior_sd = np.tile(case.base.kinds.wrench_sd, len(masks))
    view = case.base.with_columns(np.concatenate(blocks, axis=2), prior_sd)
    return view, case.fit(view)


def _best_interval(case: Case, fit: Fit, torque: Array, is_within: Flags) -> _Stretch:
    """The interval over which a wrench raises the likelihood most.

    Args:
        fit: with the wrench where `is_within`, (N,).
        torque: (N, n) N m, of the wrench at all rows.
    """
    kinds, share = case.base.kinds, np.maximum(fit.kind_share, _SHARE / len(_SHARE))
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
