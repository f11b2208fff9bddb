"""Hypothesis: positions and velocities, or all signals, are in another order of joints."""

import math
from dataclasses import replace

from wrenchsight.models.hypotheses.case import Case, View
from wrenchsight.models.hypotheses.explanation import Explanation, joint_remedy, likeliest
from wrenchsight.models.hypotheses.order_search import Order, best_order, order_text, usual_orders
from wrenchsight.models.recordings.log_words import ORDER_WORD

NAME = "order of the joints"


def explain(case: Case) -> Explanation | None:
    """The order of the positions, or of all signals, that explains the log best."""
    return likeliest(_explain(case, with_effort) for with_effort in (False, True))


def _explain(case: Case, with_effort: bool) -> Explanation | None:
    """The order of the joints that explains the log best; None: that which it has.

    Args:
        case: the log, its model and the fit of the log as it is.
        with_effort: whether the drives' signals are in that order, too.
    """
    n = case.num_joints
    if n < 2:
        return None

    def score(order: Order) -> float:
        """Log evidence of the log in an order: for each joint its index in the log, from 0."""
        return case.fit(_view(case, order, with_effort), quick=True).log_evidence

    # Each pass exchanges one pair. Where the log suits its model as it is, one pass is enough to
    # see that no exchange is better; a log in a wrong order takes some.
    passes = 1 if case.base_is_good else 3
    found = best_order(n, usual_orders(case.robot), score, case.quick_base_evidence, passes)
    if found is None:
        return None
    order = found.order
    view = _view(case, order, with_effort)
    fitted = case.fitted(view)
    # Odds beforehand: all n! orders are equally likely, with or without the drives' signals.
    log_prior = -math.lgamma(n + 1) - math.log(2.0)
    order_listed, places = order_text(order), [k + 1 for k in order]
    signals = "all signals" if with_effort else "positions and velocities"
    return Explanation(
        name=NAME,
        fitted=fitted,
        log_prior=log_prior,
        is_choice=True,
        cause=f"{signals} in the order {order_listed}",
        remedy=(
            joint_remedy(case.key if with_effort else None, ORDER_WORD, order_listed, places)
            + found.alike_text(case.robot.joint_names)
        ),
        values={"order": [float(k + 1) for k in order]},
    )


def _view(case: Case, order: Order, with_effort: bool) -> View:
    rows, places = case.rows, list(order)
    signals = ["q", "v", "vdot", "sliding", *(["effort"] if with_effort else [])]
    changed = {name: getattr(rows, name)[:, places].copy() for name in signals}
    return case.view(replace(rows, **changed))
