"""Least squares with a prior: the closed form, its limits, and the scale of the residual."""

import numpy as np
import pytest

from wrenchsight.models.calibration.prior_least_squares import COVARIANCE_ROWS, fit_with_prior

RNG = np.random.default_rng(5)
A = [RNG.normal(size=(60, 3)), RNG.normal(size=(40, 3))]
X = np.array([1.0, -2.0, 0.5])
B = [columns @ X + 0.3 * RNG.normal(size=len(columns)) for columns in A]
ROWS = [np.column_stack([columns, right]) for columns, right in zip(A, B, strict=True)]


def test_closed_form_with_the_scale_that_it_states():
    sd, mean = np.array([0.1, 1.0, 5.0]), np.array([0.9, 0.0, 0.0])
    fit = fit_with_prior(ROWS, sd, mean)
    information = np.diag(sd**-2.0)
    right = mean / sd**2
    for columns, b, s in zip(A, B, fit.scale, strict=True):
        information = information + columns.T @ columns / s**2
        right = right + columns.T @ b / s**2
    np.testing.assert_allclose(fit.values, np.linalg.solve(information, right), rtol=1e-6)
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(information), rtol=1e-6, atol=1e-12)
    errors = [np.sum((columns @ fit.values - b) ** 2) for columns, b in zip(A, B, strict=True)]
    expected = [
        np.sqrt((COVARIANCE_ROWS + e) / (COVARIANCE_ROWS + len(b)))
        for e, b in zip(errors, B, strict=True)
    ]
    # The scale follows the values of the pass before; its changes shrink a hundredfold a pass.
    np.testing.assert_allclose(fit.scale, expected, rtol=1e-6)


def test_the_evidence_is_that_of_the_integral():
    """One unknown and one scale, integrated over a grid; the difference of two sets of columns."""
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(200, 2))
    b = 0.3 * columns[:, 0] + 1.1 * rng.normal(size=200)
    sd, m = 0.5, len(b)

    def integral(a):
        x, s = np.linspace(-3.0, 3.0, 2001)[:, None], np.exp(np.linspace(-0.7, 0.7, 501))
        squares = b @ b - 2.0 * x * (a @ b) + x**2 * (a @ a)
        log = (
            -(COVARIANCE_ROWS + m) * np.log(s)
            - 0.5 * (COVARIANCE_ROWS + squares) / s**2
            - 0.5 * (x / sd) ** 2
        )
        largest = log.max()
        return largest + np.log(np.exp(log - largest).sum())

    evidence = [
        fit_with_prior([np.column_stack([a, b])], np.full(1, sd), np.zeros(1)).log_evidence
        for a in columns.T
    ]
    expected = integral(columns[:, 0]) - integral(columns[:, 1])
    # Laplace's method, and the scale at its mode: a share of 1 / (COVARIANCE_ROWS + m).
    assert evidence[0] - evidence[1] == pytest.approx(expected, abs=0.05)
    assert evidence[0] - evidence[1] > 3.0
    without_prior = fit_with_prior(ROWS, np.full(3, np.inf), np.zeros(3))
    assert np.isnan(without_prior.log_evidence)


def test_without_a_prior_it_is_least_squares():
    fit = fit_with_prior([ROWS[0]], np.full(3, np.inf), np.zeros(3))
    np.testing.assert_allclose(fit.values, np.linalg.lstsq(A[0], B[0], rcond=None)[0])
    np.testing.assert_allclose(
        fit.covariance, fit.scale[0] ** 2 * np.linalg.inv(A[0].T @ A[0]), rtol=1e-9
    )


def test_a_narrow_prior_wins_and_no_rows_leave_it():
    fit = fit_with_prior(ROWS, np.full(3, 1e-6), np.array([7.0, 8.0, 9.0]))
    np.testing.assert_allclose(fit.values, [7.0, 8.0, 9.0], atol=1e-4)
    bare = fit_with_prior([np.zeros((0, 4))], np.array([0.5, 2.0, 3.0]), np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(bare.values, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(bare.standard_deviation, [0.5, 2.0, 3.0])


def test_scatter_widens_the_standard_errors():
    fit = fit_with_prior(ROWS, np.full(3, np.inf), np.zeros(3))
    noisy = [np.column_stack([columns[:, :-1], columns[:, :-1] @ X]) for columns in ROWS]
    for columns in noisy:
        columns[:, -1] += 10.0 * RNG.normal(size=len(columns))
    wider = fit_with_prior(noisy, np.full(3, np.inf), np.zeros(3))
    assert (wider.standard_deviation > 5.0 * fit.standard_deviation).all()


@pytest.mark.parametrize(
    ("rows", "sd", "message"),
    [
        ([np.zeros((5, 3))], np.ones(3), "3 columns"),
        ([np.full((5, 4), np.nan)], np.ones(3), "finite"),
        ([np.ones((5, 4))], np.array([1.0, 0.0, 1.0]), "positive sds"),
        ([np.ones((5, 4))], np.full(3, np.inf), "neither rows nor prior"),
    ],
)
def test_unsolvable_rows_are_refused(rows, sd, message):
    with pytest.raises(ValueError, match=message):
        fit_with_prior(rows, sd, np.zeros(3))
