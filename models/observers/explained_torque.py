"""The test whether any wrench at E explains the observed torque.

Let the torque error have the covariance Sigma, and a wrench at E zero mean and the live prior's
covariance P. tau_ext then has the covariance Sigma + J^T P J, and

    D = tau_ext^T (Sigma + J^T P J)^-1 tau_ext

is n on average. Sigma is that of the torque error model, plus an error in proportion to the reading
(`scale`). Where sqrt(D) is above BEYOND, model and prior do not explain the torque. The wrench at E
is then unknown: a current has the wrong sign or size, the force acts far from E, or it is beyond
the arm's rating. For a force alone, BEYOND live sds are three times the rated payload's weight.
Such a reading is not valid. Neither are those after it, until sqrt(D) has been below WITHIN for
QUIET: a wrong signal crosses its right value again and again.

The bounds were chosen on the UR10e's three fitted runs, where sqrt(D) of valid readings stays below
WITHIN. Below these bounds, the error from a wrong current is no larger than a possible force.
"""

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.row_blocks import in_row_blocks
from wrenchsight.models.numerics.small_matrices import factorise_with_floor, solve_lower
from wrenchsight.models.numerics.views import borrowed

BEYOND = 6.0
WITHIN = 3.0
QUIET = 0.1  # s
_BLOCK = 4096  # rows a thread takes at a time
_LARGEST_SD = 1e6  # N or N m; stands for no prior

# Of the table: these numbers, then the joints' correlation, flat.
_MOMENT_VARIANCE, _FORCE_VARIANCE, _SCALE2, _PERIOD, _BEYOND2, _NUMBERS = range(6)


def explained_table(
    correlation: ArrayLike,
    moment_sd: float | None,
    force_sd: float | None,
    scale: float,
    time_step: float,
    bound: float = BEYOND,
) -> Array:
    """Returns the constants that the kernels read.

    Args:
        correlation: (n, n) of the joints' errors.
        moment_sd, force_sd: N m and N of the live prior; None: no prior.
        scale: relative sd of the reading's scale.
        time_step: s.
        bound: see above; inf: any torque is explained.
    """
    sds = [_LARGEST_SD if sd is None else min(sd, _LARGEST_SD) for sd in (moment_sd, force_sd)]
    numbers = [sds[0] ** 2, sds[1] ** 2, scale**2, time_step, bound**2]
    return np.concatenate([numbers, np.asarray(correlation, float).ravel()])


@kernel
def unexplained(table: Array, J: Array, tau_ext: Array, sd: Array) -> float:
    """D of one sample; J (6, n) as tau_ext saw it, tau_ext (n,) N m, sd (n,) N m.

    0 where any torque counts as explained.
    """
    if table[_BEYOND2] == np.inf:
        return 0.0
    n = tau_ext.shape[0]
    memory = np.empty((n + 3, n))  # one piece: each allocation takes time
    error_sd, floor, whitened = memory[n], memory[n + 1], memory[n + 2]
    for i in range(n):
        error_sd[i] = np.sqrt(sd[i] * sd[i] + table[_SCALE2] * tau_ext[i] * tau_ext[i])
        floor[i] = 1e-9 * (error_sd[i] * error_sd[i])
        whitened[i] = tau_ext[i]
    for i in range(n):
        for j in range(i + 1):
            covariance = error_sd[i] * table[_NUMBERS + n * i + j] * error_sd[j]
            for a in range(6):
                wrench_variance = table[_MOMENT_VARIANCE] if a < 3 else table[_FORCE_VARIANCE]
                covariance += J[a, i] * wrench_variance * J[a, j]
            memory[i, j] = covariance
    # Rounding takes no more from the diagonal than the error's own part.
    factorise_with_floor(memory, n, floor)
    solve_lower(memory, n, whitened)
    total = 0.0
    for i in range(n):
        total += whitened[i] * whitened[i]
    return total


def unexplained_log(table: Array, J: Array, tau_ext: Array, sd: Array) -> Array:
    """(N,) D of N samples, by threads."""
    D = np.empty(len(J))

    def run(rows: slice) -> None:
        _unexplained_rows(table, J[rows], tau_ext[rows], sd[rows], D[rows])

    in_row_blocks(run, len(J), _BLOCK)
    return D


@kernel(nogil=True)
def _unexplained_rows(table: Array, J: Array, tau_ext: Array, sd: Array, D: Array) -> None:
    table, J, tau_ext, sd = borrowed(table), borrowed(J), borrowed(tau_ext), borrowed(sd)
    for k in range(len(D)):
        D[k] = unexplained(table, J[k], tau_ext[k], sd[k])


@kernel
def is_explained(table: Array, unexplained_time: float, D: float) -> tuple[bool, float]:
    """Whether a reading may be valid, and for how long the next ones may not.

    Args:
        table: of `explained_table`.
        unexplained_time: s that remained after the sample before; NaN at the start.
        D: of `unexplained`; one that is not finite counts as small.

    Returns:
        Whether it may be valid; s after this sample in which no reading may.
    """
    remaining_time, bound_squared = 0.0, table[_BEYOND2]
    if np.isfinite(unexplained_time):
        remaining_time = max(unexplained_time - table[_PERIOD], 0.0)
    if bound_squared < D or (remaining_time > 0.0 and not D < WITHIN * WITHIN):
        remaining_time = QUIET
    return remaining_time <= 0.0, remaining_time
