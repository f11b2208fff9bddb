"""Judgement of a force reading by a sensor: bias, scatter, and coverage of the stated band.

All numbers are over averages of some time, so that two readings of one log are judged alike
whatever their rates.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.estimation.invalid import InvalidCodes
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.signals.bands import SIGMA_95


@dataclass(frozen=True, eq=False)
class ForceReading:
    """A force over time, with its method's uncertainty and validity; M averages.

    Attributes:
        force: (M,) N; NaN where there is no reading.
        sd: (M,) N, or None for a method that states none.
        valid: (M,), or None for a method that does not state it.
        invalid: (M,) reasons why an average is not valid, or None for a method without them.
    """

    force: Array
    sd: Array | None = None
    valid: Flags | None = None
    invalid: InvalidCodes | None = None

    def __getitem__(self, rows: NDArray[np.int64] | slice | Flags) -> "ForceReading":
        """The reading at some of its averages."""
        return ForceReading(
            self.force[rows],
            None if self.sd is None else self.sd[rows],
            None if self.valid is None else self.valid[rows],
            None if self.invalid is None else self.invalid[rows],
        )


@dataclass(frozen=True)
class ForceJudgement:
    """A reading against the truth over one interval of one log.

    Attributes:
        bias, sd, rmse: of the error, N.
        inside_95: share of the truth in the 95 % band; None without one.
        share_valid: None for a method that does not state it.
        rmse_valid, inside_95_valid: as rmse, N, and inside_95, of the valid averages alone; None
            where there are none.
        stated_sd: mean of the stated sd, N; None without one.
        force: mean of the truth, N.
        correlation: correlation of reading and truth; None where one of them does not vary.
        count: averages judged.
    """

    bias: float
    sd: float
    rmse: float
    inside_95: float | None
    share_valid: float | None
    stated_sd: float | None
    force: float
    correlation: float | None
    count: int
    rmse_valid: float | None = None
    inside_95_valid: float | None = None

    @classmethod
    def of(cls, reading: ForceReading, truth: Array) -> "ForceJudgement | None":
        """Judges the averages that have a reading; None where there is none.

        Args:
            reading: M averages.
            truth: (M,) N.
        """
        is_judged = np.isfinite(reading.force) & np.isfinite(truth)
        if not is_judged.any():
            return None
        error = (reading.force - truth)[is_judged]
        # What the method does not state stays None; of its validity, no average counts as valid.
        inside = valid_share = stated_sd = rmse_valid = inside_valid = None
        is_valid = np.zeros(len(error), np.bool_)
        if reading.valid is not None:
            is_valid = reading.valid[is_judged]
            valid_share = float(np.mean(is_valid))
        if is_valid.any():
            rmse_valid = float(np.sqrt(np.mean(error[is_valid] ** 2)))
        if reading.sd is not None:
            sd = reading.sd[is_judged]
            is_inside = np.abs(error) <= SIGMA_95 * sd
            inside, stated_sd = float(np.mean(is_inside)), float(np.mean(sd))
            if is_valid.any():
                inside_valid = float(np.mean(is_inside[is_valid]))
        return cls(
            bias=float(np.mean(error)),
            sd=float(np.std(error)),
            rmse=float(np.sqrt(np.mean(error**2))),
            inside_95=inside,
            share_valid=valid_share,
            stated_sd=stated_sd,
            force=float(np.mean(truth[is_judged])),
            correlation=correlation(reading.force[is_judged], truth[is_judged]),
            count=len(error),
            rmse_valid=rmse_valid,
            inside_95_valid=inside_valid,
        )

    def metrics(self, unit: str = "n") -> dict[str, Any]:
        """Figures under the keys of a study's metrics; `unit` is n or nm."""
        share = {
            "inside_95_pct": self.inside_95,
            "share_valid_pct": self.share_valid,
            "inside_95_valid_pct": self.inside_95_valid,
        }
        return {
            f"bias_{unit}": self.bias,
            f"sd_{unit}": self.sd,
            f"rmse_{unit}": self.rmse,
            f"rmse_valid_{unit}": self.rmse_valid,
            **{key: None if value is None else 100.0 * value for key, value in share.items()},
            f"stated_sd_{unit}": self.stated_sd,
            f"mean_{unit}": self.force,
            "correlation": self.correlation,
        }


def correlation(a: Array, b: Array) -> float | None:
    """Pearson's, of a (M,) and b (M,); None where one of them does not vary."""
    if np.ptp(a) == 0.0 or np.ptp(b) == 0.0:
        return None
    return float(np.corrcoef(a, b)[0, 1])


def pooled_judgement(judgements: Sequence[ForceJudgement]) -> dict[str, Any]:
    """Means over logs, under the keys of a study's metrics; None where nothing was judged."""

    def mean(values: list[float | None], factor: float = 1.0) -> float | None:
        judged = [value for value in values if value is not None]
        return factor * float(np.mean(judged)) if judged else None

    return {
        "runs": len(judgements),
        "bias_n": mean([j.bias for j in judgements]),
        "sd_n": mean([j.sd for j in judgements]),
        "rmse_n": mean([j.rmse for j in judgements]),
        "inside_95_pct": mean([j.inside_95 for j in judgements], 100.0),
        "share_valid_pct": mean([j.share_valid for j in judgements], 100.0),
        "rmse_valid_n": mean([j.rmse_valid for j in judgements]),
        "inside_95_valid_pct": mean([j.inside_95_valid for j in judgements], 100.0),
        "stated_sd_n": mean([j.stated_sd for j in judgements]),
        "force_n": mean([j.force for j in judgements]),
        "correlation": mean([j.correlation for j in judgements]),
    }
