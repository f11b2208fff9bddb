"""A Kalman filter of the momentum with wrench and torque error as states.

Momentum obeys d/dt p = u + tau, with u = tau_J - tau_f + CTv - G. In what the model does not
explain, tau = J^T F + e, the wrench F is separated from the torque error e by what is known of both
(Wahrburg et al., "Motor-current-based estimation of Cartesian contact forces and torques for
robotic manipulators and its application to force control", IEEE T-ASE 15(2), 2018, whose states are
p and F; the error's states are those of the model's own torque error):

    p_k+1 = p_k + T (u + J^T F + s x + b beta) + w,   y_k = p_k + r      n each, N m s
    F_k+1 = a F_k + ...                               first-order prior, see below
    x_k = a_x x_k-1 + ...                             error's smooth part, of sd 1
    beta                                              slow bias of sd 1, constant

x lasts the error's correlation time T_c where a joint moves, and for as long as a joint rests:
a_x = exp(-g T / T_c) r, with g the share of s^2 that is not stiction. Where s changes by a factor,
x is renewed in part, r = min(s' / s, s / s'). Otherwise the filter would
believe that it can tell a constant error of a joint at rest from a force: s varies there by an
encoder's step, a constant does not.

The torque error model (`models.identification.torque_error_model`) states the sd of what an
observer with pole K_0 reads where nothing touches the arm: sd^2 = moving^2 + stiction^2 + slow^2,
sample by sample. A share WHITE_SHARE of moving^2 is white torque noise w, of density 2 / K_0 times
it; the rest and stiction are smooth, s^2 = (1 - share) (1 + K_0 T_c) / (K_0 T_c) moving^2 +
stiction^2: behind K_0 both together have the stated variance again. The slow part b, drift of the
viscous friction and what `lasting` says, is never estimated (a force that stays would be taken for
it) but counts in gain and covariance (Schmidt, 1966):

    P   covariance of the error without it,     C   what beta = 1 adds to the error
    gain = (P + C C^T) H^T (H (P + C C^T) H^T + R)^-1,   Sigma_F = (P + C C^T) of F

An innovation of a square (over its covariance) that one sample in a million has by chance, as
where a large push begins or a fault of the drives ends, is not the model's: P grows until it is
just possible, by at most _MOST_DOUBT. What was read before then counts for less, and the sd says
so.
After as many lost samples in a row as it takes to settle the filter begins anew.

How fast a force may change does not depend on what a log is thought to hold: its variance grows by
4 pi f sd^2 a second, with the live prior's sd and f = `bandwidth_hz`, the corner of a force of that
size. How large it may be is the reading's own prior: a = exp(-2 pi f T) where both are the same,
less where the log's prior is smaller, 1 (a random walk) where nothing is known of the size. The
covariance knows how fast a force may change: a reading needs no other account of the lag.

u and y are those of `momentum_observer`: the model's part of u averaged over a period, the motor
torque held or averaged. J, s and b are those of the period's start. The measurement's noise r is
rounding's alone: what encoders add is in the torque error.
"""

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from numba import njit
from scipy.stats import chi2

from models.arrays import Array
from models.identification.torque_error_model import TORQUE_ERROR_ROWS, torque_sd_tick
from models.observers.observer import (
    CTV,
    GRAVITY,
    TAU_EXT,
    TAU_F,
    TAU_J,
    TORQUE_SD,
    ModelKnowledge,
    ObserverKernels,
    Q,
    V,
    WrenchPrior,
)
from models.observers.period_torque import arrived_momentum, checked_period, motor_share

WHITE_SHARE = 0.6  # of a moving joint's error variance behind K_0: the UR10e's three fitted runs
SETTLING = 3.0  # 1 / K_0 of the error model
_ROUNDING = 1e-3  # of the momentum that the torque's sd brings in a period
_START_SHARE = 30.0  # of the live prior's sd: an sd that stands for knowing nothing
_GROSS_ODDS = 1e-6  # of a sample whose innovation is still the model's
_MOST_DOUBT = 1e4  # times that a gross innovation widens the variance
_PLAIN_K_0, _PLAIN_TIME = 20.0, 0.3  # 1/s, s: of a model without a torque error

# Table: numbers, 6-vectors, n-vectors, an (n, n), and the torque error's own table, all flat.
PERIOD, _BEFORE, _SETTLED, _HAS_ERROR, _GROSS, _NUMBERS = range(6)
KEPT_F, NOISE_F, START_F, _SIXES = range(4)
_RATE_X, _SMOOTH, _WHITE, _SLOW_VISCOUS, _LASTING, ROUND, _JOINTS = range(7)
# Status: this or less, one less for each sample lost in a row; this.
_LOST, _RUNNING = 0.0, 1.0


@dataclass
class KalmanObserverConfig:
    """How the filter sees a force that changes."""

    bandwidth_hz: float = 0.002  # corner of the prior of a force as large as the live prior's
    time_step: float = 0.001  # s between samples
    torque_samples: str = "held"  # mean motor torque of a period: "held" or "trapezoidal"


@njit(cache=True, error_model="numpy")
def split_state(
    flat: Array,
    n: int,
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """x (N,), gain (N, n), P (N, N), C (N, n), status (2,), torque error's rows and s of the sample
    before (zero: there was none) as (TORQUE_ERROR_ROWS + 1, n); N = 2 n + 6.

    x = [p, F, x]; P, C and gain are those of the coming sample, before it is measured.
    """
    N = 2 * n + 6
    a, b = N, N + N * n
    c = b + N * N
    d = c + N * n
    e = d + 2
    return (
        flat[:a],
        flat[a:b].reshape(N, n),
        flat[b:c].reshape(N, N),
        flat[c:d].reshape(N, n),
        flat[d:e],
        flat[e : e + (TORQUE_ERROR_ROWS + 1) * n].reshape(TORQUE_ERROR_ROWS + 1, n),
    )


@njit(cache=True, error_model="numpy")
def split_table(
    table: Array,
    n: int,
) -> tuple[Array, Array, Array, Array, Array]:
    """Numbers, 6-vectors, n-vectors, an (n, n) and the torque error's table of `table`."""
    a = _NUMBERS + 6 * _SIXES
    b = a + n * _JOINTS
    c = b + n * n
    return (
        table[:_NUMBERS],
        table[_NUMBERS:a].reshape(_SIXES, 6),
        table[a:b].reshape(_JOINTS, n),
        table[b:c].reshape(n, n),
        table[c:].reshape(n, (table.shape[0] - c) // n),
    )


@njit(cache=True, error_model="numpy")
def sample_momentum(table: Array, signals: Array, i: int) -> float:
    """y of joint i."""
    y: float = arrived_momentum(0.5 * table[PERIOD], table[_BEFORE], signals, i)
    return y


@njit(cache=True, error_model="numpy")
def _is_measured(
    table: Array,
    status: Array,
    signals: Array,
) -> bool:
    finite: bool = status[0] == _RUNNING
    for i in range(signals.shape[1]):
        finite = finite and np.isfinite(sample_momentum(table, signals, i))
    return finite


@njit(cache=True, error_model="numpy")
def _read_force(
    table: Array,
    state: Array,
    signals: Array,
    wrench: Array,
) -> bool:
    """Writes F right after a sample; returns whether the sample was measured."""
    n = signals.shape[1]
    x, gain, _, _, status, _ = split_state(state.reshape(-1), n)
    measured = _is_measured(table, status, signals)
    for a in range(6):
        wrench[a] = x[n + a]
        if measured:
            for i in range(n):
                wrench[a] += gain[n + a, i] * (sample_momentum(table, signals, i) - x[i])
    return measured


@njit(cache=True, error_model="numpy")
def kalman_output(table: Array, state: Array, signals: Array, J: Array) -> bool:
    """Writes tau_ext = J^T F right after a sample; see `observer`."""
    n = signals.shape[1]
    wrench = np.empty(6)
    measured = _read_force(table, state, signals, wrench)
    status = split_state(state.reshape(-1), n)[4]
    for i in range(n):
        total = 0.0
        for a in range(6):
            total += J[a, i] * wrench[a]
        signals[TAU_EXT, i] = total if np.isfinite(total) else 0.0
    return bool(measured and status[1] >= table[_SETTLED])


@njit(cache=True, error_model="numpy")
def kalman_wrench(
    table: Array,
    state: Array,
    signals: Array,
    J: Array,
    wrench: Array,
    covariance: Array,
) -> None:
    """Writes F (6,) and its covariance (6, 6) right after a sample; see `observer`."""
    n = signals.shape[1]
    measured = _read_force(table, state, signals, wrench)
    _, gain, P, C, _, _ = split_state(state.reshape(-1), n)
    slow = np.empty((6, n))
    for a in range(6):
        for m in range(n):
            total = C[n + a, m]
            if measured:
                for i in range(n):
                    total -= gain[n + a, i] * C[i, m]
            slow[a, m] = total
    for a in range(6):
        for b in range(a + 1):
            total = P[n + a, n + b]
            if measured:  # (1 - gain H) P (1 - gain H)^T + gain R gain^T
                for i in range(n):
                    total -= gain[n + a, i] * P[i, n + b] + gain[n + b, i] * P[n + a, i]
                    for k in range(n):
                        total += gain[n + a, i] * gain[n + b, k] * P[i, k]
                    total += gain[n + a, i] * gain[n + b, i] * _rounding(table, n, i)
            for m in range(n):
                total += slow[a, m] * slow[b, m]
            covariance[a, b] = total
            covariance[b, a] = total


@njit(cache=True, error_model="numpy")
def _rounding(
    table: Array,
    n: int,
    i: int,
) -> float:
    rounding: float = table[_NUMBERS + 6 * _SIXES + ROUND * n + i]
    return rounding


@njit(cache=True, error_model="numpy")
def kalman_update(table: Array, state: Array, signals: Array, J: Array) -> None:
    """Takes a sample into `state`, in place; see `observer`.

    A sample that is not finite is not measured; the one after it starts the momentum again.
    """
    n = signals.shape[1]
    numbers, sixes, joints, mixing, error_table = split_table(table, n)
    x, gain, P, C, status, error_rows = split_state(state.reshape(-1), n)
    arrived = np.empty(n)
    known = True  # what the coming period begins with
    for i in range(n):
        arrived[i] = sample_momentum(table, signals, i)
        predicted = arrived[i] + signals[TAU_J, i] + signals[CTV, i] - signals[TAU_F, i]
        known = known and np.isfinite(predicted)
        for a in range(6):
            known = known and np.isfinite(J[a, i])
    if _is_measured(table, status, signals):
        square = innovation_square(x, P, C, joints[ROUND], arrived)
        measure(x, gain, P, C, joints[ROUND], arrived)
        status[1] += 1.0
        if square > numbers[_GROSS]:
            P *= min(square / numbers[_GROSS], _MOST_DOUBT)
    if status[0] != _RUNNING:
        for i in range(n):
            x[i] = arrived[i]
            P[i], P[:, i], C[i] = 0.0, 0.0, 0.0
            P[i, i] = joints[ROUND, i]

    smooth, white, slow, kept = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    error_parts(numbers, joints, error_table, error_rows, signals, smooth, white, slow, kept)
    if known:
        T = numbers[PERIOD]
        for i in range(n):
            u = signals[CTV, i] - signals[GRAVITY, i] - signals[TAU_F, i] + signals[TAU_J, i]
            x[i] += T * u
        renew(kept, mixing, x, P, C)
        advance(T, J, smooth, white, slow, sixes, x, P, C)
        find_gain(P, C, joints[ROUND], gain)
        status[0] = _RUNNING
    else:
        for a in range(6):  # without a motion only time goes by
            P[n + a, n + a] += sixes[NOISE_F, a]
        status[0] = min(status[0], _LOST) - 1.0
        if status[0] <= -numbers[_SETTLED]:
            begin(mixing, sixes, x, P, C)
            status[1] = 0.0


@njit(cache=True, error_model="numpy")
def begin(mixing: Array, sixes: Array, x: Array, P: Array, C: Array) -> None:
    """Writes x, P and C of a filter that has read nothing yet."""
    n = mixing.shape[0]
    x[:], P[:], C[:] = 0.0, 0.0, 0.0
    for a in range(6):
        P[n + a, n + a] = sixes[START_F, a]
    P[n + 6 :, n + 6 :] = mixing


@njit(cache=True, error_model="numpy")
def innovation_square(x: Array, P: Array, C: Array, rounding: Array, arrived: Array) -> float:
    """|y - p|^2 over its covariance, of mean n."""
    n = arrived.shape[0]
    L, left = np.empty((n, n)), np.empty(n)
    innovation_factor(P, C, rounding, L)
    total = 0.0
    for i in range(n):
        left[i] = arrived[i] - x[i]
        for k in range(i):
            left[i] -= L[i, k] * left[k]
        left[i] /= L[i, i]
        total += left[i] * left[i]
    return total


@njit(cache=True, error_model="numpy")
def innovation_factor(P: Array, C: Array, rounding: Array, L: Array) -> None:
    """Writes the lower triangle L (n, n) of the coming innovation's covariance L L^T."""
    n = L.shape[0]
    for i in range(n):
        for j in range(i + 1):
            total = P[i, j] + (rounding[i] if i == j else 0.0)
            for m in range(n):
                total += C[i, m] * C[j, m]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = np.sqrt(max(total, rounding[i])) if i == j else total / L[j, j]


@njit(cache=True, error_model="numpy")
def error_parts(
    numbers: Array,
    joints: Array,
    error_table: Array,
    rows: Array,
    signals: Array,
    smooth: Array,
    white: Array,
    slow: Array,
    kept: Array,
) -> None:
    """Writes s (N m), the white noise's variance in a period (N^2 m^2 s^2), b (N m) and a_x.

    `rows` (TORQUE_ERROR_ROWS + 1, n), the torque error's state and the s before, is changed.
    """
    n = signals.shape[1]
    sd, stiction, load = np.empty(n), np.zeros(n), np.empty(n)
    for i in range(n):
        sd[i] = signals[TORQUE_SD, i]
        load[i] = signals[TAU_J, i] - signals[TAU_F, i]
    if numbers[_HAS_ERROR] != 0.0:
        own = rows[:TORQUE_ERROR_ROWS]
        torque_sd_tick(error_table, own, signals[Q], signals[V], load, sd, stiction)
    for i in range(n):
        speed = signals[V, i] if np.isfinite(signals[V, i]) else 0.0
        drift = joints[_SLOW_VISCOUS, i] * speed
        moving = max(sd[i] ** 2 - stiction[i] ** 2 - drift**2, 0.0)
        slow[i] = drift + joints[_LASTING, i] * np.sqrt(moving)
        fading = joints[_SMOOTH, i] * moving
        smooth[i] = np.sqrt(fading + stiction[i] ** 2)
        share = fading / (fading + stiction[i] ** 2) if fading > 0.0 else 0.0
        kept[i] = np.exp(-share * joints[_RATE_X, i] * numbers[PERIOD])
        before = rows[TORQUE_ERROR_ROWS, i]
        if before > 0.0 and smooth[i] > 0.0:
            kept[i] *= min(smooth[i] / before, before / smooth[i])
        rows[TORQUE_ERROR_ROWS, i] = smooth[i]
        white[i] = joints[_WHITE, i] * moving * numbers[PERIOD]


@njit(cache=True, error_model="numpy")
def measure(
    x: Array,
    gain: Array,
    P: Array,
    C: Array,
    rounding: Array,
    arrived: Array,
) -> None:
    """Takes y into x, P and C by the gain, in place (Joseph's form, as the gain is C's too)."""
    N, n = gain.shape
    innovation = np.empty(n)
    for i in range(n):
        innovation[i] = arrived[i] - x[i]
    above, before = P[:n].copy(), C[:n].copy()
    for a in range(N):
        for i in range(n):
            x[a] += gain[a, i] * innovation[i]
    for a in range(N):
        for m in range(n):
            for i in range(n):
                C[a, m] -= gain[a, i] * before[i, m]
        for b in range(N):
            for i in range(n):
                P[a, b] -= gain[a, i] * above[i, b]
    left = P[:, :n].copy()
    for a in range(N):
        for b in range(a + 1):
            total = P[a, b]
            for i in range(n):
                total += gain[b, i] * (gain[a, i] * rounding[i] - left[a, i])
            P[a, b] = total
            P[b, a] = total


@njit(cache=True, error_model="numpy")
def renew(
    kept: Array,
    mixing: Array,
    x: Array,
    P: Array,
    C: Array,
) -> None:
    """Renews the error's smooth part in x, P and C, in place."""
    n = kept.shape[0]
    first = n + 6
    for i in range(n):
        e = first + i
        x[e] *= kept[i]
        for m in range(n):
            C[e, m] *= kept[i]
        for b in range(P.shape[0]):
            P[e, b] *= kept[i]
        for b in range(P.shape[0]):
            P[b, e] *= kept[i]
    for i in range(n):
        for j in range(n):
            fade = (1.0 - kept[i] * kept[i]) * (1.0 - kept[j] * kept[j])
            P[first + i, first + j] += mixing[i, j] * np.sqrt(fade)


@njit(cache=True, error_model="numpy")
def advance(
    T: float,
    J: Array,
    smooth: Array,
    white: Array,
    slow: Array,
    sixes: Array,
    x: Array,
    P: Array,
    C: Array,
) -> None:
    """Takes x, P and C over a period, in place; u is added elsewhere."""
    n = J.shape[1]
    N = 2 * n + 6
    for i in range(n):
        e = n + 6 + i
        s = T * smooth[i]
        x[i] += s * x[e]
        for b in range(N):
            P[i, b] += s * P[e, b]
        for m in range(n):
            C[i, m] += s * C[e, m]
        for a in range(6):
            j = T * J[a, i]
            x[i] += j * x[n + a]
            for b in range(N):
                P[i, b] += j * P[n + a, b]
            for m in range(n):
                C[i, m] += j * C[n + a, m]
        C[i, i] += T * slow[i]
    for b in range(N):
        for i in range(n):
            total = T * smooth[i] * P[b, n + 6 + i]
            for a in range(6):
                total += T * J[a, i] * P[b, n + a]
            P[b, i] += total
    for a in range(n, n + 6):
        factor = sixes[KEPT_F, a - n]
        x[a] *= factor
        for m in range(n):
            C[a, m] *= factor
        for b in range(N):
            P[a, b] *= factor
        for b in range(N):
            P[b, a] *= factor
    for i in range(n):
        P[i, i] += white[i]
    for a in range(6):
        P[n + a, n + a] += sixes[NOISE_F, a]
    for a in range(N):
        for b in range(a):
            P[a, b] = 0.5 * (P[a, b] + P[b, a])
            P[b, a] = P[a, b]


@njit(cache=True, error_model="numpy")
def find_gain(
    P: Array,
    C: Array,
    rounding: Array,
    gain: Array,
) -> None:
    """Writes the gain (N, n) of the coming sample."""
    N, n = gain.shape
    L = np.empty((n, n))
    innovation_factor(P, C, rounding, L)
    for a in range(N):
        row = gain[a]
        for i in range(n):
            total = P[a, i]
            for m in range(n):
                total += C[a, m] * C[i, m]
            for k in range(i):
                total -= L[i, k] * row[k]
            row[i] = total / L[i, i]
        for i in range(n - 1, -1, -1):
            total = row[i]
            for k in range(i + 1, n):
                total -= L[k, i] * row[k]
            row[i] = total / L[i, i]


class KalmanObserver:
    """The filter of this module for an arm with n joints; an `observer.Observer`.

    It reads the wrench itself (`observer.ObserverKernels`), by the prior of the estimator's
    configuration: methods bayesian, force_only and inverse. `informed` gives it what the model and
    that configuration say; before, it takes a prior of 1 N and 1 N m.

    Raises:
        ValueError: bandwidth or time step that is not positive, unknown torque samples; a method
            that no prior stands for.
    """

    Config: ClassVar[type] = KalmanObserverConfig
    kernels: ClassVar[ObserverKernels] = ObserverKernels(
        kalman_output, kalman_update, kalman_wrench
    )
    pole: Array | None = None

    def __init__(
        self,
        config: KalmanObserverConfig,
        num_joints: int,
        knowledge: ModelKnowledge | None = None,
    ) -> None:
        T, f = checked_period(config.time_step, config.torque_samples), float(config.bandwidth_hz)
        if not (np.isfinite(f) and f > 0.0):
            raise ValueError(f"bandwidth_hz must be positive, not {f}")
        self.config = config
        self.num_joints = num_joints
        self.time_step = T
        self.reads_present_torque = config.torque_samples != "held"
        self._knowledge = knowledge
        self.table = self._table(knowledge)
        self.settling_time = float(self.table[_SETTLED]) * T

    def informed(self, knowledge: ModelKnowledge) -> Self:
        """Returns the observer with what a model and a reading's configuration know."""
        return type(self)(self.config, self.num_joints, knowledge)

    @property
    def parameters(self) -> dict[str, Array]:
        """bandwidth_hz (1,)."""
        return {"bandwidth_hz": np.array([self.config.bandwidth_hz])}

    def with_parameters(self, values: dict[str, Array]) -> Self:
        """Returns the observer with another bandwidth."""
        config = replace(self.config, bandwidth_hz=float(values["bandwidth_hz"][0]))
        return type(self)(config, self.num_joints, self._knowledge)

    def initial_state(self) -> Array:
        """Returns the state before the first sample; its layout is `split_state`'s."""
        n = self.num_joints
        N = 2 * n + 6
        size = N + 2 * N * n + N * N + 2 + (TORQUE_ERROR_ROWS + 1) * n
        state = np.zeros((-(-size // n), n))
        start = self.table[_NUMBERS : _NUMBERS + 6 * _SIXES].reshape(_SIXES, 6)[START_F]
        P = split_state(state.reshape(-1), n)[2]
        P[range(n, N), range(n, N)] = np.concatenate([start, np.ones(n)])
        if self._knowledge is not None and self._knowledge.torque_error is not None:
            rows = split_state(state.reshape(-1), n)[5]
            rows[:TORQUE_ERROR_ROWS] = self._knowledge.torque_error.initial_state()
        return state

    def _table(self, knowledge: ModelKnowledge | None) -> Array:
        n, T = self.num_joints, self.time_step
        numbers, sixes = np.zeros(_NUMBERS), np.zeros((_SIXES, 6))
        joints, mixing = np.zeros((_JOINTS, n)), np.eye(n)
        error = None if knowledge is None else knowledge.torque_error
        K_0: Any = np.full(n, _PLAIN_K_0) if error is None else error.K_0
        times: Any = np.full(n, _PLAIN_TIME) if error is None else error.correlation_time
        numbers[PERIOD] = T
        numbers[_BEFORE] = motor_share(T, self.config.torque_samples)
        numbers[_GROSS] = chi2.isf(_GROSS_ODDS, n)
        numbers[_SETTLED] = np.ceil(SETTLING / float(np.min(K_0)) / T)
        prior = WrenchPrior(1.0, 1.0, 1.0, 1.0) if knowledge is None else knowledge.prior
        if prior is None:
            raise ValueError("a Kalman observer reads by bayesian, force_only or inverse")
        kept, steps, start = changing_wrench(prior, self.config.bandwidth_hz, T)
        sixes[KEPT_F], sixes[NOISE_F], sixes[START_F] = kept, steps, start
        joints[_RATE_X] = 1.0 / times
        joints[_SMOOTH] = (1.0 - WHITE_SHARE) * (1.0 + K_0 * times) / (K_0 * times)
        joints[_WHITE] = WHITE_SHARE * 2.0 / K_0
        sd = np.ones(n) if knowledge is None else knowledge.torque_sd
        rest = np.zeros((n, 1))
        if error is not None and knowledge is not None:
            numbers[_HAS_ERROR] = 1.0
            mixing = error.correlation
            viscous = np.abs(knowledge.friction.feedforward.coulomb_viscous.viscous)
            joints[_SLOW_VISCOUS] = error.drift * viscous
            joints[_LASTING] = np.sqrt(error.lasting)
            rest = error.table(knowledge.friction, T, error.K_0, knowledge.resolution)
            sd = error.constant
        joints[ROUND] = (_ROUNDING * T * np.asarray(sd)) ** 2
        return np.concatenate([part.ravel() for part in (numbers, sixes, joints, mixing, rest)])


def changing_wrench(
    prior: WrenchPrior, bandwidth_hz: float, time_step: float
) -> tuple[Array, Array, Array]:
    """What is known of a wrench that changes, moment first: (6,) share kept in a period, variance
    that a period adds, variance at the start.
    """
    own, live = np.array(prior[:2]), np.array(prior[2:])
    rate = 4.0 * np.pi * bandwidth_hz * live**2  # of the variance
    sd = np.where(np.isinf(own), _START_SHARE * live, own)
    walks = np.isinf(own) | (own == 0.0)
    kept = np.exp(-0.5 * rate * time_step / np.where(walks, np.inf, own) ** 2)
    size = np.where(walks, 0.0, own)
    steps = np.where(np.isinf(own), rate * time_step, (1.0 - kept**2) * size**2)
    return np.repeat(kept, 3), np.repeat(steps, 3), np.repeat(sd**2, 3)
