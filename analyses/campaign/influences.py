"""Influence of a world's drawn parameters on a figure, by rank correlation over worlds.

Where the article's figure lies outside the worlds' range, the question is which assumption would
bring it back. Spearman's rank correlation of the figure with each drawn parameter shows which of
them moves it, whatever the curve. Holm's step-down rule holds the chance of naming any that does
not below SIGNIFICANCE_LEVEL, over all parameters of a figure (S. Holm, Scand. J. Stat. 6, 1979).
The strongest of those named stay. Where a straight line (Theil and Sen's) explains enough of the
spread, it gives the parameter's value at which the figure would be the article's.

Draws of which 1 means that nothing is wrong (PAYLOAD, TORQUE_CONSTANT) may err either way: their
distance from 1 stands beside them, `|payload - 1|`.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.stats import linregress, spearmanr, theilslopes

from wrenchsight.models.numerics.arrays import Array

SIGNIFICANCE_LEVEL: Final = 0.05
MAX_NAMED_PARAMETERS: Final = 3  # parameters named for a figure
LEAST_EXPLAINED: Final = 0.25  # share of the variance that a line must explain to be used
_SEED_PARAMETERS: Final = ("individual", "day")  # drawn, but of no order
_EITHER_WAY: Final = ("payload", "torque_constant_")


@dataclass(frozen=True)
class Influence:
    """A drawn parameter that moves a figure."""

    parameter: str  # as drawn, such as `load`; `|payload - 1|` is the size of an error
    rank_correlation: float  # Spearman's, -1 to 1
    p: float  # that it is chance, corrected for the number of tested parameters
    drawn: tuple[float, float]  # the least and the largest value over the worlds
    # value at which a line through the worlds has the article's figure; None: no line explains
    # enough, or it leads farther beyond the drawn values than they are wide, or to a value that
    # cannot be
    reaches_article_at: float | None = None
    extrapolated: bool = False  # whether that value lies beyond the drawn ones

    def __str__(self) -> str:
        sign = "+" if self.rank_correlation > 0.0 else "−"
        text = f"{self.parameter} {sign} (rank correlation {self.rank_correlation:.2f}, "
        text += f"p {self.p:.2g})" if self.p >= 1e-4 else "p < 0.0001)"
        if self.reaches_article_at is None:
            return text
        low, high = self.drawn
        where = f"; the article's at {self.reaches_article_at:.3g}"
        beyond = f" (extrapolated: drawn {low:.3g} to {high:.3g})" if self.extrapolated else ""
        return text + where + beyond


def influences(
    values: Array, parameters: Mapping[str, Sequence[float]], article: float | None
) -> tuple[Influence, ...]:
    """The parameters that move a figure, the strongest first; none where none does.

    Args:
        values: (N,) of the figure, in as many worlds.
        parameters: parameters of the same worlds, what was drawn, by name.
        article: the printed figure.
    """
    names, draws = [], []
    for name, drawn in _candidates(parameters):
        if np.ptp(drawn) > 0.0:
            names.append(name)
            draws.append(drawn)
    if not names or not np.ptp(values) > 0.0:
        return ()
    tests = [spearmanr(drawn, values) for drawn in draws]
    corrected = holm(np.array([test.pvalue for test in tests]))
    strongest = sorted(range(len(names)), key=lambda k: -abs(float(tests[k].statistic)))
    return tuple(
        _influence(names[k], draws[k], values, float(tests[k].statistic), corrected[k], article)
        for k in [k for k in strongest if corrected[k] < SIGNIFICANCE_LEVEL][:MAX_NAMED_PARAMETERS]
    )


def holm(p: Array) -> Array:
    """Holm's corrected p (N,) of N tests: each p times the number of tests not yet rejected."""
    order = np.argsort(p, kind="stable")
    num_remaining = len(p) - np.arange(len(p))
    corrected = np.empty(len(p))
    corrected[order] = np.minimum(np.maximum.accumulate(p[order] * num_remaining), 1.0)
    return corrected


def influences_text(moved_by: Sequence[Influence] | None) -> str:
    """The influences on a figure in words; "" where they were not determined."""
    if moved_by is None:
        return ""
    return "; ".join(map(str, moved_by)) or "no drawn parameter is seen to move it"


def _candidates(parameters: Mapping[str, Sequence[float]]) -> Iterator[tuple[str, Array]]:
    for name, drawn in parameters.items():
        if name in _SEED_PARAMETERS:
            continue
        values = np.asarray(drawn, dtype=np.float64)
        yield name, values
        if name.startswith(_EITHER_WAY):
            yield f"|{name} - 1|", np.abs(values - 1.0)


def _influence(
    name: str, drawn: Array, values: Array, rank: float, p: float, article: float | None
) -> Influence:
    low, high = float(drawn.min()), float(drawn.max())
    influence = Influence(name, rank, float(p), (low, high))
    if article is None:
        return influence
    slope, intercept = theilslopes(values, drawn)[:2]
    if linregress(drawn, values).rvalue ** 2 < LEAST_EXPLAINED or slope == 0.0:
        return influence
    at = float((article - intercept) / slope)
    # Everything drawn is zero or more.
    if at < max(0.0, low - (high - low)) or at > high + (high - low):
        return influence
    extrapolated = not low <= at <= high
    return replace(influence, reaches_article_at=at, extrapolated=extrapolated)
