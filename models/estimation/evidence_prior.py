"""The prior of the wrench from a log: its force and moment sds by maximum evidence."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.estimation.wrench import whitening_matrix
from wrenchsight.models.estimation.wrench_prior import PriorSds
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.bounded_minimum import bounded_minimum
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.small_matrices import factorise
from wrenchsight.models.numerics.ties import in_order

FORCE_SD_RANGE = (1.0, 1e4)  # N
MOMENT_SD_RANGE = (0.01, 1e3)  # N m
NOISE_SCALE_RANGE = (1e-3, 1e3)  # on the stated sds
EVIDENCE_SAMPLES = 2000  # at most, spread over the log
_GRID_POINTS, _NUM_STARTS = 9, 4  # points along each axis of the coarse grid; best ones tried


class ScaledPrior(NamedTuple):
    """Prior of the wrench, with a factor on the torque noise.

    Attributes:
        force_sd: N.
        moment_sd: N m about E.
        noise_scale: factor on the torque sds of the stated covariance.
    """

    force_sd: float
    moment_sd: float
    noise_scale: float


def evidence_prior(J: ArrayLike, tau_ext: ArrayLike, torque_covariance: ArrayLike) -> PriorSds:
    """The prior of a log: the sds that explain its torques best.

    They maximise the marginal likelihood sum_k log N(tau_k; 0, J_k^T P J_k + Sigma_tau) over at
    most EVIDENCE_SAMPLES samples, evenly spread over the log, within FORCE_SD_RANGE and
    MOMENT_SD_RANGE. A log without contact gives the lower bounds. Nothing is drawn at random. No
    force sensor is needed.

    Args:
        J: (N, 6, n) at E in axes of W, rows [angular; linear].
        tau_ext: (N, n) N m.
        torque_covariance: (n, n) N^2 m^2.

    Raises:
        ValueError: no sample is finite, or shapes disagree.
    """
    prior = _maximum_evidence(J, tau_ext, torque_covariance, (1.0, 1.0))
    return PriorSds(prior.force_sd, prior.moment_sd)


def evidence_prior_and_noise(
    J: ArrayLike, tau_ext: ArrayLike, torque_covariance: ArrayLike
) -> ScaledPrior:
    """As `evidence_prior`, with Sigma_tau known but for a factor within NOISE_SCALE_RANGE.

    The torque that no wrench explains determines the noise; it needs more than 6 joints or many
    configurations.
    """
    return _maximum_evidence(J, tau_ext, torque_covariance, NOISE_SCALE_RANGE)


def _maximum_evidence(
    J: ArrayLike, tau_ext: ArrayLike, torque_covariance: ArrayLike, scale_range: tuple[float, float]
) -> ScaledPrior:
    """The most evident prior, its noise scale c within `scale_range`.

    With whitened torques y, S the sds of the wrench and L the part that `_log_evidence` computes,
    the mean log likelihood is, up to a constant,

        log N = -|y|^2 / (2 c^2) - n log c + L(S / c, 1 / c)

    Args:
        J: (N, 6, n) at E, rows [angular; linear].
        tau_ext: (N, n) N m; samples that are not finite are left out.
        torque_covariance: (n, n) (N m)^2.
        scale_range: least and largest factor on the sds of the noise; equal: it is given.

    Raises:
        ValueError: other shapes, or no finite sample.
    """
    J, tau_ext = np.asarray(J, float), np.asarray(tau_ext, float)
    Sigma = np.asarray(torque_covariance, float)
    if J.ndim != 3 or J.shape[1] != 6 or tau_ext.shape != (J.shape[0], J.shape[2]):
        raise ValueError(
            f"J must be (N, 6, n) and tau_ext (N, n), not {J.shape} and {tau_ext.shape}"
        )
    finite = np.flatnonzero(np.isfinite(tau_ext).all(axis=1) & np.isfinite(J).all(axis=(1, 2)))
    if finite.size == 0:
        raise ValueError("evidence_prior: no sample is finite")
    count = min(finite.size, EVIDENCE_SAMPLES)
    chosen = finite[np.linspace(0, finite.size - 1, count).round().astype(int)]
    W = whitening_matrix(Sigma)
    B = J[chosen] @ W.T
    white_tau = tau_ext[chosen] @ W.T
    # All that the likelihood needs of the samples, with noise of covariance 1.
    gram = np.ascontiguousarray(B @ B.transpose(0, 2, 1))
    projected = np.ascontiguousarray((B @ white_tau[..., None])[..., 0])
    mean_square = float(np.mean(np.sum(white_tau**2, axis=1)))
    n = tau_ext.shape[1]

    def cost(log_sds: Array) -> tuple[float, Array]:
        """-log N at the logarithms of (force_sd, moment_sd, c), and its gradient by these."""
        force_sd, moment_sd, c = np.exp(log_sds)
        evidence = _log_evidence(gram, projected, moment_sd / c, force_sd / c, 1.0 / c)
        value = float(0.5 * mean_square / c**2 + n * np.log(c) - evidence.value)
        # Of L by log c: minus its derivatives by the logarithms of its three arguments, which c
        # divides.
        by_c = n - mean_square / c**2 + evidence.by_moment + evidence.by_force + evidence.by_weight
        return value, np.array([-evidence.by_force, -evidence.by_moment, by_c])

    # Rows in the order of log_sds.
    bounds = np.log(np.array([FORCE_SD_RANGE, MOMENT_SD_RANGE, scale_range]))
    # There can be several optima (a wrench explained as force or as moment) and flat regions where
    # a sd does not matter: start from the best points of a coarse grid.
    axes = [np.linspace(low, high, _GRID_POINTS if low < high else 1) for low, high in bounds]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    starts = grid[in_order([cost(point)[0] for point in grid])[:_NUM_STARTS]]
    optimum, _ = bounded_minimum(cost, list(starts), bounds)
    force_sd, moment_sd, noise_scale = np.exp(optimum)
    return ScaledPrior(float(force_sd), float(moment_sd), float(noise_scale))


class _Evidence(NamedTuple):
    """Mean log likelihood up to a constant, and its derivatives by the logarithms of three scales.

    The scales are the moment's sd, the force's sd and the weight of the torque.
    """

    value: float
    by_moment: float
    by_force: float
    by_weight: float


@kernel
def _log_evidence(
    gram: Array, projected: Array, moment_sd: float, force_sd: float, weight: float
) -> _Evidence:
    """The part of the mean log likelihood that depends on the sds, and its derivatives.

    By the matrix determinant and inversion lemmas only the 6x6 matrix A = 1 + S gram S appears:
    2 log N = -log det A + |A^-1/2 S projected|^2 + constant, S the sds. With y = A^-1 S projected
    the derivative of log N by the logarithm of a scale S_i is y_i^2 - 1 + (A^-1)_ii. numpy on all
    samples takes eleven times as long (`tests/benchmarks/bench_small_matrices.py`).

    Args:
        gram: (N, 6, 6) B B^T of the whitened Jacobians B.
        projected: (N, 6) B times the whitened torque.
        moment_sd, force_sd: N m and N.
        weight: factor on `projected`; its derivative is |A^-1/2 S projected|^2.
    """
    # A = L L^T, R = L^-1; half = L^-1 S projected, so that y = L^-T half.
    L, R = np.zeros((6, 6)), np.zeros((6, 6))
    half, y = np.empty(6), np.empty(6)
    total, by_moment, by_force, by_weight = 0.0, 0.0, 0.0, 0.0
    for k in range(gram.shape[0]):
        for i in range(6):
            scale_i = moment_sd if i < 3 else force_sd
            for j in range(i + 1):
                scale_j = moment_sd if j < 3 else force_sd
                L[i, j] = scale_i * scale_j * gram[k, i, j] + (1.0 if i == j else 0.0)
        factorise(L, R)
        for i in range(6):
            half[i] = 0.0
            for j in range(i + 1):
                half[i] += R[i, j] * projected[k, j] * (moment_sd if j < 3 else force_sd)
            half[i] *= weight
            # log N = |half|^2 / 2 - log det L + constant
            total += 0.5 * half[i] * half[i] - np.log(L[i, i])
            by_weight += half[i] * half[i]
        for i in range(6):
            y[i], inverse_ii = 0.0, 0.0
            for j in range(i, 6):
                y[i] += R[j, i] * half[j]
                inverse_ii += R[j, i] * R[j, i]
            if i < 3:  # the wrench's moment, then its force
                by_moment += y[i] * y[i] - 1.0 + inverse_ii
            else:
                by_force += y[i] * y[i] - 1.0 + inverse_ii
    count = gram.shape[0]
    return _Evidence(total / count, by_moment / count, by_force / count, by_weight / count)
