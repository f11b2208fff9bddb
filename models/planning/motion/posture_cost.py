"""The cost of a posture: a measure of how well it reads forces, with its gradient in closed form.

A measure, such as the condition number of the Jacobian, is what a placement or an optimised
redundancy makes small. It maps joint positions to one number, smaller is better, and to its
gradient. Both measures here are functions of the Jacobian; with G its gradient with respect to J,

    d/dq_j = sum_i G_i . dJ_i/dq_j,    dJ_i/dq_j = [w_j x w_i; w_j x v_i]  for j <= i
                                                   [0;         w_i x v_j]  for j >  i

where J_i = [w_i; v_i] is the column of joint i, at E in axes of W (a prismatic joint has w_i = 0).
"""

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.estimation.wrench import WrenchReconstruction, WrenchReconstructionConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array, Flags, contiguous
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.rigid_body.structural_rank import parallel_columns, structural_rank

_MAX_MEASURE = 1e12  # stands for infinity, where a solver needs a number


class PostureMeasure(Protocol):
    """The objective of an optimisation of postures.

    Attributes:
        key: of the measure in metrics, its unit included: "jcn" or "force_sd_n".
        label: for axes and tables, with the unit.
    """

    key: str
    label: str

    def values(self, q: ArrayLike) -> Array:
        """The measure (...) at q (..., n)."""

    def values_and_gradients(self, q: ArrayLike) -> tuple[Array, Array]:
        """The measure (...) and its gradient (..., n) at q (..., n)."""


class ConditionNumber:
    """The condition number of J in m and rad, which the article calls JCN.

    With sigma_1 u_1 v_1^T and sigma_6 u_6 v_6^T the first and last terms of the singular value
    decomposition of J, G = (u_1 v_1^T - JCN u_6 v_6^T) / sigma_6. Where two singular values meet
    at either end it has a kink, and this is one of its one-sided gradients. A good path leads right
    through such postures, and there a solver that follows gradients stops somewhere near the
    optimum; exactly where depends on its start. With p-norms in the place of the extremes,

        |s|_2p |1/s|_2p = (sum_i s_i^2p)^1/2p (sum_i s_i^-2p)^1/2p,

    there is no kink. That lies above the condition number by a factor of at most 6^(1/p); G is it
    times sum_i (w_i - c_i) / s_i u_i v_i^T, w_i = s_i^2p / sum s^2p, c_i = s_i^-2p / sum s^-2p.

    At a singular posture either is 1e12, with a gradient of zero.

    Args:
        chain: an arm of six joints or more.
        sharpness: p; without it the condition number itself.

    Raises:
        InputError: the arm has fewer than six joints.
        ValueError: a sharpness below 1.
    """

    key = "jcn"
    label = "condition number of J"

    def __init__(self, chain: SerialChain, sharpness: float | None = None) -> None:
        check_joints(chain)
        if sharpness is not None and not sharpness >= 1.0:
            raise ValueError(f"sharpness must be 1 or more, not {sharpness}")
        self._chain, self._sharpness = chain, sharpness

    def values(self, q: ArrayLike) -> Array:
        """The measure (...) at q (..., n)."""
        if self._sharpness is None:
            return np.minimum(self._chain.condition_number(q), _MAX_MEASURE)
        return self.values_and_gradients(q)[0]

    def values_and_gradients(self, q: ArrayLike) -> tuple[Array, Array]:
        """The measure (...) and its gradient (..., n) at q (..., n)."""
        J = _jacobians(self._chain, _rows(self._chain, q))
        U, sigma, Vt = np.linalg.svd(J, full_matrices=False)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            condition_number = sigma[:, 0] / sigma[:, -1]
            if self._sharpness is None:
                value, share = condition_number, np.array([1.0, 0.0, 0.0, 0.0, 0.0, -1.0])
            else:
                # The extremes are divided out first: their 1e5th powers would overflow.
                large = (sigma / sigma[:, :1]) ** (2.0 * self._sharpness)
                small = (sigma[:, -1:] / sigma) ** (2.0 * self._sharpness)
                sums = large.sum(axis=1) * small.sum(axis=1)
                value = condition_number * sums ** (0.5 / self._sharpness)
                share = large / large.sum(axis=1, keepdims=True)
                share = share - small / small.sum(axis=1, keepdims=True)
            G = U * (value[:, np.newaxis] * share / sigma)[:, np.newaxis] @ Vt
            gradient = gradient_by_q(J, G)
        return _measure(q, condition_number < _MAX_MEASURE, value, gradient)


class ForceSd:
    """Root trace of the force block of the wrench's stated covariance, N.

    It is the standard deviation of the force's error as a vector, for joint torques with errors of
    covariance Sigma_tau. With E the projection on the force,

        bayesian, force_only   Sigma_F = (J Sigma_tau^-1 J^T + P^-1)^-1
                               G of its trace = -2 Sigma_F E Sigma_F J Sigma_tau^-1
        inverse                Sigma_F = H Sigma_tau H^T, H = M J, M = (J J^T)^-1
                               G = -2 Sigma_F E H + 2 M E H Sigma_tau (1 - J^T M J)

    Args:
        chain: an arm of six or more joints.
        torque_covariance: (n, n) Sigma_tau, N^2 m^2: the residual of an identified model.
        config: method "bayesian" (with a prior), "force_only" or "inverse".

    Raises:
        InputError: another method, a missing prior, a covariance that is not positive definite.
    """

    key = "force_sd_n"
    label = "stated sd of the force [N]"

    def __init__(
        self,
        chain: SerialChain,
        torque_covariance: ArrayLike,
        config: WrenchReconstructionConfig | None = None,
    ) -> None:
        """Checks that the measure has a meaning for this arm and method; see the class."""
        check_joints(chain)
        config = WrenchReconstructionConfig() if config is None else config
        if config.method in ("damped", "truncated"):
            raise InputError(
                "force-sd",
                "method",
                f"{config.method} states a smaller sd the less it reads, and the best posture "
                "would be a singular one",
                "choose bayesian, force_only or inverse",
            )
        try:
            reconstruction = WrenchReconstruction(config, torque_covariance)
        except ValueError as error:
            raise InputError("force-sd", "", str(error)) from error
        if reconstruction.num_joints != chain.num_joints:
            raise InputError(
                "force-sd",
                "torque covariance",
                f"is of {reconstruction.num_joints} joints, the arm has {chain.num_joints}",
            )
        self._chain, self._reconstruction = chain, reconstruction
        # (n, n) Sigma_tau^-1 of the posterior; the plain inverse has a formula of its own.
        self._torque_precision = np.linalg.inv(reconstruction.torque_covariance)
        self._is_inverse = config.method == "inverse"

    def values(self, q: ArrayLike) -> Array:
        """The measure (...) at q (..., n), N."""
        return self.values_and_gradients(q)[0]

    def values_and_gradients(self, q: ArrayLike) -> tuple[Array, Array]:
        """The measure (...), N, and its gradient (..., n) at q (..., n)."""
        J = _jacobians(self._chain, _rows(self._chain, q))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            trace, G = self._inverse(J) if self._is_inverse else self._posterior(J)
            value = np.sqrt(trace)
            gradient = gradient_by_q(J, G) / (2.0 * value[:, np.newaxis])
        return _measure(q, value < _MAX_MEASURE, value, gradient)

    def _posterior(self, J: Array) -> tuple[Array, Array]:
        """Trace of the posterior's force block for J (N, 6, n), (N,) N^2, and its G (N, 6, n)."""
        no_rows = np.empty((0, *J.shape[1:]))
        torque = np.zeros((len(J), J.shape[2]))
        Sigma_F = self._reconstruction.reconstruct(J, torque, J_now=no_rows).covariance
        G = -2.0 * Sigma_F[:, :, 3:] @ (Sigma_F[:, 3:] @ J @ self._torque_precision)
        return np.trace(Sigma_F[:, 3:, 3:], axis1=1, axis2=2), G

    def _inverse(self, J: Array) -> tuple[Array, Array]:
        """Trace of the plain inverse's force block for J (N, 6, n), (N,) N^2, and its G."""
        U, sigma, Vt = np.linalg.svd(J, full_matrices=False)
        UT, V = np.swapaxes(U, 1, 2), np.swapaxes(Vt, 1, 2)
        H = U / sigma[:, np.newaxis] @ Vt
        M = U / sigma[:, np.newaxis] ** 2 @ UT
        noise = H @ self._reconstruction.torque_covariance
        Sigma_F = noise @ np.swapaxes(H, 1, 2)
        off_rows = noise - noise @ V @ Vt  # H Sigma_tau (1 - J^T M J)
        G = 2.0 * (M[:, :, 3:] @ off_rows[:, 3:] - Sigma_F[:, :, 3:] @ H[:, 3:])
        return np.trace(Sigma_F[:, 3:, 3:], axis1=1, axis2=2), G


def smoothed(chain: SerialChain, measure: PostureMeasure, sharpness: float) -> PostureMeasure:
    """A measure with a gradient everywhere, near the one that may have kinks."""
    return ConditionNumber(chain, sharpness) if isinstance(measure, ConditionNumber) else measure


def check_joints(chain: SerialChain, name: str = "robot") -> None:
    """Checks that the joints of an arm can move the tool in all six directions.

    Raises:
        InputError: fewer than six joints, or fewer than six directions in every posture, as with
            two parallel columns; the line names the arm by `name`.
    """
    if chain.num_joints < 6:
        raise InputError(
            name,
            "",
            f"{chain.num_joints} joints cannot hold position and orientation of the tool",
            "an arm of six joints or more is needed",
        )
    rank = structural_rank(chain)
    if rank < 6:
        parallel_joints = parallel_columns(chain)
        reason = f": {' and '.join(parallel_joints)} push along one line" if parallel_joints else ""
        remedy = "check the axes of its joints"
        if parallel_joints:
            remedy = f"name {parallel_joints[0]} under locked_joints, or take another tool frame"
        raise InputError(
            name,
            "",
            f"its {chain.num_joints} joints move the tool in {rank} of six directions in every "
            f"posture{reason}; the condition number is infinite everywhere",
            remedy,
        )


def gradient_by_q(J: Array, G: Array) -> Array:
    """Gradient (N, n) by q of a function of J, from J and its gradient G with respect to J.

    Args:
        J, G: (N, 6, n).
    """
    J, G = contiguous(J, G)
    gradient = np.empty((J.shape[0], J.shape[2]))
    gradient_rows(J, G, gradient)
    return gradient


@kernel
def gradient_rows(J: Array, G: Array, gradient: Array) -> None:
    """Writes `gradient_by_q` of N postures.

    A search of a placement asks for it thousands of times, of a path's postures each; numpy's cross
    products take most of the time of a cost there (`tests/benchmarks/bench_small_matrices.py`).

    Args:
        J, G: (N, 6, n).
        gradient: (N, n), written.
    """
    n = J.shape[2]
    sum_from_j_on = np.empty((3, n))
    for k in range(J.shape[0]):
        w, v, a, b = J[k, :3], J[k, 3:], G[k, :3], G[k, 3:]
        # a.(w_j x w) + b.(w_j x v) = w_j.(w x a + v x b), and b.(w x v_j) = v_j.(b x w).
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            total = 0.0
            for j in range(n - 1, -1, -1):
                total += (w[y, j] * a[z, j] - w[z, j] * a[y, j]) + (
                    v[y, j] * b[z, j] - v[z, j] * b[y, j]
                )
                sum_from_j_on[x, j] = total
        for j in range(n):
            gradient[k, j] = 0.0
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            total = 0.0
            for j in range(n):
                of_j = b[y, j] * w[z, j] - b[z, j] * w[y, j]
                total += of_j
                gradient[k, j] += w[x, j] * sum_from_j_on[x, j] + v[x, j] * (total - of_j)


def _rows(chain: SerialChain, q: ArrayLike) -> Array:
    """Positions (..., n) as (N, n)."""
    array = np.asarray(q, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != chain.num_joints:
        raise ValueError(f"expected q of shape (..., {chain.num_joints}), got {array.shape}")
    return array.reshape(-1, chain.num_joints)


def _jacobians(chain: SerialChain, q: Array) -> Array:
    """J (N, 6, n) at q (N, n); zero where q is not finite."""
    J = chain.jacobian(q)
    return np.where(np.isfinite(J).all(axis=(1, 2), keepdims=True), J, 0.0)


def _measure(
    q: ArrayLike, is_readable: Flags, value: Array, gradient: Array
) -> tuple[Array, Array]:
    """Values (...) and gradients (..., n) at q (..., n); elsewhere 1e12 and zero.

    Args:
        is_readable: (N,) where the measure is a number.
        value, gradient: (N,), (N, n).
    """
    shape = np.shape(q)
    values = np.where(is_readable, value, _MAX_MEASURE).reshape(shape[:-1])
    return values, np.where(is_readable[:, np.newaxis], gradient, 0.0).reshape(shape)
