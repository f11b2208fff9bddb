"""Base parameters: rank, combinations and realisation, against chosen linear dependence."""

import numpy as np
import pytest

from wrenchsight.models.identification.base_parameters import (
    find_base_parameters,
    realise,
    triangular_factor,
)


def regressor(rng, rows=400):
    """a, b, c free; d = 2 a - 0.003 b; e = 0; f = c: rank 3 of 6, and very different units."""
    a, b, c = rng.normal(size=(3, rows)) * np.array([[1.0], [1e3], [1e-3]])
    return np.stack([a, b, c, 2.0 * a - 3e-3 * b, 0.0 * a, c], axis=1)


NAMES = ["a", "b", "c", "d", "e", "f"]


@pytest.fixture
def W():
    return regressor(np.random.default_rng(0))


def test_rank_and_names_follow_the_dependence(W):
    base = find_base_parameters(W, NAMES)
    assert len(base.names) == 3
    assert base.without_effect == ("e",)
    # c and f are the same column: whichever is kept, the other joins with factor one.
    assert any(name in ("c + f", "f + c") for name in base.names)
    # Pivots: kept ones of order one, dropped ones at rounding.
    assert base.smallest_kept > 0.1
    assert base.largest_dropped < 1e-12


def test_combinations_carry_the_whole_torque(W):
    base = find_base_parameters(W, NAMES)
    x = np.random.default_rng(1).normal(size=6)
    torque = W @ x
    # Rounding: the longest column is about 1e3 * sqrt(400).
    np.testing.assert_allclose(
        W[:, base.independent] @ (base.combination @ x), torque, atol=1e-9 * np.abs(torque).max()
    )


def test_condition_number_is_that_of_the_scaled_kept_columns(W):
    base = find_base_parameters(W, NAMES)
    columns = W[:, base.independent]
    # 1e-9: svd of the tall matrix against svd of its triangular factor.
    expected = np.linalg.cond(columns / np.linalg.norm(columns, axis=0))
    assert base.condition_number == pytest.approx(expected, rel=1e-9)


def test_triangular_factor_gives_the_same_base_parameters(W):
    whole, reduced = (find_base_parameters(A, NAMES) for A in (W, triangular_factor(W)))
    np.testing.assert_array_equal(whole.independent, reduced.independent)
    np.testing.assert_allclose(whole.combination, reduced.combination, atol=1e-9)


def test_units_do_not_change_what_is_determined(W):
    units = np.array([1e2, 1e-2, 10.0, 1.0, 1.0, 0.3])
    scaled = find_base_parameters(W * units, NAMES)
    assert len(scaled.names) == 3
    assert scaled.without_effect == ("e",)


def test_realise_meets_the_values_and_moves_least(W):
    base = find_base_parameters(W, NAMES)
    rng = np.random.default_rng(2)
    prior, spread = rng.normal(size=6), rng.uniform(0.5, 2.0, size=6)
    values = rng.normal(size=3)
    x = realise(base, values, prior, spread)
    np.testing.assert_allclose(base.combination @ x, values, atol=1e-12)
    # Least: every other solution differs by a null vector, and the weighted step is normal to all.
    null = np.linalg.svd(base.combination)[2][3:]
    np.testing.assert_allclose(null @ ((x - prior) / spread**2), 0.0, atol=1e-11)
    # A parameter without effect stays as the prior has it.
    assert x[4] == prior[4]


def test_realise_returns_a_prior_that_already_fits(W):
    base = find_base_parameters(W, NAMES)
    prior = np.random.default_rng(3).normal(size=6)
    x = realise(base, base.combination @ prior, prior, np.ones(6))
    np.testing.assert_allclose(x, prior, atol=1e-13)


@pytest.mark.parametrize(
    ("W", "problem"),
    [
        (np.zeros((5, 6)), "zero"),
        (np.full((5, 6), np.nan), "not finite"),
        (np.ones((5, 4)), "does not fit"),
    ],
)
def test_bad_regressors_are_refused(W, problem):
    with pytest.raises(ValueError, match=problem):
        find_base_parameters(W, NAMES)


def test_the_longer_of_two_parallel_columns_stands_for_both():
    x = np.random.default_rng(4).normal(size=50)
    for W, expected in (
        (np.stack([1e-3 * x, x], axis=1), "b + 0.001 a"),
        (np.stack([x, 1e-3 * x], axis=1), "a + 0.001 b"),
    ):
        assert find_base_parameters(W, ["a", "b"]).names == (expected,)
