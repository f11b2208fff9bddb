"""Motor current and joint torque.

A drive's gain is given on the joint side: the torque that one ampere puts on the link, gearing and
efficiency included. The sign says which way the drive counts its current:

    tau_J = current_sign * torque_per_ampere * current

with tau_J positive along positive joint motion, before friction.
"""

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import NO_NEW_ARRAYS, kernel


def motor_gain(torque_per_ampere: ArrayLike, current_sign: ArrayLike = 1.0) -> Array:
    """Returns the signed gain tau_J / current in N m/A, (n,).

    Args:
        torque_per_ampere: (n,) N m/A on the joint side, positive.
        current_sign: (n,) +1 or -1.

    Raises:
        ValueError: a gain is not positive and finite, or a sign is neither +1 nor -1.
    """
    gain = np.asarray(torque_per_ampere, float)
    sign = np.asarray(current_sign, float)
    if not np.all(np.isfinite(gain) & (gain > 0.0)):
        raise ValueError(f"torque per ampere must be positive and finite, not {gain}")
    if not np.all(np.abs(sign) == 1.0):
        raise ValueError(f"current sign must be +1 or -1, not {sign}")
    return np.asarray(gain * sign)


def joint_torque(gain: Array, motor_rates: Array, current: Array) -> Array:
    """The torque (N, n) in N m of motors, of which one may move several joints: D^T (gain current).

    Args:
        gain: (n,) signed, of the motors, N m/A.
        motor_rates: (n, n) D with v_motor = D v_joint; (0, n) where each moves its own alone.
        current: (N, n) A, contiguous. A NaN stays with the joints it belongs to.
    """
    tau_J = np.empty_like(current)
    joint_torque_rows(gain, motor_rates, current, tau_J)
    return tau_J


@kernel(**NO_NEW_ARRAYS)
def joint_torque_rows(gain: Array, motor_rates: Array, current: Array, tau_J: Array) -> None:
    """Writes `joint_torque` of N samples into tau_J (N, n), N m; the other arguments are its."""
    n, is_coupled = gain.shape[0], motor_rates.shape[0] > 0
    for k in range(current.shape[0]):
        for i in range(n):
            tau_J[k, i] = 0.0 if is_coupled else gain[i] * current[k, i]
        for motor in range(motor_rates.shape[0]):
            for i in range(n):
                # No product with a zero, which would hand on the NaN of a motor that moves others.
                if motor_rates[motor, i] != 0.0:
                    tau_J[k, i] += motor_rates[motor, i] * (gain[motor] * current[k, motor])
