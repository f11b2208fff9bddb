"""Fits a torque error model to what an observer read where nothing touched the arm.

The readings must be held out: of motions that the model of dynamics and friction was not fitted on.
Each joint's constants maximise the likelihood of independent Gaussian samples,

    -1/2 sum_k log s_k + e_k^2 / s_k,    s_k = sum_m c_m f_km + unknown_k^2,    c_m >= 0

with the features f of `models.identification.torque_error_model`. Samples are not independent; that
costs efficiency, not consistency. What is stated as an assumption plays no part here.

Joints' errors correlate where one motion takes all of them along: friction has the sign of the
velocity and ripples over position, and a pass through one posture shows ripples of +-.9 that
another posture turns round. So a correlation is the arm's as far as motions agree on it. With r_m
that of each reading, m = 1 .. M > 1, their mean r and its standard error e,

    e^2 = sum_m (r_m - r)^2 / (M (M - 1)),    R_ij = r max(0, 1 - e^2 / r^2)

which is the share of r^2 that the motions have in common. A single reading is taken at its word.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.identification.torque_error_model import (
    NUM_FEATURES,
    PLAIN,
    Rest,
    TorqueErrorModel,
    averaged_share,
    initial_torque_error_state,
    torque_error_features,
)
from wrenchsight.models.numerics.arrays import Array, Flags, contiguous
from wrenchsight.models.numerics.kernel import kernel

FEWEST_SAMPLES = 200  # of a joint, over all logs
WINDOWS = (0.1, 0.3, 1.0, 3.0, 10.0)  # s, over which means are taken to find what lasts
CORRELATION_TIMES = (0.01, 5.0)  # s, least and largest
_OUTLIER = 4.0  # sds, beyond which a sample says nothing of correlations
_LEAST_SHARE = 1e-4  # of a joint's rms error: the smallest constant
_BLOCK = 256  # samples
REST = Rest()
_SPAN = 18.0  # natural logarithm of the range that a coefficient is looked for in
_ENOUGH = 10_000  # samples that tell where about a likelihood is highest


@dataclass(frozen=True, eq=False)
class HeldOutReading:
    """What the observer read along one log that its model was not fitted on.

    Attributes:
        tau_ext: (N, n) N m; nothing touches the arm, so that all of it is error.
        q, v: (N, n) rad and rad/s, on a uniform grid.
        transmitted: (N, n) N m, tau_J - tau_f.
        used: (N,) samples that count; those before them still move the state.
        friction: the law of the model that read it.
        time_step: s.
        K_0: (n,) 1/s.
        resolution: (n,) rad, the step of the encoders; 0 where there is none.
    """

    tau_ext: Array
    q: Array
    v: Array
    transmitted: Array
    used: Flags
    friction: FrictionLaw
    time_step: float
    K_0: Array
    resolution: Array


def fit_torque_error(
    readings: Sequence[HeldOutReading], least: ArrayLike = 0.0, rest: Rest = REST
) -> TorqueErrorModel:
    """Returns the model that explains the readings best.

    Args:
        readings: of one gain K_0.
        least: (n,) or () N m, a floor of `constant`: a simulation without noise has no error.
        rest: how a joint's stiction comes and goes, which the likelihood of motion hardly tells.

    Raises:
        ValueError: no reading, readings that disagree, too few samples.
    """
    if not readings:
        raise ValueError("torque error: no held-out reading")
    first = readings[0]
    n = first.tau_ext.shape[1]
    for own in readings:
        shapes = {own.tau_ext.shape, own.q.shape, own.v.shape, own.transmitted.shape}
        if shapes != {(len(own.used), n)} or not np.array_equal(own.K_0, first.K_0):
            raise ValueError("torque error: readings disagree in shape or K_0")
    used = [own.used & np.isfinite(own.tau_ext).all(axis=1) for own in readings]
    count = sum(int(rows.sum()) for rows in used)
    if count < FEWEST_SAMPLES:
        raise ValueError(f"torque error: {count} samples, expected {FEWEST_SAMPLES} or more")
    unit = _plain(n, first.K_0, rest)
    features = [features_along(unit, own) for own in readings]
    F = np.concatenate([f[rows] for f, rows in zip(features, used, strict=True)])
    e = np.concatenate([own.tau_ext[rows] for own, rows in zip(readings, used, strict=True)])
    coefficients = np.stack([most_likely(F[:, j], e[:, j]) for j in range(n)])
    floor = np.broadcast_to(np.asarray(least, float), (n,))
    rms = np.sqrt(np.mean(e**2, axis=0))
    floor = np.maximum(floor, np.maximum(_LEAST_SHARE * rms, 1e-12))
    constant = np.maximum(np.sqrt(coefficients[:, 0]), floor)
    coefficients[:, 0] = constant**2
    sds = [
        np.sqrt((f[..., :-1] * coefficients).sum(axis=-1) + f[..., -1])[rows]
        for f, rows in zip(features, used, strict=True)
    ]
    scaled = [
        np.clip(own.tau_ext[rows] / sd, -_OUTLIER, _OUTLIER)
        for own, rows, sd in zip(readings, used, sds, strict=True)
    ]
    lasting, correlation_time = _averaging(scaled, first.time_step)
    speed = np.max(
        [np.abs(own.v[rows]).max(axis=0) for own, rows in zip(readings, used, strict=True)], axis=0
    )
    load = np.max(
        [
            np.abs(own.transmitted[rows]).max(axis=0)
            for own, rows in zip(readings, used, strict=True)
        ],
        axis=0,
    )
    roots = np.sqrt(coefficients)
    return TorqueErrorModel(
        constant=constant,
        speed=roots[:, 1],
        load=roots[:, 2],
        acceleration=roots[:, 3],
        reversal=roots[:, 4],
        correlation=_correlation(scaled),
        correlation_time=correlation_time,
        lasting=lasting,
        fitted_speed=speed,
        fitted_load=load,
        K_0=first.K_0,
        resolution=np.max([own.resolution for own in readings], axis=0),
        rest_time=rest.time,
        reach=rest.reach,
        resting_only=rest.only,
    )


def _plain(n: int, K_0: Array, rest: Rest) -> TorqueErrorModel:
    """A model of which only the parts that turn motion into features count."""
    return TorqueErrorModel(
        **PLAIN | {"K_0": K_0},
        constant=np.ones(n),
        correlation=np.eye(n),
        rest_time=rest.time,
        reach=rest.reach,
        resting_only=rest.only,
    )


def features_along(unit: TorqueErrorModel, own: HeldOutReading) -> Array:
    """(N, n, NUM_FEATURES) of what a variance is made of."""
    N, n = own.q.shape
    features = np.empty((N, n, NUM_FEATURES))
    q, v, load = contiguous(own.q, own.v, own.transmitted)
    table = unit.table(own.friction, own.time_step, own.K_0, own.resolution)
    torque_error_features(table, initial_torque_error_state(n), q, v, load, features)
    return features


def most_likely(F: Array, e: Array) -> Array:
    """c (M,) of one joint; F (N, M + 1) with the fixed part of the variance last, e (N,)."""
    from scipy.optimize import minimize

    A, fixed, squares = np.ascontiguousarray(F[:, :-1]), F[:, -1].copy(), e**2
    power = max(float(np.mean(e**2)), 1e-300)
    sizes = np.maximum(A.mean(axis=0), 1e-300)
    fixed += 1e-12 * power
    scale = power / sizes / A.shape[1]

    def climb(start: Array, step: int) -> tuple[float, Array]:
        """Value and place of the top that is reached from a start, over every `step`-th sample."""
        rows = slice(None, None, step)
        part = np.ascontiguousarray(A[rows]), fixed[rows].copy(), squares[rows].copy()
        count = len(part[1])

        def cost(x: Array) -> tuple[float, Array]:
            c, slope = scale * np.exp(x), np.empty(len(x))
            value = _minus_log_likelihood(*part, c, slope)
            return value / count, slope / count * c

        found = minimize(cost, start, jac=True, method="L-BFGS-B", bounds=bounds)
        return float(found.fun), found.x

    bounds = [(-_SPAN, np.log(10.0 * A.shape[1]))] * A.shape[1]
    # From an even split, and from the constant alone: the surface is not convex.
    alone = np.full(A.shape[1], -3.0)
    alone[0] = 1.0
    # Which top is the higher one, and about where, some of many samples tell.
    step = max(1, len(e) // _ENOUGH)
    climbs = [climb(start, step) for start in (np.zeros(A.shape[1]), alone)]
    found = min(climbs, key=lambda one: one[0])[1]
    if step > 1:
        found = climb(found, 1)[1]
    # A term that the likelihood pushed to its bound, or that no sample showed, is zero.
    there = (found > -_SPAN + 1e-6) & (A.max(axis=0) > 0.0)
    return np.where(there, scale * np.exp(found), 0.0)


@kernel
def _minus_log_likelihood(A: Array, fixed: Array, squares: Array, c: Array, slope: Array) -> float:
    """The sum at the top of this file, its sign turned; writes its slope (M,) in c.

    Args:
        A: (N, M), features.
        fixed: (N,) of the variance.
        squares: (N,) of the errors.
        c: (M,).
    """
    N, M = A.shape
    value, part = 0.0, np.empty(M)
    slope[:] = 0.0
    for start in range(0, N, _BLOCK):  # sums of sums: rounding does not grow with N
        part[:] = 0.0
        logarithms, ratios, factor = 0.0, 0.0, 1.0
        for k in range(start, min(N, start + _BLOCK)):
            s = fixed[k]
            for m in range(M):
                s += A[k, m] * c[m]
            inverse = 1.0 / s
            ratio = squares[k] * inverse
            ratios += ratio
            share = inverse - ratio * inverse
            for m in range(M):
                part[m] += share * A[k, m]
            if 1e-200 < factor * s < 1e200:
                factor *= s  # one logarithm for many: they are what takes the time
            else:
                logarithms += math.log(factor)
                factor = s
        value += logarithms + math.log(factor) + ratios
        for m in range(M):
            slope[m] += 0.5 * part[m]
    return 0.5 * value


def _correlation(scaled: Sequence[Array]) -> Array:
    """(n, n) that the readings agree on, shrunk a little towards 1, so that equal errors of two
    joints leave an inverse; further where the correlations do not fit each other.
    """
    seen = np.stack([_seen_correlation(own) for own in scaled if len(own) > 0])
    R = seen.mean(axis=0)
    if len(seen) > 1:
        doubt = seen.var(axis=0, ddof=1) / len(seen)
        R *= np.maximum(0.0, 1.0 - doubt / np.maximum(R**2, 1e-300))
    n = len(R)
    R[np.arange(n), np.arange(n)] = 1.0
    R *= 0.98 / max(1.0, 1.0 - float(np.linalg.eigvalsh(R)[0]))
    R[np.arange(n), np.arange(n)] = 1.0
    return np.asarray(R)


def _seen_correlation(scaled: Array) -> Array:
    """(n, n) of one reading, about zero."""
    size = np.sqrt(np.maximum(np.mean(scaled**2, axis=0), 1e-300))
    R = (scaled / size).T @ (scaled / size) / len(scaled)
    return np.asarray(0.5 * (R + R.T))


def _averaging(scaled: Sequence[Array], time_step: float) -> tuple[Array, Array]:
    """Lasting share and correlation time (n,) each, from the variance of means over WINDOWS.

    V(tau) = b + (1 - b) g(tau / T), with g of `averaged_share`, by least squares of the logarithm
    on a grid; windows longer than half of the shortest log are left out.
    """
    n = scaled[0].shape[1]
    power = np.mean(np.vstack(scaled) ** 2, axis=0)
    shortest = min(len(own) for own in scaled)
    windows = [w for w in WINDOWS if 1 < round(w / time_step) <= shortest // 2]
    if not windows:
        return np.zeros(n), np.full(n, 0.1)
    shares = []
    for window in windows:
        size = round(window / time_step)
        means = np.concatenate(
            [own[: len(own) // size * size].reshape(-1, size, n).mean(axis=1) for own in scaled]
        )
        shares.append(np.mean(means**2, axis=0) / np.maximum(power, 1e-300))
    seen = np.log(np.maximum(shares, 1e-6))  # (windows, n)
    times = np.geomspace(*CORRELATION_TIMES, 60)
    lasting = np.linspace(0.0, 0.5, 51)
    b, T = (x.ravel() for x in np.meshgrid(lasting, times, indexing="ij"))
    expected = np.log(
        b[:, None] + (1.0 - b[:, None]) * averaged_share(np.asarray(windows) / T[:, None])
    )
    best = ((expected[:, :, None] - seen) ** 2).sum(axis=1).argmin(axis=0)
    return b[best], T[best]
