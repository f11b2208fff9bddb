"""Joint torque as a linear function of a robot's parameters, and its least squares.

    tau = Y(q, v, vdot) pi + diag(vdot) rotor + diag(sgn v) coulomb + diag(v) viscous + offset

With n joints there are 14 n parameters x: ten inertial ones per moving link (order of
`SerialChain.inertial_parameters`), then rotor inertia, Coulomb, viscous and offset for each joint.

A log enters as one triangular factor per joint, R^T R = [W tau]^T [W tau]. Everything after (rank,
weighting passes, fits that leave logs out, residual norms) works on these small matrices.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.base_parameters import BaseParameters, realise, triangular_factor
from models.friction import CoulombViscous
from models.robot import Robot
from models.serial_chain import SerialChain

Array = NDArray[np.float64]

INERTIAL_NAMES = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
JOINT_NAMES = ("rotor", "coulomb", "viscous", "offset")
_INERTIAL, _JOINT = len(INERTIAL_NAMES), len(JOINT_NAMES)


@dataclass(frozen=True, eq=False)
class TorqueFactors:
    """One log's regression.

    Attributes:
        R: n matrices (at most 14 n + 1 rows, 14 n + 1 columns), one a joint; the torque is last.
        num_rows: rows of the log behind each.
    """

    R: tuple[Array, ...]
    num_rows: int

    @property
    def regressor(self) -> Array:
        """All joints' factors without the torque, stacked: what the rank is read from."""
        return np.vstack([R[:, :-1] for R in self.R])


@dataclass(frozen=True, eq=False)
class TorqueEstimate:
    """Solution of the regression.

    Attributes:
        values: (b,) base parameters.
        standard_deviations: (b,) of them, for a residual that is independent from row to row;
            systematic errors of the model are not in them.
        residual_sd: (n,) N m, per joint, with the degrees of freedom taken off.
    """

    values: Array
    standard_deviations: Array
    residual_sd: Array


def parameter_names(joint_names: Sequence[str]) -> list[str]:
    """Names of the 14 n parameters; a link goes by the name of the joint that moves it."""
    return [f"{name}[{joint}]" for joint in joint_names for name in INERTIAL_NAMES] + [
        f"{name}[{joint}]" for joint in joint_names for name in JOINT_NAMES
    ]


def split_parameters(x: Array, num_joints: int) -> tuple[Array, Array, CoulombViscous]:
    """Returns inertial parameters (n, 10), rotor inertia (n,) and friction of x (14 n,)."""
    inertial = x[: _INERTIAL * num_joints].reshape(num_joints, _INERTIAL)
    rotor, coulomb, viscous, offset = x[_INERTIAL * num_joints :].reshape(num_joints, _JOINT).T
    return inertial.copy(), rotor.copy(), CoulombViscous(coulomb, viscous, offset)


def factorise(
    chain: SerialChain,
    q: Array,
    v: Array,
    vdot: Array,
    tau: Array,
    low_pass: Callable[[Array], Array],
    rows: NDArray[np.intp],
) -> TorqueFactors:
    """Reduces a log to its factors.

    Args:
        chain: kinematics and gravity; its inertias play no part.
        q: (T, n) rad, as v, vdot.
        v: (T, n).
        vdot: (T, n).
        tau: (T, n) N m, has been through `low_pass` already.
        low_pass: along time; goes over every column of the regressor.
        rows: indices of the samples to use, after the filter.
    """
    n = q.shape[1]
    Y = chain.regressor(q, v, vdot)
    factors = []
    for j in range(n):
        # A joint's torque depends on the links that it carries, those from j on: the other
        # columns are zero and need no filter.
        first, last = _INERTIAL * n + _JOINT * j, _INERTIAL * n + _JOINT * (j + 1)
        columns = np.r_[_INERTIAL * j : _INERTIAL * n, first:last, (_INERTIAL + _JOINT) * n]
        own = np.stack([vdot[:, j], np.sign(v[:, j]), v[:, j], np.ones(len(v))], axis=1)
        W = low_pass(np.hstack([Y[:, j, _INERTIAL * j :], own]))
        R = triangular_factor(np.hstack([W[rows], tau[rows, j : j + 1]]))
        embedded = np.zeros((R.shape[0], (_INERTIAL + _JOINT) * n + 1))
        embedded[:, columns] = R
        factors.append(embedded)
    return TorqueFactors(tuple(factors), len(rows))


def solve(
    factors: Sequence[TorqueFactors],
    base: BaseParameters,
    num_passes: int,
    oversampling: float = 1.0,
) -> TorqueEstimate:
    """Weighted least squares over several logs.

    Each joint's rows are divided by that joint's residual standard deviation of the pass before;
    the first pass weighs all alike.

    Args:
        factors: of one log or more.
        base: the parameters to solve for.
        num_passes: one or more.
        oversampling: rows per independent sample of the residual.
    """
    n = len(factors[0].R)
    b = len(base.names)
    # What the fit needs of a joint: [kept columns, torque] of all logs, reduced once more.
    stacked = [np.vstack([f.R[j] for f in factors]) for j in range(n)]
    joints = [triangular_factor(np.hstack([R[:, base.independent], R[:, -1:]])) for R in stacked]
    num_rows = sum(f.num_rows for f in factors)
    freedom = max(1.0, num_rows - b / n)
    torque = np.array([np.linalg.norm(R[:, -1]) for R in joints])
    floor = 1e-12 * torque.max()  # a noise-free log leaves no residual to weigh with
    length = np.maximum(np.linalg.norm(np.vstack(joints)[:, :-1], axis=0), 1e-300)
    deviation = np.ones(n)
    for _ in range(num_passes):
        A = np.vstack([R / sd for R, sd in zip(joints, deviation, strict=True)])
        values = np.linalg.lstsq(A[:, :-1] / length, A[:, -1], rcond=None)[0] / length
        residual = np.array([np.linalg.norm(R[:, -1] - R[:, :-1] @ values) for R in joints])
        deviation = np.maximum(residual, floor) / np.sqrt(freedom)
    A = np.vstack([R[:, :-1] / sd for R, sd in zip(joints, deviation, strict=True)]) / length
    # Moore-Penrose: without one log, a fit may lose a direction that all logs determine.
    variance = np.diag(np.linalg.pinv(A.T @ A)) * oversampling
    return TorqueEstimate(values, np.sqrt(variance) / length, deviation)


def realisation(robot: Robot, base: BaseParameters, values: Array) -> Array:
    """All 14 n parameters with the given base parameters, nearest to the robot's own files.

    Nearest in units of each link's size: its mass, that mass times half the arm's mean link length,
    and times its square. Friction starts from zero.
    """
    chain, n = robot.chain, robot.num_joints
    reach = np.linalg.norm(chain.p_PJ, axis=1).sum() + float(np.linalg.norm(chain.p_LE))
    size = max(0.5 * float(reach) / n, 0.01)
    mass = np.maximum(chain.inertial_parameters[:, 0], 0.0)
    mass = np.maximum(mass, 0.1 * max(float(mass.mean()), 1e-3))
    spread = np.empty((n, _INERTIAL))
    spread[:, 0] = mass
    spread[:, 1:4] = (mass * size)[:, None]
    spread[:, 4:] = (mass * size**2)[:, None]
    joint_spread = np.empty((n, _JOINT))
    joint_spread[:, 0] = np.maximum(chain.reflected_inertia, mass * size**2)
    joint_spread[:, 1:] = 0.01 * robot.effort_limit[:, None]
    joint_prior = np.zeros((n, _JOINT))
    joint_prior[:, 0] = chain.reflected_inertia
    return realise(
        base,
        values,
        np.concatenate([chain.inertial_parameters.ravel(), joint_prior.ravel()]),
        np.concatenate([spread.ravel(), joint_spread.ravel()]),
    )
