"""Hypothesis: currents or torques are in another order of joints than positions."""

import math

import numpy as np
from scipy.optimize import linear_sum_assignment

from wrenchsight.models.hypotheses.case import Case, View
from wrenchsight.models.hypotheses.explanation import Explanation
from wrenchsight.models.hypotheses.order_search import Order, best_order, order_text, usual_orders
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.log_words import DRIVE_SIGNALS, ORDER_WORD, correction_word

NAME = "order of the drives"
_NUM_EXCHANGES = 2  # of pairs, after the starts
_MIN_SINGULAR_RATIO = 1e-6  # of the columns: less, and one depends on the others


def explain(case: Case) -> Explanation | None:
    """The order of the drives that explains the log best; None: that which it has.

    An order has for each joint of the robot the index of the drive in the log, from 0.

    Args:
        case: the log, its model and the fit of the log as it is.
    """
    n = case.num_joints
    if n < 2:
        return None
    starts = [*usual_orders(case.robot), _assignment(case)]

    def score(order: Order) -> float:
        """Log evidence of the log with its drives in an order."""
        return case.fit(_view(case, order), quick=True).log_evidence

    found = best_order(n, starts, score, case.quick_base_evidence, _NUM_EXCHANGES)
    if found is None:
        return None
    order = found.order
    view = _view(case, order)
    fitted = case.fitted(view)
    word = case.word
    return Explanation(
        name=NAME,
        fitted=fitted,
        log_prior=-math.lgamma(n + 1),
        is_choice=True,
        cause=f"{word}s in the order {order_text(order)}",
        remedy=(
            f"set {case.key}: {{order: {order_text(order)}}} in a description, or try "
            f"--log-format {correction_word(DRIVE_SIGNALS, ORDER_WORD, [k + 1 for k in order])}"
            f"{found.alike_text(case.robot.joint_names)}"
        ),
        values={"order": [float(k + 1) for k in order]},
    )


def _view(case: Case, order: Order) -> View:
    return case.changed_effort(case.rows.effort[:, list(order)])


def _assignment(case: Case) -> Order:
    """The order in which each drive fits its joint best, one by one, with friction open."""
    n, at, rows = case.num_joints, case.at, case.rows
    expected = case.base.expected[at]
    sd = case.base.kinds.sd
    cost = np.zeros((n, n))
    for k in range(n):
        effort = np.repeat(rows.effort[at, k][:, None], n, axis=1)
        torque = case.joint_torque(effort)  # of drive k, at each joint in turn
        for j in range(n):
            columns = np.stack([rows.sliding[at, j], rows.v[at, j], np.ones(len(at))], axis=1)
            cost[j, k] = _misfit((torque[:, j] - expected[:, j]) / sd[:, j], columns)
    return tuple(int(k) for k in linear_sum_assignment(cost)[1])


def _misfit(residual: Array, columns: Array) -> float:
    """Logarithm of what columns leave of a residual; robust, as a contact may last for a while."""
    solution = np.linalg.lstsq(columns, residual, rcond=_MIN_SINGULAR_RATIO)[0]
    left = residual - columns @ solution
    return float(np.log1p(left**2).mean())
