"""Fit of a torque error model to an observer's readings without contact.

The readings must be held out: of motions that the model of dynamics and friction was not fitted on.
Each joint's constants maximise the likelihood of independent Gaussian samples,

    -1/2 sum_k log s_k + e_k^2 / s_k,    s_k = sum_m c_m f_km + unknown_k^2,    c_m >= 0

with the features f of `models.identification.torque_error_model`. Samples are not independent; that
costs efficiency, not consistency. The stated assumptions are not fitted.

A short log has few independent samples for five constants. Then the likelihood finds speed or
acceleration for an error that is there without either, and calls a slow motion exact. So each joint
has one independent sample more, of an error as large as its rms and with f = (1, 0, .. 0): a prior
with the information of one observation (Kass and Wasserman, A Reference Bayesian Test for Nested
Hypotheses and its Relationship to the Schwarz Criterion, 1995). As many samples of the log count
for one as its errors correlate,

    1 + 2 sum_d r(d),    r the autocorrelation about zero, d up to its first zero.

Of eight simulated motions of 10 s, the band of the UR10e's Coulomb-viscous law holds 46 to 99 % of
three other motions without it, and 87 to 100 % with it. In logs of minutes it changes little.

Joints' errors correlate where one motion moves all of them. Friction has the sign of the velocity
and ripples over position: one pass shows correlations of +-.9 that another posture reverses. So a
correlation counts as the arm's as far as motions agree on it. With r_m
that of each reading, m = 1 .. M > 1, their mean r and its standard error e,

    e^2 = sum_m (r_m - r)^2 / (M (M - 1)),    R_ij = r max(0, 1 - e^2 / r^2)

which is the share of r^2 that the motions have in common. The correlation of a single reading is
used as it is.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.identification.torque_error_model import (
    ACCELERATION_PART,
    CONSTANT_PART,
    LOAD_PART,
    NUM_FEATURES,
    PLAIN,
    REVERSAL_PART,
    SPEED_PART,
    STICTION_PART,
    Rest,
    TorqueErrorModel,
    averaged_share,
    initial_torque_error_state,
    torque_error_features,
)
from wrenchsight.models.numerics.arrays import Array, Flags, contiguous
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.signals.root_mean_square import rms

FEWEST_SAMPLES = 200  # of a joint, over all logs
MEAN_TIMES = (0.1, 0.3, 1.0, 3.0, 10.0)  # s, over which means are taken, for the correlated error
CORRELATION_TIMES = (0.01, 5.0)  # s, least and largest
MAX_CORRELATION = 0.98  # largest of two joints; all correlations are multiplied by it
_MAX_ERROR_SDS = 4.0  # sds, at which errors are clipped for the correlations
_LEAST_SHARE = 1e-4  # of a joint's rms error: the smallest constant
_BLOCK_SAMPLES = 256  # samples
DEFAULT_REST = Rest()
_LOG_COEFFICIENT_RANGE = 18.0  # natural logarithm of the range of a coefficient
_ROUGH_FIT_SAMPLES = 10_000  # samples that locate the highest likelihood roughly
_LARGEST_FACTOR = 10.0  # of a coefficient, on the one that alone explains all of the variance
_OTHERS_START = -3.0  # logarithm of the other coefficients, where the constant is nearly alone
_BOUND_TOLERANCE = 1e-6  # of a logarithm: nearer to its bound a coefficient is zero
_MIN_VARIANCE_SHARE = 1e-12  # of the mean square, added to each sample's variance
_LEAST_CONSTANT = 1e-12  # N m, of a joint without any error
_LEAST_SQUARE = 1e-300  # for a division
# Range of a product of variances: its logarithm is taken before it overflows.
_LEAST_PRODUCT, _LARGEST_PRODUCT = 1e-200, 1e200
# The grid of `_averaging`: correlation times, and shares of a variance that lasts.
_NUM_TIMES, _NUM_LASTING, _MAX_LASTING = 60, 51, 0.5
_DEFAULT_CORRELATION_TIME = 0.1  # s, where the logs are too short to show one
_LEAST_MEAN_SHARE = 1e-6  # of the variance of a mean, for its logarithm


@dataclass(frozen=True, eq=False)
class HeldOutReading:
    """An observer's reading of one log that its model was not fitted on.

    Attributes:
        tau_ext: (N, n) N m; without contact, so that all of it is error.
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
    readings: Sequence[HeldOutReading], least: ArrayLike = 0.0, rest: Rest = DEFAULT_REST
) -> TorqueErrorModel:
    """Returns the model that explains the readings best.

    First the variance of each joint's error as a sum of features times coefficients, by maximum
    likelihood: constant, speed^2, load^2, acceleration^2, reversal^2 (in this order), beside a
    fixed part. Then, from errors over these sds, how long they last and how joints go together.

    Args:
        readings: readings of one gain K_0.
        least: (n,) or () N m, a floor of `constant`: a simulation without noise has no error.
        rest: constants of stiction at rest, which the likelihood of motion hardly determines.

    Raises:
        ValueError: no reading, readings that disagree, too few samples.
    """
    if not readings:
        raise ValueError("torque error: no held-out reading")
    _check_readings(readings)
    K_0, n = readings[0].K_0, readings[0].tau_ext.shape[1]
    is_used = [reading.used & np.isfinite(reading.tau_ext).all(axis=1) for reading in readings]
    count = sum(int(rows.sum()) for rows in is_used)
    if count < FEWEST_SAMPLES:
        raise ValueError(f"torque error: {count} samples, expected {FEWEST_SAMPLES} or more")
    unit = unit_torque_error(n, K_0, rest)
    # Of each reading (N, n, NUM_FEATURES): those of the five coefficients, then STICTION_PART.
    features = [
        features_along(unit, reading)[rows] for reading, rows in zip(readings, is_used, strict=True)
    ]
    errors = [reading.tau_ext[rows] for reading, rows in zip(readings, is_used, strict=True)]
    coefficients = _coefficients(features, errors)
    size = rms(np.concatenate(errors))
    stated_floor = np.broadcast_to(np.asarray(least, float), (n,))
    floor = np.maximum(stated_floor, np.maximum(_LEAST_SHARE * size, _LEAST_CONSTANT))
    constant = np.maximum(np.sqrt(coefficients[:, CONSTANT_PART]), floor)
    coefficients[:, CONSTANT_PART] = constant**2  # with the floor from here on
    scaled: list[Array] = []  # errors over their sds, of each reading
    for error, f in zip(errors, features, strict=True):
        fitted = (f[..., :STICTION_PART] * coefficients).sum(axis=-1)
        sd = np.sqrt(fitted + f[..., STICTION_PART])
        scaled.append(np.clip(error / sd, -_MAX_ERROR_SDS, _MAX_ERROR_SDS))
    lasting, correlation_time = _averaging(scaled, readings[0].time_step)
    roots = np.sqrt(coefficients)
    return TorqueErrorModel(
        constant=constant,
        speed=roots[:, SPEED_PART],
        load=roots[:, LOAD_PART],
        acceleration=roots[:, ACCELERATION_PART],
        reversal=roots[:, REVERSAL_PART],
        correlation=_correlation(scaled),
        correlation_time=correlation_time,
        lasting=lasting,
        fitted_speed=_largest([reading.v for reading in readings], is_used),
        fitted_load=_largest([reading.transmitted for reading in readings], is_used),
        K_0=K_0,
        resolution=np.max([reading.resolution for reading in readings], axis=0),
        rest_time=rest.time,
        reach=rest.reach,
        resting_only=rest.only,
    )


def _check_readings(readings: Sequence[HeldOutReading]) -> None:
    """Raises ValueError for readings that disagree in shape or gain."""
    n, K_0 = readings[0].tau_ext.shape[1], readings[0].K_0
    for reading in readings:
        shapes = {array.shape for array in (reading.tau_ext, reading.q, reading.v)}
        shapes.add(reading.transmitted.shape)
        if shapes != {(len(reading.used), n)} or not np.array_equal(reading.K_0, K_0):
            raise ValueError("torque error: readings disagree in shape or K_0")


def _largest(signals: Sequence[Array], used: Sequence[Flags]) -> Array:
    """(n,) largest magnitude of the signals (N, n) over the rows that are used."""
    largest = [np.abs(values[rows]).max(axis=0) for values, rows in zip(signals, used, strict=True)]
    return np.asarray(np.max(largest, axis=0))


def unit_torque_error(n: int, K_0: Array, rest: Rest = DEFAULT_REST) -> TorqueErrorModel:
    """A model of which only the constants that turn motion into features and rest are used."""
    return TorqueErrorModel(
        **PLAIN | {"K_0": K_0},
        constant=np.ones(n),
        correlation=np.eye(n),
        rest_time=rest.time,
        reach=rest.reach,
        resting_only=rest.only,
    )


def features_along(unit: TorqueErrorModel, reading: HeldOutReading) -> Array:
    """(N, n, NUM_FEATURES) features of the variance along a reading."""
    N, n = reading.q.shape
    features = np.empty((N, n, NUM_FEATURES))
    q, v, load = contiguous(reading.q, reading.v, reading.transmitted)
    table = unit.table(reading.friction, reading.time_step, reading.K_0, reading.resolution)
    torque_error_features(table, initial_torque_error_state(n), q, v, load, features)
    return features


def _coefficients(features: Sequence[Array], errors: Sequence[Array]) -> Array:
    """(n, STICTION_PART) most likely variances per unit of a feature, of each joint.

    Args:
        features: (N, n, NUM_FEATURES) of each reading; STICTION_PART, the last, counts as it is.
        errors: (N, n) N m of each reading.
    """
    F, e = np.concatenate(features), np.concatenate(errors)
    n = e.shape[1]
    coefficients = np.empty((n, STICTION_PART))
    for j in range(n):
        # With one independent sample more, as large as the rms: the module's prior.
        F_j, e_j = _with_a_prior(F[:, j], e[:, j], [error[:, j] for error in errors])
        coefficients[j] = most_likely(F_j, e_j)
    return coefficients


def _with_a_prior(F: Array, e: Array, errors: Sequence[Array]) -> tuple[Array, Array]:
    """Features (N, M) and errors (N,) of a joint, with the samples of the prior.

    Args:
        F, e: of all readings.
        errors: the same errors, reading by reading.
    """
    count = round(correlated_samples(errors))
    prior = np.zeros((count, F.shape[1]))
    prior[:, CONSTANT_PART] = 1.0
    rms = np.sqrt(np.mean(e**2))
    return np.vstack([F, prior]), np.concatenate([e, np.full(count, rms)])


def correlated_samples(errors: Sequence[Array]) -> float:
    """How many samples count for one that is independent of others, 1 or more.

    Args:
        errors: errors of one joint, (N_k,) of each reading.
    """
    longest = max(len(error) for error in errors)
    covariance = np.zeros(longest)
    for error in errors:
        spectrum = np.abs(np.fft.rfft(error, 2 * len(error))) ** 2  # twice the length: no wrap
        covariance[: len(error)] += np.fft.irfft(spectrum)[: len(error)]
    if not covariance[0] > 0.0:
        return 1.0
    r = covariance / covariance[0]
    crossings = np.flatnonzero(r <= 0.0)
    end = crossings[0] if crossings.size else longest
    return float(1.0 + 2.0 * r[1:end].sum())


class _Minimum(NamedTuple):
    """Least mean cost of one joint, and the logarithms of c / scale (M,) there."""

    value: float
    x: Array


def most_likely(F: Array, e: Array) -> Array:
    """Coefficients c (M,) of one joint, of the variance F[:, :M] c + F[:, M] of its errors.

    They are found as logarithms over a scale, c = scale exp(x): those of scale each explain an M-th
    of the errors' mean square.

    Args:
        F: (N, M + 1) features; the last is the part of the variance that is fixed, (N m)^2.
        e: (N,) N m, errors.
    """
    from scipy.optimize import minimize

    A, squares = np.ascontiguousarray(F[:, :-1]), e**2
    M = A.shape[1]
    mean_square = max(float(np.mean(squares)), _LEAST_SQUARE)
    mean_feature = np.maximum(A.mean(axis=0), _LEAST_SQUARE)
    fixed = F[:, -1] + _MIN_VARIANCE_SHARE * mean_square
    scale = mean_square / mean_feature / M
    # The upper one is _LARGEST_FACTOR times what explains all of the variance alone, scale M.
    bounds = [(-_LOG_COEFFICIENT_RANGE, np.log(_LARGEST_FACTOR * M))] * M

    def minimum_from(start: Array, step: int) -> _Minimum:
        """The minimum that is reached from a start, over every `step`-th sample."""
        rows = slice(None, None, step)
        part_A, part_fixed = np.ascontiguousarray(A[rows]), fixed[rows].copy()
        part_squares = squares[rows].copy()
        count = len(part_fixed)

        def cost(x: Array) -> tuple[float, Array]:
            """Minus the mean log likelihood, and its slope by x."""
            c, slope = scale * np.exp(x), np.empty(len(x))
            value = _minus_log_likelihood(part_A, part_fixed, part_squares, c, slope)
            return value / count, slope / count * c

        result = minimize(cost, start, jac=True, method="L-BFGS-B", bounds=bounds)
        return _Minimum(float(result.fun), result.x)

    # The cost is not convex: one start splits the variance evenly, one has the constant alone.
    even_split, constant_alone = np.zeros(M), np.full(M, _OTHERS_START)
    constant_alone[0] = 1.0
    # A part of many samples shows which minimum is the lower one, and about where it lies.
    step = max(1, len(e) // _ROUGH_FIT_SAMPLES)
    minima = [minimum_from(start, step) for start in (even_split, constant_alone)]
    x = min(minima, key=lambda minimum: minimum.value).x
    if step > 1:
        x = minimum_from(x, 1).x
    # A term that the likelihood pushed to its bound, or that no sample excited, is zero.
    is_inside = x > -_LOG_COEFFICIENT_RANGE + _BOUND_TOLERANCE
    is_determined = is_inside & (A.max(axis=0) > 0.0)
    return np.where(is_determined, scale * np.exp(x), 0.0)


@kernel
def _minus_log_likelihood(A: Array, fixed: Array, squares: Array, c: Array, slope: Array) -> float:
    """Writes the slope (M,) by c of the value returned, with s_k = fixed_k + A_k c:

        sum_k (log s_k + squares_k / s_k) / 2

    Args:
        A: (N, M), features.
        fixed: (N,) of the variance, (N m)^2, positive.
        squares: (N,) of the errors, (N m)^2.
        c: (M,).
        slope: (M,), written.
    """
    N, M = A.shape
    value, block_slope = 0.0, np.empty(M)
    slope[:] = 0.0
    for start in range(0, N, _BLOCK_SAMPLES):  # sums of sums: rounding does not grow with N
        block_slope[:] = 0.0
        # The sum of log s_k is `logarithms` and the logarithm of `product`.
        logarithms, ratios, product = 0.0, 0.0, 1.0
        for k in range(start, min(N, start + _BLOCK_SAMPLES)):
            s = fixed[k]
            for m in range(M):
                s += A[k, m] * c[m]
            inverse = 1.0 / s
            ratio = squares[k] * inverse
            ratios += ratio
            by_s = inverse - ratio * inverse  # twice the derivative by s_k
            for m in range(M):
                block_slope[m] += by_s * A[k, m]
            if _LEAST_PRODUCT < product * s < _LARGEST_PRODUCT:
                product *= s  # one logarithm for many: they are what takes the time
            else:
                logarithms += math.log(product)
                product = s
        value += logarithms + math.log(product) + ratios
        for m in range(M):
            slope[m] += 0.5 * block_slope[m]
    return 0.5 * value


def _correlation(scaled: Sequence[Array]) -> Array:
    """(n, n) correlation that the readings agree on, positive definite.

    It is multiplied by MAX_CORRELATION, so that it has an inverse even if two joints have equal
    errors. It is shrunk further if the correlations of pairs contradict each other.
    """
    correlations = np.stack(
        [_correlation_of_reading(errors) for errors in scaled if len(errors) > 0]
    )
    R = correlations.mean(axis=0)
    if len(correlations) > 1:
        variance_of_mean = correlations.var(axis=0, ddof=1) / len(correlations)
        R *= np.maximum(0.0, 1.0 - variance_of_mean / np.maximum(R**2, _LEAST_SQUARE))
    n = len(R)
    R[np.arange(n), np.arange(n)] = 1.0
    R *= MAX_CORRELATION / max(1.0, 1.0 - float(np.linalg.eigvalsh(R)[0]))
    R[np.arange(n), np.arange(n)] = 1.0
    return np.asarray(R)


def _correlation_of_reading(scaled: Array) -> Array:
    """(n, n) of one reading, about zero."""
    size = np.sqrt(np.maximum(np.mean(scaled**2, axis=0), _LEAST_SQUARE))
    R = (scaled / size).T @ (scaled / size) / len(scaled)
    return np.asarray(0.5 * (R + R.T))


def _averaging(scaled: Sequence[Array], time_step: float) -> tuple[Array, Array]:
    """Share of lasting error and correlation time in s, (n,) each, from means over MEAN_TIMES.

    The variance of means over tau s of errors of sd 1 is V(tau) = b + (1 - b) g(tau / T), with b
    what never averages out and g of `averaged_share`. It is fitted by least squares of the
    logarithm on a grid. Windows longer than half of the shortest log are left out; without any,
    nothing lasts and errors are correlated over _DEFAULT_CORRELATION_TIME.

    Args:
        scaled: (N, n) of each log, errors over their sds, sample by sample.
        time_step: s.
    """
    n = scaled[0].shape[1]
    mean_square = np.mean(np.vstack(scaled) ** 2, axis=0)
    shortest = min(len(errors) for errors in scaled)
    windows = [w for w in MEAN_TIMES if 1 < round(w / time_step) <= shortest // 2]
    if not windows:
        return np.zeros(n), np.full(n, _DEFAULT_CORRELATION_TIME)
    shares = []
    for window in windows:  # whole ones of each log, one after another
        window_samples = round(window / time_step)
        means = np.concatenate(
            [
                errors[: len(errors) // window_samples * window_samples]
                .reshape(-1, window_samples, n)
                .mean(axis=1)
                for errors in scaled
            ]
        )
        shares.append(np.mean(means**2, axis=0) / np.maximum(mean_square, _LEAST_SQUARE))
    log_shares = np.log(np.maximum(shares, _LEAST_MEAN_SHARE))  # (windows, n)
    times = np.geomspace(*CORRELATION_TIMES, _NUM_TIMES)
    lasting = np.linspace(0.0, _MAX_LASTING, _NUM_LASTING)
    # All pairs of b and T, one after another: (pairs,), and (pairs, windows) expected of each.
    b, T = (x.ravel() for x in np.meshgrid(lasting, times, indexing="ij"))
    expected = np.log(
        b[:, None] + (1.0 - b[:, None]) * averaged_share(np.asarray(windows) / T[:, None])
    )
    nearest = ((expected[:, :, None] - log_shares) ** 2).sum(axis=1).argmin(axis=0)
    return b[nearest], T[nearest]
