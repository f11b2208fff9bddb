"""Condition numbers against numpy's, against exact ones, and at the edges."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.conditioning import condition_number
from wrenchsight.models.robot.robot import Robot

# LAPACK's smallest singular value is off by about 1e-16 times the condition number, here 1e-10.
TOLERANCE = 1e-9


@pytest.mark.parametrize("n", range(1, 10))
def test_equals_lapack(n: int) -> None:
    J = np.random.default_rng(n).normal(size=(500, 6, n))
    assert np.abs(condition_number(J) / np.linalg.cond(J) - 1.0).max() < TOLERANCE


@pytest.mark.parametrize("name", ["sts_sre4_600", "ur10e"])
def test_equals_lapack_on_a_robots_jacobians(name: str) -> None:
    chain = Robot.load(name).chain
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (20_000, chain.num_joints))
    J = chain.jacobian(q)
    expected = np.linalg.cond(J)
    regular = expected < 1e6
    assert regular.mean() > 0.999
    condition = condition_number(J)
    assert np.abs(condition[regular] / expected[regular] - 1.0).max() < TOLERANCE
    # Through the chain, without keeping the Jacobians: the same to the last bit.
    assert np.array_equal(chain.condition_number(q), condition)


def test_the_article_arms_distribution(sts: Robot) -> None:
    """Over full turns: minimum 9.06, 94 % above 11 and median 32.5, computed from Table 1."""
    chain = sts.chain
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (100_000, 6))
    values = chain.condition_number(q)
    assert 9.05 < values.min() < 9.2
    assert 0.935 < np.mean(values > 11.0) < 0.945
    # Four standard errors of this median are 0.5.
    assert np.median(values) == pytest.approx(32.5, abs=0.5)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(
    st.integers(1, 8).flatmap(
        lambda n: arrays(np.float64, (6, n), elements=st.floats(-10.0, 10.0, allow_subnormal=False))
    )
)
def test_any_matrix(J: Array) -> None:
    """Zero rows, repeated columns, tiny entries: what hypothesis finds."""
    # Entries below 1e-60 underflow in fourth powers; no Jacobian has any.
    J = np.where(np.abs(J) < 1e-60, 0.0, J)
    expected = np.linalg.svd(J, compute_uv=False)
    ratio = float(condition_number(J))
    if expected[-1] > 1e-6 * expected[0]:
        assert ratio == pytest.approx(expected[0] / expected[-1], rel=TOLERANCE)
    else:
        assert ratio > 0.9e6


def test_condition_numbers_are_relatively_accurate() -> None:
    """Scaled orthogonal rows have singular values that are known to the last digits."""
    rng = np.random.default_rng(2)
    exact = np.array([1.0, 0.3, 1e-3, 1e-6, 1e-9, 1e-12])
    for _ in range(20):
        Q, _ = np.linalg.qr(rng.normal(size=(6, 6)))
        J = rng.permutation(exact)[:, None] * Q
        assert condition_number(J) == pytest.approx(1e12, rel=1e-13)


def test_equal_singular_values() -> None:
    Q, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(6, 6)))
    assert condition_number(Q) == pytest.approx(1.0, abs=1e-14)
    assert condition_number(np.eye(6)) == 1.0
    assert condition_number(2.0 * np.ones((6, 1))) == 1.0


def test_singular_is_infinite(sts: Robot) -> None:
    J = np.random.default_rng(4).normal(size=(6, 6))
    zero_row, equal_columns, dependent = J.copy(), J.copy(), J.copy()
    zero_row[2] = 0.0
    equal_columns[:, 3] = equal_columns[:, 1]
    dependent[5] = J[0] - 2.0 * J[3]  # singular but for rounding
    stack = np.array([np.zeros((6, 6)), zero_row, equal_columns, dependent, J])
    assert np.isinf(condition_number(stack)).tolist() == [True] * 4 + [False]
    # The bundled arm stretched out straight.
    assert np.isinf(sts.chain.condition_number(np.zeros(6)))
    # Seven joints, two of them about the same axis, are not singular for that.
    redundant = np.hstack([J, J[:, :1]])
    assert condition_number(redundant) == pytest.approx(np.linalg.cond(redundant), rel=TOLERANCE)


def test_not_finite_is_nan() -> None:
    J = np.random.default_rng(5).normal(size=(3, 6, 6))
    J[0, 2, 2] = np.nan
    J[1, 0, 5] = np.inf
    assert np.isnan(condition_number(J)).tolist() == [True, True, False]


def test_one_and_many_agree_bit_for_bit() -> None:
    J = np.random.default_rng(6).normal(size=(300, 6, 7))
    many = condition_number(J)
    for k in (0, 127, 128, 299):
        assert np.array_equal(condition_number(J[k]), many[k])
    assert condition_number(J[0]).shape == ()
    folded = J.reshape(30, 10, 6, 7)
    assert np.array_equal(condition_number(folded), many.reshape(30, 10))
    assert condition_number(J[:0]).shape == (0,)
    # Column order in memory must not matter.
    assert np.array_equal(condition_number(np.asfortranarray(J)), many)


def test_bad_samples_leave_their_neighbours_alone() -> None:
    """Samples are turned in groups: what is not finite or singular stays with its own sample."""
    clean = np.random.default_rng(9).normal(size=(64, 6, 6))
    J = clean.copy()
    J[3, 1, 1], J[17, 2, 2], J[18, 0] = np.nan, np.inf, 1e200
    J[33], J[34, 5] = 0.0, 0.0
    bad = [3, 17, 18, 33, 34]
    condition, expected = condition_number(J), condition_number(clean)
    others = np.setdiff1d(np.arange(64), bad)
    assert np.array_equal(condition[others], expected[others])
    assert not np.any(np.isfinite(condition[bad]))
    for k in bad:
        assert np.array_equal(condition_number(J[k]), condition[k], equal_nan=True)


def test_input_is_left_alone() -> None:
    J = np.random.default_rng(7).normal(size=(6, 6))
    before = J.copy()
    condition_number(J)
    assert np.array_equal(J, before)


@pytest.mark.parametrize("shape", [(6,), (5, 6), (6, 0), (3, 7, 6)])
def test_wrong_shapes_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"expected Jacobians of shape \(\.\.\., 6, n\)"):
        condition_number(np.zeros(shape))
