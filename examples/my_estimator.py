"""An estimator of one's own in the benchmark, beside the others:

    wrenchsight study benchmark --method my_estimator:make

in this file's folder. It reads what inverse dynamics and friction leave of the motors' torque,
behind a first-order low-pass, as a force at E by least squares.
"""

import numpy as np
from scipy.signal import lfilter

CUTOFF = 3.0  # Hz


class LowPassedResidual:
    def __init__(self, setting):
        self.robot, self.step = setting.robot, setting.time_step
        self.chain, self.friction = setting.model.chain(setting.robot), setting.model.friction
        self.torque_covariance = setting.model.residual_covariance

    def torque(self, q, v):
        """(N, n) N m that the motors need where nothing touches the arm: task `torque`."""
        acceleration = np.diff(v, axis=0, prepend=v[:1]) / self.step
        rigid = self.chain.inverse_dynamics(q, v, acceleration)
        return rigid + self.friction.torque_along(q, v, rigid)

    def __call__(self, q, v, current):
        """Wrench (N, 6) [mx my mz fx fy fz] at E in axes of W, and its covariance (N, 6, 6)."""
        pole = np.exp(-2.0 * np.pi * CUTOFF * self.step)
        left = self.torque(q, v) - self.robot.joint_torque(current)
        tau_ext = lfilter([1.0 - pole], [1.0, -pole], left, axis=0)
        gain = np.linalg.pinv(self.robot.chain.jacobian(q)[:, 3:].transpose(0, 2, 1))  # (N, 3, n)
        wrench, covariance = np.zeros((len(q), 6)), np.zeros((len(q), 6, 6))
        wrench[:, 3:] = np.einsum("kaj,kj->ka", gain, tau_ext)
        covariance[:, 3:, 3:] = gain @ self.torque_covariance @ gain.transpose(0, 2, 1)
        return wrench, covariance


def make(setting):
    """Called once for each arm and tool; see `wrenchsight.analyses.study.own_methods`."""
    return LowPassedResidual(setting)
