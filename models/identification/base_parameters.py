"""Base parameters: the combinations of parameters that a set of motions determines.

A torque that is linear in p parameters, tau = W x, seldom determines them all: columns of W vanish
or depend on each other. With W1 a largest set of independent columns and W2 = W1 K the others,

    W x = W1 (x1 + K x2),

so that the motion determines the base parameters x1 + K x2 and no more (Gautier, "Numerical
calculation of the base inertial parameters of robots", 1991). Rank and K come from a QR
factorisation of W with column pivoting. The columns are scaled to unit length. Otherwise the choice
of units would decide which parameters count as determined.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from wrenchsight.models.numerics.arrays import Array

# Dependent columns have pivots of 1e-15; a joint axis written as 1.57079632679 makes that 1e-11.
# Determined columns lie above 1e-3 even for poor motions. No value in between has occurred.
RANK_TOLERANCE = 1e-7
HIGH_CONDITION_NUMBER = 100.0  # above it, small torque errors move the parameters a lot
_LENGTH_POWER = 0.05  # by which a longer column is preferred; small, so that the rank decides
_ORDER_WEIGHT = 1e-6  # relative; how much a column's place counts against its length


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """The determined combinations of p parameters.

    Attributes:
        names: the b combinations, written out.
        independent: (b,) columns of W kept, ascending.
        combination: (b, p); base parameters = combination @ parameters. The identity on the columns
            `independent`, K on the others.
        without_effect: names of the parameters that no torque depends on.
        condition_number: condition number of the kept columns, scaled to unit length.
        smallest_kept: smallest pivot kept, relative to the largest.
        largest_dropped: largest pivot dropped, relative to the largest; 0 if none was dropped.
            The wider the gap between the two, the surer the rank.
    """

    names: tuple[str, ...]
    independent: NDArray[np.intp]
    combination: Array
    without_effect: tuple[str, ...]
    condition_number: float
    smallest_kept: float
    largest_dropped: float


def triangular_factor(W: Array) -> Array:
    """Returns R (min(m, p), p) with R^T R = W^T W for W (m, p): all that the fit needs from W."""
    # The mode "r" would take R of all m rows; "raw" makes no Q either.
    _, R = qr(W, mode="raw", check_finite=False)
    return np.asarray(R)


def independent_columns(W: Array, tolerance: float = RANK_TOLERANCE) -> NDArray[np.intp]:
    """Returns `BaseParameters.independent` of a regressor W (m, p) that is finite and not zero."""
    factor = _pivoted(W, tolerance)
    return np.sort(factor.present[factor.order[: int((factor.pivots > tolerance).sum())]])


def find_base_parameters(
    W: Array, names: Sequence[str], tolerance: float = RANK_TOLERANCE
) -> BaseParameters:
    """Finds the base parameters of a regressor.

    Args:
        W: (m, p) regressor over all samples and joints, or its triangular factor.
        names: names of the p parameters.
        tolerance: pivot, relative to the largest, below which a scaled column counts as dependent;
            and length, relative to the longest column, below which it counts as zero.

    Returns:
        The b base parameters, each a combination (row of (b, p)) of parameters: one of the columns
        that are independent of one another, plus what depends on it.

    Raises:
        ValueError: shapes disagree, W is not finite, or W is zero.
    """
    W = np.asarray(W, float)
    if W.ndim != 2 or W.shape[1] != len(names):
        raise ValueError(f"regressor {W.shape} does not fit {len(names)} names")
    if not np.isfinite(W).all():
        raise ValueError("regressor has values that are not finite")
    if not W.any():
        raise ValueError("regressor is zero: nothing moves and nothing weighs")
    factor = _pivoted(W, tolerance)
    pivots, length = factor.pivots, factor.length  # pivots fall, those of independent columns first
    b = int((pivots > tolerance).sum())
    columns = factor.present[factor.order]  # of W, in the order of R
    independent, dependent = columns[:b], columns[b:]
    R = factor.R / factor.favour[factor.order]  # of columns of length 1, as they are not favoured
    # The dependent columns are the independent ones times K, all of length 1.
    K = solve_triangular(R[:b, :b], R[:b, b:])
    K[np.abs(K) < tolerance] = 0.0  # rounding
    combination = np.zeros((b, len(names)))
    combination[np.arange(b), independent] = 1.0
    combination[:, dependent] = K * length[dependent] / length[independent][:, None]
    ascending = np.argsort(independent, kind="stable")
    combination = combination[ascending]
    singular_values = np.linalg.svd(R[:b, :b], compute_uv=False)
    return BaseParameters(
        names=tuple(
            _written_out(row, column, names)
            for row, column in zip(combination, independent[ascending], strict=True)
        ),
        independent=independent[ascending],
        combination=combination,
        without_effect=tuple(names[i] for i in np.setdiff1d(np.arange(len(names)), columns)),
        condition_number=float(singular_values[0] / singular_values[-1]),
        smallest_kept=float(pivots[b - 1]),
        largest_dropped=float(pivots[b]) if b < len(pivots) else 0.0,
    )


class _PivotedFactor(NamedTuple):
    """QR factorisation with column pivoting of a regressor W (m, p).

    Attributes:
        R: upper triangle, of the columns `present[order]`, scaled to length one, times favour.
        length: (p,) of all columns of W.
        present: columns whose length is not zero.
        order: (len(present),) of these columns in R.
        favour: (len(present),) factors by which longer columns are preferred.
        pivots: pivots of R, relative to the largest.
    """

    R: Array
    length: Array
    present: NDArray[np.intp]
    order: NDArray[np.intp]
    favour: Array
    pivots: Array


def _pivoted(W: Array, tolerance: float) -> _PivotedFactor:
    """Factorises W; columns shorter than `tolerance` times the longest count as zero."""
    length = np.linalg.norm(W, axis=0)
    present = np.flatnonzero(length > tolerance * length.max())
    # Of two columns that are multiples of each other, the longer one is kept: a moment of inertia
    # is then not written as 1000 times some mass. Without this rule, rounding would decide.
    favour = (length[present] / length.max()) ** _LENGTH_POWER
    scaled = W[:, present] / length[present]
    _, R, order = qr(scaled * favour, mode="raw", pivoting=True, check_finite=False)
    # Of two columns of one length, the earlier one is kept. LAPACK compares lengths that it updates
    # step by step; they are exact to half their digits.
    ordered_favour = favour * (1.0 - _ORDER_WEIGHT * np.arange(len(present)))
    _, _, by_rule = qr(scaled * ordered_favour, mode="raw", pivoting=True, check_finite=False)
    if not np.array_equal(by_rule, order):
        order = by_rule
        R = triangular_factor((scaled * favour)[:, order])
    pivots = np.abs(np.diag(R)) / np.abs(R[0, 0])
    return _PivotedFactor(R, length, present, order, favour, pivots)


def realise(base: BaseParameters, values: Array, prior: Array, spread: Array) -> Array:
    """Returns the p parameters nearest to `prior` that have the given base parameters.

    Minimises sum(((x - prior) / spread)^2) subject to combination @ x = values. What the motion
    does not determine keeps the prior's value.

    Args:
        base: the combinations.
        values: (b,) their values.
        prior: (p,) for instance what the robot's URDF states.
        spread: (p,) how far each parameter may plausibly lie from the prior, positive.
    """
    B = base.combination * spread
    # The minimum-norm solution by QR of B^T, which has full column rank: B holds an identity.
    Q, R = np.linalg.qr(B.T)
    missing = values - base.combination @ prior
    step = Q @ solve_triangular(R, missing, trans="T")
    return np.asarray(prior + spread * step)


def _written_out(row: Array, leading: int, names: Sequence[str]) -> str:
    terms = [names[leading]]
    for i in map(int, np.flatnonzero(row)):
        if i != leading:
            sign = "-" if row[i] < 0.0 else "+"
            size = abs(row[i])
            factor = "" if abs(size - 1.0) < 1e-9 else f"{size:.6g} "
            terms.append(f"{sign} {factor}{names[i]}")
    return " ".join(terms)
