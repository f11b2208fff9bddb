"""Which differences between a simulated arm and the real one are more than chance, on such logs?

Two simulated arms with the same parameters, on other days and with other noise, differ by what
chance does to logs of this length. Were the truth right, the real arm would differ from either by
as much: log ratios with the same standard deviation, that of the two simulated arms' log ratios
over a statistic's joints (of expectation zero, one degree of freedom a joint).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from wrenchsight.models.arrays import Array

ERROR = 0.05  # of calling what is chance a difference, a number


@dataclass(frozen=True, eq=False)
class ToldApart:
    """Of one statistic.

    Attributes:
        factor: by which chance takes a ratio from 1, up or down, in all but ERROR of the cases;
            NaN where no joint tells.
        joints: (n,) whether a joint's number is further off than the aim and than chance.
    """

    factor: float
    joints: NDArray[np.bool_]


def told_apart(ratio: Array, two_simulated: Array, aim: float) -> ToldApart:
    """Judges one statistic, by Student's t with the spread of the two simulated arms.

    Args:
        ratio: (n,) of simulated over real; NaN where a joint has no such number.
        two_simulated: (n,) of one simulated arm over another with the same parameters.
        aim: by which a ratio may differ from 1 before anybody asks whether it is chance.
    """
    apart = np.log(two_simulated[np.isfinite(two_simulated) & (two_simulated > 0.0)])
    if apart.size == 0:
        return ToldApart(float("nan"), np.zeros(ratio.shape, dtype=np.bool_))
    spread = float(np.sqrt(np.mean(apart**2)))
    limit = float(student.ppf(1.0 - ERROR / 2.0, apart.size)) * spread
    known = np.isfinite(ratio) & (ratio > 0.0)
    size = np.abs(np.log(np.where(known, ratio, 1.0)))
    off = np.abs(np.where(known, ratio, 1.0) - 1.0) > aim
    return ToldApart(float(np.exp(limit)), known & off & (size > limit))
