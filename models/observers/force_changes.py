"""A log's wrench by fixed-interval smoothing, with the times at which a force comes or goes.

The model of `models.observers.kalman_observer` lets a force walk. One that begins or ends, as a
push does, is no walk: smoothing rounds its edges off and states an sd that knows nothing of them.
So the log is smoothed more than once. What a smoother has of the samples from k + 1 on, lambda and
Lambda (`models.estimation.smoothing`), says what a change of F after sample k would explain: were
its covariance D, all that was seen would be

    B = exp((d^T (1 + S)^-1 d) / 2) det(1 + S)^-1/2,   d = D^1/2 lambda,   S = D^1/2 Lambda D^1/2

times likelier (lambda, Lambda: the parts of F; de Jong and Penzer, "Diagnosing shocks in time
series", JASA 93(442), 1998, whose statistic lambda^T Lambda^-1 lambda this is for an unbounded D).
D is the live prior's variance, as for the observer. As B is 1 on average where the model holds, it
is more than 1 / CHANGE_ODDS by chance at no more than CHANGE_ODDS of the samples (Markov). Where it
is more and nowhere greater within the longest of CHANGE_TIMES, F changes. The time is as sure as B
is narrow: with one change there and no time preferred, it lies at k with a probability in
proportion to B_k. Each sample gains that share of D. A walk through two levels by such shares has
the variance of a reading that does not know which of them it is at.

A sample that is off, or a blow, is no force that stays: the momentum changes at once, and may do so
in any joint. What that would explain is lambda^T Lambda^-1 lambda / 2 with the parts of p, against
d^T (1 + S)^-1 d / 2. Where it explains more within the shortest of CHANGE_TIMES, for the numbers
that each of them fits (Akaike, IEEE TAC 19(6), 1974), F is left as it is.

The next pass sees what is left: a change beside a larger one. At most PASSES - 1 times changes are
added. A log without any is read in one pass, and as if none were thought of.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d

from wrenchsight.models.arrays import Array
from wrenchsight.models.observers.fixed_interval import (
    BLOW_GAIN,
    FORCE_GAIN,
    LIKELIER,
    NUM_EVIDENCE,
    NUM_KINDS,
    NUM_PERIOD,
    FilterLog,
    FilterState,
    backward_log,
    forward_log,
    response_log,
)
from wrenchsight.models.observers.kalman_kernels import JUMP_F, PERIOD, START_F, split_table
from wrenchsight.models.observers.kalman_observer import CHANGE_ODDS, CHANGE_TIMES
from wrenchsight.models.observers.observer import V

PASSES = 4


class IntervalReading(NamedTuple):
    """What one pass forward and backward reads of N samples.

    Attributes:
        wrench, covariance: (K, 6), (K, 6, 6) of the first K <= N samples; as `WrenchEstimator`'s.
        evidence: (N, NUM_EVIDENCE) of `wrenchsight.models.observers.fixed_interval`.
        log: what the forward pass left.
    """

    wrench: Array
    covariance: Array
    evidence: Array
    log: FilterLog


class ChangesSought(NamedTuple):
    """How `likely_changes` looks for them.

    Attributes:
        reach: samples to both sides among which no more than one change is looked for at a time.
        blow_reach: samples to both sides among which a blow may explain more.
        more_numbers: that a blow fits, n, than a change of F, 3 or 6.
    """

    reach: int
    blow_reach: int
    more_numbers: int


class ProportionalError(NamedTuple):
    """Errors of a joint in proportion to the torque that is read, N m per N m.

    Attributes:
        gain: of the torque itself, as by a torque per ampere that is off.
        friction: of its magnitude, against the joint's motion, as by friction that a load adds.
    """

    gain: float
    friction: float


def _copied(state: FilterState) -> FilterState:
    """The same state, which the next sample leaves as it is."""
    z, P, running, before = state
    return FilterState(z.copy(), P.copy(), running.copy(), before.copy())


class IntervalSmoother:
    """Reads stretches of a log, one after the other.

    Args:
        table: KalmanObserver.table.
        num_joints: n.
        kept_drift: share of the slow part of the torque error that outlasts a period.
        proportional: what of the torque that is read each joint errs by.
    """

    def __init__(
        self,
        table: Array,
        num_joints: int,
        kept_drift: float,
        proportional: ProportionalError | None = None,
    ) -> None:
        n = num_joints
        M = 3 * n + 6
        numbers, sixes, *_ = split_table(table, n)
        z, P = np.zeros(M), np.zeros((M, M))
        P[range(n, M), range(n, M)] = np.concatenate([sixes[START_F], np.ones(2 * n)])
        self._table, self._kept_drift = table, kept_drift
        T, size = float(numbers[PERIOD]), int(np.count_nonzero(sixes[JUMP_F]))
        self._sought = ChangesSought(
            round(max(CHANGE_TIMES) / T), round(min(CHANGE_TIMES) / T), n - size
        )
        self._start = FilterState(z, P, np.zeros(1, np.bool_), np.zeros(n))
        self._proportional = proportional
        self._response = np.zeros((M, len(ProportionalError._fields) * n))

    def read(self, signals: Array, J: Array, ready: int) -> tuple[Array, Array]:
        """Wrench (ready, 6) and covariance (ready, 6, 6) of the first samples, given all.

        The next stretch begins with the first sample that was not ready.

        Args:
            signals, J: (N, NUM_SIGNALS, n), (N, 6, n) of a stretch.
            ready: at most N.
        """
        changes = np.zeros(len(signals))
        found, after = self.smoothed(signals, J, changes, ready)
        for _ in range(PASSES - 1):
            more = likely_changes(found.evidence, self._sought)
            if not more.any():
                break
            changes += more
            found, after = self.smoothed(signals, J, changes, ready)
        self._start = after
        return found.wrench, found.covariance + self._proportional_covariance(signals, J, found)

    def _proportional_covariance(self, signals: Array, J: Array, found: IntervalReading) -> Array:
        """Covariance (K, 6, 6) from the errors in proportion to what is read; or zero."""
        K, n = len(found.wrench), J.shape[2]
        if self._proportional is None:
            return np.zeros((K, 6, 6))
        wrench = found.log.z[:, n : n + 6].copy()  # what has not been smoothed yet
        wrench[:K] = found.wrench
        read = np.einsum("kai,ka->ki", J, wrench)
        against = -np.sign(signals[:, V]) * np.abs(read)
        torque = np.stack(
            [self._proportional.gain * read, self._proportional.friction * against], axis=1
        )
        response = np.empty((K, 6, self._response.shape[1]))
        response_log(
            *(self._table, self._kept_drift, found.log, J),
            *(np.nan_to_num(torque), self._response, response),
        )
        return np.asarray(response @ response.transpose(0, 2, 1))

    def smoothed(
        self, signals: Array, J: Array, changes: Array, ready: int
    ) -> tuple[IntervalReading, FilterState]:
        """One pass, and where its forward part stood before the first sample that is not ready.

        Args:
            changes: (N,) live prior's variances that F gains after each sample.
            others: as `read`.
        """
        N, _, n = signals.shape
        M = 3 * n + 6
        log = FilterLog(
            *(np.empty((N, M)), np.empty((N, M, M))),
            *(np.empty((N, NUM_PERIOD, n)), np.empty((N, NUM_KINDS), np.bool_)),
        )
        state = _copied(self._start)

        def forward(rows: slice) -> None:
            forward_log(
                *(self._table, self._kept_drift, state, signals[rows], J[rows], changes[rows]),
                FilterLog(log.z[rows], log.P[rows], log.period[rows], log.kinds[rows]),
            )

        forward(slice(0, ready))
        after = _copied(state)
        forward(slice(ready, N))
        evidence = np.empty((N, NUM_EVIDENCE))
        wrench, covariance = np.empty((ready, 6)), np.empty((ready, 6, 6))
        backward_log(self._table, self._kept_drift, log, J, evidence, wrench, covariance)
        return IntervalReading(wrench, covariance, evidence, log), after


def likely_changes(evidence: Array, sought: ChangesSought) -> Array:
    """Shares (N,) of the live prior's variance that F is to gain after each sample.

    Args:
        evidence: (N, NUM_EVIDENCE) of `wrenchsight.models.observers.fixed_interval`.
        sought: how far, and against what.
    """
    N = len(evidence)
    shares = np.zeros(N)
    if N == 0:
        return shares
    reach, likelier = sought.reach, evidence[:, LIKELIER]
    highest = maximum_filter1d(likelier, 2 * reach + 1, mode="nearest")
    blow = maximum_filter1d(evidence[:, BLOW_GAIN], 2 * sought.blow_reach + 1, mode="nearest")
    force = evidence[:, FORCE_GAIN] + sought.more_numbers
    last = -reach - 1
    for k in np.flatnonzero((likelier > -np.log(CHANGE_ODDS)) & (likelier >= highest)):
        if k - last <= reach or blow[k] > force[k]:  # as likely as the one before, as in a gap
            continue
        near = slice(max(k - reach, 0), k + reach + 1)
        likelihood = np.exp(likelier[near] - likelier[k])
        shares[near] += likelihood / likelihood.sum()
        last = int(k)
    return shares
