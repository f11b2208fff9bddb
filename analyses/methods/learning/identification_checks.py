"""Do the logs of an identification contradict each other, or the robot's file?

Two checks on the fit's own reduced rows, made after it: neither changes the model.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from models.identification.base_parameters import triangular_factor
from models.identification.torque_regression import INERTIAL_NAMES, TorqueFactors

Array = NDArray[np.float64]

_INERTIAL = len(INERTIAL_NAMES)
RANK_TOLERANCE = 1e-7  # as models.identification.base_parameters
GAUSS_NEWTON_STEPS = 6


def gain_ratios(
    factors: Sequence[TorqueFactors], x: Array, residual_sd: Array, oversampling: float
) -> tuple[Array, Array]:
    """By what factor each joint's torque exceeds what the other joints say of the same masses.

    A link's masses act on all joints below it. For one joint after the other the fit of all rows is
    made once more, with a factor on that joint's rigid-body torque: 1 if all torque constants are
    right, or all wrong alike. Bilinear; by Gauss-Newton steps.

    Args:
        factors: of the logs.
        x: all parameters of the fit without factors.
        residual_sd: (n,) N m.
        oversampling: rows per independent sample.

    Returns:
        (n,) factors and their sds; NaN and infinity where nothing is told of a factor.
    """
    n = len(factors[0].R)
    stacked = [
        triangular_factor(np.vstack([f.R[j] for f in factors])) / residual_sd[j] for j in range(n)
    ]
    rigid = slice(0, _INERTIAL * n)
    ends = np.cumsum([len(R) for R in stacked])
    rows = np.vstack(stacked)
    length = np.maximum(np.linalg.norm(rows[:, :-1], axis=0), 1e-12)
    ratios, deviations = np.full(n, np.nan), np.full(n, np.inf)
    for j in range(n):
        own = slice(ends[j] - len(stacked[j]), ends[j])
        ratio, parameters = 1.0, x
        for _ in range(GAUSS_NEWTON_STEPS):
            A = np.column_stack([rows[:, :-1], np.zeros(len(rows))])
            A[own, -1] = rows[own, rigid] @ parameters[rigid]
            A[own, rigid] *= ratio
            reach = np.linalg.norm(A[:, -1])
            if not reach > 0.0:
                break
            scale = np.append(length, reach)
            U, s, Vt = np.linalg.svd(A / scale, full_matrices=False)
            kept = s > RANK_TOLERANCE * s[0]
            weight = Vt[kept, -1]
            deviation = float(np.linalg.norm(weight / s[kept])) / reach * np.sqrt(oversampling)
            if np.linalg.norm(weight) < 0.999:  # partly in the null space: not determined
                break
            solution = Vt[kept].T @ ((U[:, kept].T @ rows[:, -1]) / s[kept]) / scale
            ratio, parameters = ratio + float(solution[-1]), solution[:-1]
            ratios[j], deviations[j] = ratio, deviation
    return ratios, deviations


def payload_differences(
    factors: Sequence[TorqueFactors], x: Array, residual_sd: Array, oversampling: float
) -> tuple[Array, Array]:
    """What each log carries at the last link more than the fit of all logs says.

    Args:
        factors: of each log.
        x: all parameters of that fit.
        residual_sd: (n,) N m.
        oversampling: rows per independent sample.

    Returns:
        Mass (logs,) in kg and its sd: the log's residual, fitted with a mass and its first moments
        on the last link.
    """
    n = len(factors[0].R)
    last = slice(_INERTIAL * (n - 1), _INERTIAL * (n - 1) + 4)
    masses, deviations = [], []
    for factor in factors:
        rows = np.vstack([R / residual_sd[j] for j, R in enumerate(factor.R)])
        W, e = rows[:, last], rows[:, -1] - rows[:, :-1] @ x
        normal = np.linalg.pinv(W.T @ W)
        extra = normal @ (W.T @ e)
        masses.append(extra[0])
        noise = max(1.0, float(np.sum((e - W @ extra) ** 2)) / max(1, factor.num_rows * n))
        deviations.append(np.sqrt(normal[0, 0] * noise * oversampling))
    return np.array(masses), np.array(deviations)
