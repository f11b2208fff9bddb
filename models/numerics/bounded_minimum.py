"""The minimum of a smooth function within bounds, to as many digits as its gradient has.

A quasi-Newton method stops where its tolerance is met: from another start, or with another last bit
in a sum, some 1e-5 away. Newton's method from there doubles the digits at each step, so that the
result depends on the optimum and not on the path to it.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.ties import TIE_TOLERANCE

_DIFFERENCE_STEP = 1e-5  # of the variables, for the second derivatives
_NEWTON_STEPS = 8  # at the most: each doubles the digits, and there are 16
_MIN_CURVATURE_RATIO = 1e-9  # of the largest curvature; below it there is none to divide by
# L-BFGS-B: tolerances near rounding, so that Newton's method starts near; counts far above need.
_DESCENT_OPTIONS = {"ftol": 1e-14, "gtol": 1e-8, "maxiter": 1000, "maxfun": 5000, "maxcor": 20}


def bounded_minimum(
    value_and_gradient: Callable[[Array], tuple[float, Array]],
    starts: Sequence[ArrayLike],
    bounds: ArrayLike,
) -> tuple[Array, float]:
    """The lowest of the local minima that descents from some starts reach.

    Args:
        value_and_gradient: function of x (D,): its value, and its gradient (D,), exact
            to rounding. It is also asked 1e-5 outside the bounds, for differences.
        starts: each (D,); of minima that are the same to 1e-9 the first one's counts.
        bounds: (D, 2) lower and upper; infinite where there is none.

    Returns:
        x (D,) and the function there. A variable that makes no difference, to 1e-9 of it, is at its
        lower bound.

    Raises:
        ValueError: there is no start.
    """
    from scipy.optimize import minimize

    limits = np.asarray(bounds, dtype=np.float64)
    best_x, best_value = None, np.inf
    for start in starts:
        descent = minimize(
            value_and_gradient,
            np.clip(np.asarray(start, dtype=np.float64), limits[:, 0], limits[:, 1]),
            method="L-BFGS-B",
            jac=True,
            bounds=limits,
            options=_DESCENT_OPTIONS,
        )
        x, value = np.asarray(descent.x), float(descent.fun)
        if best_x is None or value < best_value - TIE_TOLERANCE * max(1.0, abs(best_value)):
            best_x, best_value = x, value
    if best_x is None:
        raise ValueError("no start")
    x = _newton(value_and_gradient, best_x, limits)
    value = value_and_gradient(x)[0]
    # A variable that makes no difference would else end where the path has led it.
    for i in np.flatnonzero(np.isfinite(limits[:, 0])):
        lower = x.copy()
        lower[i] = limits[i, 0]
        if value_and_gradient(lower)[0] <= value + TIE_TOLERANCE * max(1.0, abs(value)):
            x = lower
    return x, value_and_gradient(x)[0]


def _newton(
    value_and_gradient: Callable[[Array], tuple[float, Array]], start: Array, limits: Array
) -> Array:
    """Newton's method in the variables that no bound holds, as long as the gradient falls.

    The curvature comes from differences of the gradient; where it is not clearly positive definite
    in these variables, no further step is taken.

    Args:
        value_and_gradient: as `bounded_minimum`.
        start: (D,) near a minimum.
        limits: (D, 2) lower and upper.

    Returns:
        x (D,) with the smallest slope that was reached; `start` where no step made it smaller.
    """
    x, (_, gradient) = start, value_and_gradient(start)
    for _ in range(_NEWTON_STEPS):
        free = _free(x, gradient, limits)
        slope = _largest_slope(x, gradient, limits)
        if slope == 0.0:  # also where bounds hold all variables
            break
        curvature = np.empty((len(free), len(free)))
        for row, i in enumerate(free):
            x_plus, x_minus = x.copy(), x.copy()
            x_plus[i], x_minus[i] = x[i] + _DIFFERENCE_STEP, x[i] - _DIFFERENCE_STEP
            change = value_and_gradient(x_plus)[1] - value_and_gradient(x_minus)[1]
            curvature[row] = change[free] / (2.0 * _DIFFERENCE_STEP)
        values, vectors = np.linalg.eigh(0.5 * (curvature + curvature.T))
        if not values[0] > _MIN_CURVATURE_RATIO * values[-1]:
            break
        x_trial = x.copy()
        x_trial[free] -= vectors @ ((vectors.T @ gradient[free]) / values)
        x_trial = np.clip(x_trial, limits[:, 0], limits[:, 1])
        _, trial_gradient = value_and_gradient(x_trial)
        if not _largest_slope(x_trial, trial_gradient, limits) < slope:  # true for NaN as well
            break
        x, gradient = x_trial, trial_gradient
    return x


def _largest_slope(x: Array, gradient: Array, limits: Array) -> float:
    """Largest absolute derivative in a variable that no bound holds; 0 where all are held."""
    return float(np.max(np.abs(gradient[_free(x, gradient, limits)]), initial=0.0))


def _free(x: Array, gradient: Array, limits: Array) -> NDArray[np.intp]:
    """Variables that no bound holds: inside, or on one that the descent leads away from."""
    is_held = ((x <= limits[:, 0]) & (gradient >= 0.0)) | ((x >= limits[:, 1]) & (gradient <= 0.0))
    return np.flatnonzero(~is_held)
