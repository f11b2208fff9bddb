"""External torque where motion repeats itself: torque one period ago minus torque now (eq. 4)."""

import numpy as np
from scipy.signal import lfilter

from wrenchsight.models.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot


def repetition_torque(
    recording: Recording, robot: Robot, period: int, K_0: float | None = None
) -> Array:
    """tau_ext (T - period, n) in N m by eq. 4: torque one period ago (tau_d) minus torque now.

    In our sign: what the environment exerts, positive along the motion it causes.

    Args:
        recording: of a motion that repeats itself.
        period: samples.
        K_0: 1/s, of a first-order low-pass as the momentum observer's; None: raw, as eq. 4 stands.
    """
    tau = robot.joint_torque(recording.current)
    tau_ext = tau[:-period] - tau[period:]
    if K_0 is None:
        return np.asarray(tau_ext)
    pole = float(np.exp(-K_0 * recording.time_step))
    return np.asarray(lfilter([1.0 - pole], [1.0, -pole], tau_ext, axis=0))
