"""The torque of a period, as an observer averages it over the period's two ends.

With u = tau_J + C^T v - G - tau_f, every observer integrates the momentum over a period T. The
model's part of u is the mean of its values at both ends. The motor torque of a period is either
"held", that is commanded at its start and constant, or "trapezoidal", the mean of both ends'
samples. The part of a sample that belongs to the period before it is therefore known before the
next period begins.
"""

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel

TORQUE_SAMPLES = ("held", "trapezoidal")


@kernel
def arrived_momentum(
    half_period: float, motor_time: float, momentum: float, model: float, tau_J: float
) -> float:
    """Momentum of a joint minus the share of the sample's torque in the period that it ends.

    Args:
        half_period: T / 2, s.
        motor_time: `motor_share`, s; with 0 the motor torque is not read.
        momentum: kg m^2/s.
        model: C^T v - G - tau_f, N m.
        tau_J: motor torque, N m.
    """
    arrived = momentum - half_period * model
    if motor_time != 0.0:
        arrived -= motor_time * tau_J
    return arrived


def motor_share(time_step: float, torque_samples: str) -> float:
    """Time that a sample's motor torque has acted in the period that it ends, s."""
    return 0.0 if torque_samples == "held" else 0.5 * time_step


def checked_period(time_step: float, torque_samples: str) -> float:
    """The time step, s.

    Raises:
        ValueError: it is not positive; unknown torque samples.
    """
    T = float(time_step)
    if not (np.isfinite(T) and T > 0.0):
        raise ValueError(f"time_step must be positive, not {T}")
    if torque_samples not in TORQUE_SAMPLES:
        choices = " or ".join(TORQUE_SAMPLES)
        raise ValueError(f"torque_samples must be {choices}, not {torque_samples!r}")
    return T


def positive_per_joint(name: str, values: ArrayLike, num_joints: int) -> Array:
    """(n,) from one value for all joints or one for each.

    Raises:
        ValueError: neither 1 nor n values, or one that is not positive.
    """
    array = np.atleast_1d(np.asarray(values, float))
    if array.shape not in ((1,), (num_joints,)):
        raise ValueError(f"{name} must have 1 or {num_joints} values, not {array.shape[0]}")
    if not np.all(np.isfinite(array) & (array > 0.0)):
        raise ValueError(f"{name} must be positive, not {array}")
    return np.broadcast_to(array, (num_joints,)).copy()
