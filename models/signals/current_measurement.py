"""A drive's measurement of its motor current: first-order bandwidth, noise, resolution."""

import math

import numpy as np

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel


@kernel
def update_lag(bandwidth: Array, time_step: float, current_true: Array, state: Array) -> None:
    """Single-sample kernel: takes one tick of current into `state`, in place.

        lagged_k = a lagged_{k-1} + (1 - a) current_true_k,   a = exp(-2 pi bandwidth time_step)

    the exact response of a first-order lag, at the tick's end, to a current held over the tick.
    Before the first tick the lag is at rest at the present current. A current that is not finite
    leaves its joint as it is.

    Args:
        bandwidth: (n,) Hz at -3 dB; inf is no lag.
        time_step: s.
        current_true: (n,) A, held over the tick.
        state: (n,) A, lagged current; NaN before a joint's first tick.
    """
    for i in range(current_true.shape[0]):
        u = current_true[i]
        if not math.isfinite(u):
            continue
        if math.isnan(state[i]):
            state[i] = u
        else:
            pole = math.exp(-2.0 * math.pi * bandwidth[i] * time_step)
            state[i] = pole * state[i] + (1.0 - pole) * u


@kernel
def report_current(
    noise_sd: Array, resolution: Array, current_true: Array, noise: Array, current: Array
) -> None:
    """Single-sample kernel: turns the lagged into the reported current, in place.

    Noise is added, then the sum is rounded. A true current that is not finite is reported as it is.

    Args:
        noise_sd: (n,) A.
        resolution: (n,) A, step of the reported value (halves to even); zero leaves it as it is.
        current_true: (n,) A.
        noise: (n,) unit Gaussian draws.
        current: (n,) A, the lagged current; overwritten.
    """
    for i in range(current.shape[0]):
        if not math.isfinite(current_true[i]):
            current[i] = current_true[i]
            continue
        value = current[i]
        if noise_sd[i] > 0.0:
            value += noise_sd[i] * noise[i]
        if resolution[i] > 0.0:
            value = np.rint(value / resolution[i]) * resolution[i]
        current[i] = value


@kernel
def measure_current(
    table: Array, time_step: float, current_true: Array, noise: Array, state: Array, current: Array
) -> None:
    """Single-sample kernel: writes the reported current; the lagged one in `state` stays as it is.

    Args:
        table: (3, n) rows bandwidth, noise_sd, resolution.
        others: as in `update_lag` and `report_current`.
    """
    current[:] = state
    update_lag(table[0], time_step, current_true, current)
    report_current(table[1], table[2], current_true, noise, current)
