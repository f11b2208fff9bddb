"""Kernels of the Kalman observer: output, measurement, prediction over a period, torque error.

The equations are those of `models.observers.kalman_observer`, whose constants and state these are.
"""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.kernel import in_kernels, kernel
from wrenchsight.models.numerics.small_matrices import (
    factorise_with_floor,
    solve_factorised,
    solve_lower,
)
from wrenchsight.models.observers.observer import (
    CTV,
    DRIFT,
    GRAVITY,
    MOMENTUM,
    STICTION,
    TAU_EXT,
    TAU_F,
    TAU_J,
    TORQUE_SD,
)
from wrenchsight.models.observers.period_torque import arrived_momentum

# Entries of KalmanTable.numbers; symbols as in `models.observers.kalman_observer`.
(
    PERIOD,  # T, s
    BEFORE,  # s, the motor torque's weight in the period before a sample
    SETTLED,  # samples until the filter has settled; as many lost in a row start it anew
    GROSS,  # least square of a whitened innovation that contradicts the model
    CHANGED,  # least |s|^2 of a sum of innovations that shows a change of the force
    DECAY_SUM,  # a of the first of the NUM_SUMS sums s, which follow each other
) = range(6)
NUM_SUMS = 3  # of the innovations, each over a time of its own
NUM_NUMBERS = DECAY_SUM + NUM_SUMS
# Rows of `sixes`, for the six entries of F.
(
    DECAY_F,  # a, over a period
    NOISE_F,  # variance that F gains in a period
    START_F,  # variance before the first sample
    JUMP_F,  # variance that F gains where it may have changed
    SIXES,
) = range(5)
# Rows of `joints`. s^2 = SMOOTH moving^2 + stiction^2, b = drift + LASTING moving.
(
    RATE_X,  # 1 / T_c, 1/s
    SMOOTH,  # factor on moving^2 of what is smooth
    WHITE,  # s, density of w over moving^2
    LASTING,  # sd that lasts, over moving
    ROUND,  # variance of r, (N m s)^2
    JOINTS,
) = range(6)

MOST_DOUBT = 1e4  # largest factor by which a gross innovation widens the variance
# Entries of KalmanState.status: the phase, and the number of measured samples. The phase is 1 while
# the filter runs, 0 before a first sample, and -k after k samples lost in a row.
_PHASE, _NUM_MEASURED = 0, 1
_LOST_STATUS, _RUNNING_STATUS = 0.0, 1.0


class StatePlaces(NamedTuple):
    """Where the parts of the filters' state begin; rows and columns of its covariance alike.

    The state is [p, F, x] in the observer and [p, F, x, beta] in the smoother
    (`models.observers.fixed_interval`): p is the momentum of n joints, entries 0 to n - 1.

    Attributes:
        force: of F (6), the wrench on the robot at E, rotation first.
        smooth: of x (n), the smooth part of the torque error, of sd 1.
        slow: of beta (n), its slow part, of sd 1; so the size of the observer's state.
        end: the size of the smoother's state.
    """

    force: int
    smooth: int
    slow: int
    end: int


@in_kernels
def state_places(num_joints: int) -> StatePlaces:
    """The places in a state of n joints."""
    n = num_joints
    return StatePlaces(force=n, smooth=n + 6, slow=2 * n + 6, end=3 * n + 6)


class KalmanTable(NamedTuple):
    """The constants of the filter.

    Attributes:
        numbers: (NUM_NUMBERS,).
        sixes: (SIXES, 6), of the wrench.
        joints: (JOINTS, n).
        mixing: (n, n) correlation of the joints' errors.
    """

    numbers: Array
    sixes: Array
    joints: Array
    mixing: Array


class KalmanState(NamedTuple):
    """The state of the filter, N = 2 n + 6 numbers [p, F, x] in their `state_places`.

    It is that before a sample, and `_take_sample` leaves that before the next one, with its gain.

    Attributes:
        x, gain, P, C: (N,), (N, n), (N, N), (N, n) of the coming sample, before it is measured.
        status: (2,) phase, and number of measured samples.
        previous_smooth: (n,) s of the sample before; zero: there was none.
        sums: (NUM_SUMS, n) of the whitened innovations.
    """

    x: Array
    gain: Array
    P: Array
    C: Array
    status: Array
    previous_smooth: Array
    sums: Array


class ErrorParts(NamedTuple):
    """The torque error of a period, (n,) each.

    Attributes:
        smooth: s, N m.
        white: variance of the white noise's integral over the period, N^2 m^2 s^2.
        slow: b, N m.
        decay: a_x.
    """

    smooth: Array
    white: Array
    slow: Array
    decay: Array


@kernel
def sample_momentum(numbers: Array, signals: Array, i: int) -> float:
    """The measured momentum y of joint i.

    Args:
        numbers: of KalmanTable.
        signals: (NUM_SIGNALS, n) of a sample.
    """
    model = signals[CTV, i] - signals[GRAVITY, i] - signals[TAU_F, i]
    y: float = arrived_momentum(
        0.5 * numbers[PERIOD], numbers[BEFORE], signals[MOMENTUM, i], model, signals[TAU_J, i]
    )
    return y


@kernel
def _is_measured(numbers: Array, status: Array, signals: Array) -> bool:
    """Whether the filter runs and the sample's momentum is finite."""
    is_measured: bool = status[_PHASE] == _RUNNING_STATUS
    for i in range(signals.shape[1]):
        is_measured = is_measured and np.isfinite(sample_momentum(numbers, signals, i))
    return is_measured


@kernel
def _read_force(numbers: Array, s: KalmanState, signals: Array, wrench: Array) -> bool:
    """Writes F right after a sample; returns whether the sample was measured."""
    n = signals.shape[1]
    F = state_places(n).force
    is_measured = _is_measured(numbers, s.status, signals)
    for a in range(6):
        wrench[a] = s.x[F + a]
        if is_measured:
            for i in range(n):
                wrench[a] += s.gain[F + a, i] * (sample_momentum(numbers, signals, i) - s.x[i])
    return is_measured


@kernel
def observe_wrench(
    table: KalmanTable,
    state: KalmanState,
    signals: Array,
    J: Array,
    is_fresh: Flags,
    wrench: Array,
    covariance: Array,
) -> None:
    """Takes N samples of KalmanObserver.

    Args:
        table: constants.
        state: changed.
        signals: (N, NUM_SIGNALS, n); tau_ext is written.
        J: (N, 6, n).
        is_fresh, wrench, covariance: (N,), (N, 6) and (N, 6, 6), written.
    """
    for k in range(signals.shape[0]):
        is_fresh[k] = _torque_after(table, state, signals[k], J[k])
        _wrench_after(table, state, signals[k], wrench[k], covariance[k])
        _take_sample(table, state, signals[k], J[k])


@kernel
def _torque_after(table: KalmanTable, state: KalmanState, signals: Array, J: Array) -> bool:
    """Writes tau_ext = J^T F right after a sample; returns whether it is fresh."""
    n = signals.shape[1]
    wrench = np.empty(6)
    is_measured = _read_force(table.numbers, state, signals, wrench)
    for i in range(n):
        total = 0.0
        for a in range(6):
            total += J[a, i] * wrench[a]
        signals[TAU_EXT, i] = total if np.isfinite(total) else 0.0
    return bool(is_measured and state.status[_NUM_MEASURED] >= table.numbers[SETTLED])


@kernel
def _wrench_after(
    table: KalmanTable, state: KalmanState, signals: Array, wrench: Array, covariance: Array
) -> None:
    """Writes F (6,) and its covariance (6, 6) right after a sample; the state stays as it is.

    The covariance is that of F in P after the measurement (as `_measure` makes it, R = `rounding`),
    plus slow slow^T: C (N, n) is what the slow part of the torque error, n numbers of sd 1, has put
    into the state.

    Args:
        table, state: the filter's, before the sample, whose gain the state holds already.
        signals: (NUM_SIGNALS, n) of the sample; where it is not finite, F is as predicted.
        wrench, covariance: written.
    """
    n = signals.shape[1]
    F = state_places(n).force
    gain, P, C, rounding = state.gain, state.P, state.C, table.joints[ROUND]
    is_measured = _read_force(table.numbers, state, signals, wrench)
    slow = np.empty((6, n))
    for a in range(6):
        for m in range(n):
            total = C[F + a, m]
            if is_measured:
                for i in range(n):
                    total -= gain[F + a, i] * C[i, m]
            slow[a, m] = total
    for a in range(6):
        for b in range(a + 1):
            total = P[F + a, F + b]
            if is_measured:  # (1 - gain H) P (1 - gain H)^T + gain R gain^T
                for i in range(n):
                    total -= gain[F + a, i] * P[i, F + b] + gain[F + b, i] * P[F + a, i]
                    for k in range(n):
                        total += gain[F + a, i] * gain[F + b, k] * P[i, k]
                    total += gain[F + a, i] * gain[F + b, i] * rounding[i]
            for m in range(n):
                total += slow[a, m] * slow[b, m]
            covariance[a, b] = total
            covariance[b, a] = total


@kernel
def _take_sample(t: KalmanTable, s: KalmanState, signals: Array, J: Array) -> None:
    """Updates the state `s` with a sample, in place: measurement, then prediction over a period.

    A sample that is not finite is not measured, and is lost, as is one with a torque or J that is
    not: the period after it is not known. The next one starts the momentum again. After SETTLED
    lost samples in a row the filter begins anew. The status counts the measured samples, and holds
    the phase: _RUNNING_STATUS (1), or _LOST_STATUS (0) less the number of samples lost in a row.

    Args:
        t: constants.
        s: state before the sample; changed to that before the next.
        signals: (NUM_SIGNALS, n) of the sample.
        J: (6, n) of the sample.
    """
    n = signals.shape[1]
    at = state_places(n)
    numbers, sixes, rounding = t.numbers, t.sixes, t.joints[ROUND]
    x, P, C, status = s.x, s.P, s.C, s.status
    arrived = np.empty(n)
    is_known = True  # whether what the coming period begins with is finite
    for i in range(n):
        arrived[i] = sample_momentum(numbers, signals, i)
        torque_sum = signals[TAU_J, i] + signals[CTV, i] - signals[TAU_F, i]
        is_known = is_known and np.isfinite(arrived[i] + torque_sum)
        for a in range(6):
            is_known = is_known and np.isfinite(J[a, i])
    if _is_measured(numbers, status, signals):
        # Before the measurement, which changes the prediction that it is off.
        whitened = _whitened_innovation(s, rounding, arrived)
        _measure(s, rounding, arrived)
        status[_NUM_MEASURED] += 1.0
        _doubt_prediction(t, s, whitened)
    # After a gap the momentum is what the sample says, without regard to the one before. (Of a
    # sample that is not finite that is NaN, which the next one replaces in the same way.)
    if status[_PHASE] != _RUNNING_STATUS:
        for i in range(n):
            x[i] = arrived[i]
            P[i], P[:, i], C[i] = 0.0, 0.0, 0.0
            P[i, i] = rounding[i]

    # The prediction over the coming period. The error's smooth part fades and is renewed first: in
    # x and P by `renew`, in C here, which gets no noise.
    error = ErrorParts(np.empty(n), np.empty(n), np.empty(n), np.empty(n))
    error_parts(t, s.previous_smooth, signals, error)
    if is_known:
        for i in range(n):
            u = signals[CTV, i] - signals[GRAVITY, i] - signals[TAU_F, i] + signals[TAU_J, i]
            x[i] += numbers[PERIOD] * u  # the modelled torque changes the momentum
            for m in range(n):
                C[at.smooth + i, m] *= error.decay[i]
        renew(error.decay, t.mixing, x, P)
        _advance(t, s, J, error)
        _find_gain(s, rounding)
        status[_PHASE] = _RUNNING_STATUS
    else:
        for a in range(6):  # without a motion only time goes by
            P[at.force + a, at.force + a] += sixes[NOISE_F, a]
        status[_PHASE] = min(status[_PHASE], _LOST_STATUS) - 1.0  # less the samples lost so far
        if status[_PHASE] <= -numbers[SETTLED]:
            _begin(t, s)


@kernel
def _doubt_prediction(t: KalmanTable, s: KalmanState, whitened: Array) -> None:
    """Widens P where the innovation is beyond the model, and F's part where it stays off.

    Args:
        t: constants.
        s: state; P and the sums of innovations are changed.
        whitened: (n,) innovation of the sample, of covariance 1 by the model.
    """
    numbers, P, n = t.numbers, s.P, whitened.shape[0]
    at = state_places(n)
    square = 0.0
    for i in range(n):
        square += whitened[i] * whitened[i]
    if square > numbers[GROSS]:
        P *= min(square / numbers[GROSS], MOST_DOUBT)
    if _sum_innovations(numbers, s.sums, whitened) > numbers[CHANGED]:
        for a in range(6):
            P[at.force + a, at.force + a] += t.sixes[JUMP_F, a]
        s.sums[:] = 0.0


@kernel
def _begin(t: KalmanTable, s: KalmanState) -> None:
    """Writes the state before a first sample, which reads no gain; the phase stays: not running."""
    n = t.mixing.shape[0]
    at = state_places(n)
    s.x[:], s.P[:], s.C[:], s.sums[:], s.status[_NUM_MEASURED] = 0.0, 0.0, 0.0, 0.0, 0.0
    for a in range(6):
        s.P[at.force + a, at.force + a] = t.sixes[START_F, a]
    for i in range(n):
        for j in range(n):
            s.P[at.smooth + i, at.smooth + j] = t.mixing[i, j]


@kernel
def _whitened_innovation(s: KalmanState, rounding: Array, arrived: Array) -> Array:
    """L^-1 (y - p) (n,), of covariance 1."""
    n = arrived.shape[0]
    L, innovation = np.empty((n, n)), np.empty(n)
    _innovation_factor(s, rounding, L)
    for i in range(n):
        innovation[i] = arrived[i] - s.x[i]
    solve_lower(L, n, innovation)
    return innovation


@kernel
def _sum_innovations(numbers: Array, sums: Array, whitened: Array) -> float:
    """Updates `sums` (NUM_SUMS, n) with a whitened innovation (n,), in place.

    Returns:
        The largest |sum|^2. Each sum has the covariance 1 where the model holds.
    """
    largest = 0.0
    for m in range(NUM_SUMS):
        decay, total = numbers[DECAY_SUM + m], 0.0
        weight = np.sqrt(1.0 - decay * decay)
        for i in range(whitened.shape[0]):
            sums[m, i] = decay * sums[m, i] + weight * whitened[i]
            total += sums[m, i] * sums[m, i]
        largest = max(largest, total)
    return largest


@kernel
def _innovation_factor(s: KalmanState, rounding: Array, L: Array) -> None:
    """Writes the lower triangle L (n, n) of the next innovation's covariance L L^T."""
    n = L.shape[0]
    for i in range(n):
        for j in range(i + 1):
            total = s.P[i, j] + (rounding[i] if i == j else 0.0)
            for m in range(n):
                total += s.C[i, m] * s.C[j, m]
            L[i, j] = total
    factorise_with_floor(L, n, rounding)


@kernel
def error_parts(t: KalmanTable, previous_smooth: Array, signals: Array, parts: ErrorParts) -> None:
    """Writes the parts of the torque error.

    Args:
        t: constants.
        previous_smooth: (n,) s of the sample before, N m; changed to that of this one.
        signals: of the sample.
        parts: written.
    """
    joints, period = t.joints, t.numbers[PERIOD]
    for i in range(signals.shape[1]):
        sd, stiction, drift = signals[TORQUE_SD, i], signals[STICTION, i], signals[DRIFT, i]
        moving_variance = max(sd**2 - stiction**2 - drift**2, 0.0)
        parts.slow[i] = drift + joints[LASTING, i] * np.sqrt(moving_variance)
        fading_variance = joints[SMOOTH, i] * moving_variance
        smooth = np.sqrt(fading_variance + stiction**2)
        share = fading_variance / (fading_variance + stiction**2) if fading_variance > 0.0 else 0.0
        decay = np.exp(-share * joints[RATE_X, i] * period)
        if previous_smooth[i] > 0.0 and smooth > 0.0:
            decay *= min(smooth / previous_smooth[i], previous_smooth[i] / smooth)
        previous_smooth[i] = smooth
        parts.smooth[i], parts.decay[i] = smooth, decay
        parts.white[i] = joints[WHITE, i] * moving_variance * period


@kernel
def _measure(s: KalmanState, rounding: Array, arrived: Array) -> None:
    """Updates x, P and C with y, in place (Joseph's form, since the gain also depends on C).

    Args:
        s: state; x (N,), P (N, N) and C (N, n) are changed, gain K (N, n) is read. The measurement
            H x is the momentum, the first n entries of x.
        rounding: (n,) variance R of the measured momentum.
        arrived: (n,) y, the measured momentum.
    """
    x, gain, P, C = s.x, s.gain, s.P, s.C
    N, n = gain.shape
    innovation = np.empty(n)
    for i in range(n):
        innovation[i] = arrived[i] - x[i]
    P_rows, C_rows = P[:n].copy(), C[:n].copy()
    # x <- x + K (y - H x), with H x the momentum; C <- (1 - K H) C and P <- (1 - K H) P.
    for a in range(N):
        for i in range(n):
            x[a] += gain[a, i] * innovation[i]
    for a in range(N):
        for m in range(n):
            for i in range(n):
                C[a, m] -= gain[a, i] * C_rows[i, m]
        for b in range(N):
            for i in range(n):
                P[a, b] -= gain[a, i] * P_rows[i, b]
    # P <- P (1 - K H)^T + K R K^T.
    P_columns = P[:, :n].copy()
    for a in range(N):
        for b in range(a + 1):
            total = P[a, b]
            for i in range(n):
                total += gain[b, i] * (gain[a, i] * rounding[i] - P_columns[a, i])
            P[a, b] = total
            P[b, a] = total


@kernel
def fade(decay: Array, x: Array, P: Array) -> None:
    """Multiplies the error's smooth part in x, and in rows and columns of P, by a_x, in place."""
    n = decay.shape[0]
    at = state_places(n)
    for i in range(n):
        e = at.smooth + i
        x[e] *= decay[i]
        for b in range(P.shape[0]):
            P[e, b] *= decay[i]
        for b in range(P.shape[0]):
            P[b, e] *= decay[i]


@kernel
def renew(decay: Array, mixing: Array, x: Array, P: Array) -> None:
    """Renews the error's smooth part in x and P, in place: it fades by a_x, and gets its noise."""
    n = decay.shape[0]
    at = state_places(n)
    fade(decay, x, P)
    for i in range(n):
        for j in range(n):
            variance = (1.0 - decay[i] * decay[i]) * (1.0 - decay[j] * decay[j])
            P[at.smooth + i, at.smooth + j] += mixing[i, j] * np.sqrt(variance)


@kernel
def _advance(t: KalmanTable, s: KalmanState, J: Array, error: ErrorParts) -> None:
    """Propagates x, P and C over a period, in place.

    Before it `_take_sample` has added T u to the momentum, and faded and renewed the error's smooth
    part: here that part only acts on the momentum.

    Args:
        t: constants.
        s: state, of which x (N,), P (N, N) and C (N, n) are changed.
        J: (6, n), rows [angular; linear], as F.
        error: parts of the torque error, of the period.
    """
    x, P, C, T = s.x, s.P, s.C, t.numbers[PERIOD]
    n = J.shape[1]
    at = state_places(n)
    N = at.slow  # the size of the state
    # x <- A x, C <- A C and P <- A P. A is 1 but for the momentum's rows: over the period the
    # smooth part of the torque error and J^T F add to it, and to C its slow part.
    for i in range(n):
        e = at.smooth + i
        T_smooth = T * error.smooth[i]
        x[i] += T_smooth * x[e]
        for b in range(N):
            P[i, b] += T_smooth * P[e, b]
        for m in range(n):
            C[i, m] += T_smooth * C[e, m]
        for a in range(6):
            T_J = T * J[a, i]
            x[i] += T_J * x[at.force + a]
            for b in range(N):
                P[i, b] += T_J * P[at.force + a, b]
            for m in range(n):
                C[i, m] += T_J * C[at.force + a, m]
        C[i, i] += T * error.slow[i]
    # P <- P A^T.
    for b in range(N):
        for i in range(n):
            total = T * error.smooth[i] * P[b, at.smooth + i]
            for a in range(6):
                total += T * J[a, i] * P[b, at.force + a]
            P[b, i] += total
    # The force forgets, in all rows and columns.
    for a in range(at.force, at.force + 6):
        factor = t.sixes[DECAY_F, a - at.force]
        x[a] *= factor
        for m in range(n):
            C[a, m] *= factor
        for b in range(N):
            P[a, b] *= factor
        for b in range(N):
            P[b, a] *= factor
    # The noise of the period; then P is made symmetric, which rounding has lost.
    for i in range(n):
        P[i, i] += error.white[i]
    for a in range(6):
        P[at.force + a, at.force + a] += t.sixes[NOISE_F, a]
    for a in range(N):
        for b in range(a):
            P[a, b] = 0.5 * (P[a, b] + P[b, a])
            P[b, a] = P[a, b]


@kernel
def _find_gain(s: KalmanState, rounding: Array) -> None:
    """Writes the gain of the next sample."""
    N, n = s.gain.shape
    L = np.empty((n, n))
    _innovation_factor(s, rounding, L)
    for a in range(N):
        row = s.gain[a]
        for i in range(n):
            row[i] = s.P[a, i]
            for m in range(n):
                row[i] += s.C[a, m] * s.C[i, m]
        solve_factorised(L, n, row)
