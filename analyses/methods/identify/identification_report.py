"""Sentences and tables on an identification: laws and their errors, filter, links."""

from collections.abc import Mapping, Sequence

import numpy as np

from wrenchsight.analyses.methods.identify.identification_config import IdentificationConfig
from wrenchsight.analyses.methods.identify.law_choice import Extrapolated, law_scores
from wrenchsight.models.numerics.arrays import Array


def filter_text(config: IdentificationConfig) -> str:
    """The filter of measured and predicted torque, in words."""
    filtered = "measured and predicted" if config.filter_regressor else "measured"
    return (
        f"zero-phase Butterworth low-pass, {config.cutoff:g} Hz (amplitude one half there), order "
        f"{config.filter_order} each way, of the {filtered} torque: errors are those below that"
    )


def law_lines(
    errors: Mapping[str, Array],
    chosen: str,
    error_source: str,
    extrapolated: Extrapolated | None = None,
) -> list[str]:
    """A line for each law that was tried: its error by joint; the chosen one first, then by score.

    Args:
        errors: RMSE (n,) N m by law.
        chosen: the law of the model.
        error_source: on what the errors are, "held out" or "fitted".
        extrapolated: as `law_scores`.
    """
    width = max(map(len, errors))
    scores = dict(zip(errors, law_scores(errors, extrapolated), strict=True))
    order = sorted(errors, key=lambda law: (law != chosen, scores[law]))
    lines = [f"friction laws, {error_source} RMSE by joint [N m]; last column: score"]
    for law in order:
        by_joint = " ".join(f"{error:7.3f}" for error in errors[law])
        verdict = "chosen" if law == chosen else "lost"
        lines.append(f"  {law:{width}} {by_joint}  {scores[law]:7.3f}  {verdict}")
    if len(order) > 1:
        lines.append(
            "  score: geometric mean over joints of these errors and of those on each "
            "joint's fastest and slowest samples, predicted without them"
        )
    return lines


def inconsistent_links_text(links: Sequence[str], count: int) -> str | None:
    """A sentence on links whose inertia no body can have; None where there are none."""
    if not links:
        return None
    which = "every link" if len(links) == count else ", ".join(links)
    return (
        f"physically impossible inertia: {which}; it spoils simulations and motions unlike the "
        "logs', not the torque predicted for similar ones; identify again with --consistent"
    )


def residual_text(mean: Array, sd: Array) -> str:
    """Mean ± 1 sd by joint, to two digits of the sd."""
    return ", ".join(f"{_rounded(m, s)} ± {s:.2g}" for m, s in zip(mean, sd, strict=True))


def _rounded(value: float, sd: float) -> str:
    """To the second digit of the sd; nothing is "-0.00"."""
    decimals = 1 - int(np.floor(np.log10(sd))) if sd > 0.0 else 2
    text = f"{value:+.{min(max(decimals, 0), 9)}f}"
    return text if float(text) else "0"
