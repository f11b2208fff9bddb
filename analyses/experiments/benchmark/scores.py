"""A figure with its spread, as the benchmark's metrics hold it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.stats import beta


def spread(key: str, values: Sequence[float]) -> dict[str, Any]:
    """Median, least, largest and mean of the values of several logs, runs, postures or pieces."""
    scores = np.asarray(values, float)
    return {
        key: float(np.median(scores)),
        f"{key}_low": float(scores.min()),
        f"{key}_high": float(scores.max()),
        f"{key}_mean": float(scores.mean()),
        f"{key}_count": len(scores),
    }


def share(key: str, count: int, of: int) -> dict[str, Any]:
    """A share in %, and the least and the largest that agree with its count at 95 % (Clopper and
    Pearson, 1934).
    """
    low = beta.ppf(0.025, count, of - count + 1) if count else 0.0
    high = beta.ppf(0.975, count + 1, of - count) if count < of else 1.0
    return {
        f"{key}_pct": 100.0 * count / of,
        f"{key}_pct_low": 100.0 * float(low),
        f"{key}_pct_high": 100.0 * float(high),
        f"{key}_pct_count": of,
    }
