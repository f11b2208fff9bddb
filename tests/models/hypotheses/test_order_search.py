"""The search for an order of joints: the best one, and those that explain a log alike."""

from wrenchsight.models.hypotheses.order_search import Order, best_order

NAMES = ("pan", "lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
BY_NAME = (2, 1, 0, 3, 4, 5)


def score(order: Order) -> float:
    """Log evidence: elbow and pan are exchanged, the last two joints are hardly told apart."""
    wrong = sum(k != j for j, k in zip(order[:4], (2, 1, 0, 3), strict=True))
    return -50.0 * wrong + (0.5 if order[4:] == (5, 4) else 0.0)


def test_of_orders_that_explain_alike_the_usual_one_is_taken_and_the_others_are_named() -> None:
    found = best_order(6, [BY_NAME], score, score((0, 1, 2, 3, 4, 5)))
    assert found is not None
    assert found.order == BY_NAME
    assert found.alike == ((2, 1, 0, 3, 5, 4),)
    text = found.alike_text(NAMES)
    assert "[3, 2, 1, 4, 6, 5] would explain them alike" in text
    assert text.endswith("one after the other: wrist_2, wrist_3")


def test_of_orders_that_explain_alike_the_nearest_to_the_log_is_taken() -> None:
    """The last two joints exchanged are likelier by e^0.5 alone."""
    found = best_order(6, [], score, score((0, 1, 2, 3, 4, 5)))
    assert found is not None
    assert found.order == BY_NAME
    assert found.alike == ((2, 1, 0, 3, 5, 4),)


def test_where_one_order_alone_explains_a_log_no_other_is_named() -> None:
    found = best_order(6, [BY_NAME], lambda order: -50.0 * (order != BY_NAME), -50.0)
    assert found is not None
    assert (found.order, found.alike, found.alike_text(NAMES)) == (BY_NAME, (), "")
    assert best_order(6, [BY_NAME], lambda order: -1.0, 0.0) is None
