"""What a smoothed wrench leaves out of a force that changes fast, by the causal reading.

The smoother's prior lets a force walk, or jump at few times. A force that changes fast and often is
neither: smoothing takes part of it for noise, and states an sd that ignores this. The causal
reading shows it. It is the force behind a low-pass LP of K_0, F_causal = LP F. So

    e = r + (dr/dt) / K_0,   r = F_causal - LP F_smooth

is the force that the smoothed wrench lacks, with the noise of the causal reading. It is seen
through a zero-phase low-pass of the corner RATE_CORNERS omega, omega / (2 pi) the stated
`force_bandwidth_hz`. What exceeds the noise is added, as its power over the time around a sample:

    Sigma_F <- Sigma_F + ZP(g g^T) / LAG_POWER_SHARE
    g_i = e_i sqrt(max(0, 1 - NOISE_FACTOR Sigma_F,ii / e_i^2))

with ZP the zero-phase low-pass of the corner POWER_CORNER omega, and LAG_POWER_SHARE and
RATE_CORNERS of `models.observers.lag`. A force beyond that bandwidth is not held: its readings are
not valid, as the causal ones are not.

**Springs** in gears and links change what is read of a force by a share of the observer's lag, in
any direction (`models.observers.lag`). No smoothing undoes that. F_smooth + e is not behind the
observer, so that its own rate shows the lag,

    f = (d/dt (F_smooth + e)) / K_0,   seen through the same low-pass as e,

and with g of f as above, Sigma_F <- Sigma_F + spring_share^2 tr(ZP(g g^T)) / LAG_POWER_SHARE 1, of
the force alone.
"""

import numpy as np
from scipy.signal import lfilter

from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.observers.lag import LAG_POWER_SHARE, RATE_CORNERS, lag_settings

NOISE_FACTOR = 2.0  # on the smoothed variance, which e shows as well
POWER_CORNER = 0.5  # of the stated bandwidth, over whose inverse the power is taken


class MissingForce:
    """Covariance of what smoothing leaves out, for successive parts of a log.

    Args:
        K_0: 1/s of the causal observer, the least of its joints.
        time_step: s.
        force_bandwidth_hz: Hz; 0 leaves it out of the band.
    """

    def __init__(self, K_0: float, time_step: float, force_bandwidth_hz: float) -> None:
        omega = 2.0 * np.pi * force_bandwidth_hz
        self._K_0, self._time_step = K_0, time_step
        self._rate_pole = float(np.exp(-RATE_CORNERS * omega * time_step))
        self._power_pole = float(np.exp(-POWER_CORNER * omega * time_step))
        self._spring_share = lag_settings(K_0, time_step, force_bandwidth_hz, 0.0).spring_share
        self._low_passed: Array | None = None  # (6,) LP F_smooth at the last sample, and F_smooth
        self._last_smoothed: Array | None = None

    def covariance(self, causal: Array, smoothed: Array, variance: Array, is_force: Flags) -> Array:
        """Takes the next N samples; returns the covariance (N, 6, 6) to be added.

        Args:
            causal, smoothed: (N, 6) wrenches.
            variance: (N, 6) of the smoothed ones.
            is_force: (N,) where the causal reading is one, apart from its lag.
        """
        N = len(smoothed)
        if N == 0 or self._rate_pole == 1.0:
            return np.zeros((N, 6, 6))
        behind = self._behind_observer(smoothed)
        residual = np.nan_to_num(np.where(is_force[:, None], causal - behind, 0.0))
        rate = np.gradient(residual, self._time_step, axis=0) if N > 1 else np.zeros_like(residual)
        missing = _zero_phase(residual + rate / self._K_0, self._rate_pole)
        covariance = self._mean_power(missing, variance)
        force = missing + _zero_phase(np.nan_to_num(smoothed), self._rate_pole)
        lag = np.gradient(force, self._time_step, axis=0) / self._K_0 if N > 1 else 0.0 * force
        lag_of_force = self._mean_power(lag, variance)[:, 3:, 3:]
        added = self._spring_share**2 * np.trace(lag_of_force, axis1=1, axis2=2)  # (N,) N^2
        covariance[:, 3:, 3:] += added[:, None, None] * np.eye(3)
        return covariance

    def _mean_power(self, error: Array, variance: Array) -> Array:
        """(N, 6, 6) of an error (N, 6), without the noise of a reading of a variance (N, 6)."""
        power = np.maximum(error**2 - NOISE_FACTOR * variance, 0.0)
        g = np.copysign(np.sqrt(np.nan_to_num(power)), error)
        return _zero_phase(g[:, :, None] * g[:, None, :], self._power_pole) / LAG_POWER_SHARE

    def _behind_observer(self, smoothed: Array) -> Array:
        """(N, 6) the smoothed wrench through the observer's low-pass."""
        if self._low_passed is None or self._last_smoothed is None:
            self._low_passed = self._last_smoothed = smoothed[0]
        pole = np.exp(-self._K_0 * self._time_step)
        means = 0.5 * (smoothed + np.vstack([self._last_smoothed, smoothed[:-1]]))
        behind, _ = lfilter(
            [1.0 - pole], [1.0, -pole], means, axis=0, zi=pole * self._low_passed[None]
        )
        self._low_passed, self._last_smoothed = behind[-1], smoothed[-1]
        return np.asarray(behind)


def _zero_phase(x: Array, pole: float) -> Array:
    """x (N, ...) through a first-order low-pass, forward and backward."""
    for _ in range(2):
        x, _ = lfilter([1.0 - pole], [1.0, -pole], x, axis=0, zi=pole * x[:1])
        x = x[::-1]
    return np.asarray(x)
