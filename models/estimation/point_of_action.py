"""The point on the tool where a force acts, from external joint torques alone.

A force at a point P that is fixed in E, of mean f (constant in W) and with deviations from it:

    tau_k ~ N(J_Pk^T [0; f], J_Pk^T diag(moment_sd^2, force_sd^2) J_Pk + noise_scale^2 Sigma_tau)

P, f, both sds and the noise's scale maximise this marginal likelihood. The force is integrated out,
not fitted to each sample, so that P is unbiased. With as many forces as samples the fit would put
part of the noise into the lever (Neyman and Scott, Econometrica 16, 1948).

**Why a mean.** A Gaussian prior of mean zero pulls every reading towards zero, most in directions
that the torques determine badly. For forces of all directions these pulls average out. A weight has
one direction; its pulls add up to a bias. With the mean in the prior only the deviation from it is
pulled towards zero.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.estimation.evidence_prior import FORCE_SD_RANGE, MOMENT_SD_RANGE
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.bounded_minimum import bounded_minimum

NOISE_RANGE = (1.0, 10.0)  # a model is at least as wrong under load as without
LARGEST_OFFSET = 2.0  # m from E in each axis
_UNIT_FORCE = 10.0  # N, of the optimiser's variables
# Starts: sd of the moment, N m; of the force, N, where it is mostly mean and where all deviation.
_START_MOMENT_SD, _START_DEVIATIONS = 1.0, (10.0, 30.0)


class PointOfAction(NamedTuple):
    """Result of `find_point_of_action`.

    Attributes:
        p_EP: (3,) m from E to P in axes of E.
        mean_force_W: (3,) N.
        force_sd: N of the deviations from it.
        moment_sd: N m about P.
        noise_scale: factor on the sds of Sigma_tau.
        log_likelihood: mean over the samples, up to a constant of the log.
    """

    p_EP: Array
    mean_force_W: Array
    force_sd: float
    moment_sd: float
    noise_scale: float
    log_likelihood: float


def jacobian_at(J: ArrayLike, R_WE: ArrayLike, p_EP: ArrayLike) -> Array:
    """Returns the Jacobian (N, 6, n) at P for J (N, 6, n) at E, both in axes of W.

    Args:
        J: rows [angular; linear].
        R_WE: (N, 3, 3).
        p_EP: (3,) m, in axes of E.
    """
    J = np.asarray(J, float)
    p_EP_W = np.asarray(R_WE, float) @ np.asarray(p_EP, float)
    moved = J.copy()
    moved[:, 3:] += np.cross(J[:, :3], p_EP_W[:, :, None], axis=1)
    return moved


def find_point_of_action(
    J: ArrayLike,
    R_WE: ArrayLike,
    tau_ext: ArrayLike,
    torque_covariance: ArrayLike,
    with_mean: bool = True,
    free_noise: bool = True,
    at_E: bool = False,
) -> PointOfAction:
    """Finds the most evident point of action.

    Args:
        J: (N, 6, n) at E in axes of W, rows [angular; linear].
        R_WE: (N, 3, 3).
        tau_ext: (N, n) N m.
        torque_covariance: (n, n) Sigma_tau, N^2 m^2.
        with_mean: whether the force may have a mean; without, it is zero.
        free_noise: whether the noise may be larger than Sigma_tau says.
        at_E: whether the force acts at E, so that the rest is to be found alone.

    Raises:
        ValueError: shapes disagree, or a value is not finite.
    """
    J, R, tau = np.asarray(J, float), np.asarray(R_WE, float), np.asarray(tau_ext, float)
    Sigma = np.asarray(torque_covariance, float)
    N = len(tau)
    if J.shape != (N, 6, tau.shape[-1]) or R.shape != (N, 3, 3):
        raise ValueError(f"expected J (N, 6, n), R (N, 3, 3), not {J.shape} and {R.shape}")
    if not (np.isfinite(J).all() and np.isfinite(R).all() and np.isfinite(tau).all()):
        raise ValueError("point of action: a sample is not finite")

    likelihood = _Likelihood.of(J, R, tau, Sigma)
    noise = NOISE_RANGE if free_noise else (1.0, 1.0)
    # In the order of `_Likelihood.cost`: point, sds and scale, mean force. Equal bounds hold what
    # is given.
    bounds = [
        *[(0.0, 0.0) if at_E else (-LARGEST_OFFSET, LARGEST_OFFSET)] * 3,
        *np.log([FORCE_SD_RANGE, MOMENT_SD_RANGE, noise]).tolist(),
        *[(-np.inf, np.inf) if with_mean else (0.0, 0.0)] * 3,
    ]
    # The two basins, both from E on: a force that is mostly mean, and one that is all deviation.
    mean = _mean_force(J, tau, Sigma) / _UNIT_FORCE if with_mean else np.zeros(3)
    starts = [
        np.r_[np.zeros(3), np.log([force_sd, _START_MOMENT_SD, 1.0]), start_mean]
        for force_sd, start_mean in zip(_START_DEVIATIONS, (mean, np.zeros(3)), strict=True)
    ]
    optimum, cost = bounded_minimum(likelihood.cost, starts, bounds)
    force_sd, moment_sd, noise_scale = (float(s) for s in np.exp(optimum[3:6]))
    return PointOfAction(
        p_EP=optimum[:3],
        mean_force_W=_UNIT_FORCE * optimum[6:],
        force_sd=force_sd,
        moment_sd=moment_sd,
        noise_scale=noise_scale,
        log_likelihood=-float(cost),
    )


class _Likelihood(NamedTuple):
    """Likelihood of N torques under a force at P, for a gradient search.

    Attributes:
        J: (N, 6, n) at E.
        R_WE: (N, 3, 3).
        tau: (N, n) N m.
        Sigma: (n, n) N^2 m^2.
        turned: (3, N, 3, n) change of the linear rows of J at P, per metre along each axis of E.
    """

    J: Array
    R_WE: Array
    tau: Array
    Sigma: Array
    turned: Array

    @classmethod
    def of(cls, J: Array, R_WE: Array, tau: Array, Sigma: Array) -> "_Likelihood":
        """Returns the likelihood of N torques."""
        # The linear rows change by w x R e_c, for each axis c of E.
        turned = np.stack([np.cross(J[:, :3], R_WE[:, :, c, None], axis=1) for c in range(3)])
        return cls(J, R_WE, tau, Sigma, turned)

    def cost(self, x: Array) -> tuple[float, Array]:
        """Minus the mean log likelihood, up to a constant, and its gradient (9,).

        With C the covariance, r the torque less that of the mean force, and a = C^-1 r, each
        sample's share changes by tr((C^-1 - a a^T) dC) / 2 + a^T dr. By the logarithm of an sd dC
        is twice the part of C that has its square.

        Args:
            x: (9,) p_EP in m; logarithms of force sd, moment sd and noise scale; mean force in
                units of _UNIT_FORCE.
        """
        p_EP, force = x[:3], _UNIT_FORCE * x[6:]
        force_sd, moment_sd, scale = np.exp(x[3:6])
        J_P = jacobian_at(self.J, self.R_WE, p_EP)
        angular, linear = moment_sd * J_P[:, :3], force_sd * J_P[:, 3:]
        of_moment = angular.transpose(0, 2, 1) @ angular
        of_force = linear.transpose(0, 2, 1) @ linear
        covariance = of_moment + of_force + scale**2 * self.Sigma
        residual = self.tau - (J_P[:, 3:].transpose(0, 2, 1) @ force)
        L = np.linalg.cholesky(covariance)
        inverse = np.linalg.inv(covariance)
        a = (inverse @ residual[..., None])[..., 0]
        log_det = np.log(np.diagonal(L, axis1=1, axis2=2)).sum(axis=1)
        value = float(np.mean(0.5 * (residual * a).sum(axis=1) + log_det))
        by_C = inverse - a[:, :, None] * a[:, None, :]
        gradient = np.empty(9)
        # `turned[c]` is the derivative of J_P's linear rows by coordinate c of p_EP. dC is `half`
        # and its transpose, so that half of the formula's trace is that of `half`.
        for c in range(3):
            half = (self.turned[c].transpose(0, 2, 1) @ J_P[:, 3:]) * force_sd**2
            gradient[c] = np.mean(
                (by_C * half).sum(axis=(1, 2)) - (a * (force @ self.turned[c])).sum(axis=1)
            )
        for i, part in enumerate((of_force, of_moment, scale**2 * self.Sigma)):
            gradient[3 + i] = np.mean((by_C * part).sum(axis=(1, 2)))
        gradient[6:] = -_UNIT_FORCE * np.mean((J_P[:, 3:] @ a[..., None])[..., 0], axis=0)
        return value, gradient


def _mean_force(J: Array, tau: Array, Sigma: Array) -> Array:
    """Least squares of one constant wrench over all samples: its force, a start."""
    W = np.linalg.inv(np.linalg.cholesky(Sigma))
    A = (W @ J.transpose(0, 2, 1)).reshape(-1, 6)
    return np.asarray(np.linalg.lstsq(A, (tau @ W.T).ravel(), rcond=None)[0][3:])
