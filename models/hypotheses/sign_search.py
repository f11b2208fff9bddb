"""Search for signs by turning one joint after the other."""

from collections.abc import Callable

import numpy as np

from wrenchsight.models.numerics.arrays import Array


def best_signs(num_joints: int, score: Callable[[Array], float], base_score: float) -> Array | None:
    """(n,) signs of the largest score, -1 where turned; None where no other signs are better.

    Args:
        score: score of signs (n,).
        base_score: score of the log's own signs.
    """
    own_signs = np.ones(num_joints)
    starts = [(base_score, own_signs), (score(-own_signs), -own_signs)]
    best_score, best = max(starts, key=lambda pair: pair[0])
    for _ in range(num_joints):
        trials = []
        for j in range(num_joints):
            signs = best.copy()
            signs[j] = -signs[j]
            trials.append((score(signs), signs))
        trial_score, trial = max(trials, key=lambda pair: pair[0])
        if trial_score <= best_score:
            break
        best_score, best = trial_score, trial
    return None if (best > 0.0).all() else best
