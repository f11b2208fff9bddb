"""Joint torque as a linear function of a robot's parameters, and its least squares.

    tau = Y(q, v, vdot) pi + diag(vdot) rotor + diag(sgn v) coulomb + diag(v) viscous + offset

With n joints there are 14 n parameters x. First come ten inertial ones per moving link (order of
`SerialChain.inertial_parameters`), then rotor inertia, Coulomb, viscous and offset for each joint.
Other friction laws put other terms in the place of the last three
(`wrenchsight.models.friction.friction_structure`).

If motors move several joints, all of this is written for the motors. Row k is then C^T times the
joints' rows. Rotor inertia and friction are those of motor k at its own speed
(`wrenchsight.models.robot.coupling`).

A log enters as one triangular factor per joint, R^T R = [W tau]^T [W tau]. Everything after (rank,
weighting passes, fits that leave logs out, residual norms) works on these small matrices.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lstsq, pinvh

from wrenchsight.models.identification.base_parameters import (
    BaseParameters,
    realise,
    triangular_factor,
)
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot
from wrenchsight.models.robot.rotational_inertia import INERTIA, MOMENT

INERTIAL_NAMES = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
JOINT_NAMES = ("rotor", "coulomb", "viscous", "offset")
NUM_INERTIAL, _JOINT = len(INERTIAL_NAMES), len(JOINT_NAMES)
_MIN_RESIDUAL_SHARE = 1e-12  # of the torque's norm: a log without noise leaves nothing to weigh by
_LEAST_LENGTH = 1e-300  # of a column of zeros, for a division
# Prior of what a robot's file does not state.
_LEAST_HALF_LENGTH = 0.01  # m, of a link
_LEAST_MEAN_MASS = 1e-3  # kg, of the links
# kg/m^2, moving mass over the square of the stretched arm's length, of an arm that states no mass:
# Panda 9, UR10e 10, UR5e 12, LR Mate 27, KR210 80
_MASS_PER_LENGTH = 20.0
_LIGHT_LINK_SHARE = 0.1  # of the links' mean mass, for one without a mass
_FRICTION_SHARE = 0.01  # of the effort limit: sd of each friction coefficient


@dataclass(frozen=True, eq=False)
class TorqueFactors:
    """One log's regression.

    Attributes:
        R: n matrices, one a joint, of at most p + 1 rows and of p + 1 columns, as
            `parameter_columns` names them: p parameters, and the torque last.
        num_rows: rows of the log behind each.
    """

    R: tuple[Array, ...]
    num_rows: int

    @property
    def regressor(self) -> Array:
        """All joints' factors without the torque, stacked; it determines the rank."""
        return np.vstack([R[:, :-1] for R in self.R])


def joined_factors(parts: Sequence[TorqueFactors]) -> TorqueFactors:
    """Joins the regressions of several logs into one."""
    if len(parts) == 1:
        return parts[0]
    stacked = (np.vstack(factors) for factors in zip(*(part.R for part in parts), strict=True))
    return TorqueFactors(
        tuple(triangular_factor(R) for R in stacked), sum(part.num_rows for part in parts)
    )


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


def parameter_names(
    joint_names: Sequence[str], terms: Sequence[Sequence[str]] | None = None
) -> list[str]:
    """Names of all parameters; a link goes by the name of the joint that moves it.

    Args:
        joint_names: joint names of the n joints.
        terms: friction terms per joint; None: Coulomb, viscous and offset.
    """
    terms_of_joints = [JOINT_NAMES[1:]] * len(joint_names) if terms is None else terms
    return [f"{name}[{joint}]" for joint in joint_names for name in INERTIAL_NAMES] + [
        f"{name}[{joint}]"
        for joint, friction in zip(joint_names, terms_of_joints, strict=True)
        for name in (JOINT_NAMES[0], *friction)
    ]


class ParameterColumns(NamedTuple):
    """Where each parameter stands: its column of the regressor, and its place in x.

    Attributes:
        inertial: (n, 10) of each link, in the order of INERTIAL_NAMES.
        rotor: (n,) of each joint (motor).
        friction: of each joint (motor), in the order of its terms.
        torque: column of the measured torque, behind all p parameters: p.
    """

    inertial: NDArray[np.intp]
    rotor: NDArray[np.intp]
    friction: list[NDArray[np.intp]]
    torque: int


def parameter_columns(counts: Sequence[int]) -> ParameterColumns:
    """The order of all parameters, for `counts` friction terms per joint.

    The inertial ones come first, ten a link; then joint by joint its rotor inertia and friction.
    """
    n = len(counts)
    ends = NUM_INERTIAL * n + np.cumsum([1 + count for count in counts])
    starts = ends - [1 + count for count in counts]
    return ParameterColumns(
        inertial=np.arange(NUM_INERTIAL * n).reshape(n, NUM_INERTIAL),
        rotor=starts,
        friction=[np.arange(start + 1, end) for start, end in zip(starts, ends, strict=True)],
        torque=int(ends[-1]),
    )


class ArmParameters(NamedTuple):
    """The parameters of an arm, apart.

    Attributes:
        inertial: (n, 10) of each link, in the order of INERTIAL_NAMES.
        rotor: (n,) inertia of each joint's rotor.
        friction: coefficients of each joint.
    """

    inertial: Array
    rotor: Array
    friction: list[Array]


def split_terms(x: Array, counts: Sequence[int]) -> ArmParameters:
    """Returns the parameters x apart, for `counts` friction terms per joint."""
    columns = parameter_columns(counts)
    return ArmParameters(
        inertial=x[columns.inertial],
        rotor=x[columns.rotor],
        friction=[x[terms] for terms in columns.friction],
    )


class JointMotion(NamedTuple):
    """The motion of a log, filtered: (T, n) rad, rad/s, rad/s^2 (m for prismatic joints)."""

    q: Array
    v: Array
    vdot: Array


@dataclass(frozen=True, eq=False)
class RegressionRows:
    """One log's rows of the regression, before friction.

    Attributes:
        rigid: per joint (motor) (m, 10 (n - j) + 1): inertial columns of the links from j on, that
            the joint (motor) carries, then its rotor inertia, through the low-pass. (A joint's
            torque depends on no other.)
        tau: (m, n) N m, of the joints (motors).
        low_pass: along time; friction columns go through it too.
        rows: (m,) samples of the log that are used, after the filter.
    """

    rigid: tuple[Array, ...]
    tau: Array
    low_pass: Callable[[Array], Array]
    rows: NDArray[np.intp]

    @classmethod
    def of(
        cls,
        chain: SerialChain,
        motion: JointMotion,
        tau: Array,
        low_pass: Callable[[Array], Array],
        rows: NDArray[np.intp],
    ) -> "RegressionRows":
        """Builds the rows; arguments as `factorise`, all of the joints."""
        vdot = motion.vdot
        n = vdot.shape[1]
        Y = chain.regressor(motion.q, motion.v, vdot)
        first_links = list(range(n))
        if chain.motor_rates.size:
            C = np.linalg.inv(chain.motor_rates)
            Y = np.einsum("jk,tjp->tkp", C, Y)
            tau, vdot = tau @ C, vdot @ chain.motor_rates.T
            first_links = [int(np.flatnonzero(column)[0]) for column in C.T]
        rigid = tuple(
            low_pass(np.hstack([Y[:, k, NUM_INERTIAL * j :], vdot[:, k : k + 1]]))[rows]
            for k, j in enumerate(first_links)
        )
        return cls(rigid, tau[rows], low_pass, rows)

    @property
    def _first_links(self) -> list[int]:
        """Of each joint's (motor's) rows, the first link that they depend on."""
        return [self.tau.shape[1] - W.shape[1] // NUM_INERTIAL for W in self.rigid]

    @cached_property
    def _orthogonal(self) -> list[tuple[Array, Array]]:
        """Q and R of each joint's rigid part, which `factors` need for any friction."""
        return [np.linalg.qr(W) for W in self.rigid]

    def friction_rows(self, friction: Sequence[Array]) -> list[Array]:
        """Friction columns (N, k_j) of the whole log, low-passed, at the rows that are used."""
        return [self.low_pass(columns)[self.rows] for columns in friction]

    def factors(
        self,
        friction: Sequence[Array],
        part: slice = slice(None),
        weights: Array | None = None,
    ) -> "TorqueFactors":
        """Reduces the rows to their factors: of each joint R (rows, p + 1) of the least squares.

        Columns are those of `parameter_columns`. A joint feels only the links from its first on:
        their columns and its own are filled in, all others are zero.

        Args:
            friction: (m, terms) of each joint, of `friction_rows`; its rotor's column is the last
                of the rigid part.
            part: which of the rows.
            weights: (m, n) of the squared residuals, None for one.
        """
        layout = parameter_columns([terms.shape[1] for terms in friction])
        takes_all_rows = part == slice(None) and weights is None
        factors = []
        for j, first_link in enumerate(self._first_links):
            other_columns = np.hstack([friction[j], self.tau[:, j : j + 1]])
            if takes_all_rows:
                R = self._factor_of_all_rows(j, other_columns)
            else:
                W = np.hstack([self.rigid[j], other_columns])[part]
                if weights is not None:
                    W = W * np.sqrt(weights[part, j : j + 1])
                R = triangular_factor(W)
            # Where the columns of W, and so of R, stand among all.
            felt_links = layout.inertial[first_link:].ravel()
            columns = np.r_[felt_links, layout.rotor[j], layout.friction[j], layout.torque]
            embedded = np.zeros((R.shape[0], layout.torque + 1))
            embedded[:, columns] = R
            factors.append(embedded)
        return TorqueFactors(tuple(factors), len(self.tau[part]))

    def _factor_of_all_rows(self, j: int, other_columns: Array) -> Array:
        """The triangular factor of joint j's rigid part and other columns behind it.

        The rigid part is factorised already; only the few other columns are new.
        """
        Q, upper = self._orthogonal[j]
        projection = Q.T @ other_columns
        lower = triangular_factor(other_columns - Q @ projection)
        return np.block([[upper, projection], [np.zeros((len(lower), upper.shape[1])), lower]])

    def residual(self, friction: Sequence[Array], x: Array) -> Array:
        """Measured minus predicted torque (m, n) for all parameters x."""
        inertial, rotor, coefficients = split_terms(x, [f.shape[1] for f in friction])
        predicted = [
            self.rigid[j] @ np.r_[inertial[first_link:].ravel(), rotor[j]]
            + friction[j] @ coefficients[j]
            for j, first_link in enumerate(self._first_links)
        ]
        return np.asarray(self.tau - np.stack(predicted, axis=1))


def factorise(
    chain: SerialChain,
    motion: JointMotion,
    tau: Array,
    low_pass: Callable[[Array], Array],
    rows: NDArray[np.intp],
) -> TorqueFactors:
    """Reduces a log to its factors, with Coulomb-viscous friction and offset.

    Args:
        chain: kinematics and gravity; its inertias play no part.
        motion: motion of T samples.
        tau: (T, n) N m, has been through `low_pass` already.
        low_pass: along time; goes over every column of the regressor.
        rows: indices of the samples to use, after the filter.
    """
    regression = RegressionRows.of(chain, motion, tau, low_pass, rows)
    friction = [np.stack([np.sign(v), v, np.ones(len(v))], axis=1) for v in motion.v.T]
    return regression.factors(regression.friction_rows(friction))


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
        factors: factors of one log or more.
        base: the parameters to solve for.
        num_passes: one or more.
        oversampling: rows per independent sample of the residual.
    """
    fit = _weighted(factors, base.independent, num_passes)
    rows = [R[:, :-1] / sd for R, sd in zip(fit.joints, fit.residual_sd, strict=True)]
    A = np.vstack(rows) / fit.length
    # Moore-Penrose: without one log, a fit may lose a direction that all logs determine.
    variance = np.diag(pinvh(A.T @ A)) * oversampling
    return TorqueEstimate(fit.values, np.sqrt(variance) / fit.length, fit.residual_sd)


def solve_values(
    factors: Sequence[TorqueFactors], independent: NDArray[np.intp], num_passes: int
) -> Array:
    """Returns `solve`'s values (b,) alone, of the columns `independent`."""
    return _weighted(factors, independent, num_passes).values


class _WeightedFit(NamedTuple):
    """Weighted least squares of b parameters.

    Attributes:
        values: (b,).
        residual_sd: (n,) N m.
        joints: each joint's reduced rows, b columns and the torque.
        length: (b,) of the columns over all joints.
    """

    values: Array
    residual_sd: Array
    joints: list[Array]
    length: Array


def _weighted(
    factors: Sequence[TorqueFactors], independent: NDArray[np.intp], num_passes: int
) -> _WeightedFit:
    """Solves for the columns `independent` by least squares, each joint's rows over their sd.

    The sds are those of the joints' residuals, found in turns with the solution; in the first turn
    all are one.

    Args:
        factors: of each log, of each joint a triangular factor R (rows, p + 1), the torque last.
        independent: (b,) columns of the p parameters.
        num_passes: turns, one or more.
    """
    n = len(factors[0].R)
    b = len(independent)
    # Per joint, [independent columns, torque] of all logs, reduced once more.
    stacked = [np.vstack([f.R[j] for f in factors]) for j in range(n)]
    joints = [triangular_factor(np.hstack([R[:, independent], R[:, -1:]])) for R in stacked]
    # Rows of a joint, less its share of the parameters.
    freedom = max(1.0, sum(f.num_rows for f in factors) - b / n)
    torque = np.array([np.linalg.norm(R[:, -1]) for R in joints])
    floor = _MIN_RESIDUAL_SHARE * torque.max()
    length = np.maximum(np.linalg.norm(np.vstack(joints)[:, :-1], axis=0), _LEAST_LENGTH)
    residual_sd = np.ones(n)
    for _ in range(num_passes):
        A = np.vstack([R / sd for R, sd in zip(joints, residual_sd, strict=True)])
        # By pivoted QR, which takes a fixed number of steps: the iteration of an SVD failed to
        # converge once, on finite rows that other runs solved.
        scaled = A[:, :-1] / length
        cond = np.finfo(float).eps * max(scaled.shape)
        values = lstsq(scaled, A[:, -1], cond=cond, lapack_driver="gelsy")[0] / length
        residual = np.array([np.linalg.norm(R[:, -1] - R[:, :-1] @ values) for R in joints])
        residual_sd = np.maximum(residual, floor) / np.sqrt(freedom)
    return _WeightedFit(values=values, residual_sd=residual_sd, joints=joints, length=length)


def realisation(
    robot: Robot, base: BaseParameters, values: Array, counts: Sequence[int] | None = None
) -> Array:
    """All parameters with the given base parameters, nearest to the robot's own files.

    Nearest in units of each link's size: its mass, that mass times half the arm's mean link length,
    and times its square. Friction starts from zero.
    """
    prior, spread = parameter_prior(robot, counts)
    return realise(base, values, prior, spread)


def parameter_prior(robot: Robot, counts: Sequence[int] | None = None) -> tuple[Array, Array]:
    """Prior of all parameters: the values in the robot's files, and their plausible errors (sds).

    A link's error is as large as the link itself: its mass m, m times its size, m times its size
    squared; its size is half of a link's mean length. Of an arm that states no mass at all, it is
    as large as a link of an arm of that length. A rotor's is as large as the rotor, or as a
    link of that size. Friction has the prior zero, and a hundredth of the joint's effort limit for
    its error.

    Args:
        robot: the robot.
        counts: friction terms per joint; None: three each.

    Returns:
        Values and sds, in the order of the regressor: ten inertial parameters a link, link by link;
        then joint by joint the rotor's inertia and the friction terms.
    """
    chain, n = robot.chain, robot.num_joints
    reach = np.linalg.norm(chain.p_PJ, axis=1).sum() + float(np.linalg.norm(chain.p_LE))
    half_length = max(0.5 * float(reach) / n, _LEAST_HALF_LENGTH)  # m
    stated_mass = np.maximum(chain.inertial_parameters[:, 0], 0.0)
    likely_mass = 0.0 if stated_mass.any() else _MASS_PER_LENGTH * float(reach) ** 2 / n
    mean_mass = max(float(stated_mass.mean()), likely_mass, _LEAST_MEAN_MASS)
    light_link_share = _LIGHT_LINK_SHARE if stated_mass.any() else 1.0
    mass = np.maximum(stated_mass, light_link_share * mean_mass)
    spread = np.empty((n, NUM_INERTIAL))  # columns: mass, m c (3), inertia (6)
    spread[:, 0] = mass
    spread[:, MOMENT] = (mass * half_length)[:, None]
    spread[:, INERTIA] = (mass * half_length**2)[:, None]
    drive_prior: list[Array] = []
    drive_spread: list[Array] = []
    rotor_spread = np.maximum(chain.reflected_inertia, mass * half_length**2)
    num_friction = [_JOINT - 1] * n if counts is None else counts  # a joint's first is its rotor
    for j, count in enumerate(num_friction):
        drive_prior.append(np.r_[chain.reflected_inertia[j], np.zeros(count)])
        friction_sd = _FRICTION_SHARE * robot.effort_limit[j]
        drive_spread.append(np.r_[rotor_spread[j], np.full(count, friction_sd)])
    return (
        np.concatenate([chain.inertial_parameters.ravel(), *drive_prior]),
        np.concatenate([spread.ravel(), *drive_spread]),
    )
