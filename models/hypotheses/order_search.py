"""Orders of joints that logs have: candidates, and a search by exchanges."""

from collections.abc import Callable, Sequence
from itertools import combinations

from wrenchsight.models.robot.robot import Robot

Order = tuple[int, ...]
"""Entry j is the place, counted from 0, at which the log has what belongs to joint j."""


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
) -> Order | None:
    """The order of the largest score by exchanges of pairs; None where no other order is better.

    Args:
        num_joints: n; an order has for each joint of the robot its index in the log.
        starts: from which the search begins, beside the log's own order.
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
    return None if best == own_order else best


def order_text(order: Order) -> str:
    """The order as a list in YAML, counted from 1."""
    return "[" + ", ".join(str(k + 1) for k in order) + "]"
