"""The evidence of a log for one explanation: a marginal likelihood in which contacts are allowed.

The residual r (n,) of a row is what the measured torque leaves of the expected one. A row is of one
of these kinds, whose shares are learnt from the log:

    free        r has the covariance S of the model's error
    poor        3 times the model's error: drift, a poor model
    touched     S + J^T P J: a force at the tool as large as the live prior's
    pressed     S + J^T P J, with four times that force
    odd         S + a share of the effort limits squared: a contact elsewhere, or a fault

What an explanation leaves open is linear, r = measured - expected - A theta, with a Gaussian prior
of theta. Its most likely value comes from expectation and maximisation over the rows' kinds; the
evidence is Laplace's: the likelihood there times the volume of theta that the log leaves, over
that which the prior gave. So a free number, a force at the tool and a permutation pay for what they
could have explained, and explanations of different kinds compare by odds.

Rows closer together than CORRELATION_TIME share the model's error (REST_CORRELATION where nothing
moves): each counts as that part of an independent sample.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.numerics.arrays import Array

CORRELATION_TIME = 0.25  # s, of the model's error in motion
REST_CORRELATION = 2.5  # s, of stiction
POOR_ERROR_RATIO = 3.0  # times the model's error
PRESSED_FORCE_RATIO = 4.0  # times the live prior's force
ODD_SHARE = 0.15  # of the effort limit
# Kinds of rows. Beside the model's error there is nothing ("free"), or it is larger than stated
# ("poor"). A force acts at E as the live prior has it ("touched"), or a larger one ("pressed"). Or
# each joint has another error, of ODD_SHARE of its effort limit ("odd").
KINDS = ("free", "poor", "touched", "pressed", "odd")
KIND_PRIOR = np.array([20.0, 2.0, 1.0, 1.0, 0.5])  # counts of a Dirichlet prior
_NUM_ITERATIONS, _NUM_QUICK_ITERATIONS = 6, 3
_BLOCK_NUMBERS = 2500  # numbers of A in one product
_LARGEST_RESIDUAL = 1e8  # N m; squares stay finite


@dataclass(frozen=True, eq=False)
class Fit:
    """The most likely explanation of one form.

    Attributes:
        log_evidence: natural logarithm.
        theta: (k,) values of what was open, and their standard errors `sd`.
        kind_share: (5,) of the rows, by KINDS.
        residual: (N, n) N m.
    """

    log_evidence: float
    theta: Array
    sd: Array
    kind_share: Array
    residual: Array


@dataclass(frozen=True, eq=False)
class RowKinds:
    """Covariances of the residual of N rows, by kind.

    Attributes:
        sd: (N, n) N m, of the model's error.
        J: (N, 6, n) of E, rotation first.
        wrench_sd: (6,) N m and N of the live prior, rotation first.
        odd_sd: (n,) N m.
        weight: (N,) independent samples that a row stands for.
    """

    sd: Array
    J: Array
    wrench_sd: Array
    odd_sd: Array
    weight: Array

    @cached_property
    def precision(self) -> Array:
        """(5, N, n, n) 1/(N m)^2."""
        return np.asarray(np.linalg.inv(self._covariance))

    @cached_property
    def log_scale(self) -> Array:
        """(5, N) logarithms of the densities at r = 0."""
        n = self.sd.shape[1]
        _, log_det = np.linalg.slogdet(self._covariance)
        return np.asarray(-0.5 * (log_det + n * np.log(2.0 * np.pi)))

    @cached_property
    def _covariance(self) -> Array:
        n = self.sd.shape[1]
        S = np.zeros((len(self.sd), n, n))
        S[:, np.arange(n), np.arange(n)] = self.sd**2
        scaled = self.J * self.wrench_sd[:, None]
        touched = np.swapaxes(scaled, 1, 2) @ scaled
        odd = np.diag(self.odd_sd**2)
        return np.stack(
            [S, POOR_ERROR_RATIO**2 * S, S + touched, S + PRESSED_FORCE_RATIO**2 * touched, S + odd]
        )

    def fit(self, residual: Array, A: Array, prior_sd: Array, quick: bool = False) -> Fit:
        """Fits theta to residual = A theta + error; each row is of one of the KINDS.

        Args:
            residual: (N, n) N m.
            A: (N, n, k) N m per unit of theta.
            prior_sd: (k,) of theta, whose prior has mean zero.
            quick: from one start and with few iterations, to rank what is fitted again.
        """
        residual = np.clip(residual, -_LARGEST_RESIDUAL, _LARGEST_RESIDUAL)
        scaled = A * prior_sd  # of theta / prior_sd, whose prior is of unit sd
        # The kinds make several optima. Begun from what explains the rows as far as anything may,
        # all of them "odd", and from no correction.
        odd = self.precision[-1] * self.weight[:, None, None]
        starts = [self._solved(scaled, residual, odd)[0]]
        if not quick:
            starts.append(np.zeros(len(prior_sd)))
        fits = [
            self._iterated(residual, scaled, theta, None, _NUM_QUICK_ITERATIONS) for theta in starts
        ]
        best = max(fits, key=lambda fit: fit.log_evidence)
        if not quick:
            best = self._iterated(residual, scaled, best.theta, best.kind_share, _NUM_ITERATIONS)
        return replace(best, theta=best.theta * prior_sd, sd=best.sd * prior_sd)

    def _iterated(
        self, residual: Array, A: Array, theta: Array, share: Array | None, iterations: int
    ) -> Fit:
        """Expectation maximisation over the rows' kinds, begun from theta (k,) of unit prior sd.

        Args:
            share: (5,) of the kinds at the start; None: that of KIND_PRIOR.
        """
        prior_share = KIND_PRIOR / KIND_PRIOR.sum()
        total = float(self.weight.sum())
        share = prior_share if share is None else (total * share + prior_share) / (total + 1.0)
        left = residual - A @ theta
        kind, log_rows = self.of_rows(left, share)
        for _ in range(iterations):
            share = (kind @ self.weight + prior_share) / (total + 1.0)
            precision = ((kind * self.weight)[:, :, None, None] * self.precision).sum(axis=0)
            theta, hessian = self._solved(A, residual, precision)
            left = residual - A @ theta
            kind, log_rows = self.of_rows(left, share)
        covariance = np.linalg.inv(hessian)
        _, log_det = np.linalg.slogdet(hessian)
        log_evidence = float(self.weight @ log_rows - 0.5 * theta @ theta - 0.5 * log_det)
        kind_share = kind @ self.weight / total
        return Fit(log_evidence, theta, np.sqrt(np.diag(covariance)), kind_share, left)

    def of_rows(self, residual: Array, share: Array) -> tuple[Array, Array]:
        """Probability (5, N) of each row's kind, and the logarithm (N,) of the row's density.

        Args:
            residual: (N, n) N m.
            share: (5,) of the kinds, all above zero.
        """
        whitened = np.matmul(self.precision, residual[:, :, None])[..., 0]
        squares = (whitened * residual).sum(axis=2)
        log_kinds = np.log(share)[:, None] + self.log_scale - 0.5 * squares
        largest = log_kinds.max(axis=0)
        kinds = np.exp(log_kinds - largest)
        total = kinds.sum(axis=0)
        return kinds / total, largest + np.log(total)

    @staticmethod
    def _solved(A: Array, residual: Array, precision: Array) -> tuple[Array, Array]:
        """theta (k,), and the Hessian (k, k) of its posterior."""
        # Block by block: one large product would start threads for microseconds.
        n, k = A.shape[1:]
        weighted = precision @ A
        size = max(1, _BLOCK_NUMBERS // (n * k))
        hessian = np.eye(k)
        for begin in range(0, len(A), size):
            rows = slice(begin, begin + size)
            hessian += A[rows].reshape(-1, k).T @ weighted[rows].reshape(-1, k)
        gradient = np.einsum("nik,ni->k", weighted, residual)
        return np.linalg.solve(hessian, gradient), hessian


def row_weights(step: float, is_moving: NDArray[np.bool_]) -> Array:
    """(N,) independent samples that rows stand for, `step` s apart."""
    weight = step / np.where(is_moving, CORRELATION_TIME, REST_CORRELATION)
    return np.asarray(np.minimum(weight, 1.0))
