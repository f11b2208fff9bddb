"""The tail of a statistic: how often it exceeds a high level, from its excesses over lower ones.

Excesses over a high level follow a generalised Pareto law (Pickands, 1975), so that an exceedance
of `level` + x happens

    rate (1 + shape x / scale)^(-1 / shape)

times an hour. Samples of one excursion are one exceedance: excursions that begin less than
MIN_EXCURSION_GAP after another's end belong to it, and its largest sample counts.

Scale and shape are the most likely ones, given that the shape is 0 within SHAPE_SD. The norms that
are judged here have exponential tails. The most likely shape of some 30 excursions alone is known
within .2, which makes the level that is exceeded once an hour a matter of chance (penalised
likelihood: Coles and Dixon, 1999). A tail is never taken as bounded, and the shape is at least one
over the number of excursions: the law that an exponential tail of unknown scale has for the next
one to come (Lomax). So a level from few excursions lies higher than one from many.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammainccinv, gammaln, xlogy

from wrenchsight.models.numerics.arrays import Array

MIN_EXCURSION_GAP = 0.5  # s
# of the samples above the level: the first with ENOUGH_EXCURSIONS excursions
TAIL_SHARES = (0.02, 0.05, 0.1)
ENOUGH_EXCURSIONS = 25  # for the level to stay as high as it is
MIN_EXCURSIONS = 10  # fewer tell nothing of a tail
SHAPE_SD = 0.1
LARGEST_SHAPE = 0.5  # beyond it the law has no variance; a few excursions do not show such a tail
_GAUSSIAN_TAIL_SHARE = 1e-3  # share of a Gaussian tail's level


@dataclass
class ExceedanceTail:
    """The tail of a statistic, by the law of this module."""

    level: float = 0.0  # of the statistic, above which the law holds
    rate_per_hour: float = 0.0  # of excursions above it
    scale: float = 0.0  # of their excess
    shape: float = 0.0  # of the generalised Pareto law; 0: exponential

    def check(self) -> None:
        """Raises ValueError where a number is negative or not finite, or the scale is zero."""
        values = (self.level, self.rate_per_hour, self.scale, self.shape)
        if not all(np.isfinite(x) and x >= 0.0 for x in values) or self.scale == 0.0:
            raise ValueError(f"expected numbers of zero or more, scale above zero, not {values}")

    def level_at(self, rate_per_hour: float) -> float:
        """The level that is exceeded `rate_per_hour` times an hour; at least `level`."""
        ratio = np.log(max(self.rate_per_hour / rate_per_hour, 1.0))
        if self.shape * ratio < 1e-9:
            return float(self.level + self.scale * ratio)
        return float(self.level + self.scale * np.expm1(self.shape * ratio) / self.shape)


def peaks_above(statistic: ArrayLike, level: float, time_step: float) -> Array:
    """The largest sample of each excursion above `level` of a statistic (N,)."""
    values = np.asarray(statistic, float)
    rows_above = np.flatnonzero(values > level)
    if not len(rows_above):
        return np.empty(0)
    parts = np.split(
        rows_above, np.flatnonzero(np.diff(rows_above) * time_step > MIN_EXCURSION_GAP) + 1
    )
    return np.array([values[part].max() for part in parts])


def fit_exceedances(runs: Sequence[ArrayLike], time_step: float) -> ExceedanceTail | None:
    """The tail of a statistic along some logs, (N,) each; None where too few excursions are seen.

    The peaks of excursions above a level have a generalised Pareto distribution (`shape`, `scale`).
    The level is the highest of the quantiles 1 - TAIL_SHARES that ENOUGH_EXCURSIONS exceed, else
    the lowest of them.

    Args:
        runs: logs of the statistic; no excursion goes on from one to the next.
        time_step: s, from sample to sample.
    """
    values = [np.asarray(run, float) for run in runs]
    pooled = np.concatenate(values)
    if not len(pooled):
        return None
    for share in TAIL_SHARES:
        level = float(np.quantile(pooled, 1.0 - share))
        excess = np.concatenate([peaks_above(run, level, time_step) for run in values]) - level
        if len(excess) >= ENOUGH_EXCURSIONS:
            break  # else the last level, the lowest, stands
    if len(excess) < MIN_EXCURSIONS:
        return None
    shape, scale = _most_likely(excess)
    # A lighter tail than the number of peaks can show is not believed: it is taken as exponential,
    # of the mean excess, with the shape that this number gives the next one to come.
    if shape < 1.0 / len(excess):
        shape, scale = 1.0 / len(excess), excess.mean()
    return ExceedanceTail(
        level=level,
        rate_per_hour=3600.0 * len(excess) / (len(pooled) * time_step),
        scale=float(scale),
        shape=float(min(shape, LARGEST_SHAPE)),
    )


def _most_likely(excess: Array) -> tuple[float, float]:
    """Shape and scale of the law of excesses (N,), with SHAPE_SD known of the shape."""
    from scipy.optimize import minimize
    from scipy.stats import genpareto

    def cost(x: Array) -> float:
        shape, scale = float(x[0]), float(np.exp(x[1]))
        log_likelihood = genpareto.logpdf(excess, shape, scale=scale).sum()
        return float(0.5 * (shape / SHAPE_SD) ** 2 - log_likelihood)

    start = np.array([0.01, np.log(excess.mean())])
    shape, size = minimize(cost, start, method="Nelder-Mead").x
    return float(shape), float(np.exp(size))


def gaussian_tail(size: int, correlation_time: float) -> ExceedanceTail:
    """The tail of the norm of `size` standard normal variables, where nothing was learnt.

    Each has the covariance exp(-|t| / correlation_time). Such a process stays above a high level u
    for correlation_time / u^2 at a time (Aldous, 1989). Beyond its level the tail is exponential,
    which is wider than Gaussian.
    """
    # as scipy.stats.chi has it
    level = float(np.sqrt(2.0 * gammainccinv(0.5 * size, _GAUSSIAN_TAIL_SHARE)))
    log_density = np.log(2.0) - 0.5 * np.log(2.0) * size - gammaln(0.5 * size)
    density = np.exp(log_density + xlogy(size - 1.0, level) - 0.5 * level**2)
    return ExceedanceTail(
        level=level,
        rate_per_hour=3600.0 * _GAUSSIAN_TAIL_SHARE * level**2 / correlation_time,
        scale=float(1.0 / (density / _GAUSSIAN_TAIL_SHARE - 2.0 / level)),
    )
