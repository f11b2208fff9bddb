"""Test whether a force at E without a moment explains the torques, as `force_only` presupposes.

The misfit of the best such force to a sample's torque,

    D = min_f (tau - J^T f)^T Sigma^-1 (tau - J^T f)

is n - 3 on average where it explains the torque. Its mean over MEAN_TIME s may be MAX_MISFIT_RATIO
times that. A load or a contact away from E exceeds it; its force is off by more than the stated
band.

MAX_MISFIT_RATIO was chosen on logs of a UR10e. Of contact-free ones it invalidates at most 2 % of
the valid readings. On a log with 2.8 kg at .18 m off the flange 29 % of the valid forces are inside
their band without it; with it 2 % of that log stay valid.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import uniform_filter1d

from wrenchsight.models.numerics.arrays import Array, Flags

MEAN_TIME = 0.3  # s
MAX_MISFIT_RATIO = 3.0
_SINGULAR_SHARE = 1e-9  # of the information of all directions, added to that of each


def force_alone_explains(
    t: Array, J: ArrayLike, tau_ext: ArrayLike, sd: ArrayLike, correlation: ArrayLike
) -> Flags:
    """Tests at N samples whether a force at E alone explains the torques around each (N,).

    The misfit of the best force, which is n - 3 on average where a force explains the torque, is
    averaged over MEAN_TIME about each sample. Samples with numbers that are not finite count as
    zero in it. With three joints or less, which a force explains but where singular, one stands
    for n - 3.

    Args:
        t: (N,) s.
        J: (N, 6, n) at E, rows [angular; linear].
        tau_ext: (N, n) N m.
        sd: (N, n) N m of its error.
        correlation: (n, n) of the errors of the joints.
    """
    J, tau, sd = (np.asarray(x, float) for x in (J, tau_ext, sd))
    N, n = tau.shape
    is_finite = np.asarray(np.isfinite(tau + sd).all(axis=1) & np.isfinite(J).all(axis=(1, 2)))
    misfit = np.zeros(N)
    # Least squares of y = A^T f, torques over their sds and made independent, each of sd 1.
    whitening = np.linalg.inv(np.linalg.cholesky(np.asarray(correlation, float)))
    y = (tau[is_finite] / sd[is_finite]) @ whitening.T
    A = (J[is_finite, 3:] / sd[is_finite][:, None]) @ whitening.T
    # A floor keeps singular postures solvable; the directions that they hide are not misfit.
    gram = A @ A.swapaxes(1, 2)  # (N, 3, 3)
    floor = _SINGULAR_SHARE * np.trace(gram, axis1=1, axis2=2)
    gram = gram + floor[:, None, None] * np.eye(3)
    projected = (A @ y[..., None])[..., 0]
    explained = (projected * np.linalg.solve(gram, projected[..., None])[..., 0]).sum(axis=1)
    misfit[is_finite] = np.maximum((y**2).sum(axis=1) - explained, 0.0)
    step = float(np.median(np.diff(t))) if N > 1 else MEAN_TIME
    mean_samples = max(1, min(N, round(MEAN_TIME / step))) if step > 0.0 else 1
    mean_misfit = uniform_filter1d(misfit, mean_samples, mode="nearest")
    return np.asarray(mean_misfit <= MAX_MISFIT_RATIO * max(n - 3, 1))
