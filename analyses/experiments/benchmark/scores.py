"""A figure with its spread, as the benchmark's metrics hold it."""

from collections.abc import Sequence
from typing import Any

import numpy as np


def spread(key: str, values: Sequence[float]) -> dict[str, Any]:
    """Median, least, largest and mean of the values of several logs, runs, postures or pieces."""
    own = np.asarray(values, float)
    return {
        key: float(np.median(own)),
        f"{key}_low": float(own.min()),
        f"{key}_high": float(own.max()),
        f"{key}_mean": float(own.mean()),
        f"{key}_count": len(own),
    }


def share(key: str, count: int, of: int) -> dict[str, Any]:
    """A share in % with the standard error of its count, in %."""
    p = count / of
    return {
        f"{key}_pct": 100.0 * p,
        f"{key}_pct_error": 100.0 * float(np.sqrt(p * (1.0 - p) / of)),
    }
