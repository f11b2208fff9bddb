"""Kernels of a fixed-interval smoother: a Kalman filter forward, its adjoint backward.

The equations are those of `models.estimation.smoothing`; z = [p, F, x, beta] of size M = 3 n + 6
has the parts of `models.observers.kalman_observer`, and beta. Where F is thought to change, its
noise grows, and the adjoint tells what speaks for such a change (`models.observers.force_changes`).

A torque d(t) of one joint that the model does not have changes what is read by some dF(t). Both
passes are linear in what was seen, and the gains do not depend on it. So dF follows from the same
two passes over d alone (`response_log`).
"""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.kernel import kernel
from wrenchsight.models.observers.kalman_kernels import (
    JUMP_F,
    KEPT_F,
    NOISE_F,
    PERIOD,
    ROUND,
    ErrorParts,
    KalmanTable,
    error_parts,
    fade,
    renew,
    sample_momentum,
    split_table,
)
from wrenchsight.models.observers.observer import CTV, GRAVITY, TAU_F, TAU_J
from wrenchsight.models.rigid_body.small_matrices import (
    factorise_in_place,
    factorise_with_floor,
    solve_factorised,
    solve_lower,
)
from wrenchsight.models.views import copy_to, copy_whole

# Kinds of a sample: whether it was measured, and whether the coming period is known.
_MEASURED, _KNOWN, NUM_KINDS = range(3)
# Rows of what is kept of a period: s and b, N m, a_x, and what the sample missed z by, N m s.
_SMOOTH, _SLOW, _KEEPS, _MISS, NUM_PERIOD = range(5)
# Log of how many times likelier all is that was seen, if F changes by its live prior, and at best:
# by any change of F that this prior bounds, by any change of the momentum.
LIKELIER, FORCE_GAIN, BLOW_GAIN, NUM_EVIDENCE = range(4)


class FilterState(NamedTuple):
    """Where the forward pass stands.

    Attributes:
        z, P: (M,), (M, M).
        running: (1,) whether there was a sample before.
        before: (n,) s of the sample before.
    """

    z: Array
    P: Array
    running: Flags
    before: Array


class FilterLog(NamedTuple):
    """What the forward pass leaves of N samples.

    Attributes:
        z, P: (N, M), (N, M, M) before a sample is measured.
        period: (N, NUM_PERIOD, n).
        kinds: (N, NUM_KINDS).
    """

    z: Array
    P: Array
    period: Array
    kinds: Flags


@kernel
def _gain(
    P: Array,
    rounding: Array,
    L: Array,
    K: Array,
) -> None:
    """K = P H^T S^-1 with S = H P H^T + R, whose Cholesky is left in L (n, n), lower."""
    n = L.shape[0]
    for i in range(n):
        for j in range(i + 1):
            L[i, j] = P[i, j] + (rounding[i] if i == j else 0.0)
    factorise_with_floor(L, n, rounding)
    for a in range(P.shape[0]):
        for i in range(n):
            K[a, i] = P[a, i]
        solve_factorised(L, n, K[a])


@kernel
def _step_matrix(t: KalmanTable, kept_drift: float, J: Array, period: Array, A: Array) -> None:
    """Writes what is not 1 of A (M, M): its first n rows beyond p, and the other diagonals."""
    n = J.shape[1]
    T = t.numbers[PERIOD]
    for i in range(n):
        for a in range(6):
            A[i, n + a] = T * J[a, i]
        A[i, n + 6 + i] = T * period[_SMOOTH, i]
        A[i, 2 * n + 6 + i] = T * period[_SLOW, i]
        A[2 * n + 6 + i, 2 * n + 6 + i] = kept_drift
    for a in range(6):
        A[n + a, n + a] = t.sixes[KEPT_F, a]


@kernel
def forward_log(
    table: Array,
    kept_drift: float,
    state: FilterState,
    signals: Array,
    J: Array,
    changes: Array,
    log: FilterLog,
) -> None:
    """The filter over N samples.

    Args:
        table: KalmanObserver.table.
        kept_drift: share of the slow part of the torque error that outlasts a period.
        state: goes on from it.
        signals, J: (N, NUM_SIGNALS, n), (N, 6, n).
        changes: (N,) live prior's variances that F gains after a sample, beside its walk.
        log: written.
    """
    z, P, running, before = state
    z_log, P_log, period, kinds = log
    N, _, n = signals.shape
    M = 3 * n + 6
    t = split_table(table, n)
    numbers, sixes, rounding, T = t.numbers, t.sixes, t.joints[ROUND], t.numbers[PERIOD]
    L, K, A = np.zeros((n, n)), np.empty((M, n)), np.eye(M)
    arrived, white = np.empty(n), np.empty(n)
    for k in range(N):
        own = signals[k]
        copy_to(z_log[k], z)
        copy_whole(P_log[k], P)
        seen, known = True, True
        for i in range(n):
            arrived[i] = sample_momentum(numbers, own, i)
            u = own[TAU_J, i] + own[CTV, i] - own[GRAVITY, i] - own[TAU_F, i]
            seen = seen and np.isfinite(arrived[i])
            known = known and np.isfinite(arrived[i] + u)
            for a in range(6):
                known = known and np.isfinite(J[k, a, i])
            period[k, _MISS, i] = 0.0
        measured = seen and running[0]
        kinds[k, _MEASURED], kinds[k, _KNOWN] = measured, known
        if measured:
            _gain(P, rounding, L, K)
            above = P[:n].copy()
            for i in range(n):
                period[k, _MISS, i] = arrived[i] - z[i]
            for a in range(M):
                for i in range(n):
                    z[a] += K[a, i] * period[k, _MISS, i]
            for a in range(M):
                for b in range(a + 1):
                    for i in range(n):
                        P[a, b] -= K[a, i] * above[i, b]
                    P[b, a] = P[a, b]
        else:
            for i in range(n):
                z[i] = arrived[i] if np.isfinite(arrived[i]) else 0.0
                P[i], P[:, i] = 0.0, 0.0
                P[i, i] = rounding[i]
        parts = ErrorParts(period[k, _SMOOTH], white, period[k, _SLOW], period[k, _KEEPS])
        error_parts(t, before, own, parts)
        running[0] = known
        if not known:
            for a in range(6):
                P[n + a, n + a] += sixes[NOISE_F, a] + changes[k] * sixes[JUMP_F, a]
            continue
        renew(period[k, _KEEPS], t.mixing, z, P)
        _step_matrix(t, kept_drift, J[k], period[k], A)
        _add_rows(A, n, z.reshape(M, 1))
        for a in range(n, M):
            z[a] *= A[a, a]
        for i in range(n):
            z[i] += T * (own[TAU_J, i] + own[CTV, i] - own[GRAVITY, i] - own[TAU_F, i])
        _congruent(A, n, P)
        for i in range(n):
            P[i, i] += white[i]
            P[2 * n + 6 + i, 2 * n + 6 + i] += 1.0 - kept_drift * kept_drift
        for a in range(6):
            P[n + a, n + a] += sixes[NOISE_F, a] + changes[k] * sixes[JUMP_F, a]


@kernel
def _add_rows(A: Array, n: int, x: Array) -> None:
    """x <- A x in place, (M, columns), but for the diagonal: below n rows A has no more."""
    for i in range(n):
        for b in range(x.shape[1]):
            total = x[i, b]
            for c in range(n, x.shape[0]):
                if A[i, c] != 0.0:
                    total += A[i, c] * x[c, b]
            x[i, b] = total


@kernel
def _congruent(A: Array, n: int, P: Array) -> None:
    """P <- A P A^T, in place."""
    _add_rows(A, n, P)
    _add_rows(A, n, P.T)
    for a in range(P.shape[0]):
        for b in range(a + 1):
            P[a, b] = 0.5 * (P[a, b] + P[b, a]) * A[a, a] * A[b, b]
            P[b, a] = P[a, b]


@kernel
def backward_log(
    table: Array,
    kept_drift: float,
    log: FilterLog,
    J: Array,
    evidence: Array,
    wrench: Array,
    covariance: Array,
) -> None:
    """Reads the first rows of N that `forward_log` has left, with all N.

    Args:
        evidence: (N, NUM_EVIDENCE), written: what a change after a sample would explain.
        wrench, covariance: (K, 6), (K, 6, 6) with K at most N, written.
        others: as `forward_log`.
    """
    z_log, P_log, period, kinds = log
    N, _, n = period.shape
    M = 3 * n + 6
    t = split_table(table, n)
    rounding = t.joints[ROUND]
    L, K, A = np.zeros((n, n)), np.empty((M, n)), np.eye(M)
    small, large = np.zeros(M), np.zeros((M, M))  # lambda, Lambda
    inverse, product = np.empty((n, n)), np.empty((M, n))
    for k in range(N - 1, -1, -1):
        _weigh_change(small, large, t.sixes[JUMP_F], n, evidence[k])
        if kinds[k, _KNOWN]:
            _step_matrix(t, kept_drift, J[k], period[k], A)
            _transposed(A, n, small.reshape(M, 1))  # lambda <- A^T lambda, Lambda <- A^T Lambda A
            _transposed(A, n, large.T)
            _transposed(A, n, large)
            fade(period[k, _KEEPS], small, large)
        else:  # the momentum of the next sample has nothing of this one's
            small[:n], large[:n], large[:, :n] = 0.0, 0.0, 0.0
        if kinds[k, _MEASURED]:
            _gain(P_log[k], rounding, L, K)
            for i in range(n):
                for j in range(n):
                    inverse[i, j] = 1.0 if i == j else 0.0
                solve_factorised(L, n, inverse[i])
            for i in range(n):
                total = 0.0
                for a in range(M):
                    total -= K[a, i] * small[a]
                for j in range(n):
                    total -= inverse[i, j] * period[k, _MISS, j]
                product[0, i] = total
            for i in range(n):
                small[i] += product[0, i]
            for a in range(M):
                for i in range(n):
                    total = 0.0
                    for b in range(M):
                        total += large[a, b] * K[b, i]
                    product[a, i] = total
            for a in range(M):
                for i in range(n):
                    large[a, i] -= product[a, i]
            for i in range(n):
                for b in range(M):
                    total = 0.0
                    for a in range(M):
                        total += K[a, i] * large[a, b]
                    product[b, i] = total
            for i in range(n):
                for b in range(M):
                    large[i, b] -= product[b, i]
                for j in range(n):
                    large[i, j] += inverse[i, j]
            for a in range(M):
                for b in range(a):
                    large[a, b] = 0.5 * (large[a, b] + large[b, a])
                    large[b, a] = large[a, b]
        else:
            small[:n], large[:n], large[:, :n] = 0.0, 0.0, 0.0
        if k < wrench.shape[0]:
            _smoothed(z_log[k], P_log[k], small, large, n, wrench[k], covariance[k])


@kernel
def response_log(
    table: Array,
    kept_drift: float,
    log: FilterLog,
    J: Array,
    torque: Array,
    error: Array,
    response: Array,
) -> None:
    """What the two passes read of torques that the model does not have, one joint at a time.

    Args:
        log: of `forward_log`, over the same N samples.
        torque: (N, C, n) N m, held for a period. Each joint's is a case of its own: c n + j for
            torque[:, c, j].
        error: (M, C n) of z before the first sample; changed to that before the first one that is
            not in `response`.
        response: (K, 6, C n) with K at most N, written: dF.
        others: as `forward_log`.
    """
    _, P_log, period, kinds = log
    N, _, n = period.shape
    M, columns = P_log.shape[1], error.shape[1]
    t = split_table(table, n)
    rounding, T, ready = t.joints[ROUND], t.numbers[PERIOD], response.shape[0]
    L, K, A = np.zeros((n, n)), np.empty((M, n)), np.eye(M)
    seen = np.empty((N, n + 6, columns))
    own, small = error.copy(), np.zeros((M, columns))
    for k in range(N):
        if k == ready:
            copy_whole(error, own)
        copy_whole(seen[k], own[: n + 6])
        if kinds[k, _MEASURED]:
            _gain(P_log[k], rounding, L, K)
            for a in range(M):
                for i in range(n):
                    for c in range(columns):
                        own[a, c] -= K[a, i] * seen[k, i, c]
        else:
            own[:n] = 0.0
        if not kinds[k, _KNOWN]:
            continue
        for i in range(n):
            own[n + 6 + i] *= period[k, _KEEPS, i]
        _step_matrix(t, kept_drift, J[k], period[k], A)
        _add_rows(A, n, own)
        for c in range(columns):
            own[c % n, c] -= T * torque[k, c // n, c % n]
        for a in range(n, M):
            own[a] *= A[a, a]
    if ready == N:
        copy_whole(error, own)
    back = np.empty(n)
    for k in range(N - 1, -1, -1):
        if kinds[k, _KNOWN]:
            _step_matrix(t, kept_drift, J[k], period[k], A)
            _transposed(A, n, small)
            for i in range(n):
                small[n + 6 + i] *= period[k, _KEEPS, i]
        if kinds[k, _MEASURED]:
            _gain(P_log[k], rounding, L, K)
            for c in range(columns):
                copy_to(back, seen[k, :n, c])
                solve_factorised(L, n, back)
                for i in range(n):
                    for a in range(M):
                        back[i] -= K[a, i] * small[a, c]
                small[:n, c] += back
        else:
            small[:n] = 0.0
        if k < ready:
            for a in range(6):
                response[k, a] = seen[k, n + a]
                for b in range(M):
                    for c in range(columns):
                        response[k, a, c] -= P_log[k, n + a, b] * small[b, c]


@kernel
def _weigh_change(
    small: Array,
    large: Array,
    jump: Array,
    n: int,
    evidence: Array,
) -> None:
    """Writes what a change of F, of variance diag(jump), or of any p explains, before a sample.

    The equations are those of `wrenchsight.models.observers.force_changes`.
    """
    evidence[:] = 0.0
    L, left = np.empty((6, 6)), np.empty(6)
    for a in range(6):
        left[a] = np.sqrt(jump[a]) * small[n + a]
        for b in range(a + 1):
            L[a, b] = np.sqrt(jump[a] * jump[b]) * large[n + a, n + b]
        L[a, a] += 1.0
    if factorise_in_place(L, 6, 0.5):
        solve_lower(L, 6, left)
        for a in range(6):
            evidence[FORCE_GAIN] += 0.5 * left[a] * left[a]
            evidence[LIKELIER] -= np.log(L[a, a])
        evidence[LIKELIER] += evidence[FORCE_GAIN]
    M, blow = large[:n, :n].copy(), small[:n].copy()
    if factorise_in_place(M, n, 0.0):
        solve_lower(M, n, blow)
        for i in range(n):
            evidence[BLOW_GAIN] += 0.5 * blow[i] * blow[i]


@kernel
def _transposed(A: Array, n: int, x: Array) -> None:
    """x <- A^T x, (M, columns) in place; below its first n rows A is diagonal."""
    for b in range(n, x.shape[0]):
        for c in range(x.shape[1]):
            total = A[b, b] * x[b, c]
            for i in range(n):
                if A[i, b] != 0.0:
                    total += A[i, b] * x[i, c]
            x[b, c] = total


@kernel
def _smoothed(
    z: Array,
    P: Array,
    small: Array,
    large: Array,
    n: int,
    wrench: Array,
    covariance: Array,
) -> None:
    """F and its covariance given all, from what was known before a sample and the adjoint."""
    M = z.shape[0]
    half = np.empty((6, M))
    for a in range(6):
        total = z[n + a]
        for b in range(M):
            total -= P[n + a, b] * small[b]
            half[a, b] = 0.0
            for c in range(M):
                half[a, b] += P[n + a, c] * large[c, b]
        wrench[a] = total
    for a in range(6):
        for b in range(a + 1):
            total = P[n + a, n + b]
            for c in range(M):
                total -= half[a, c] * P[c, n + b]
            covariance[a, b] = total
            covariance[b, a] = total
