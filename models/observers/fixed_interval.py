"""Kernels of a fixed-interval smoother: a Kalman filter forward, its adjoint backward.

The equations are those of `models.estimation.smoothing`. z = [p, F, x, beta] of size M = 3 n + 6
has the states of `models.observers.kalman_observer`, and beta, in their `state_places`. Where F may
change, its noise grows. The adjoint gives the evidence for such a change
(`models.observers.force_changes`).

A torque d(t) of one joint that the model does not have changes the reading by some dF(t). Both
passes are linear in the samples, and the gains do not depend on them. So dF follows from the same
two passes over d alone (`response_log`).
"""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.small_matrices import (
    factorise_in_place,
    factorise_with_floor,
    solve_factorised,
    solve_lower,
)
from wrenchsight.models.observers.kalman_kernels import (
    DECAY_F,
    JUMP_F,
    NOISE_F,
    PERIOD,
    ROUND,
    ErrorParts,
    KalmanTable,
    error_parts,
    fade,
    renew,
    sample_momentum,
    state_places,
)
from wrenchsight.models.observers.observer import CTV, GRAVITY, TAU_F, TAU_J

# Kinds of a sample: whether it was measured, and whether the coming period is known.
_MEASURED, _KNOWN, NUM_KINDS = range(3)
# Rows of a period: s and b, N m, a_x, and the innovation of the sample, N m s.
_SMOOTH, _SLOW, _DECAY, _MISS, NUM_PERIOD = range(5)
# Log of how many times likelier all samples are if F changes by its live prior; and at best, by any
# change of F that this prior bounds, and by any change of the momentum.
LIKELIER, FORCE_GAIN, BLOW_GAIN, NUM_EVIDENCE = range(4)


class IntervalModel(NamedTuple):
    """The constants of both passes, and the Jacobians of N samples.

    Attributes:
        table: of the Kalman observer.
        drift_decay: share of the slow part of the torque error that outlasts a period.
        J: (N, 6, n), rotation first, axes of W.
    """

    table: KalmanTable
    drift_decay: float
    J: Array


class FilterState(NamedTuple):
    """The state of the forward pass.

    Attributes:
        z, P: (M,), (M, M).
        running: (1,) whether the period before the sample is known; not so before a first sample.
        previous_smooth: (n,) s of the sample before.
    """

    z: Array
    P: Array
    running: Flags
    previous_smooth: Array


class FilterLog(NamedTuple):
    """The results of the forward pass over N samples.

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
    """Writes K = P H^T S^-1 with S = H P H^T + R, and the Cholesky factor L (n, n) of S, lower."""
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
def _step_matrix(t: KalmanTable, drift_decay: float, J: Array, period: Array, A: Array) -> None:
    """Writes the entries of A (M, M) that depend on the sample: A is 1 elsewhere on its diagonal.

    They are the first n rows beyond p, and the diagonal of F and beta.
    """
    n = J.shape[1]
    at = state_places(n)
    T = t.numbers[PERIOD]
    for i in range(n):
        for a in range(6):
            A[i, at.force + a] = T * J[a, i]
        A[i, at.smooth + i] = T * period[_SMOOTH, i]
        A[i, at.slow + i] = T * period[_SLOW, i]
        A[at.slow + i, at.slow + i] = drift_decay
    for a in range(6):
        A[at.force + a, at.force + a] = t.sixes[DECAY_F, a]


@kernel
def forward_log(
    model: IntervalModel, signals: Array, changes: Array, state: FilterState, log: FilterLog
) -> None:
    """Runs the filter over N samples.

    A sample that is not finite, or the first after a period that is not known (`state.running`),
    is not measured: it starts the momentum anew.

    Args:
        model: constants, and J of the same N samples.
        signals: (N, NUM_SIGNALS, n), rows as in `models.observers.observer`.
        changes: (N,) live prior's variances that F gains after a sample, beside its walk.
        state: before the first sample; changed to that before the one after the last.
        log: written: z and P before each sample, parts of the error and innovation (`period`), and
            whether the sample is measured and the period after it known (`kinds`).
    """
    z, P, running, period = state.z, state.P, state.running, log.period
    drift_decay = model.drift_decay
    N, _, n = signals.shape
    at = state_places(n)
    M = at.end
    t = model.table
    sixes, rounding, T = t.sixes, t.joints[ROUND], t.numbers[PERIOD]
    L, K, A = np.zeros((n, n)), np.empty((M, n)), np.eye(M)  # factor of S, gain, step over a period
    arrived, white = np.empty(n), np.empty(n)
    for k in range(N):
        sample, miss = signals[k], period[k, _MISS]
        log.z[k], log.P[k] = z, P
        is_finite, is_known = _arrive(t.numbers, sample, model.J[k], arrived)
        is_measured = is_finite and running[0]
        log.kinds[k, _MEASURED], log.kinds[k, _KNOWN] = is_measured, is_known
        # Over the sample.
        for i in range(n):
            miss[i] = arrived[i] - z[i] if is_measured else 0.0
        if is_measured:
            _gain(P, rounding, L, K)
            _take_innovation(K, miss, z, P)
        else:
            _restart_momentum(arrived, rounding, z, P)
        # Over the period after it: z <- A z + T u, P <- A P A^T + noise. x fades and gets its noise
        # first, in `renew`: A is the rest of the step. The parts are rows of the log, which so
        # gets them.
        parts = ErrorParts(
            smooth=period[k, _SMOOTH], white=white, slow=period[k, _SLOW], decay=period[k, _DECAY]
        )
        error_parts(t, state.previous_smooth, sample, parts)
        running[0] = is_known
        if is_known:
            renew(period[k, _DECAY], t.mixing, z, P)
            _step_matrix(t, drift_decay, model.J[k], period[k], A)
            _add_rows(A, n, z.reshape(M, 1))  # A z but for A's diagonal
            for a in range(n, M):
                z[a] *= A[a, a]
            for i in range(n):
                z[i] += T * _modelled_torque(sample, i)
            _congruent(A, n, P)  # P <- A P A^T, all of it
            for i in range(n):
                P[i, i] += white[i]
                P[at.slow + i, at.slow + i] += 1.0 - drift_decay * drift_decay
        # Of a period that is not known, too: F goes on changing.
        for a in range(6):
            P[at.force + a, at.force + a] += sixes[NOISE_F, a] + changes[k] * sixes[JUMP_F, a]


@kernel
def _modelled_torque(sample: Array, i: int) -> float:
    """The torque of joint i that the model knows, N m: it changes the momentum."""
    u: float = sample[TAU_J, i] + sample[CTV, i] - sample[GRAVITY, i] - sample[TAU_F, i]
    return u


@kernel
def _arrive(numbers: Array, sample: Array, J: Array, arrived: Array) -> tuple[bool, bool]:
    """Writes the measured momentum (n,).

    Args:
        numbers: of KalmanTable.
        sample: (NUM_SIGNALS, n).
        J: (6, n).

    Returns:
        Whether it is finite; and whether the coming period is known.
    """
    is_finite, is_known = True, True
    for i in range(arrived.shape[0]):
        arrived[i] = sample_momentum(numbers, sample, i)
        is_finite = is_finite and np.isfinite(arrived[i])
        is_known = is_known and np.isfinite(arrived[i] + _modelled_torque(sample, i))
        for a in range(6):
            is_known = is_known and np.isfinite(J[a, i])
    return is_finite, is_known


@kernel
def _take_innovation(K: Array, miss: Array, z: Array, P: Array) -> None:
    """z <- z + K miss, P <- P - K H P, in place; K (M, n), the innovation `miss` (n,)."""
    M, n = K.shape
    P_rows = P[:n].copy()
    for a in range(M):
        for i in range(n):
            z[a] += K[a, i] * miss[i]
    for a in range(M):
        for b in range(a + 1):
            for i in range(n):
                P[a, b] -= K[a, i] * P_rows[i, b]
            P[b, a] = P[a, b]


@kernel
def _restart_momentum(arrived: Array, rounding: Array, z: Array, P: Array) -> None:
    """Sets the momentum in z, P to the measured one (n,), or to zero where that is not finite."""
    for i in range(arrived.shape[0]):
        z[i] = arrived[i] if np.isfinite(arrived[i]) else 0.0
        P[i], P[:, i] = 0.0, 0.0
        P[i, i] = rounding[i]


@kernel
def _add_rows(A: Array, n: int, x: Array) -> None:
    """x <- A x in place, (M, columns), without A's diagonal: below n rows A is diagonal."""
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


class _Adjoint(NamedTuple):
    """The adjoint of the filter's state.

    Attributes:
        vector: lambda (M,).
        matrix: Lambda (M, M).
    """

    vector: Array
    matrix: Array


@kernel
def backward_log(
    model: IntervalModel, log: FilterLog, evidence: Array, wrench: Array, covariance: Array
) -> None:
    """Estimates the wrench of the first samples from all N of `forward_log`.

    Backward goes the adjoint of the filter's state z: lambda (M,) and Lambda (M, M) are what the
    samples from k on say of z before sample k, and z - P lambda, P - P Lambda P what all samples
    say of it.

    Args:
        model, log: of `forward_log`, over the same N samples.
        evidence: (N, NUM_EVIDENCE), written: evidence for a change after a sample.
        wrench, covariance: (num_ready, 6), (num_ready, 6, 6), written; num_ready is at most N.
    """
    period, kinds = log.period, log.kinds
    N, _, n = period.shape
    M = state_places(n).end
    t = model.table
    rounding = t.joints[ROUND]
    L, K, A = np.zeros((n, n)), np.empty((M, n)), np.eye(M)
    adjoint = _Adjoint(np.zeros(M), np.zeros((M, M)))
    vector, matrix = adjoint.vector, adjoint.matrix
    S_inverse, scratch = np.empty((n, n)), np.empty((M, n))
    for k in range(N - 1, -1, -1):
        # Of the samples after k alone: a change comes between k and them.
        _weigh_change(adjoint, t.sixes[JUMP_F], n, evidence[k])
        if kinds[k, _KNOWN]:
            _step_matrix(t, model.drift_decay, model.J[k], period[k], A)
            # lambda <- A^T lambda, Lambda <- A^T Lambda A: A^T is applied to the rows, then to the
            # columns. Forward `renew` fades x before A, so backward it fades after A^T.
            _transposed(A, n, vector.reshape(M, 1))
            _transposed(A, n, matrix.T)
            _transposed(A, n, matrix)
            fade(period[k, _DECAY], vector, matrix)
        else:
            _forget_momentum(adjoint, n)
        if kinds[k, _MEASURED]:
            _gain(log.P[k], rounding, L, K)
            for i in range(n):
                for j in range(n):
                    S_inverse[i, j] = 1.0 if i == j else 0.0
                solve_factorised(L, n, S_inverse[i])  # a column, and a row, as S is symmetric
            _take_adjoint(K, S_inverse, period[k, _MISS], adjoint, scratch)
        else:
            _forget_momentum(adjoint, n)
        if k < wrench.shape[0]:
            _smoothed(log.z[k], log.P[k], adjoint, wrench[k], covariance[k])


@kernel
def _forget_momentum(adjoint: _Adjoint, n: int) -> None:
    """Clears what later samples say of the momentum: theirs has nothing of the one before a gap."""
    adjoint.vector[:n], adjoint.matrix[:n], adjoint.matrix[:, :n] = 0.0, 0.0, 0.0


@kernel
def _take_adjoint(
    K: Array, S_inverse: Array, miss: Array, adjoint: _Adjoint, scratch: Array
) -> None:
    """Takes the adjoint over a measurement, in place.

        lambda <- lambda - H^T (K^T lambda + S^-1 miss)
        Lambda <- (1 - K H)^T Lambda (1 - K H) + H^T S^-1 H

    H picks the first n states, the momentum: of Lambda K H only the first n columns are not zero.

    Args:
        K: (M, n) gain.
        S_inverse: (n, n) inverse covariance of the innovation.
        miss: (n,) innovation, N m s.
        adjoint: lambda (M,) and Lambda (M, M), changed.
        scratch: (M, n), overwritten: memory for the products.
    """
    vector, matrix = adjoint.vector, adjoint.matrix
    M, n = K.shape
    # All of K^T lambda before lambda changes.
    vector_step = scratch[0]
    for i in range(n):
        total = 0.0
        for a in range(M):
            total -= K[a, i] * vector[a]
        for j in range(n):
            total -= S_inverse[i, j] * miss[j]
        vector_step[i] = total
    for i in range(n):
        vector[i] += vector_step[i]
    # Lambda <- Lambda (1 - K H).
    for a in range(M):
        for i in range(n):
            total = 0.0
            for b in range(M):
                total += matrix[a, b] * K[b, i]
            scratch[a, i] = total
    for a in range(M):
        for i in range(n):
            matrix[a, i] -= scratch[a, i]
    # Lambda <- (1 - K H)^T Lambda + H^T S^-1 H; then made symmetric, which rounding has lost.
    for i in range(n):
        for b in range(M):
            total = 0.0
            for a in range(M):
                total += K[a, i] * matrix[a, b]
            scratch[b, i] = total
    for i in range(n):
        for b in range(M):
            matrix[i, b] -= scratch[b, i]
        for j in range(n):
            matrix[i, j] += S_inverse[i, j]
    for a in range(M):
        for b in range(a):
            matrix[a, b] = 0.5 * (matrix[a, b] + matrix[b, a])
            matrix[b, a] = matrix[a, b]


@kernel
def response_log(
    model: IntervalModel, log: FilterLog, torque: Array, error: Array, response: Array
) -> None:
    """Computes the response of both passes to torques that the model does not have, by joint.

    Args:
        model, log: of `forward_log`, over the same N samples.
        torque: (N, C, n) N m, held for a period. Each joint's is a case of its own: c n + j for
            torque[:, c, j].
        error: (M, C n) of z before the first sample; changed to that before the first one that is
            not in `response`.
        response: (num_ready, 6, C n), written: dF; num_ready is at most N.
    """
    N, num_ready, n = len(log.kinds), len(response), log.period.shape[2]
    errors = np.empty((N, state_places(n).smooth, error.shape[1]))  # of momentum and F
    _forward_response(model, log, torque, error, num_ready, errors)
    _backward_response(model, log, errors, response)


@kernel
def _forward_response(
    model: IntervalModel,
    log: FilterLog,
    torque: Array,
    error: Array,
    num_ready: int,
    errors: Array,
) -> None:
    """Writes what the torques change in the filter's predictions: dz, with the log's gains.

        dz <- dz - K dp                 a sample is measured; dp is dz's momentum
        dz <- A dz - T torque           a period goes by

    A column of dz, or case, is the torque of one joint alone. The steps are those of `forward_log`
    on z, in its order: x fades, the rows of A are added, then comes A's diagonal. A restart leaves
    no error of p.

    Args:
        model, log: of `forward_log`.
        torque: (N, C, n) N m, held for a period; torque[:, c, j] is case c n + j.
        error: (M, C n) dz before the first sample; changed to that before sample `num_ready`.
        num_ready: at most N.
        errors: (N, n + 6, C n), written: momentum and F of dz before each sample.
    """
    N, _, n = log.period.shape
    at = state_places(n)
    M, num_cases = error.shape
    table = model.table
    T, rounding = table.numbers[PERIOD], table.joints[ROUND]
    L, K, A = np.zeros((n, n)), np.empty((M, n)), np.eye(M)
    dz = error.copy()
    for k in range(N):
        if k == num_ready:
            error[:] = dz
        errors[k] = dz[: at.smooth]
        if log.kinds[k, _MEASURED]:
            _gain(log.P[k], rounding, L, K)
            for a in range(M):
                for i in range(n):
                    for case in range(num_cases):
                        dz[a, case] -= K[a, i] * errors[k, i, case]
        else:
            dz[:n] = 0.0
        if log.kinds[k, _KNOWN]:
            for i in range(n):
                dz[at.smooth + i] *= log.period[k, _DECAY, i]
            _step_matrix(table, model.drift_decay, model.J[k], log.period[k], A)
            _add_rows(A, n, dz)
            for case in range(num_cases):
                joint = case % n
                dz[joint, case] -= T * torque[k, case // n, joint]
            for a in range(n, M):
                dz[a] *= A[a, a]
    if num_ready == N:
        error[:] = dz


@kernel
def _backward_response(
    model: IntervalModel, log: FilterLog, errors: Array, response: Array
) -> None:
    """Writes dF after smoothing, from the changes of the predictions.

    Back over each sample, in this order; lambda's parts are those of z = [p, F, x, beta]:

        lambda <- A^T lambda, then lambda_x <- decay lambda_x   back over a period that is known
        lambda_p <- lambda_p + S^-1 dp - K^T lambda             over a sample that is measured
        lambda_p <- 0                                           over one that is not
        dF = dz_F - P_F lambda                                  P_F: rows of F

    The second line is the step of `_take_adjoint` with the innovation -dp: the torques change not
    the measurement but its prediction. The third is that of `_forget_momentum`: a sample that is
    not measured starts the momentum anew, whatever dp was before it. dF is of the prediction, as z
    and P of the log are: so lambda is that of this sample and all later ones.

    Args:
        model, log: of `forward_log`.
        errors: (N, n + 6, C n) of `_forward_response`: momentum and F of dz before each sample, for
            C n torques that the model does not have.
        response: (num_ready, 6, C n), written: dF; num_ready is at most N.
    """
    N, _, n = log.period.shape
    at = state_places(n)
    M, num_cases = log.P.shape[1], errors.shape[2]
    table = model.table
    L, K, A = np.zeros((n, n)), np.empty((M, n)), np.eye(M)
    vectors = np.zeros((M, num_cases))  # lambda, a column a case
    step = np.empty(n)  # of lambda_p, over a sample
    for k in range(N - 1, -1, -1):
        if log.kinds[k, _KNOWN]:
            # Forward x fades before A, so backward after A^T; beta's decay is A's, as F's is.
            _step_matrix(table, model.drift_decay, model.J[k], log.period[k], A)
            _transposed(A, n, vectors)
            for i in range(n):
                vectors[at.smooth + i] *= log.period[k, _DECAY, i]
        if log.kinds[k, _MEASURED]:
            _gain(log.P[k], table.joints[ROUND], L, K)
            for case in range(num_cases):
                step[:] = errors[k, :n, case]
                solve_factorised(L, n, step)  # S^-1 dp
                for i in range(n):
                    for a in range(M):
                        step[i] -= K[a, i] * vectors[a, case]
                vectors[:n, case] += step
        else:
            vectors[:n] = 0.0
        if k < len(response):
            for a in range(6):
                response[k, a] = errors[k, at.force + a]
                for b in range(M):
                    for case in range(num_cases):
                        response[k, a, case] -= log.P[k, at.force + a, b] * vectors[b, case]


@kernel
def _weigh_change(adjoint: _Adjoint, jump: Array, n: int, evidence: Array) -> None:
    """Writes the evidence for a change of F, of variance diag(jump), or of any p, at a sample.

    With d = D^1/2 lambda_F, S = D^1/2 Lambda_FF D^1/2 and D = diag(jump), all later samples are

        exp(d^T (1 + S)^-1 d / 2) det(1 + S)^-1/2

    times likelier if F changes. The evidence is the log of that (LIKELIER), its exponent alone
    (FORCE_GAIN), and lambda_p^T Lambda_pp^-1 lambda_p / 2 of a change of the momentum (BLOW_GAIN);
    zero where a matrix is not positive definite. `wrenchsight.models.observers.force_changes` says
    what follows from it.

    Args:
        adjoint: of the later samples, read only.
        jump: (6,) variances.
        n: number of joints.
        evidence: (NUM_EVIDENCE,), written.
    """
    vector, matrix = adjoint.vector, adjoint.matrix
    F = state_places(n).force
    evidence[:] = 0.0
    L, force = np.empty((6, 6)), np.empty(6)  # 1 + S, then its factor; d, then whitened by it
    for a in range(6):
        force[a] = np.sqrt(jump[a]) * vector[F + a]
        for b in range(a + 1):
            L[a, b] = np.sqrt(jump[a] * jump[b]) * matrix[F + a, F + b]
        L[a, a] += 1.0
    # No pivot of 1 + S is below 1 but by rounding, of which 0.5 is too much.
    if factorise_in_place(L, 6, 0.5):
        solve_lower(L, 6, force)
        for a in range(6):
            evidence[FORCE_GAIN] += 0.5 * force[a] * force[a]
            evidence[LIKELIER] -= np.log(L[a, a])
        evidence[LIKELIER] += evidence[FORCE_GAIN]
    factor, blow = matrix[:n, :n].copy(), vector[:n].copy()
    if factorise_in_place(factor, n, 0.0):
        solve_lower(factor, n, blow)
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
def _smoothed(z: Array, P: Array, adjoint: _Adjoint, wrench: Array, covariance: Array) -> None:
    """Writes F and its covariance given all samples, from the prediction and the adjoint."""
    vector, matrix = adjoint.vector, adjoint.matrix
    M = z.shape[0]
    F = state_places((M - 6) // 3).force
    half = np.empty((6, M))
    for a in range(6):
        total = z[F + a]
        for b in range(M):
            total -= P[F + a, b] * vector[b]
            half[a, b] = 0.0
            for c in range(M):
                half[a, b] += P[F + a, c] * matrix[c, b]
        wrench[a] = total
    for a in range(6):
        for b in range(a + 1):
            total = P[F + a, F + b]
            for c in range(M):
                total -= half[a, c] * P[c, F + b]
            covariance[a, b] = total
            covariance[b, a] = total
