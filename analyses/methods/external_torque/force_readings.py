"""Forces read from external joint torque, and their errors against a sensor, log by log.

The prior's sds and the torque noise (one sd for all joints) are those of greatest evidence over all
logs together (`wrenchsight.models.estimation.evidence_prior`). The sensor judges only.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import rankdata

from wrenchsight.models.estimation.evidence_prior import evidence_prior, evidence_prior_and_noise
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.signals.root_mean_square import rms, rms_length


@dataclass(frozen=True)
class Knowledge:
    """Prior and torque noise of an estimate."""

    force_sd: float  # N, prior
    moment_sd: float  # N m, prior
    torque_covariance: Array  # (n, n) N^2 m^2


@dataclass(frozen=True)
class LogReading:
    """One log, read by one method, beside a sensor."""

    force: Array  # (N, 3) N, in the axes of the comparison
    covariance: Array  # (N, 3, 3) N^2, of the force
    condition_number: Array  # (N,)
    error: Array  # (N, 3) N, estimate minus sensor
    loaded: Flags  # (N,) the rows that are judged

    @property
    def rmse(self) -> float:
        """RMS length of the error over the loaded rows, N."""
        return rms_length(self.error[self.loaded])

    @property
    def axis_rmse(self) -> list[float]:
        """RMS error over the loaded rows along x, y and z, N."""
        return [float(rms(self.error[self.loaded, axis])) for axis in range(3)]

    @property
    def axis_sd(self) -> list[float]:
        """Stated sd over the loaded rows along x, y and z, N."""
        covariance = self.covariance[self.loaded]
        return [float(np.sqrt(np.mean(covariance[:, axis, axis]))) for axis in range(3)]

    @property
    def stated_sd(self) -> Array:
        """(N,) root of the covariance's trace, N: what the error's RMS length should be."""
        return np.asarray(np.sqrt(np.trace(self.covariance, axis1=1, axis2=2)))


@dataclass(frozen=True)
class MethodReading:
    """One method over all logs."""

    logs: tuple[LogReading, ...]

    def of_one(self) -> dict[str, float]:
        """Errors of a single log: RMSE (N), stated sd (N), ratio, and direction."""
        (log,) = self.logs
        return {
            "rmse_n": log.rmse,
            "stated_sd_n": float(rms(log.stated_sd[log.loaded])),
            "error_over_stated_sd": float(_error_over_sd(self.logs)[0]),
            "error_in_worst_stated_direction_pct": float(_worst_direction_share(self.logs)[0]),
        }

    def metrics(self) -> dict[str, Any]:
        """RMSE, and rank correlations of the errors with stated sd and condition number.

        Lists have an entry a log. Correlated are logs ("poses": each is one), axes of logs, and
        single loaded rows. Every log has a loaded row.
        """
        rmse = np.array([log.rmse for log in self.logs])
        sd = np.array([rms(log.stated_sd[log.loaded]) for log in self.logs])
        condition = np.array([np.mean(log.condition_number[log.loaded]) for log in self.logs])
        axis_error = np.array([log.axis_rmse for log in self.logs])
        axis_sd = np.array([log.axis_sd for log in self.logs])
        error_of_row = np.concatenate(
            [np.linalg.norm(log.error[log.loaded], axis=1) for log in self.logs]
        )
        sd_of_row = np.concatenate([log.stated_sd[log.loaded] for log in self.logs])
        condition_of_row = np.concatenate([log.condition_number[log.loaded] for log in self.logs])
        return {
            "mean_rmse_n": float(rmse.mean()),
            "rmse_n": rmse,
            "stated_sd_n": sd,
            "error_over_stated_sd": _error_over_sd(self.logs),
            "error_in_worst_stated_direction_pct": _worst_direction_share(self.logs),
            "rank_correlation": {
                "poses": {
                    "stated_sd": rank_correlation(rmse, sd),
                    "condition_number": rank_correlation(rmse, condition),
                },
                "axes": {
                    "stated_sd": rank_correlation(axis_error.ravel(), axis_sd.ravel()),
                    "condition_number": rank_correlation(
                        axis_error.ravel(), np.repeat(condition, 3)
                    ),
                },
                "samples": {
                    "stated_sd": rank_correlation(error_of_row, sd_of_row),
                    "condition_number": rank_correlation(error_of_row, condition_of_row),
                },
            },
        }


def knowledge_by_evidence(J: Array, tau_ext: Array, torque_sd: Array | None = None) -> Knowledge:
    """Prior and torque noise (alike in all joints) of greatest evidence.

    Args:
        J: (N, 6, n) rows [angular; linear].
        tau_ext: (N, n) N m.
        torque_sd: (n,) N m, of the torque's error; None: it is estimated.
    """
    if torque_sd is not None:
        covariance = np.diag(torque_sd**2)
        force_sd, moment_sd = evidence_prior(J, tau_ext, covariance)
        return Knowledge(force_sd, moment_sd, covariance)
    n = tau_ext.shape[1]
    force_sd, moment_sd, sd = evidence_prior_and_noise(J, tau_ext, np.eye(n))
    return Knowledge(force_sd, moment_sd, sd**2 * np.eye(n))


def rank_correlation(a: Array, b: Array) -> float:
    """Spearman's rank correlation; NaN where one of the two is constant."""
    ranks = [rankdata(x) - (len(x) + 1) / 2.0 for x in (a, b)]
    size = np.linalg.norm(ranks[0]) * np.linalg.norm(ranks[1])
    return float(ranks[0] @ ranks[1] / size) if size > 0.0 else float("nan")


def _error_over_sd(logs: Sequence[LogReading]) -> Array:
    """Per log, RMS of the error in units of its stated sd, over three axes; ideally 1."""
    ratios = []
    for log in logs:
        error, covariance = log.error[log.loaded], log.covariance[log.loaded]
        weighted = np.linalg.solve(covariance, error[..., None])[..., 0]
        ratios.append(np.sqrt(np.mean(np.sum(error * weighted, axis=1)) / 3.0))
    return np.array(ratios)


def _worst_direction_share(logs: Sequence[LogReading]) -> Array:
    """Per log, share of the squared error along the direction stated as worst, %; 33 by chance."""
    shares = []
    for log in logs:
        error = log.error[log.loaded]
        worst = np.linalg.eigh(log.covariance[log.loaded]).eigenvectors[:, :, -1]
        along = np.sum(error * worst, axis=1)
        shares.append(100.0 * np.sum(along**2) / np.sum(error**2))
    return np.array(shares)
