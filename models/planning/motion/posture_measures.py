"""Measures of how well a posture reads forces, with gradients in closed form.

A measure maps joint positions to one number, smaller is better, and to its gradient. Both measures
here are functions of the Jacobian; with G its gradient with respect to J,

    d/dq_j = sum_i G_i . dJ_i/dq_j,    dJ_i/dq_j = [w_j x w_i; w_j x v_i]  for j <= i
                                                   [0;         w_i x v_j]  for j >  i

where J_i = [w_i; v_i] is the column of joint i, at E in axes of W (a prismatic joint has w_i = 0).
"""

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.estimation.wrench import WrenchReconstruction, WrenchReconstructionConfig
from wrenchsight.models.estimation.wrench_kernels import NUM_QUALITY, reconstruct
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.row_blocks import in_row_blocks
from wrenchsight.models.numerics.small_matrices import orthogonalise_rows
from wrenchsight.models.rigid_body.chain_kernels import SCRATCH_COLUMNS, pose_and_jacobian
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.rigid_body.structural_rank import parallel_columns, structural_rank

# Starting threads costs more than a path's postures.
_BLOCK_POSTURES = 128  # postures that are worth a thread: a millisecond
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
        table, sharpness = self._chain.table, self._sharpness

        def run(rows: Array, values: Array, gradients: Array) -> None:
            if sharpness is None:
                _condition_number_rows(table, rows, values, gradients)
            else:
                _smooth_rows(table, float(sharpness), rows, values, gradients)

        return _of_rows(self._chain, q, run)


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
        self._chain = chain
        self._reading = _Reading(
            settings=reconstruction.table,
            covariance_tau=reconstruction.torque_covariance,
            precision_tau=np.linalg.inv(reconstruction.torque_covariance),
            is_inverse=config.method == "inverse",
            work=reconstruction.scratch(),
        )

    def values(self, q: ArrayLike) -> Array:
        """The measure (...) at q (..., n), N."""
        return self.values_and_gradients(q)[0]

    def values_and_gradients(self, q: ArrayLike) -> tuple[Array, Array]:
        """The measure (...), N, and its gradient (..., n) at q (..., n)."""

        def run(rows: Array, values: Array, gradients: Array) -> None:
            _force_sd_rows(self._chain.table, self._reading, rows, values, gradients)

        return _of_rows(self._chain, q, run)


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


def _of_rows(
    chain: SerialChain, q: ArrayLike, run: Callable[[Array, Array, Array], None]
) -> tuple[Array, Array]:
    """Values (...) and gradients (..., n) that `run` writes for blocks of rows of q (..., n)."""
    array = np.asarray(q, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != chain.num_joints:
        raise ValueError(f"expected q of shape (..., {chain.num_joints}), got {array.shape}")
    rows = np.ascontiguousarray(array).reshape(-1, chain.num_joints)
    values, gradients = np.empty(len(rows)), np.empty(rows.shape)
    in_row_blocks(
        lambda part: run(rows[part], values[part], gradients[part]), len(rows), _BLOCK_POSTURES
    )
    return values.reshape(array.shape[:-1]), gradients.reshape(array.shape)


@kernel
def contract(J: Array, G: Array, gradient: Array) -> None:
    """Writes gradient_j = sum_i G_i . dJ_i/dq_j; J and G (6, n)."""
    n = J.shape[1]
    for j in range(n):
        gradient[j] = 0.0
    for i in range(n):
        wx, wy, wz, vx, vy, vz = J[0, i], J[1, i], J[2, i], J[3, i], J[4, i], J[5, i]
        ax, ay, az, bx, by, bz = G[0, i], G[1, i], G[2, i], G[3, i], G[4, i], G[5, i]
        # a.(w_j x w) + b.(w_j x v) = w_j.(w x a + v x b)
        cx = (wy * az - wz * ay) + (vy * bz - vz * by)
        cy = (wz * ax - wx * az) + (vz * bx - vx * bz)
        cz = (wx * ay - wy * ax) + (vx * by - vy * bx)
        for j in range(i + 1):
            gradient[j] += J[0, j] * cx + J[1, j] * cy + J[2, j] * cz
        # b.(w x v_j) = v_j.(b x w)
        cx = by * wz - bz * wy
        cy = bz * wx - bx * wz
        cz = bx * wy - by * wx
        for j in range(i + 1, n):
            gradient[j] += J[3, j] * cx + J[4, j] * cy + J[5, j] * cz


@kernel
def _condition_number_gradient(J: Array, B: Array, Q: Array, G: Array, gradient: Array) -> float:
    """Condition number of J (6, n), n >= 6, and gradient (n,); B, G (6, n) and Q (6, 6) scratch."""
    n = J.shape[1]
    orthogonalise_rows(J, B, Q)
    largest_row, smallest_row = 0, 0
    largest, smallest = -1.0, math.inf
    for m in range(6):
        total = 0.0
        for k in range(n):
            total += B[m, k] * B[m, k]
        if total > largest:
            largest_row, largest = m, total
        if total < smallest:
            smallest_row, smallest = m, total
    value = math.sqrt(largest / smallest) if smallest > 0.0 else math.inf
    if not value < _MAX_MEASURE:
        for j in range(n):
            gradient[j] = 0.0
        return _MAX_MEASURE
    # u_m = Q[m], v_m = B[m] / sigma_m: d JCN / JCN = d sigma_1 / sigma_1 - d sigma_6 / sigma_6.
    for i in range(6):
        for k in range(n):
            G[i, k] = value * (
                Q[largest_row, i] * B[largest_row, k] / largest
                - Q[smallest_row, i] * B[smallest_row, k] / smallest
            )
    contract(J, G, gradient)
    return value


@kernel(nogil=True)
def _condition_number_rows(table: Array, q: Array, values: Array, gradients: Array) -> None:
    n = q.shape[1]
    scratch = np.empty((n, SCRATCH_COLUMNS))
    J, B, G = np.empty((6, n)), np.empty((6, n)), np.empty((6, n))
    Q, R_WE, p_WE = np.empty((6, 6)), np.empty((3, 3)), np.empty(3)
    for k in range(q.shape[0]):
        pose_and_jacobian(table, q[k], R_WE, p_WE, J, scratch)
        values[k] = _condition_number_gradient(J, B, Q, G, gradients[k])


@kernel(nogil=True)
def _smooth_rows(table: Array, sharpness: float, q: Array, values: Array, gradients: Array) -> None:
    n = q.shape[1]
    scratch = np.empty((n, SCRATCH_COLUMNS))
    J, B, G = np.empty((6, n)), np.empty((6, n)), np.empty((6, n))
    Q, R_WE, p_WE = np.empty((6, 6)), np.empty((3, 3)), np.empty(3)
    squares, share = np.empty(6), np.empty(6)
    for k in range(q.shape[0]):
        pose_and_jacobian(table, q[k], R_WE, p_WE, J, scratch)
        orthogonalise_rows(J, B, Q)
        largest, smallest = 0.0, math.inf
        for m in range(6):
            squares[m] = 0.0
            for j in range(n):
                squares[m] += B[m, j] * B[m, j]
            largest, smallest = max(largest, squares[m]), min(smallest, squares[m])
        gradients[k] = 0.0
        values[k] = _MAX_MEASURE
        if not smallest > 0.0 or not math.sqrt(largest / smallest) < _MAX_MEASURE:
            continue
        # The extremes are divided out first: their 1e5th powers would overflow.
        sum_of_powers, sum_of_inverse_powers = 0.0, 0.0
        for m in range(6):
            sum_of_powers += (squares[m] / largest) ** sharpness
            sum_of_inverse_powers += (smallest / squares[m]) ** sharpness
        value = math.sqrt(largest / smallest) * (sum_of_powers * sum_of_inverse_powers) ** (
            0.5 / sharpness
        )
        values[k] = value
        for m in range(6):
            share[m] = (squares[m] / largest) ** sharpness / sum_of_powers
            share[m] -= (smallest / squares[m]) ** sharpness / sum_of_inverse_powers
        for i in range(6):
            for j in range(n):
                total = 0.0
                for m in range(6):
                    total += share[m] / squares[m] * Q[m, i] * B[m, j]
                G[i, j] = value * total
        contract(J, G, gradients[k])


class _Reading(NamedTuple):
    """How a wrench is read.

    Attributes:
        settings: WrenchReconstruction.table.
        covariance_tau, precision_tau: (n, n) Sigma_tau, N^2 m^2, and its inverse.
        is_inverse: whether the method is "inverse".
        work: of WrenchReconstruction.scratch. It is not written: every thread has a copy.
    """

    settings: Array
    covariance_tau: Array
    precision_tau: Array
    is_inverse: bool
    work: Array


class _Reconstructed(NamedTuple):
    """The torques `tau` (n,), all zero, and what `reconstruct` writes for them."""

    tau: Array
    wrench: Array
    covariance: Array
    quality: Array
    work: Array


@kernel
def _posterior_trace(reading: _Reading, J: Array, G: Array, reconstructed: _Reconstructed) -> float:
    """Trace of the force block of Sigma_F of the Gaussian posterior, and its G (6, n)."""
    n = J.shape[1]
    precision = reading.precision_tau
    covariance, work = reconstructed.covariance, reconstructed.work
    reconstruct(
        reading.settings,
        J,
        reconstructed.tau,
        reconstructed.wrench,
        covariance,
        reconstructed.quality,
        work,
    )
    # Sigma_F E Sigma_F J Sigma_tau^-1, from the right.
    for i in range(6):
        for k in range(n):
            total = 0.0
            for j in range(n):
                total += J[i, j] * precision[j, k]
            work[i, k] = total
    for i in range(6):
        for k in range(n):
            total = 0.0
            for j in range(6):
                total += covariance[i, j] * work[j, k]
            work[6 + i, k] = total
    for i in range(6):
        for k in range(n):
            total = 0.0
            for j in range(3, 6):
                total += covariance[i, j] * work[6 + j, k]
            G[i, k] = -2.0 * total
    return float(covariance[3, 3] + covariance[4, 4] + covariance[5, 5])


@kernel
def _inverse_trace(covariance_tau: Array, J: Array, G: Array, B: Array, Q: Array) -> float:
    """Trace of the force block of Sigma_F of the plain inverse, and its G (6, n)."""
    n = J.shape[1]
    orthogonalise_rows(J, B, Q)
    M, H = np.zeros((6, 6)), np.zeros((6, n))
    projector = np.zeros((n, n))
    for m in range(6):
        square = 0.0
        for k in range(n):
            square += B[m, k] * B[m, k]
        if not square > 0.0:
            G[:] = 0.0
            return math.inf
        for i in range(6):
            weight = Q[m, i] / square
            for j in range(6):
                M[i, j] += weight * Q[m, j]
            for k in range(n):
                H[i, k] += weight * B[m, k]
        for i in range(n):
            for k in range(n):
                projector[i, k] += B[m, i] * B[m, k] / square
    noise = np.zeros((6, n))  # H Sigma_tau
    for i in range(6):
        for k in range(n):
            for j in range(n):
                noise[i, k] += H[i, j] * covariance_tau[j, k]
    trace = 0.0
    for i in range(6):
        for k in range(n):
            G[i, k] = 0.0
    for i in range(6):
        for m in range(3, 6):
            spread = 0.0  # Sigma_F
            for k in range(n):
                spread += noise[i, k] * H[m, k]
            if i == m:
                trace += spread
            for k in range(n):
                off_row = noise[m, k]
                for j in range(n):
                    off_row -= noise[m, j] * projector[j, k]
                G[i, k] += 2.0 * (M[i, m] * off_row - spread * H[m, k])
    return trace


@kernel(nogil=True)
def _force_sd_rows(
    table: Array, reading: _Reading, q: Array, values: Array, gradients: Array
) -> None:
    n = q.shape[1]
    scratch = np.empty((n, SCRATCH_COLUMNS))
    J, B, G = np.empty((6, n)), np.empty((6, n)), np.empty((6, n))
    Q, R_WE, p_WE = np.empty((6, 6)), np.empty((3, 3)), np.empty(3)
    reconstructed = _Reconstructed(
        tau=np.zeros(n),
        wrench=np.empty(6),
        covariance=np.empty((6, 6)),
        quality=np.empty(NUM_QUALITY),
        work=np.zeros_like(reading.work),
    )
    for k in range(q.shape[0]):
        pose_and_jacobian(table, q[k], R_WE, p_WE, J, scratch)
        if reading.is_inverse:
            trace = _inverse_trace(reading.covariance_tau, J, G, B, Q)
        else:
            trace = _posterior_trace(reading, J, G, reconstructed)
        contract(J, G, gradients[k])
        value = math.sqrt(trace)
        values[k] = min(value, _MAX_MEASURE)
        for j in range(n):
            gradients[k, j] = gradients[k, j] / (2.0 * value) if value < _MAX_MEASURE else 0.0
