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
