"""What anyone has without this project: least squares, a first-order observer, pinv(J^T).

Least squares of inertial parameters, rotors, Coulomb (sign of the velocity) and viscous friction on
the identification logs, low-passed at CUTOFF_FREQUENCY both ways; the momentum observer of the same
gain as that of `estimate`; eq. 22 of the article. Only the chain's regressor and its kinematics are
ours.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.signal import butter, filtfilt

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot

CUTOFF_FREQUENCY = 7.5  # Hz
ROW_STRIDE = 4
K_0 = 20.0  # 1/s, the default of `estimate`
MIN_COLUMN_RATIO = 1e-9  # of the largest column of the regressor
FILTER_ORDER = 4  # of the low-pass, each way
END_ROWS = 20  # left out at both ends of a log: the filter's and the gradient's
RANK_TOLERANCE = 1e-8  # of the largest singular value; below it a combination counts as not seen
MIN_SIGN_SPEED = 0.02  # rad/s, below which the sign of the velocity is not used for the fit


@dataclass(frozen=True, eq=False)
class PlainModel:
    """A model by least squares.

    Attributes:
        robot: whose.
        chain: with the fitted inertias.
        coulomb, viscous: (n,) N m, N m s/rad.
    """

    robot: Robot
    chain: SerialChain
    coulomb: Array
    viscous: Array

    @classmethod
    def fit(cls, robot: Robot, logs: list[Recording]) -> Self:
        """Fits all parameters to contact-free logs of constant step.

        The 13 n columns are ten inertial parameters a body, then the rotor inertia of each joint,
        its Coulomb and its viscous friction; a row is a joint that moves, at a sample.
        """
        n = robot.num_joints
        rows, torques = [], []
        for log in logs:
            b, a = butter(FILTER_ORDER, CUTOFF_FREQUENCY, fs=1.0 / log.time_step)
            signals = (log.q, log.v, _torque(robot, log))
            q, v, tau = (filtfilt(b, a, signal, axis=0) for signal in signals)
            vdot = np.gradient(v, log.time_step, axis=0)
            inner = slice(END_ROWS, -END_ROWS, ROW_STRIDE)
            rigid = robot.chain.regressor(q[inner], v[inner], vdot[inner]).reshape(-1, n, 10 * n)
            # The torque of a joint depends on its own rotor and friction alone.
            joint = np.eye(n)
            factors = (vdot[inner], np.sign(v[inner]), v[inner])  # of rotor, Coulomb, viscous
            drives = [factor[:, :, None] * joint for factor in factors]
            moves = (np.abs(v[inner]) > MIN_SIGN_SPEED).reshape(-1)
            all_columns = np.concatenate([rigid, *drives], axis=2).reshape(-1, 13 * n)
            rows.append(all_columns[moves])
            torques.append(tau[inner].reshape(-1)[moves])
        A, y = np.concatenate(rows), np.concatenate(torques)
        size = np.linalg.norm(A, axis=0)
        # No torque depends on these: they get 0.
        size[size < MIN_COLUMN_RATIO * size.max()] = np.inf
        x = np.linalg.lstsq(A / size, y, rcond=RANK_TOLERANCE)[0] / size  # of least norm
        inertial = x[: 10 * n].reshape(n, 10)
        rotor_inertia, coulomb, viscous = x[10 * n :].reshape(3, n)
        chain = robot.chain.with_inertial_parameters(inertial, rotor_inertia)
        return cls(robot, chain, coulomb, viscous)

    def read(self, log: Recording) -> Array:
        """(N, 3) N, force on E of each sample."""
        chain = self.chain
        momentum, CTv, G = chain.momentum_terms(log.q, log.v)
        tau_f = self.coulomb * np.sign(log.v) + self.viscous * log.v
        drive = _torque(self.robot, log) - tau_f + CTv - G
        step = log.time_step
        tau_ext = np.zeros_like(momentum)
        total = momentum[0].copy()
        for k in range(1, len(momentum)):
            total += step * (drive[k - 1] + tau_ext[k - 1])
            tau_ext[k] = K_0 * (momentum[k] - total)
        J = self.chain.jacobian(log.q)
        return np.asarray(np.einsum("kij,kj->ki", np.linalg.pinv(J.transpose(0, 2, 1)), tau_ext))[
            :, 3:
        ]


def _torque(robot: Robot, log: Recording) -> Array:
    return robot.joint_torque(log.current)
