"""Choice of a model's friction law: the one that predicts best what it was not fitted on."""

from collections.abc import Mapping, Sequence

import numpy as np

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.ties import first_of_least

Extrapolated = Mapping[str, Sequence[Array]]


def law_scores(held_out: Mapping[str, Array], extrapolated: Extrapolated | None = None) -> Array:
    """The score of each law, lower is better: it decides which law a model gets.

    The score is an RMSE on what a law was not fitted on, as the geometric mean over the joints. A
    joint that carries little counts as much as one that carries the arm. Each joint's fastest
    samples and its slowest ones, predicted from the others, weigh as much as the held-out logs:
    use may differ from the fit.

    Args:
        held_out: (n,) N m per law, from the logs that were fitted alone.
        extrapolated: (n,) N m each, per law; for a missing law its held-out error counts.

    Returns:
        (laws,) N m (N), in the order of `held_out`.
    """

    def score(law: str) -> float:
        extremes = (extrapolated or {}).get(law) or [held_out[law]]
        errors = [held_out[law], *extremes]
        weights = [1.0, *[2.0 / len(extremes)] * len(extremes)]
        mean_logarithms = [np.mean(np.log(np.maximum(error, 1e-12))) for error in errors]
        return float(np.average(mean_logarithms, weights=weights))

    return np.exp([score(law) for law in held_out])


def best_law(held_out: Mapping[str, Array], extrapolated: Extrapolated | None = None) -> str:
    """The law with the lowest of `law_scores`; of those equal but for rounding the first."""
    return list(held_out)[int(first_of_least(law_scores(held_out, extrapolated)))]
