"""Search for signs by turning one joint after the other."""

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.numerics.arrays import Array

# Of a joint's turned sign against its own, from which on the joint is named: the sign of one that
# moves little or carries little is likelier either way by chance.
MIN_ODDS = 100.0


def best_signs(num_joints: int, score: Callable[[Array], float], base_score: float) -> Array | None:
    """(n,) the likeliest signs, -1 where turned; None where no other signs than the log's are.

    Two searches start, from the log's own signs and from all turned: where masses are free, a log
    with some signs wrong may fit better with all turned, and one joint after the other then leads
    to the opposite of each true sign. All turned is what a convention does: it is the result where
    no other signs are MIN_ODDS times likelier. Else a joint is turned only where that makes the log
    MIN_ODDS times likelier.

    Args:
        num_joints: n.
        score: log evidence of signs (n,).
        base_score: score of the log's own signs.
    """
    own_signs = np.ones(num_joints)
    all_score = score(-own_signs)
    starts = [(base_score, own_signs), (all_score, -own_signs)]
    found = [_climbed(start, start_score, score) for start_score, start in starts]
    best_score, best = max(found, key=lambda pair: pair[0])
    margin = math.log(MIN_ODDS)
    if all_score > base_score and best_score - all_score < margin:
        return -own_signs
    while (turned := np.flatnonzero(best < 0.0)).size:
        if len(turned) == 1:  # its own sign gives those of the log
            return best if best_score - base_score > 0.0 else None
        trial_score, trial = _best_change(best, turned, score)
        if best_score - trial_score >= margin:
            break
        best_score, best = trial_score, trial
    return None if (best > 0.0).all() else best


def _climbed(
    signs: Array, start_score: float, score: Callable[[Array], float]
) -> tuple[float, Array]:
    """The score and the signs at which no change of one sign is better, from a start."""
    best_score, best = start_score, signs
    for _ in range(len(signs)):
        trial_score, trial = _best_change(best, range(len(signs)), score)
        if trial_score <= best_score:
            break
        best_score, best = trial_score, trial
    return best_score, best


def _best_change(
    signs: Array, joints: "Sequence[int] | NDArray[np.intp]", score: Callable[[Array], float]
) -> tuple[float, Array]:
    """The score and the signs of the best change of one of these joints' signs."""
    trials = []
    for j in joints:
        changed = signs.copy()
        changed[j] = -changed[j]
        trials.append((score(changed), changed))
    return max(trials, key=lambda pair: pair[0])
