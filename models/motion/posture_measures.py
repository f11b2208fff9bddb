"""How well a posture reads forces, with gradients in closed form: one posture or thousands.

A measure maps joint positions to one number, smaller is better, and to its gradient. Both measures
here are functions of the Jacobian; with G its gradient with respect to J,

    d/dq_j = sum_i G_i . dJ_i/dq_j,    dJ_i/dq_j = [w_j x w_i; w_j x v_i]  for j <= i
                                                   [0;         w_i x v_j]  for j >  i

where J_i = [w_i; v_i] is the column of joint i, at E in axes of W (a prismatic joint has w_i = 0).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.arrays import Array
from wrenchsight.models.estimation.wrench import WrenchReconstruction, WrenchReconstructionConfig
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.rigid_body.structural_rank import parallel_columns, structural_rank

UNREADABLE = 1e12  # stands for infinity, where a solver needs a number


class PostureMeasure(Protocol):
    """What an optimisation of postures minimises.

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
    at either end it has a kink, and this is one of its one-sided gradients. At a singular posture
    it is 1e12, with a gradient of zero.

    Raises:
        InputError: the arm has fewer than six joints.
    """

    key = "jcn"
    label = "condition number of J"

    def __init__(self, chain: SerialChain) -> None:
        check_joints(chain)
        self._chain = chain

    def values(self, q: ArrayLike) -> Array:
        """The measure (...) at q (..., n)."""
        return np.minimum(self._chain.condition_number(q), UNREADABLE)

    def values_and_gradients(self, q: ArrayLike) -> tuple[Array, Array]:
        """The measure (...) and its gradient (..., n) at q (..., n)."""

        def ends(s: Array) -> tuple[Array, Array]:
            share = np.zeros_like(s)
            share[:, 0], share[:, -1] = 1.0, -1.0
            return s[:, 0] / s[:, -1], share

        return by_singular_values(self._chain, q, ends)


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
        self._covariance = reconstruction.torque_covariance
        self._precision = np.linalg.inv(self._covariance)
        self._prior_sd: Array | None = None
        if config.method != "inverse":
            _, force_sd, moment_sd = reconstruction.table[2 * chain.num_joints, :3]
            self._prior_sd = np.repeat([moment_sd, force_sd], 3)

    def values(self, q: ArrayLike) -> Array:
        """The measure (...) at q (..., n), N."""
        return self.values_and_gradients(q)[0]

    def values_and_gradients(self, q: ArrayLike) -> tuple[Array, Array]:
        """The measure (...), N, and its gradient (..., n) at q (..., n)."""
        rows = _rows(self._chain, q)
        J = self._chain.jacobian(rows)
        with np.errstate(all="ignore"):  # a singular J has no inverse: it is unreadable
            covariance, G = self._posterior(J) if self._prior_sd is not None else self._inverse(J)
            values = np.sqrt(np.trace(covariance[:, 3:, 3:], axis1=1, axis2=2))
        return _readable(q, J, values, G / (2.0 * values)[:, None, None])

    def _posterior(self, J: Array) -> tuple[Array, Array]:
        """Sigma_F of the Gaussian posterior and its trace's G, (N, 6, 6) and (N, 6, n)."""
        # In units of the prior's sds, so that a prior of any size does.
        assert self._prior_sd is not None
        S = self._prior_sd
        JP = J @ self._precision
        scaled = S[:, None] * (JP @ J.swapaxes(1, 2)) * S + np.eye(6)
        covariance = S[:, None] * np.linalg.inv(scaled) * S
        return covariance, -2.0 * covariance[:, :, 3:] @ (covariance @ JP)[:, 3:]

    def _inverse(self, J: Array) -> tuple[Array, Array]:
        """The same for the plain inverse, by the singular value decomposition of J."""
        U, s, V = np.linalg.svd(J, full_matrices=False)
        M, H = (U / s[:, None] ** 2) @ U.swapaxes(1, 2), (U / s[:, None]) @ V
        noise = H @ self._covariance
        covariance = noise @ H.swapaxes(1, 2)
        rest = noise - noise @ V.swapaxes(1, 2) @ V
        G = 2.0 * (M[:, :, 3:] @ rest[:, 3:] - covariance[:, :, 3:] @ H[:, 3:])
        return covariance, G


@dataclass(frozen=True)
class PathMeasure:
    """The mean of a posture's measure over the postures of a path (eq. 27, over k + 1 points)."""

    posture: PostureMeasure

    def value(self, q: Array) -> float:
        """Mean over q (k + 1, n)."""
        return float(np.mean(self.posture.values(q)))

    def value_and_gradient(self, q: Array) -> tuple[float, Array]:
        """Mean over q (k + 1, n), and its gradient (k + 1, n)."""
        values, gradients = self.posture.values_and_gradients(q)
        return float(np.mean(values)), gradients / len(q)


def check_joints(chain: SerialChain, name: str = "robot") -> None:
    """Raises InputError for an arm that it calls `name`: fewer than six joints, or joints that
    leave the tool fewer than six directions in every posture, as two parallel columns do.
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
        same = parallel_columns(chain)
        why = f": {' and '.join(same)} push along one line" if same else ""
        raise InputError(
            name,
            "",
            f"its {chain.num_joints} joints move the tool in {rank} of six directions in every "
            f"posture{why}; the condition number is infinite everywhere",
            f"name {same[0]} under locked_joints, or take another tool frame"
            if same
            else "check the axes of its joints",
        )


def by_singular_values(
    chain: SerialChain, q: ArrayLike, measure: Callable[[Array], tuple[Array, Array]]
) -> tuple[Array, Array]:
    """A function of J's singular values (...) at q (..., n), and its gradient (..., n).

    Args:
        measure: of singular values (N, 6), falling: it gives (N,) values f and (N, 6) shares
            s_i / f df/ds_i, so that G = f sum_i share_i / s_i u_i v_i^T.
    """
    J = chain.jacobian(_rows(chain, q))
    U, s, V = np.linalg.svd(J, full_matrices=False)
    with np.errstate(all="ignore"):  # a singular J is unreadable
        values, share = measure(s)
        G = (U * (values[:, None] * share / s)[:, None]) @ V
    return _readable(q, J, values, G)


def _readable(q: ArrayLike, J: Array, values: Array, G: Array) -> tuple[Array, Array]:
    """Values (...) and gradients (..., n) at q (..., n); UNREADABLE and zero for what is infinite.

    Args:
        J, G: (N, 6, n), G the gradient of values (N,) by J.
    """
    readable = values < UNREADABLE
    values, G = np.where(readable, values, UNREADABLE), np.where(readable[:, None, None], G, 0.0)
    shape = np.shape(q)
    return values.reshape(shape[:-1]), _contracted(J, G).reshape(shape)


def _rows(chain: SerialChain, q: ArrayLike) -> Array:
    array = np.asarray(q, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != chain.num_joints:
        raise ValueError(f"expected q of shape (..., {chain.num_joints}), got {array.shape}")
    return np.ascontiguousarray(array).reshape(-1, chain.num_joints)


def _contracted(J: Array, G: Array) -> Array:
    """gradient_j = sum_i G_i . dJ_i/dq_j, (N, n); J and G (N, 6, n)."""
    w, v, a, b = J[:, :3], J[:, 3:], G[:, :3], G[:, 3:]
    # i >= j: a_i.(w_j x w_i) + b_i.(w_j x v_i) = w_j.(w_i x a_i + v_i x b_i)
    after = np.cumsum((np.cross(w, a, axis=1) + np.cross(v, b, axis=1))[..., ::-1], axis=-1)
    # i < j: b_i.(w_i x v_j) = v_j.(b_i x w_i)
    own = np.cross(b, w, axis=1)
    before = np.cumsum(own, axis=-1) - own
    return np.asarray(np.sum(w * after[..., ::-1] + v * before, axis=1))
