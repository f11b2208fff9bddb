"""A log's wrench by fixed-interval smoothing, with the times at which a force comes or goes.

In the model of `models.observers.kalman_observer` a force is a random walk. A force that begins or
ends, such as a push, is not: smoothing rounds its edges off and states an sd that ignores them. The
log is therefore smoothed more than once. The smoother's adjoint of the samples from k + 1 on is
lambda and Lambda (`models.estimation.smoothing`). It states how well a change of F after sample k
explains them. With the covariance D of that change, all samples would be

    B = exp((d^T (1 + S)^-1 d) / 2) det(1 + S)^-1/2,   d = D^1/2 lambda,   S = D^1/2 Lambda D^1/2

times likelier, with the parts of lambda and Lambda that belong to F. For an unbounded D this is the
statistic lambda^T Lambda^-1 lambda of de Jong and Penzer, "Diagnosing shocks in time series", JASA
93(442), 1998. D is the live prior's variance, as for the observer. B is 1 on average where the
model holds. By chance it is more than 1 / CHANGE_ODDS at no more than CHANGE_ODDS of the samples
(Markov). A change of F is placed where B is more than that and has its maximum within the longest
of CHANGE_TIMES. The width of B states how well the time is known: with a single change and no
preferred time, it lies at k with a probability in proportion to B_k. That share of D is added to
the variance of each sample. The variance is then that of a reading for which it is unknown on which
side of the change it lies.

A wrong sample or a blow is not a lasting force: the momentum changes at once, in any joint.
The evidence for this is lambda^T Lambda^-1 lambda / 2 with the parts of p. It is compared
with d^T (1 + S)^-1 d / 2, given the number of parameters that each fits (Akaike, IEEE TAC 19(6),
1974). Where it is greater within the shortest of CHANGE_TIMES, F is not changed.

The next pass sees the remaining changes, as one beside a larger one. At most NUM_PASSES - 1 times
changes are added. A log without any is read in one pass.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.fixed_interval import (
    BLOW_GAIN,
    FORCE_GAIN,
    LIKELIER,
    NUM_EVIDENCE,
    NUM_KINDS,
    NUM_PERIOD,
    FilterLog,
    FilterState,
    IntervalModel,
    backward_log,
    forward_log,
    response_log,
)
from wrenchsight.models.observers.kalman_kernels import (
    JUMP_F,
    PERIOD,
    START_F,
    KalmanTable,
    state_places,
)
from wrenchsight.models.observers.kalman_observer import CHANGE_ODDS, CHANGE_TIMES
from wrenchsight.models.observers.observer import V

NUM_PASSES = 4


class IntervalReading(NamedTuple):
    """The result of one pass forward and backward over N samples.

    Attributes:
        wrench, covariance: (K, 6), (K, 6, 6) of the first K <= N samples; as `WrenchEstimator`'s.
        evidence: (N, NUM_EVIDENCE) of `wrenchsight.models.observers.fixed_interval`.
        log: log of the forward pass.
    """

    wrench: Array
    covariance: Array
    evidence: Array
    log: FilterLog


class ChangeSearch(NamedTuple):
    """Settings of `likely_changes`.

    Attributes:
        reach: samples to both sides among which no more than one change is looked for at a time.
        blow_reach: samples to both sides among which a blow may explain more.
        extra_parameters: number of parameters of a blow, n, less that of a change of F, 3 or 6.
    """

    reach: int
    blow_reach: int
    extra_parameters: int


class ProportionalError(NamedTuple):
    """Errors of a joint in proportion to the measured torque, N m per N m.

    Attributes:
        gain: relative error of the torque itself, as by a torque per ampere that is off.
        friction: relative error of its magnitude, against the joint's motion, as by friction that a
            load adds.
    """

    gain: float
    friction: float


def _copied(state: FilterState) -> FilterState:
    """A copy of the state, which the next sample does not change."""
    return FilterState(
        z=state.z.copy(),
        P=state.P.copy(),
        running=state.running.copy(),
        previous_smooth=state.previous_smooth.copy(),
    )


class IntervalSmoother:
    """Estimates the wrench of a log by smoothing, stretch by stretch.

    Args:
        table: of the Kalman observer.
        num_joints: n.
        drift_decay: share of the slow part of the torque error that outlasts a period.
        proportional: error of each joint in proportion to the torque that is read; None: none.
    """

    def __init__(
        self,
        table: KalmanTable,
        num_joints: int,
        drift_decay: float,
        proportional: ProportionalError | None = None,
    ) -> None:
        n = num_joints
        M = state_places(n).end
        numbers, sixes = table.numbers, table.sixes
        z, P = np.zeros(M), np.zeros((M, M))
        P[range(n, M), range(n, M)] = np.concatenate([sixes[START_F], np.ones(2 * n)])
        self._table, self._drift_decay = table, drift_decay
        T = float(numbers[PERIOD])
        self._search = ChangeSearch(
            reach=round(max(CHANGE_TIMES) / T),
            blow_reach=round(min(CHANGE_TIMES) / T),
            extra_parameters=n - int(np.count_nonzero(sixes[JUMP_F])),
        )
        self._start = FilterState(z, P, np.zeros(1, np.bool_), np.zeros(n))
        self._proportional = proportional
        self._response = np.zeros((M, len(ProportionalError._fields) * n))

    def read(self, signals: Array, J: Array, num_ready: int) -> tuple[Array, Array]:
        """Estimates the wrench (K, 6) and its covariance (K, 6, 6) of the first K samples.

        The next stretch begins with the first sample that was not ready.

        Args:
            signals, J: (N, NUM_SIGNALS, n), (N, 6, n) of a stretch.
            num_ready: K, at most N. All N samples count for these.
        """
        changes = np.zeros(len(signals))
        reading, next_start = self.smoothed(signals, J, changes, num_ready)
        for _ in range(NUM_PASSES - 1):
            new_changes = likely_changes(reading.evidence, self._search)
            if not new_changes.any():
                break
            changes += new_changes
            reading, next_start = self.smoothed(signals, J, changes, num_ready)
        self._start = next_start
        return reading.wrench, reading.covariance + self._proportional_covariance(
            signals, J, reading
        )

    def _proportional_covariance(self, signals: Array, J: Array, reading: IntervalReading) -> Array:
        """Covariance (K, 6, 6) from the errors in proportion to what is read; or zero."""
        K, at = len(reading.wrench), state_places(J.shape[2])
        if self._proportional is None:
            return np.zeros((K, 6, 6))
        wrench = reading.log.z[:, at.force : at.force + 6].copy()  # beyond K: not smoothed yet
        wrench[:K] = reading.wrench
        tau_read = np.einsum("kai,ka->ki", J, wrench)
        tau_against = -np.sign(signals[:, V]) * np.abs(tau_read)
        torque = np.stack(
            [self._proportional.gain * tau_read, self._proportional.friction * tau_against], axis=1
        )
        response = np.empty((K, 6, self._response.shape[1]))
        model = IntervalModel(self._table, self._drift_decay, J)
        response_log(model, reading.log, np.nan_to_num(torque), self._response, response)
        return np.asarray(response @ response.transpose(0, 2, 1))

    def smoothed(
        self, signals: Array, J: Array, changes: Array, num_ready: int
    ) -> tuple[IntervalReading, FilterState]:
        """Runs one pass forward and backward over a stretch of N samples.

        Args:
            signals, J: (N, NUM_SIGNALS, n) as in `models.observers.observer`, (N, 6, n).
            changes: (N,) live prior's variances that F gains after each sample.
            num_ready: K, at most N, number of samples that are read; the others count for these.

        Returns:
            The reading of K samples with the log of all N; and the filter's state before sample K,
            from which the next stretch starts.
        """
        N, _, n = signals.shape
        M = state_places(n).end
        log = FilterLog(
            z=np.empty((N, M)),
            P=np.empty((N, M, M)),
            period=np.empty((N, NUM_PERIOD, n)),
            kinds=np.empty((N, NUM_KINDS), np.bool_),
        )
        state = _copied(self._start)

        def forward(rows: slice) -> None:
            """Runs `state` over these rows, and writes them in `log`."""
            forward_log(
                IntervalModel(self._table, self._drift_decay, J[rows]),
                signals[rows],
                changes[rows],
                state,
                FilterLog(
                    z=log.z[rows],
                    P=log.P[rows],
                    period=log.period[rows],
                    kinds=log.kinds[rows],
                ),
            )

        forward(slice(0, num_ready))
        next_start = _copied(state)
        forward(slice(num_ready, N))
        evidence = np.empty((N, NUM_EVIDENCE))
        wrench, covariance = np.empty((num_ready, 6)), np.empty((num_ready, 6, 6))
        model = IntervalModel(self._table, self._drift_decay, J)
        backward_log(model, log, evidence, wrench, covariance)
        reading = IntervalReading(wrench=wrench, covariance=covariance, evidence=evidence, log=log)
        return reading, next_start


def likely_changes(evidence: Array, search: ChangeSearch) -> Array:
    """Shares (N,) of the live prior's variance that F is to gain after each sample.

    A change lies where the likelihood ratio has its maximum within `reach` samples to both sides
    and is above 1 / CHANGE_ODDS, unless a blow explains more nearby. Its share of 1 is spread over
    these samples in proportion to the likelihood that it lies there; shares of changes less than
    twice `reach` apart add up where they overlap. All zero: no change is likely.

    Args:
        evidence: (N, NUM_EVIDENCE) logs of likelihood ratios, as
            `wrenchsight.models.observers.fixed_interval` writes them.
        search: how far apart changes are looked for, and what a blow counts for.
    """
    N = len(evidence)
    shares = np.zeros(N)
    if N == 0:
        return shares
    reach, log_likelihood = search.reach, evidence[:, LIKELIER]
    highest = maximum_filter1d(log_likelihood, 2 * reach + 1, mode="nearest")
    blow_gain = maximum_filter1d(evidence[:, BLOW_GAIN], 2 * search.blow_reach + 1, mode="nearest")
    # Akaike: what has more parameters must explain as many units of log-likelihood more.
    force_gain = evidence[:, FORCE_GAIN] + search.extra_parameters
    last_change = -reach - 1
    for k in np.flatnonzero((log_likelihood > -np.log(CHANGE_ODDS)) & (log_likelihood >= highest)):
        # Two maxima within reach are equal, as in a gap of the log: the first stands for both.
        if k - last_change <= reach or blow_gain[k] > force_gain[k]:
            continue
        neighbours = slice(max(k - reach, 0), k + reach + 1)
        likelihood = np.exp(log_likelihood[neighbours] - log_likelihood[k])
        shares[neighbours] += likelihood / likelihood.sum()
        last_change = int(k)
    return shares
