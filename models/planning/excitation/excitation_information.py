"""The information of a motion about an arm's parameters, and its gradient by the motion.

The torque is linear in the base parameters, weight * tau = W x
(`models.identification.torque_regression`), each joint's rows weighted with one over the size of
its torque error. Two measures of W:

    condition_number   ln cond(W D^-1), D the lengths of its columns
    log_det            -ln det(W^T W) / (2 b), b columns

The condition number is the ratio of the extreme singular values, which has a kink wherever two of
them meet. Minimised is a smooth bound above it,

    1/(2 p) ln sum_i lambda_i^p + 1/(2 p) ln sum_i lambda_i^-p   >=   ln cond,

lambda the eigenvalues of D^-1 W^T W D^-1.

Gradients are exact but for differences of q: with Lambda the gradient by the entries of the
regressor Y(q, v, vdot), the sum Lambda * Y of one sample is a scalar function of 3 n numbers,
quadratic in v and affine in vdot, so that central differences of any step are exact there. It costs
6 n evaluations of Y a sample, one microsecond each, instead of a regressor per coefficient.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wrenchsight.models.identification.base_parameters import BaseParameters, find_base_parameters
from wrenchsight.models.identification.torque_regression import (
    JOINT_NAMES,
    NUM_INERTIAL,
    parameter_names,
)
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.rigid_body.serial_chain import SerialChain

Measure = Literal["condition_number", "log_det"]
MEASURES: tuple[Measure, ...] = get_args(Measure)

# p of the smooth bound: at most 60^(1/12), a factor of 1.4, above the condition number
_BOUND_POWER = 12.0
# Least length of a column of W and least eigenvalue, where a motion leaves something undetermined.
_MIN_LENGTH, _MIN_EIGENVALUE = 1e-12, 1e-13
# rad, of the differences of q: cut-off and rounding both below 1e-8 of the gradient
_DIFFERENCE_STEP = 1e-4


class _JointColumns(NamedTuple):
    """Columns (n,) of the joints' own parameters among the 14 n of the regressor.

    Attributes:
        rotor, coulomb, viscous, offset: of each joint, whose torque they multiply by its
            acceleration, the sign of its speed, its speed, and 1.
    """

    rotor: NDArray[np.intp]
    coulomb: NDArray[np.intp]
    viscous: NDArray[np.intp]
    offset: NDArray[np.intp]


def _joint_columns(num_joints: int) -> _JointColumns:
    """The columns of n joints: behind the ten parameters of each link, joint after joint."""
    first = NUM_INERTIAL * num_joints + len(JOINT_NAMES) * np.arange(num_joints)
    return _JointColumns(**{name: first + k for k, name in enumerate(JOINT_NAMES)})


@dataclass(frozen=True, eq=False)
class ExcitationInformation:
    """The regression of torque on parameters over a motion, as a measure of the motion.

    Attributes:
        chain: kinematics and gravity.
        weight: (n,) 1/(N m), of each joint's rows.
        columns: (b,) of the 14 n parameters of `models.identification.torque_regression`: a set
            that determines the base parameters of a general motion.
        names: (b,) of the base parameters.
        friction_velocity: rad/s; sgn(v) enters as tanh(v / friction_velocity), which has a
            gradient. Zero for sgn itself.
    """

    chain: SerialChain
    weight: Array
    columns: NDArray[np.intp]
    names: tuple[str, ...]
    friction_velocity: float

    @classmethod
    def of_chain(
        cls, chain: SerialChain, weight: ArrayLike, friction_velocity: float = 0.02
    ) -> "ExcitationInformation":
        """Finds the parameters that a general motion of the chain determines."""
        n = chain.num_joints
        rng = np.random.default_rng(0)  # any motion in general position has the same rank
        q = rng.uniform(-2.0, 2.0, (400, n))
        v = rng.uniform(-2.0, 2.0, (400, n))
        vdot = rng.uniform(-2.0, 2.0, (400, n))
        measure = cls(chain, np.asarray(weight, float), np.arange(14 * n), (), 0.0)
        base = measure.base_parameters(q, v, vdot)
        return cls(chain, measure.weight, base.independent, base.names, friction_velocity)

    def regressor(self, q: Array, v: Array, vdot: Array) -> Array:
        """Weighted regressor (N n, 14 n) of all parameters at N samples."""
        n = self.chain.num_joints
        W = np.zeros((len(q), n, 14 * n))
        W[:, :, : NUM_INERTIAL * n] = self.chain.regressor(q, v, vdot)
        sign = np.tanh(v / self.friction_velocity) if self.friction_velocity > 0 else np.sign(v)
        joint, at = np.arange(n), _joint_columns(n)
        W[:, joint, at.rotor], W[:, joint, at.coulomb] = vdot, sign
        W[:, joint, at.viscous], W[:, joint, at.offset] = v, 1.0
        W *= self.weight[:, None]
        return W.reshape(-1, 14 * n)

    def base_parameters(self, q: Array, v: Array, vdot: Array) -> BaseParameters:
        """The parameters that this motion determines, as `identify` will find them."""
        return find_base_parameters(
            self.regressor(q, v, vdot), parameter_names(self.chain.joint_names)
        )

    def undetermined(self, q: Array, v: Array, vdot: Array, tolerance: float = 1e-5) -> list[str]:
        """Names of the base parameters that this motion does not determine."""
        W = self.regressor(q, v, vdot)[:, self.columns]
        determined = find_base_parameters(W, self.names, tolerance)
        missing = np.setdiff1d(np.arange(len(self.columns)), determined.independent)
        return [self.names[i] for i in missing]

    def condition_number(self, q: Array, v: Array, vdot: Array) -> float:
        """Condition number of the base parameters' columns, scaled to length 1; inf if one is 0."""
        W = self.regressor(q, v, vdot)[:, self.columns]
        length = np.linalg.norm(W, axis=0)
        if not (length > 0.0).all():
            return float("inf")
        singular = np.linalg.svd(W / length, compute_uv=False)
        return float(singular[0] / singular[-1]) if singular[-1] > 0.0 else float("inf")

    def cost(
        self, measure: Measure, q: Array, v: Array, vdot: Array
    ) -> tuple[float, Array, Array, Array]:
        """The measure to minimise, and its gradients (N, n) by q, v and vdot (N, n).

        In the two measures (see the module's docstring) W are the columns of the weighted regressor
        (N n, 14 n) that determine the base parameters, A = W D^-1 the same scaled to length 1, and
        lambda, V the eigenvalues and eigenvectors of A^T A. `by_X` is the gradient by X. A motion
        that leaves something undetermined has a large cost, not an infinite one: lengths and
        eigenvalues are bounded below. The gradient is that without the bounds, so that it leads
        away from such a motion.
        """
        n, b = self.chain.num_joints, len(self.columns)
        W = self.regressor(q, v, vdot)[:, self.columns]
        lengths = np.maximum(np.linalg.norm(W, axis=0), _MIN_LENGTH)
        A = W / lengths
        gram = A.T @ A
        eigenvalues, V = np.linalg.eigh(gram)
        eigenvalues = np.maximum(eigenvalues, _MIN_EIGENVALUE)
        if measure == "condition_number":
            largest, by_largest = _log_sum(eigenvalues, _BOUND_POWER)
            smallest, by_smallest = _log_sum(eigenvalues, -_BOUND_POWER)
            value = 0.5 * (largest + smallest)  # bound above ln cond(A)
            by_eigenvalue = 0.5 * (by_largest - by_smallest)
            by_A = 2.0 * A @ ((V * by_eigenvalue) @ V.T)
            # A column of unit length changes only across itself.
            by_W = (by_A - A * (A * by_A).sum(axis=0)) / lengths
        else:
            value = -float(0.5 * np.log(eigenvalues).sum() + np.log(lengths).sum()) / b
            # -W (W^T W)^-1 / b, with (W^T W)^-1 = D^-1 V lambda^-1 V^T D^-1.
            by_W = -(A @ ((V / eigenvalues) @ V.T)) / lengths / b
        by_regressor = np.zeros((len(q), n, 14 * n))  # by the regressor without the weights
        by_regressor.reshape(-1, 14 * n)[:, self.columns] = by_W
        by_regressor *= self.weight[:, None]  # joint by joint, as `regressor` does
        by_q, by_v, by_vdot = self._pull_back(by_regressor, q, v, vdot)
        return float(value), by_q, by_v, by_vdot

    def _pull_back(
        self, weights: Array, q: Array, v: Array, vdot: Array
    ) -> tuple[Array, Array, Array]:
        n = self.chain.num_joints
        of_links = weights[:, :, : NUM_INERTIAL * n]
        by_q, by_v, by_vdot = regressor_pull_back(self.chain, of_links, q, v, vdot)
        joint, at = np.arange(n), _joint_columns(n)
        by_vdot += weights[:, joint, at.rotor]
        by_v += weights[:, joint, at.viscous]
        if self.friction_velocity > 0.0:
            steep = (1.0 - np.tanh(v / self.friction_velocity) ** 2) / self.friction_velocity
            by_v += weights[:, joint, at.coulomb] * steep
        return by_q, by_v, by_vdot


def regressor_pull_back(
    chain: SerialChain, weights: Array, q: Array, v: Array, vdot: Array
) -> tuple[Array, Array, Array]:
    """Gradients (N, n) by q, v and vdot of the sum over weights (N, n, 10 n) * chain.regressor."""
    n = chain.num_joints
    steps = [_DIFFERENCE_STEP] * n + [1.0] * (2 * n)
    stacked = np.concatenate([q, v, vdot], axis=1)  # (N, 3 n)
    shift = np.diag(steps)
    shifted = np.concatenate([stacked[:, None] + shift, stacked[:, None] - shift], axis=1)
    rows = shifted.reshape(-1, 3 * n)
    Y = chain.regressor(rows[:, :n].copy(), rows[:, n : 2 * n].copy(), rows[:, 2 * n :].copy())
    values = np.einsum("kmp,kp->km", Y.reshape(len(q), 6 * n, -1), weights.reshape(len(q), -1))
    gradient = (values[:, : 3 * n] - values[:, 3 * n :]) / (2.0 * np.array(steps))
    return gradient[:, :n].copy(), gradient[:, n : 2 * n].copy(), gradient[:, 2 * n :].copy()


def _log_sum(x: Array, power: float) -> tuple[float, Array]:
    """1/|p| ln sum x^p, and |its gradient|."""
    y = power * np.log(x)
    top = float(y.max())
    share = np.exp(y - top)
    total = float(share.sum())
    return (top + float(np.log(total))) / abs(power), share / (total * x)
