"""The lag of an observer, and how the reading accounts for it.

The observer reads each joint through K_0 / (s + K_0), LP for short: it yields LP(J^T F), not J^T F.

**The arm moves meanwhile.** With the present J even a constant force is read wrong, in proportion
to the change of J within 1 / K_0. On the UR10e with 2.8 kg at the flange this error is as large as
that of all friction. With

    J_seen = LP(J), column j through the observer's pole of joint j,

LP(J^T F) = J_seen^T F holds exactly for a force that is constant in the axes of W.

**The force changes meanwhile.** No reading can undo this without adding noise; the band covers it.
For a force that changes at a steady rate, LP lags by that rate over K_0. The reading F minus its
own low-pass at a corner omega is that rate over omega. Therefore

    Sigma_F <- Sigma_F + f f^T,    f = (omega / K_0) (F - LP_omega(F))

covers the lag of every force whose rate is steady over 1 / omega; `force_bandwidth_hz` is omega /
(2 pi). A force that jumps is outside the band until the reading shows about half of it, since it
cannot be foreseen. The noise of F minus LP_omega(F) is in Sigma_F already. f_i therefore counts as
f_i max(0, 1 - Sigma_F,ii / f_i^2): in full far above the noise, not at all within it. Where a
reading is not valid, LP_omega follows a tenth as fast, since a reading near a singular posture is
not the force.

**The scale** of all readings (torque per ampere, friction under a load that no log had) has a
stated relative sd: Sigma_F <- Sigma_F + (scale F) (scale F)^T.
"""

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel

JACOBIAN_ROWS = 6  # of the state, (JACOBIAN_ROWS, n), NaN before the first sample
_DOUBTED = 0.1  # pace of LP_omega where the reading is not valid

_POLE, _DOUBTED_POLE, _FACTOR, _SCALE = range(4)  # entries of the settings


def lag_settings(
    K_0: ArrayLike | None, time_step: float, force_bandwidth_hz: float, scale: float
) -> Array:
    """Returns the (4,) constants of `lag_tick`.

    Args:
        K_0: (n,) or () 1/s of the observer; None: it has no such lag.
        time_step: s.
        force_bandwidth_hz: 0 leaves the lag of a changing force out of the band.
        scale: share of what is read.

    Raises:
        ValueError: a number that is negative or not finite.
    """
    for name, value in (("force_bandwidth_hz", force_bandwidth_hz), ("scale", scale)):
        if not (np.isfinite(value) and value >= 0.0):
            raise ValueError(f"{name} must be zero or more, not {value}")
    omega = 2.0 * np.pi * force_bandwidth_hz
    settings = np.array([0.0, 0.0, 0.0, scale])
    if K_0 is not None:
        settings[_POLE] = np.exp(-omega * time_step)
        settings[_DOUBTED_POLE] = np.exp(-_DOUBTED * omega * time_step)
        settings[_FACTOR] = omega / float(np.min(K_0))
    return settings


def observer_poles(K_0: ArrayLike | None, num_joints: int, time_step: float) -> Array:
    """(n,) poles per tick of an observer with K_0 (n,) or () in 1/s; -1 for one without lag."""
    if K_0 is None:
        return np.full(num_joints, -1.0)
    rates = np.broadcast_to(np.asarray(K_0, float), (num_joints,))
    return np.asarray(np.exp(-rates * time_step))


@kernel
def see_jacobian(poles: Array, state: Array, J: Array, J_seen: Array) -> None:
    """Single-sample kernel: writes J_seen (6, n) right after a sample; `state` stays as it is.

    As in the observer, a period counts with the mean of its ends.
    """
    for j in range(poles.shape[0]):
        half = 0.5 * (1.0 - poles[j])
        for i in range(6):
            state_entry = state[i, j]
            if poles[j] < 0.0 or not np.isfinite(state_entry):
                J_seen[i, j] = J[i, j]
            else:
                J_seen[i, j] = state_entry + half * J[i, j]


@kernel
def take_jacobian(poles: Array, state: Array, J: Array, J_seen: Array) -> None:
    """Single-sample kernel: updates `state` with a sample and its `see_jacobian`, in place.

    A J that is not finite starts it anew.
    """
    for j in range(poles.shape[0]):
        half = 0.5 * (1.0 - poles[j])
        for i in range(6):
            state[i, j] = poles[j] * J_seen[i, j] + half * J[i, j]


@kernel
def lag_tick(
    settings: Array, state: Array, wrench: Array, covariance: Array, lateness: Array
) -> None:
    """Single-sample kernel: adds lag and scale to the covariance (6, 6); `state` stays as it is.

    Args:
        settings: of `lag_settings`.
        state: (6,) LP_omega of the wrench, NaN before the first.
        wrench: (6,).
        covariance: (6, 6), changed.
        lateness: (6,) N m and N, overwritten with f.
    """
    scale = settings[_SCALE]
    for i in range(6):
        # The diagonal from i on has not been changed yet.
        late_i = _late(settings, state[i], wrench[i], covariance[i, i])
        for j in range(i):
            covariance[i, j] += late_i * lateness[j] + scale * scale * wrench[i] * wrench[j]
            covariance[j, i] = covariance[i, j]
        covariance[i, i] += late_i * late_i + scale * scale * wrench[i] * wrench[i]
        lateness[i] = late_i


@kernel
def _late(settings: Array, low_passed: float, value: float, variance: float) -> float:
    """The lag f_i of one component."""
    if not np.isfinite(low_passed):
        return 0.0
    lateness = settings[_FACTOR] * (value - low_passed)
    square = lateness * lateness
    return lateness * (1.0 - variance / square) if square > variance else 0.0


@kernel
def lag_update(settings: Array, state: Array, wrench: Array, valid: bool) -> None:
    """Single-sample kernel: updates `state` with the reading of a sample, in place."""
    pole = settings[_POLE] if valid else settings[_DOUBTED_POLE]
    for i in range(6):
        if np.isfinite(wrench[i]):
            if np.isfinite(state[i]):
                state[i] = pole * state[i] + (1.0 - pole) * wrench[i]
            else:
                state[i] = wrench[i]
