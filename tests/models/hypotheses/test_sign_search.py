"""Which joints are named as turned; the score is a sum over the joints, so that it is known."""

import numpy as np
import pytest

from wrenchsight.models.hypotheses.sign_search import best_signs


@pytest.mark.parametrize(
    ("gains", "turned"),
    [
        ((100.0, 2.0, -50.0), [0]),  # e^2 to 1 names no joint
        ((100.0, 6.0, -50.0), [0, 1]),
        ((50.0, 50.0, -2.0), [0, 1, 2]),  # a convention: the light joint's sign is not seen
        ((50.0, 50.0, -9.0), [0, 1]),
        ((-5.0, -5.0, -5.0), []),
        ((-50.0, 1.5, 2.5), [2]),  # the best one alone: its odds are judged elsewhere
    ],
)
def test_a_joint_is_turned_where_that_is_far_likelier(
    gains: tuple[float, ...], turned: list[int]
) -> None:
    """Gains of log evidence by turning each joint."""

    def score(signs: np.ndarray) -> float:
        return float(np.dot(gains, signs < 0.0))

    signs = best_signs(len(gains), score, 0.0)
    expected = np.ones(len(gains))
    expected[turned] = -1.0
    np.testing.assert_array_equal(np.ones(len(gains)) if signs is None else signs, expected)


def test_the_opposite_of_the_true_signs_does_not_hide_them() -> None:
    """All turned is likelier than the log's own signs, and leads to the opposite of the true ones:
    a Panda's log with torques 2 and 6 turned was said to have 1, 3, 4 and 5 turned."""
    true_signs = np.array([1.0, -1.0, 1.0, 1.0, -1.0])

    def score(signs: np.ndarray) -> float:
        wrong = np.sum(signs != true_signs)
        wrong_of_opposite = np.sum(signs != -true_signs)
        return float(max(100.0 - 40.0 * wrong, 60.0 - 10.0 * wrong_of_opposite))

    assert score(-np.ones(5)) > score(np.ones(5))
    np.testing.assert_array_equal(best_signs(5, score, score(np.ones(5))), true_signs)
