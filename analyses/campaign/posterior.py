"""Approximate Bayesian computation: which draws give printed figures? (Beaumont et al. 2002)

Of many draws those nearest to the figures are accepted, each with a weight that falls with its
distance (Epanechnikov). What is left of the distance is taken off the parameters by a weighted
linear regression on the figures, in logits of the ranges, so that none leaves its range. There are
more figures than draws can tell apart: the regression is a ridge, as strong as leaving each draw
out once says (Blum, Nunes, Prangle, Sisson, Statistical Science 28(2), 2013).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.arrays import Array

FEWEST = 12  # draws that are accepted, if there are as many
_EDGE = 1e-3  # of a range: nearer to its ends a logit tells nothing
_RIDGES = 10.0 ** np.arange(-2.0, 4.0)


@dataclass(frozen=True, eq=False)
class Posterior:
    """Draws that agree with figures.

    Attributes:
        accepted: (A,) rows of the draws, the nearest first.
        distance: (N,) of all draws, in tolerances, root mean square over the figures.
        weight: (A,) sum 1.
        adjusted: (A, P) parameters, with what is left of the distance taken off.
    """

    accepted: NDArray[np.int_]
    distance: Array
    weight: Array
    adjusted: Array

    def resampled(self, count: int) -> Array:
        """(count, P) adjusted parameters, equally likely: systematic resampling."""
        at = np.searchsorted(np.cumsum(self.weight), (np.arange(count) + 0.5) / count)
        return np.asarray(self.adjusted[np.minimum(at, len(self.weight) - 1)])


def approximate_posterior(parameters: Array, off: Array, ranges: Array, share: float) -> Posterior:
    """Accepts the nearest draws, weighs and adjusts them.

    Args:
        parameters: (N, P) drawn.
        off: (N, R) by how much each figure is off, in tolerances.
        ranges: (P, 2) from, to.
        share: of the draws to accept, at least FEWEST.
    """
    distance = np.sqrt(np.mean(off**2, axis=1))
    count = min(len(distance), max(FEWEST, round(share * len(distance))))
    accepted = np.argsort(distance, kind="stable")[:count]
    near = distance[accepted]
    reach = near[-1] * 1.05 + 1e-12  # the farthest counts a little, too
    weight = 1.0 - (near / reach) ** 2
    weight /= weight.sum()
    width = ranges[:, 1] - ranges[:, 0]
    share_of_range = (parameters[accepted] - ranges[:, 0]) / width
    logit = np.log(1.0 / np.clip(share_of_range, _EDGE, 1.0 - _EDGE) - 1.0)
    adjusted = logit - off[accepted] @ _slopes(off[accepted], logit, weight)
    return Posterior(accepted, distance, weight, ranges[:, 0] + width / (1.0 + np.exp(adjusted)))


def weighted_quantile(values: Array, weight: Array, q: float) -> float:
    """The value below which a share q of the weight lies, linear between values."""
    order = np.argsort(values)
    at = np.cumsum(weight[order]) - 0.5 * weight[order]
    return float(np.interp(q, at / weight.sum(), values[order]))


def _slopes(off: Array, logit: Array, weight: Array) -> Array:
    """(R, P) of the ridge that predicts left-out draws best."""
    root = np.sqrt(weight)[:, None]
    centre, level = weight @ off, weight @ logit
    X, Y = root * (off - centre), root * (logit - level)
    U, s, Vt = np.linalg.svd(X, full_matrices=False)
    best, slopes = np.inf, np.zeros((off.shape[1], logit.shape[1]))
    scale = float(np.mean(s**2)) or 1.0
    for ridge in _RIDGES * scale:
        shrunk = s**2 / (s**2 + ridge)
        hat = (U**2) @ shrunk + root[:, 0] ** 2
        left = (Y - (U * shrunk) @ (U.T @ Y)) / np.maximum(1.0 - hat, 1e-3)[:, None]
        error = float(np.sum(left**2))
        if error < best:
            best, slopes = error, (Vt.T * (s / (s**2 + ridge))) @ (U.T @ Y)
    return np.asarray(slopes)
