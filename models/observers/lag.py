"""The lag of an observer, and how the reading accounts for it.

The observer reads each joint through K_0 / (s + K_0), LP for short: it yields LP(J^T F), not J^T F.

**The arm moves meanwhile.** With the present J even a constant force is read wrong, in proportion
to the change of J within 1 / K_0. On the UR10e with 2.8 kg at the flange this error is as large as
that of all friction. With

    J_seen = LP(J), column j through the observer's pole of joint j,

LP(J^T F) = J_seen^T F holds exactly for a force that is constant in the axes of W.

**The force changes meanwhile.** No reading can undo this without adding noise; the band covers it.
Behind a first-order low-pass the lag is the reading's own rate, exactly: F - LP F = (d/dt LP F) /
K_0. The rate is seen through a further low-pass, of the corner w = RATE_CORNERS omega, with omega /
(2 pi) the stated `force_bandwidth_hz`:

    f = (w / K_0) (F - LP_w(F))

f is late itself. It passes through zero where the lag does not. So the band takes the power of f
over the last 1 / omega, and that of this instant where it is larger, as right after a jump:

    Sigma_F <- Sigma_F + L / LAG_POWER_SHARE + h h^T,   L = LP_omega(g g^T),
    g_i = f_i sqrt(max(0, 1 - noise_i / f_i^2)),   h_i = sgn(g_i) sqrt(max(0, g_i^2 - L_ii /
    LAG_POWER_SHARE))

LP_w takes part of the rate's power. For a force whose spectrum is flat up to omega it leaves
LAG_POWER_SHARE = int_0^1 x^2 / (1 + x^2 / r^2) dx / int_0^1 x^2 dx, r = RATE_CORNERS. f shows the
noise of the reading, too, which is in Sigma_F already: noise_i = NOISE_FACTOR Sigma_F,ii. Of an
error with a correlation time of .05 s (white torque behind K_0 = 20/s) to .3 s, f shows 1.2 to .3
of the variance, and scatters about that.

A force that jumps is outside the band until the reading shows some of it, since it cannot be
foreseen. Where a reading is not valid, the low-passes follow a tenth as fast, since a reading near
a singular posture is not the force.

**Faster than stated.** Of a force beyond `force_bandwidth_hz` LP_w takes more than LAG_POWER_SHARE
leaves. The corner w shows it beside omega: for a sine of the frequency x omega the powers of the
rates seen through both are as (1 + x^2) / (1 + x^2 / r^2), 1.6 at x = 1. Above MAX_POWER_RATIO, x =
1.5, the reading lags by an unknown amount. It does not keep pace, and is not valid, from where the
lag's variance is more than MAX_LAG_RATIO of all else that the force's holds until it is less than
CAUGHT_UP_LAG_RATIO of it. With one limit both ways readings are valid between two peaks of a force
that turns to and fro: of 10 sds of the noise, at 9 Hz, a fifth of them, and a fifth of those err by
more than 3 sd.

**Springs.** Gears and links are springs that encoders at the motors do not see. A force that
changes bends them and accelerates the links, and F - A d^2/dt^2 F is read, with A = J^-T M K^-1 J^T
for a joint stiffness K. The eigenvalues of A are 1 / w_s^2 of the arm's natural frequencies w_s
with held motors. Within the bandwidth d^2/dt^2 F is at most omega K_0 times the lag, so that the
error is about omega K_0 / w_s^2 of it, in any direction, as A mixes them:

    Sigma_F <- Sigma_F + (omega K_0 / w_s^2)^2 tr(lag) 1,    of the force alone

Along the force the lag itself is wider. No log without fast contact shows w_s, so it is assumed:
NATURAL_FREQUENCY_HZ.

**The scale** of all readings (torque per ampere, friction under a load that no log had) has a
stated relative sd: Sigma_F <- Sigma_F + (scale F) (scale F)^T.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.numerics.arrays import Array, Record, record_type
from wrenchsight.models.numerics.kernel import NO_NEW_ARRAYS, kernel

JACOBIAN_ROWS = 6  # of the state, (JACOBIAN_ROWS, n), NaN before the first sample
RATE_CORNERS = 2.0  # corner of the rate's low-pass, in units of the stated bandwidth
NOISE_FACTOR = 2.0  # on the variance of all else, above which the rate's power is a lag
PACE_TIME = 4.0  # 1 / omega, over which powers are compared: a period of the slowest such force
LAG_POWER_SHARE = 3.0 * RATE_CORNERS**2 * (1.0 - RATE_CORNERS * math.atan(1.0 / RATE_CORNERS))
MAX_POWER_RATIO = 2.1  # of the rates seen through both corners
MAX_LAG_RATIO = 4.0  # variance of the lag of a force faster than stated, over that of all else
CAUGHT_UP_LAG_RATIO = 1.0  # the same, below which a reading that has lagged keeps pace again
NATURAL_FREQUENCY_HZ = 8.0  # lowest of an industrial arm with held motors; assumed
_DOUBTED_PACE = 0.1  # pace of the low-passes where the reading is not valid

LAG_STATE_TYPE = record_type(
    fast=(6,), slow=(6,), mean_lag=(6, 6), fast_power=(), slow_power=(), has_lagged=()
)
"""What `lag_tick` and `lag_update` remember.

    fast, slow              (6,) the wrench through the low-passes at the corner w and at omega; NaN
                            before the first sample
    mean_lag                (6, 6) L
    fast_power, slow_power  N^2, of the force's rate seen through each of the two
    has_lagged              1 where the reading did not keep pace, else 0
"""


class LagSettings(NamedTuple):
    """The constants of `lag_tick` and `lag_update`.

    Attributes:
        pole, slow_pole: per tick, of the low-passes at the corner w and at omega.
        doubted_pole, doubted_slow_pole: the same where the reading is not valid.
        pace_pole: per tick, of the powers' mean over PACE_TIME.
        rate_factor, slow_rate_factor: w / K_0 and omega / K_0, for samples a tick apart; 0: the
            observer has no lag.
        scale: relative sd of the scale of all readings.
        spring_share: of the lag, by which springs change the force in any direction.
    """

    pole: float
    slow_pole: float
    doubted_pole: float
    doubted_slow_pole: float
    pace_pole: float
    rate_factor: float
    slow_rate_factor: float
    scale: float
    spring_share: float


def lag_settings(
    K_0: ArrayLike | None, time_step: float, force_bandwidth_hz: float, scale: float
) -> LagSettings:
    """Returns the constants of `lag_tick`.

    Args:
        K_0: (n,) or () 1/s of the observer, of which the slowest counts; None: it has no such lag,
            and all but the scale are zero.
        time_step: s.
        force_bandwidth_hz: 0 leaves the lag of a changing force out of the band.
        scale: relative sd of the scale of all readings.

    Raises:
        ValueError: a number that is negative or not finite.
    """
    for name, value in (("force_bandwidth_hz", force_bandwidth_hz), ("scale", scale)):
        if not (np.isfinite(value) and value >= 0.0):
            raise ValueError(f"{name} must be zero or more, not {value}")
    omega = 2.0 * np.pi * force_bandwidth_hz
    if K_0 is None:
        return LagSettings(
            pole=0.0,
            slow_pole=0.0,
            doubted_pole=0.0,
            doubted_slow_pole=0.0,
            pace_pole=0.0,
            rate_factor=0.0,
            slow_rate_factor=0.0,
            scale=float(scale),
            spring_share=0.0,
        )
    slowest_K_0 = float(np.min(K_0))
    # Of each pair the first is at the corner w, the one called slow at omega.
    rates = np.array([RATE_CORNERS, 1.0]) * omega  # 1/s
    pole, slow_pole = np.exp(-rates * time_step).tolist()
    doubted_pole, doubted_slow_pole = np.exp(-_DOUBTED_PACE * rates * time_step).tolist()
    # Such that a ramp, low-passed up to the sample before, shows its rate exactly.
    ramp_rates = (1.0 - np.exp(-rates * time_step)) / time_step
    natural_frequency = 2.0 * np.pi * NATURAL_FREQUENCY_HZ  # w_s of the module's docstring
    rate_factor, slow_rate_factor = (ramp_rates / slowest_K_0).tolist()
    return LagSettings(
        pole=pole,
        slow_pole=slow_pole,
        doubted_pole=doubted_pole,
        doubted_slow_pole=doubted_slow_pole,
        pace_pole=float(np.exp(-omega * time_step / PACE_TIME)),
        rate_factor=rate_factor,
        slow_rate_factor=slow_rate_factor,
        scale=float(scale),
        spring_share=omega * slowest_K_0 / natural_frequency**2,
    )


def initial_lag_state() -> Record:
    """Returns the state (1,) of LAG_STATE_TYPE before the first sample."""
    state = np.zeros(1, LAG_STATE_TYPE)
    state["fast"], state["slow"] = np.nan, np.nan
    return state


def observer_poles(K_0: ArrayLike | None, num_joints: int, time_step: float) -> Array:
    """(n,) poles per tick of an observer with K_0 (n,) or () in 1/s; -1 for one without lag."""
    if K_0 is None:
        return np.full(num_joints, -1.0)
    rates = np.broadcast_to(np.asarray(K_0, float), (num_joints,))
    return np.asarray(np.exp(-rates * time_step))


@kernel(**NO_NEW_ARRAYS)
def see_jacobian_rows(poles: Array, state: Array, J: Array, J_seen: Array) -> None:
    """Writes J as the observer saw it, right after each of N samples.

    As in the observer, a period counts with the mean of its ends. A J that is not finite starts
    the low-pass anew.

    Args:
        poles: of `observer_poles`.
        state: (JACOBIAN_ROWS, n), changed; NaN before the first sample.
        J: (N, 6, n).
        J_seen: (N, 6, n), written.
    """
    for k in range(J.shape[0]):
        for j in range(poles.shape[0]):
            pole = poles[j]
            half = 0.5 * (1.0 - pole)
            for i in range(6):
                seen = J[k, i, j]
                if pole >= 0.0 and np.isfinite(state[i, j]):
                    seen = state[i, j] + half * J[k, i, j]
                J_seen[k, i, j] = seen
                state[i, j] = pole * seen + half * J[k, i, j]


@kernel(**NO_NEW_ARRAYS)
def lag_tick(
    settings: LagSettings, state: Record, wrench: Array, covariance: Array, work: Array
) -> bool:
    """Single-sample kernel: adds lag and scale to the covariance (6, 6).

        covariance += L / LAG_POWER_SHARE + h h^T + scale^2 F F^T

    and on the force's diagonal what springs add: spring_share^2 times the trace of the force's part
    of the first two terms. f is what the reading F lags by, from its rate; g = f without the noise
    of the reading; L the mean of g g^T over the last 1 / omega; h what of g this instant has beyond
    that mean; omega / (2 pi) the bandwidth that the user states. The noise of the reading is that
    of the covariance as it is given: f and g come before it is changed.

    Args:
        settings: of `lag_settings`.
        state: (1,) of LAG_STATE_TYPE; all but the low-passed wrench are updated. `lag_update` takes
            the sample into that.
        wrench: (6,) the reading, moment first; where it is not finite, f is 0 and L fades.
        covariance: (6, 6), changed.
        work: (2, 6) N m and N, overwritten with g and h.

    Returns:
        Whether the reading keeps pace with the force.
    """
    fast_power, slow_power, force_variance = 0.0, 0.0, 0.0  # of the three forces, N^2
    g, h = work[0], work[1]
    memory = state[0]
    mean_lag = memory.mean_lag
    for i in range(6):
        f, slow_f = 0.0, 0.0  # slow_f: what f is through the lower corner, omega
        if np.isfinite(memory.fast[i]) and np.isfinite(wrench[i]):
            f = settings.rate_factor * (wrench[i] - memory.fast[i])
            slow_f = settings.slow_rate_factor * (wrench[i] - memory.slow[i])
        power = f * f - NOISE_FACTOR * covariance[i, i]
        g[i] = np.copysign(np.sqrt(power), f) if power > 0.0 else 0.0
        if i >= 3:
            fast_power += f * f
            slow_power += slow_f * slow_f
            force_variance += covariance[i, i]
    slow_pole, pace_pole = settings.slow_pole, settings.pace_pole
    for i in range(6):  # L = LP_omega(g g^T)
        for j in range(6):
            product = g[i] * g[j]
            mean_lag[i, j] = slow_pole * mean_lag[i, j] + (1.0 - slow_pole) * product
    # Powers over PACE_TIME tell a force faster than stated.
    memory.fast_power = pace_pole * memory.fast_power + (1.0 - pace_pole) * fast_power
    memory.slow_power = pace_pole * memory.slow_power + (1.0 - pace_pole) * slow_power
    for i in range(6):
        missing = g[i] * g[i] - mean_lag[i, i] / LAG_POWER_SHARE
        h[i] = np.copysign(np.sqrt(missing), g[i]) if missing > 0.0 else 0.0
    lag_variance, scale = 0.0, settings.scale
    for i in range(6):
        for j in range(i + 1):
            lag = mean_lag[i, j] / LAG_POWER_SHARE + h[i] * h[j]
            covariance[i, j] += lag + scale * scale * wrench[i] * wrench[j]
            covariance[j, i] = covariance[i, j]
            if i == j and i >= 3:
                lag_variance += lag
    for i in range(3, 6):  # what springs in gears and links add, whatever the force's direction
        covariance[i, i] += settings.spring_share * settings.spring_share * lag_variance
    is_fast = memory.fast_power > MAX_POWER_RATIO * memory.slow_power
    limit = CAUGHT_UP_LAG_RATIO if memory.has_lagged > 0.0 else MAX_LAG_RATIO
    lags = is_fast and lag_variance > limit * force_variance
    memory.has_lagged = 1.0 if lags else 0.0
    return not lags


@kernel(**NO_NEW_ARRAYS)
def lag_update(settings: LagSettings, state: Record, wrench: Array, is_force: bool) -> None:
    """Single-sample kernel: updates `state` with the reading of a sample, in place.

    Args:
        settings, state, wrench: as `lag_tick`.
        is_force: whether the reading is valid, apart from its lag.
    """
    pole = settings.pole if is_force else settings.doubted_pole
    slow_pole = settings.slow_pole if is_force else settings.doubted_slow_pole
    fast, slow = state[0].fast, state[0].slow
    for i in range(6):
        if np.isfinite(wrench[i]):
            if np.isfinite(fast[i]):
                fast[i] = pole * fast[i] + (1.0 - pole) * wrench[i]
                slow[i] = slow_pole * slow[i] + (1.0 - slow_pole) * wrench[i]
            else:
                fast[i] = slow[i] = wrench[i]
