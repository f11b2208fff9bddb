"""Parameters that agree with printed figures: an emulator of every figure, and draws from it.

By how much a figure is off is a quadratic of the parameters, each from -1 to 1 over its range. It
is fitted by ridge regression over the arms that have the figure; near arms weigh more.
Leave-one-out error sets the strength of the ridge and gives the emulator's error. A parameter set
is as likely as

    exp(-1/2 sum_r off_r^2 / (1 + error_r^2)),    off and error in tolerances,

within the ranges; Metropolis steps draw from that (Kennedy, O'Hagan, J. R. Stat. Soc. B 63, 2001;
Vernon, Goldstein, Bower, Bayesian Analysis 5(4), 2010).
"""

import numpy as np

from wrenchsight.models.numerics.arrays import Array, Flags

FEWEST = 12  # arms that a figure's emulator is made of, at least
_NEAR = 0.2  # share of the arms that count more than a quarter
_RIDGES = 10.0 ** np.arange(-4.0, 3.0)
_SQUARES, _PRODUCTS = 3.0, 10.0  # ridge of these terms, over that of the linear ones
MOST = 4.0  # tolerances: what is off by more counts no more
_STEPS, _UNUSED, _DRAWS = 1500, 0.2, 400  # per parameter; share before the chain has settled
_FAR = 0.3  # share of steps that go anywhere in the range
_STEP = 0.25  # of the others, of half a range


class Emulator:
    """Emulator of the error of R figures, in tolerances, as a quadratic of P parameters.

    Args:
        parameters: (N, P) of the arms.
        off: (N, R) by how much each figure is off, in tolerances; NaN: the arm has no such figure.
        near: (N,) distance of each arm from the figures; the near ones count more.
        ranges: (P, 2) from, to.

    Attributes:
        error: (R,) standard deviation of the emulator itself, in tolerances.

    Raises:
        ValueError: fewer than FEWEST arms have a figure.
    """

    def __init__(self, parameters: Array, off: Array, near: Array, ranges: Array) -> None:
        self._low, self._half = ranges[:, 0], 0.5 * (ranges[:, 1] - ranges[:, 0])
        terms, is_measured = _terms(self._inside(parameters)), np.isfinite(off)
        if is_measured.sum(axis=0).min() < FEWEST:
            raise ValueError(f"a figure of fewer than {FEWEST} arms")
        reach = max(float(np.quantile(near, _NEAR)), 1e-12)
        weight = 1.0 / (1.0 + (near / reach) ** 2) ** 2
        self._slopes, self.error = np.empty((terms.shape[1], off.shape[1])), np.empty(off.shape[1])
        for r in range(off.shape[1]):
            rows = is_measured[:, r]
            fitted = _ridge(terms[rows], off[rows, r], weight[rows], len(ranges))
            self._slopes[:, r], self.error[r] = fitted
        self._start = self._inside(parameters[int(np.argmin(near))])

    def _inside(self, parameters: Array) -> Array:
        """Parameters from -1 to 1 over their ranges."""
        return np.asarray((parameters - self._low) / self._half - 1.0)

    def off(self, parameters: Array) -> Array:
        """(A, R) by how much figures are off at parameters (A, P), in tolerances."""
        return np.asarray(_terms(self._inside(parameters)) @ self._slopes)

    def draws(self, rows: Flags, sharpness: float = 1.0, seed: int = 0) -> Array:
        """(_DRAWS, P) parameters that agree with some of the figures, equally likely.

        Args:
            rows: (R,) which figures.
            sharpness: power of the density that is drawn from: above 1 nearer to the likeliest.
            seed: of the draws.
        """
        slopes, variance = self._slopes[:, rows], (1.0 + self.error[rows] ** 2) / sharpness
        chain = _metropolis(slopes, variance, self._start, np.random.default_rng(seed))
        return np.asarray(self._low + (chain + 1.0) * self._half)


def _terms(u: Array) -> Array:
    """(N, 1 + P + P (P + 1) / 2): one, u, its squares and products, for u (N, P)."""
    row, column = np.triu_indices(u.shape[1], 1)
    constant = np.ones((len(u), 1))
    return np.hstack([constant, u, u**2, u[:, row] * u[:, column]])


def _ridge(terms: Array, off: Array, weight: Array, P: int) -> tuple[Array, float]:
    """Slopes of the ridge that predicts left-out arms best, and its error."""
    penalty = np.full(terms.shape[1], _PRODUCTS)
    penalty[: 1 + P], penalty[1 + P : 1 + 2 * P] = 1.0, _SQUARES
    penalty[0] = 1e-9  # the level is free
    root = np.sqrt(weight / weight.mean())
    # In terms over the root of their penalties all are alike.
    X, y = root[:, None] * terms / np.sqrt(penalty), root * off
    U, s, Vt = np.linalg.svd(X, full_matrices=False)
    best, slopes = np.inf, np.zeros(terms.shape[1])
    for ridge in _RIDGES:
        shrunk = s**2 / (s**2 + ridge)
        hat = (U**2) @ shrunk
        left_out_error = (y - (U * shrunk) @ (U.T @ y)) / np.maximum(1.0 - hat, 1e-3)
        error = float(np.mean(left_out_error**2))
        if error < best:
            best = error
            slopes = (Vt.T * (s / (s**2 + ridge))) @ (U.T @ y) / np.sqrt(penalty)
    return slopes, float(np.sqrt(best))


def _metropolis(slopes: Array, variance: Array, start: Array, rng: np.random.Generator) -> Array:
    """(_DRAWS, P) of -1 to 1, one parameter a step."""

    def density(u: Array) -> float:
        off = np.clip(_terms(u[None])[0] @ slopes, -MOST, MOST)
        return float(-0.5 * np.sum(off**2 / variance))

    P = len(start)
    u, log_density = np.clip(start, -1.0, 1.0), -np.inf
    steps = _STEPS * P
    selected = np.linspace(_UNUSED * steps, steps - 1, _DRAWS).astype(int)
    draws = np.empty((steps, P))
    for k in range(steps):
        j, far, chance = int(rng.integers(P)), rng.random(), np.log(rng.random())
        candidate = u.copy()
        candidate[j] = (
            rng.uniform(-1.0, 1.0) if far < _FAR else u[j] + _STEP * rng.standard_normal()
        )
        if abs(candidate[j]) < 1.0:
            candidate_density = density(candidate)
            if chance < candidate_density - log_density:
                u, log_density = candidate, candidate_density
        draws[k] = u
    return np.asarray(draws[selected])
