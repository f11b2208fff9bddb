"""The test whether any wrench at E explains the observed torque.

Let the torque error have the covariance Sigma, and a wrench at E zero mean and the live prior's
covariance P. tau_ext then has the covariance Sigma + J^T P J, and

    D = tau_ext^T (Sigma + J^T P J)^-1 tau_ext

is n on average. Sigma is that of the torque error model, plus an error in proportion to the reading
(`scale`). Where sqrt(D) is above ONSET_SDS, model and prior do not explain the torque. The wrench
at E is then unknown: a current has the wrong sign or size, the force acts far from E, or it is
beyond the arm's rating. For a force alone, ONSET_SDS live sds are three times the rated payload's
weight. Such a reading is not valid. Neither are those after it, until sqrt(D) has been below
RELEASE_SDS for RELEASE_TIME: a wrong signal crosses its right value again and again.

The bounds were chosen on the UR10e's three fitted runs, where sqrt(D) of valid readings stays below
RELEASE_SDS. Below these bounds, the error from a wrong current is no larger than a possible force.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import NEW_ARRAYS, kernel
from wrenchsight.models.numerics.row_blocks import in_row_blocks
from wrenchsight.models.numerics.small_matrices import factorise_with_floor, solve_lower

ONSET_SDS = 6.0
RELEASE_SDS = 3.0
RELEASE_TIME = 0.1  # s
_BLOCK_ROWS = 4096  # rows a thread takes at a time
_LARGEST_SD = 1e6  # N or N m; stands for no prior, as J^T P J must be finite
_FLOOR_SHARE = 1e-9  # of an error's variance: the least pivot, where rounding would leave less


class ExplainedConstants(NamedTuple):
    """Constants of the test.

    Attributes:
        moment_variance, force_variance: (N m)^2 and N^2, of the live prior; very large for none.
        scale_squared: square of the relative sd of the reading's scale.
        period: s.
        bound_squared: of D, beyond which a torque is not explained; inf: any is.
        correlation: (n, n) of the joints' errors.
    """

    moment_variance: float
    force_variance: float
    scale_squared: float
    period: float
    bound_squared: float
    correlation: Array

    @property
    def explains_all(self) -> bool:
        """Whether any torque counts as explained."""
        return math.isinf(self.bound_squared)


def explained_constants(
    correlation: ArrayLike,
    moment_sd: float | None,
    force_sd: float | None,
    scale: float,
    time_step: float,
    bound: float = ONSET_SDS,
) -> ExplainedConstants:
    """Returns the constants that the kernels read.

    Args:
        correlation: (n, n) of the joints' errors.
        moment_sd, force_sd: N m and N of the live prior; None: no prior.
        scale: relative sd of the reading's scale.
        time_step: s.
        bound: of sqrt(D), beyond which a torque is not explained; inf: any is.
    """
    finite_moment_sd, finite_force_sd = (
        _LARGEST_SD if sd is None else min(sd, _LARGEST_SD) for sd in (moment_sd, force_sd)
    )
    return ExplainedConstants(
        moment_variance=float(finite_moment_sd**2),
        force_variance=float(finite_force_sd**2),
        scale_squared=float(scale**2),
        period=float(time_step),
        bound_squared=float(bound**2),
        correlation=np.array(correlation, float),
    )


def unexplained_log(constants: ExplainedConstants, J: Array, tau_ext: Array, sd: Array) -> Array:
    """(N,) D of N samples, by threads; 0 where any torque counts as explained.

    Args:
        constants: of `explained_constants`.
        J: (N, 6, n) as tau_ext saw it.
        tau_ext, sd: (N, n) N m.
    """
    if constants.explains_all:
        return np.zeros(len(J))
    D = np.empty(len(J))
    numbers = (constants.moment_variance, constants.force_variance, constants.scale_squared)
    if len(J) <= _BLOCK_ROWS:
        unexplained_rows(*numbers, constants.correlation, J, tau_ext, sd, D)
        return D

    def run(rows: slice) -> None:
        unexplained_rows(*numbers, constants.correlation, J[rows], tau_ext[rows], sd[rows], D[rows])

    in_row_blocks(run, len(J), _BLOCK_ROWS)
    return D


@kernel(nogil=True)
def unexplained_rows(
    moment_variance: float,
    force_variance: float,
    scale_squared: float,
    correlation: Array,
    J: Array,
    tau_ext: Array,
    sd: Array,
    D: Array,
) -> None:
    """Writes D = tau_ext^T (Sigma + J^T P J)^-1 tau_ext of each of N samples.

    Sigma_ij = sd_i correlation_ij sd_j, with (scale tau_ext_i)^2 added to sd_i^2; P is the diagonal
    live prior covariance of the wrench, rotation first.

    Args:
        moment_variance, force_variance, scale_squared, correlation: of ExplainedConstants.
        J: (N, 6, n) as tau_ext saw it.
        tau_ext, sd: (N, n) N m.
        D: (N,), written; n on average where a wrench at E explains the torque.

    numpy on the log takes 5.5 times as long (`tests/benchmarks/bench_small_matrices.py`).
    """
    n = tau_ext.shape[1]
    covariance, floor, whitened = np.empty((n, n)), np.empty(n), np.empty(n)
    for k in range(len(D)):
        _write_error(scale_squared, correlation, tau_ext[k], sd[k], covariance, floor)
        whitened[:] = tau_ext[k]
        for i in range(n):
            for j in range(i + 1):
                total = covariance[i, j]
                for a in range(6):
                    variance = moment_variance if a < 3 else force_variance
                    total += J[k, a, i] * variance * J[k, a, j]
                covariance[i, j] = total
        # J^T P J may be singular, and so large that rounding hides Sigma beside it.
        factorise_with_floor(covariance, n, floor)
        solve_lower(covariance, n, whitened)  # which holds tau_ext until here
        D[k] = 0.0
        for i in range(n):
            D[k] += whitened[i] * whitened[i]


@kernel
def _write_error(
    scale_squared: float,
    correlation: Array,
    tau_ext: Array,
    sd: Array,
    covariance: Array,
    floor: Array,
) -> None:
    """Writes Sigma, the covariance of a torque's error, and what its pivots are at least.

    Args:
        scale_squared, correlation: as `unexplained_rows`.
        tau_ext, sd: (n,) N m.
        covariance: (n, n) N^2 m^2, whose lower triangle is written.
        floor: (n,) N^2 m^2, written.
    """
    n, error_sd = tau_ext.shape[0], floor  # which holds the sds until the covariance is written
    for i in range(n):
        error_sd[i] = np.sqrt(sd[i] * sd[i] + scale_squared * tau_ext[i] ** 2)
        for j in range(i + 1):
            covariance[i, j] = error_sd[i] * correlation[i, j] * error_sd[j]
    for i in range(n):
        floor[i] = _FLOOR_SHARE * (error_sd[i] * error_sd[i])


@kernel(**NEW_ARRAYS)
def beside_lines(
    scale_squared: float, correlation: Array, lines: Array, tau_ext: Array, sd: Array
) -> float:
    """The least of (tau_ext - a line)^T Sigma^-1 (tau_ext - a line) over all lines and numbers a.

    Sigma is the covariance that D has without a wrench: what a torque along one of the lines leaves
    is so compared with what a wrench at E leaves.

    Args:
        scale_squared, correlation: as `unexplained_rows`.
        lines: (m, n) N m, of any length but zero: what one ampere in a motor, or one more in one
            and less in another, puts on the joints (`models.observers.fault_signature`).
        tau_ext, sd: (n,) N m.
    """
    n = tau_ext.shape[0]
    covariance, floor, whitened = np.empty((n, n)), np.empty(n), tau_ext.copy()
    _write_error(scale_squared, correlation, tau_ext, sd, covariance, floor)
    factorise_with_floor(covariance, n, floor)
    solve_lower(covariance, n, whitened)
    square = 0.0
    for i in range(n):
        square += whitened[i] * whitened[i]
    largest, line = 0.0, np.empty(n)
    for k in range(lines.shape[0]):
        line[:] = lines[k]
        solve_lower(covariance, n, line)
        along, length = 0.0, 0.0
        for i in range(n):
            along += line[i] * whitened[i]
            length += line[i] * line[i]
        largest = max(largest, along * along / length)
    return square - largest


@kernel
def is_explained(
    period: float, bound_squared: float, unexplained_time: float, D: float
) -> tuple[bool, float]:
    """Whether a reading may be valid, and for how long the next ones may not.

    Args:
        period, bound_squared: of ExplainedConstants.
        unexplained_time: s that remained after the sample before; NaN at the start.
        D: of `unexplained_log`; one that is not finite counts as small.

    Returns:
        Whether it may be valid; s after this sample in which no reading may.
    """
    remaining_time = 0.0
    if np.isfinite(unexplained_time):
        remaining_time = max(unexplained_time - period, 0.0)
    if bound_squared < D or (remaining_time > 0.0 and not D < RELEASE_SDS * RELEASE_SDS):
        remaining_time = RELEASE_TIME
    return remaining_time <= 0.0, remaining_time
