"""Kernels for small matrices against numpy."""

import numpy as np
import pytest

from wrenchsight.models.numerics.small_matrices import (
    factorise,
    factorise_in_place,
    factorise_with_floor,
    largest_eigenvalue_3x3,
    solve_factorised,
)


def definite(n: int, seed: int) -> np.ndarray:
    A = np.random.default_rng(seed).normal(size=(n, n))
    return A @ A.T + np.eye(n)


@pytest.mark.parametrize("n", [1, 3, 6, 7])
def test_the_factor_solves_what_numpy_solves(n: int) -> None:
    A, b = definite(n, n), np.random.default_rng(n).normal(size=n)
    L, x = A.copy(), b.copy()
    assert factorise_in_place(L, n, 0.0)
    np.testing.assert_allclose(np.tril(L), np.linalg.cholesky(A), atol=1e-12)
    solve_factorised(L, n, x)
    np.testing.assert_allclose(x, np.linalg.solve(A, b), atol=1e-12)


def test_a_pivot_that_is_too_small_is_reported() -> None:
    assert factorise_in_place(np.diag([1.0, 1e-3]), 2, 1e-4)
    assert not factorise_in_place(np.diag([1.0, 1e-3]), 2, 1e-2)
    assert not factorise_in_place(np.ones((2, 2)), 2, 1e-12)
    assert not factorise_in_place(np.full((2, 2), np.nan), 2, 0.0)


def test_the_factor_and_its_inverse() -> None:
    A = definite(6, 8)
    L, R = A.copy(), np.zeros((6, 6))
    factorise(L, R)
    np.testing.assert_allclose(np.tril(L), np.linalg.cholesky(A), atol=1e-12)
    np.testing.assert_allclose(R @ np.tril(L), np.eye(6), atol=1e-12)


def test_largest_eigenvalue_of_3x3() -> None:
    rng = np.random.default_rng(9)
    for scale in (1e-8, 1.0, 1e12):
        for _ in range(50):
            A = rng.normal(size=(3, 3))
            A = scale * A @ np.diag(rng.uniform(0, 1, 3) ** 8) @ A.T
            A = 0.5 * (A + A.T)
            expected = np.linalg.eigvalsh(A)[-1]
            assert largest_eigenvalue_3x3(A) == pytest.approx(expected, rel=1e-9)
    assert largest_eigenvalue_3x3(np.diag([2.0, 2.0, 2.0])) == 2.0
    assert largest_eigenvalue_3x3(np.zeros((3, 3))) == 0.0


def test_a_pivot_that_rounding_took_is_held_at_its_floor():
    rng = np.random.default_rng(8)
    A = rng.normal(size=(7, 4))
    S = A @ A.T + 0.1 * np.eye(7)
    L = np.tril(S)
    factorise_with_floor(L, 7, np.full(7, 1e-9))
    np.testing.assert_allclose(L, np.linalg.cholesky(S), atol=1e-12)
    lost = np.tril(A @ A.T - 1e-6 * np.eye(7))  # of rank four, and below zero
    floor = 1e-4 * np.arange(1.0, 8.0)
    factorise_with_floor(lost, 7, floor)
    assert np.isfinite(lost).all()
    np.testing.assert_allclose(np.diag(lost)[4:], np.sqrt(floor[4:]), rtol=1e-12)
