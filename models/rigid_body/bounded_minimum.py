"""The least of a smooth function within bounds, to as many digits as its gradient has.

A quasi-Newton method stops where its own tolerance is met: from another start, or with another last
bit in a sum, some 1e-5 away. Newton's method from there doubles the digits at each step, so that
the result depends on the optimum and not on the path to it.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrenchsight.models.arrays import Array
from wrenchsight.models.rigid_body.ties import SAME

_DIFFERENCE = 1e-5  # of the variables, for the second derivatives
_NEWTON_STEPS = 8
_FLAT = 1e-9  # of the largest curvature; below it there is none to divide by
_OPTIONS = {"ftol": 1e-14, "gtol": 1e-8, "maxiter": 1000, "maxfun": 5000, "maxcor": 20}


def bounded_minimum(
    value_and_gradient: Callable[[Array], tuple[float, Array]],
    starts: Sequence[ArrayLike],
    bounds: ArrayLike,
) -> tuple[Array, float]:
    """The least of the local minima that are downhill from some starts.

    Args:
        value_and_gradient: of x (D,): the function, and its gradient (D,), exact to rounding.
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
    best: tuple[Array, float] | None = None
    for start in starts:
        climb = minimize(
            value_and_gradient,
            np.clip(np.asarray(start, dtype=np.float64), limits[:, 0], limits[:, 1]),
            method="L-BFGS-B",
            jac=True,
            bounds=limits,
            options=_OPTIONS,
        )
        x, value = np.asarray(climb.x), float(climb.fun)
        if best is None or value < best[1] - SAME * max(1.0, abs(best[1])):
            best = x, value
    if best is None:
        raise ValueError("no start")
    x = _newton(value_and_gradient, best[0], limits)
    value = value_and_gradient(x)[0]
    for i in np.flatnonzero(np.isfinite(limits[:, 0])):
        lower = x.copy()
        lower[i] = limits[i, 0]
        if value_and_gradient(lower)[0] <= value + SAME * max(1.0, abs(value)):
            x = lower
    return x, value_and_gradient(x)[0]


def _newton(
    value_and_gradient: Callable[[Array], tuple[float, Array]], x: Array, limits: Array
) -> Array:
    """Newton's method in the variables that no bound holds, as long as the gradient falls."""
    _, gradient = value_and_gradient(x)
    for _ in range(_NEWTON_STEPS):
        free = _free(x, gradient, limits)
        size = float(np.max(np.abs(gradient[free]), initial=0.0))
        if size == 0.0:
            break
        curvature = np.empty((len(free), len(free)))
        for row, i in enumerate(free):
            ahead, behind = x.copy(), x.copy()
            ahead[i], behind[i] = x[i] + _DIFFERENCE, x[i] - _DIFFERENCE
            change = value_and_gradient(ahead)[1] - value_and_gradient(behind)[1]
            curvature[row] = change[free] / (2.0 * _DIFFERENCE)
        values, vectors = np.linalg.eigh(0.5 * (curvature + curvature.T))
        if not values[0] > _FLAT * values[-1]:
            break
        trial = x.copy()
        trial[free] -= vectors @ ((vectors.T @ gradient[free]) / values)
        trial = np.clip(trial, limits[:, 0], limits[:, 1])
        _, after = value_and_gradient(trial)
        if not np.max(np.abs(after[_free(trial, after, limits)]), initial=0.0) < size:
            break
        x, gradient = trial, after
    return x


def _free(x: Array, gradient: Array, limits: Array) -> NDArray[np.intp]:
    """Variables that no bound holds: inside, or on one that the descent leads away from."""
    held = ((x <= limits[:, 0]) & (gradient >= 0.0)) | ((x >= limits[:, 1]) & (gradient <= 0.0))
    return np.flatnonzero(~held)
