"""Orders of joints that logs have: candidates, and a search by exchanges."""

import math
from collections.abc import Callable, Sequence
from itertools import combinations
from typing import NamedTuple

from wrenchsight.models.robot.robot import Robot

Order = tuple[int, ...]
"""Entry j is the place, counted from 0, at which the log has what belongs to joint j."""

ALIKE_ODDS = 100.0  # within which two orders explain a log alike
_MOST_STATED = 2  # orders that are named beside the one that is taken


class FoundOrder(NamedTuple):
    """The order that explains a log best, and those that explain it alike, likeliest first."""

    order: Order
    alike: tuple[Order, ...]

    def alike_text(self, joint_names: Sequence[str]) -> str:
        """A clause on the orders that explain the log alike; empty where there is none."""
        if not self.alike:
            return ""
        stated = self.alike[:_MOST_STATED]
        unlike = {j for order in stated for j, k in enumerate(order) if k != self.order[j]}
        names = ", ".join(joint_names[j] for j in sorted(unlike))
        orders = " or ".join(order_text(order) for order in stated)
        return (
            f"; {orders} would explain them alike: the names of the columns tell which it is, or a "
            f"log in which these joints move one after the other: {names}"
        )


def usual_orders(robot: Robot) -> list[Order]:
    """Orders that loggers make: by name, and from tool to base."""
    n = robot.num_joints
    names = sorted(robot.joint_names)
    by_name = tuple(names.index(name) for name in robot.joint_names)
    backwards = tuple(reversed(range(n)))
    known = tuple(range(n))
    return [order for order in dict.fromkeys((by_name, backwards)) if order != known]


def exchanged(order: Sequence[int], j: int, k: int) -> Order:
    """The order with the places of joints j and k exchanged."""
    changed = list(order)
    changed[j], changed[k] = changed[k], changed[j]
    return tuple(changed)


def best_order(
    num_joints: int,
    starts: Sequence[Order],
    score: Callable[[Order], float],
    base_score: float,
    passes: int = 3,
) -> FoundOrder | None:
    """The order of the largest score by exchanges of pairs; None where no other order is better.

    Of orders whose scores are within ALIKE_ODDS of the largest one, the first of `starts` is taken;
    else that of the fewest joints out of place: exchanged, joints that move little fit alike.

    Args:
        num_joints: n; an order has for each joint of the robot its index in the log.
        starts: from which the search begins, beside the log's own order: the usual orders first.
        score: score of an order; each order's is computed once.
        base_score: score of the log's own order.
        passes: exchanges of one pair, at most.
    """
    own_order = tuple(range(num_joints))
    scores = {own_order: base_score}

    def scored(order: Order) -> float:
        """The order's score, computed once."""
        if order not in scores:
            scores[order] = score(order)
        return scores[order]

    best = max((own_order, *starts), key=scored)
    for _ in range(passes):
        neighbours = [exchanged(best, j, k) for j, k in combinations(range(num_joints), 2)]
        better = max(neighbours, key=scored)
        if scored(better) <= scored(best):
            break
        best = better
    if best == own_order:
        return None
    least = scored(best) - math.log(ALIKE_ODDS)
    alike = [order for order in sorted(scores, key=scored, reverse=True) if scored(order) > least]
    alike = [order for order in alike if order != own_order]
    nearest = min(alike, key=lambda order: sum(k != j for j, k in enumerate(order)))
    taken = next((order for order in starts if order in alike), nearest)
    return FoundOrder(taken, tuple(order for order in alike if order != taken))


def order_text(order: Order) -> str:
    """The order as a list in YAML, counted from 1."""
    return "[" + ", ".join(str(k + 1) for k in order) + "]"
