"""The lag of a reading behind a force of limited bandwidth whose rate is unsteady.

Behind K_0 / (s + K_0) a force F reads LP F, late by s LP F / K_0. `models.observers.lag` uses the
rate of the reading itself, f = (omega / K_0) (F - LP_omega F), as the lag at that instant. This is
right for a rate that is steady over 1 / omega. A hand's is not: f is itself late, and passes
through zero where the lateness does not. So the band takes the power of f over the last 1 / omega
in its place:

    Sigma_F <- Sigma_F + LP_omega(g g^T) / share,   g_i = f_i sqrt(max(0, 1 - noise_i / f_i^2))

with noise the variance of F that noise alone gives: f shows it, too, and it is in Sigma_F already.
LP_omega takes part of the rate's power; for a force whose spectrum is flat up to omega it leaves

    share = int_0^1 x^2 / (1 + x^2) dx / int_0^1 x^2 dx = 3 (1 - pi / 4)

1.96 sds of it hold 89 % of such a force's lateness where there is no noise besides.
"""

import numpy as np

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel

LAG_POWER_SHARE = 3.0 * (1.0 - 0.25 * np.pi)


class LagPower:
    """Adds the lag to the covariances of successive samples.

    Args:
        K_0: 1/s; None: no lag.
        time_step: s.
        force_bandwidth_hz: Hz.
    """

    def __init__(self, K_0: float | None, time_step: float, force_bandwidth_hz: float) -> None:
        omega = 2.0 * np.pi * force_bandwidth_hz
        self._pole = float(np.exp(-omega * time_step))
        self._factor = 0.0 if K_0 is None else omega / K_0
        self._low_passed = np.full(6, np.nan)  # the wrench, NaN before the first sample
        self._mean_lag = np.zeros((6, 6))  # of the products of what its parts lag by

    def add(self, wrench: Array, noise: Array, covariance: Array) -> None:
        """Takes the next N samples.

        Args:
            wrench: (N, 6) as read, N m and N.
            noise: (N, 6) its variance by noise alone.
            covariance: (N, 6, 6), changed in place.
        """
        if self._factor > 0.0:
            lag_power_log(
                self._pole,
                self._factor,
                self._low_passed,
                self._mean_lag,
                wrench,
                noise,
                covariance,
            )


@kernel
def lag_power_log(
    pole: float,
    factor: float,
    low_passed: Array,
    mean_lag: Array,
    wrench: Array,
    noise: Array,
    covariance: Array,
) -> None:
    """`LagPower.add`; an entry of the wrench that is not finite leaves its `low_passed` one."""
    lateness = np.zeros(6)
    for k in range(wrench.shape[0]):
        for i in range(6):
            value = wrench[k, i]
            if np.isfinite(value):
                if not np.isfinite(low_passed[i]):
                    low_passed[i] = value
                low_passed[i] = pole * low_passed[i] + (1.0 - pole) * value
                f = factor * (value - low_passed[i])
                power = f * f - noise[k, i]
                lateness[i] = np.copysign(np.sqrt(power), f) if power > 0.0 else 0.0
        for i in range(6):
            for j in range(6):
                mean_lag[i, j] = pole * mean_lag[i, j] + (1.0 - pole) * lateness[i] * lateness[j]
                covariance[k, i, j] += mean_lag[i, j] / LAG_POWER_SHARE
