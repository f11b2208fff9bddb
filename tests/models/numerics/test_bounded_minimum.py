"""Minima within bounds: as exact as the gradient, and the same whatever the last bits say."""

import numpy as np
import pytest
from scipy.optimize import rosen, rosen_der

from wrenchsight.models.numerics.bounded_minimum import bounded_minimum

EVERYWHERE = np.tile([-np.inf, np.inf], (4, 1))


def valley(x):
    return rosen(x), rosen_der(x)


def test_a_curved_valley_is_followed_to_its_end():
    x, value = bounded_minimum(valley, [np.full(4, -1.2)], EVERYWHERE)
    # Newton's last step leaves a gradient of rounding, over a curvature of 0.4 or more.
    np.testing.assert_allclose(x, 1.0, atol=1e-12)
    assert value < 1e-24


def test_a_bound_holds_what_would_go_beyond_it():
    bounds = np.array([[-2.0, 0.5], [-2.0, 2.0], [-2.0, 2.0], [-2.0, 2.0]])
    x, _ = bounded_minimum(valley, [np.zeros(4)], bounds)
    assert x[0] == 0.5
    gradient = valley(x)[1]
    assert gradient[0] < 0.0
    np.testing.assert_allclose(gradient[1:], 0.0, atol=1e-11)


def two_wells(x):
    """Minima at x = -1 and 1, as deep as each other but for rounding."""
    well = (x[0] ** 2 - 1.0) ** 2
    return well + 1e-13 * x[0], np.array([4.0 * x[0] * (x[0] ** 2 - 1.0) + 1e-13])


@pytest.mark.parametrize("first", [-0.8, 0.8])
def test_of_equal_minima_the_first_start_s_counts(first):
    x, _ = bounded_minimum(two_wells, [[first], [-first]], [[-3.0, 3.0]])
    assert x[0] == pytest.approx(np.sign(first), abs=1e-12)


def test_the_deeper_minimum_counts_wherever_the_first_start_is():
    def tilted(x):
        value, gradient = two_wells(x)
        return value + 1e-3 * x[0], gradient + 1e-3

    x, _ = bounded_minimum(tilted, [[0.8], [-0.8]], [[-3.0, 3.0]])
    assert x[0] < 0.0


def test_a_parameter_without_effect_is_at_its_lower_bound():
    def flat(x):
        return (x[0] - 2.0) ** 2, np.array([2.0 * (x[0] - 2.0), 0.0])

    x, _ = bounded_minimum(flat, [[0.0, 3.0]], [[-5.0, 5.0], [-4.0, 9.0]])
    np.testing.assert_allclose(x, [2.0, -4.0], atol=1e-12)


def test_starts_outside_the_bounds_are_moved_within_and_none_is_refused():
    x, _ = bounded_minimum(two_wells, [[-50.0]], [[0.5, 3.0]])
    assert x[0] == pytest.approx(1.0, abs=1e-12)
    with pytest.raises(ValueError, match="no start"):
        bounded_minimum(two_wells, [], [[0.5, 3.0]])
