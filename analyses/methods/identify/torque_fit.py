"""Measured torque of a log and what a model predicts for it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.signals.root_mean_square import rms

SIMILARITY = (
    "similarity_pct is the correlation of measured and predicted torque, the article's figure: it "
    "ignores scale and offset, and is near 100 wherever gravity changes much, however many "
    "standard deviations the error is; judge by rmse_nm, by relative_pct (rmse_nm over the root "
    "mean square of the measured torque, torque_rms_nm), and by residual_mean_nm beside "
    "residual_sd_nm"
)


@dataclass(frozen=True, eq=False)
class TorqueFit:
    """Measured torque of one log and what a model predicts for it, both low-passed."""

    name: str  # of the log
    t: Array  # (T,) s
    measured: Array  # (T, n) N m
    predicted: Array  # (T, n) N m

    @property
    def residual(self) -> Array:
        """(T, n) measured minus predicted, N m."""
        return self.measured - self.predicted

    @property
    def rmse(self) -> Array:
        """(n,) N m."""
        return rms(self.residual)

    @property
    def bias(self) -> Array:
        """(n,) mean of the residual, N m."""
        return np.asarray(self.residual.mean(axis=0))

    @property
    def residual_sd(self) -> Array:
        """(n,) standard deviation of the residual about its mean, N m."""
        return np.asarray(self.residual.std(axis=0))

    @property
    def relative(self) -> Array:
        """(n,) rmse over the root mean square of the measured torque."""
        return self.rmse / rms(self.measured)

    @property
    def similarity(self) -> Array:
        """(n,) correlation coefficient of measured and predicted torque.

        The article (section 4.1) states a similarity above 90 % and does not define it. It is near
        100 % wherever gravity moves much, however large the error is: see SIMILARITY.
        """
        a = self.measured - self.measured.mean(axis=0)
        b = self.predicted - self.predicted.mean(axis=0)
        return np.asarray((a * b).sum(axis=0) / np.sqrt((a**2).sum(axis=0) * (b**2).sum(axis=0)))

    def metrics(self) -> dict[str, Any]:
        """Lists per joint, as written to metrics.json."""
        return {
            "rmse_nm": self.rmse,
            "residual_mean_nm": self.bias,
            "residual_sd_nm": self.residual_sd,
            "relative_pct": 100.0 * self.relative,
            "similarity_pct": 100.0 * self.similarity,
            "torque_rms_nm": rms(self.measured),
        }


def joined_fits(fits: Sequence[TorqueFit], name: str) -> TorqueFit:
    """All samples of several logs as one."""
    return TorqueFit(
        name,
        t=np.concatenate([fit.t for fit in fits]),
        measured=np.concatenate([fit.measured for fit in fits]),
        predicted=np.concatenate([fit.predicted for fit in fits]),
    )


def pooled_rmse(fits: Sequence[TorqueFit]) -> Array:
    """(n,) N m, over the samples of all fits together."""
    return rms(np.vstack([fit.residual for fit in fits]))
