"""Contact detection on an external torque that the controller reports, without a model.

Such a torque tau (`analyses.methods.external_torque`) has three errors: an offset that stays for
seconds, noise, and a step that friction and filters of the arm cause at each contact. A baseline
takes off the offset. The log's stretches without contact show how large the other two are:

    z = (tau - base) / sd,    s = |z|

**Baseline**: the mean of the first START_TIME s; then, without contact, a first-order low-pass of
BASELINE_TIME s. During contact it stays.

**Contact** begins where s has exceeded CONTACT_LEVEL for ONSET_TIME s and two samples. It ends
where s is below RELEASE_SHARE of that level. It also ends where less than MIN_PEAK_SHARE remains of
the largest z so far, p: z.p < MIN_PEAK_SHARE p.p. A hand lets go within .1 s; the torque that
remains then is an error of the arm. p fades within PEAK_TIME, so that a force that falls slowly is
followed. For PAUSE_TIME s after a contact none begins. Then the baseline starts again from the
sample of smallest s in that time.

**Error.** Two sds for each joint, of an arm at rest and of one that moves. The arm moves where some
entry of J has changed by more than MIN_JACOBIAN_RATE a second over MOTION_TIME within the last
REST_TIME s. A touch shifts an arm less.
At rest sd^2 is the sum of the squares of

    noise   1.48 times the median of |tau - base| in free samples; no less than the lower quartile
            of the standard deviations within windows of SD_WINDOW s
    step    the same of the baselines' changes over a contact
    floor   the root mean square of both over the joints, since few contacts determine the error
            of a single joint

They come from NUM_ROUNDS rounds of detection, the first with START_SD_RATIO times the windows' sd.
In motion noise is 1.48 times the median of |tau - its low-pass| over all moving samples, most of
which are taken as free; the same floor is added, and the sd is no less than at rest.

The constants were chosen on five recordings of a Franka Panda that a hand touches (`link_contact`:
f2, d3, c2, b6, a4) and checked on five others. After the check START_SD_RATIO was lowered from 3,
and REST_TIME was set.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchsight.models.numerics.arrays import Array, Flags, contiguous
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.signals.bands import SD_PER_MEDIAN

START_TIME = 0.15  # s
BASELINE_TIME = 1.0  # s
CONTACT_LEVEL = 6.0
ONSET_TIME = 0.005  # s
RELEASE_SHARE = 0.7
MIN_PEAK_SHARE = 0.15
PEAK_TIME = 1.0  # s
PAUSE_TIME = 0.12  # s
MIN_JACOBIAN_RATE, MOTION_TIME = 0.05, 0.3  # 1/s (m/s where J is in metres), s
REST_TIME = 0.5  # s
SD_WINDOW = 0.15  # s
NUM_ROUNDS = 3
START_SD_RATIO = 2.0
MAX_SAMPLES = 1 << 18  # from which the error is learnt
SENSOR_LOADED_SDS = 1.5  # as `link_odds.LOADED_SDS`, of what torque sensors read
_MIN_SD = 1e-4  # N m, where a log shows no error
_MIN_MEDIAN_SAMPLES = 20  # samples, of which a median is taken
_MIN_STEPS = 3  # contacts, of whose steps of the baseline a median is taken
_SETTLING_TIME = 0.15  # s after a contact, from when a sample counts as free
# Entries of `_State.numbers`.
(
    _TIME,  # s, of the last sample; NaN before the first
    _CONTACT,  # 1: contact, 0: none
    _WAIT,  # s left of the pause after a contact
    _SMALLEST,  # smallest s in that pause
    _ABOVE,  # s, for which s has been above CONTACT_LEVEL; NaN: it is not
    _MOVED,  # s, for which the arm still counts as moving
    _NUM_NUMBERS,
) = range(7)
# Columns of `torque_contact_log`'s output.
_STATISTIC_COLUMN, _CONTACT_COLUMN, _MOVING_COLUMN, _NUM_COLUMNS = range(4)


class ReportedTorqueSd(NamedTuple):
    """Sd of the reported torque without contact.

    Attributes:
        rest_sd: (n,) N m, of an arm at rest.
        moving_sd: (n,) N m, of one that moves.
    """

    rest_sd: Array
    moving_sd: Array


class _Samples(NamedTuple):
    """N samples: t (N,) s, tau_ext (N, n) N m and J (N, 6, n)."""

    t: Array
    tau_ext: Array
    J: Array


class _State(NamedTuple):
    """What a detector knows of the samples so far; changed in place.

    Attributes:
        J_mean: (6, n) J, low-passed.
        baseline: (n,) N m, of the torque without contact.
        peak: (n,) z of the contact where it was largest, fading.
        calmest: (n,) N m, the torque of smallest s in the pause after a contact.
        numbers: (_NUM_NUMBERS,), entries _TIME to _MOVED.
    """

    J_mean: Array
    baseline: Array
    peak: Array
    calmest: Array
    numbers: Array


class TorqueContact(NamedTuple):
    """Detection at N samples.

    Attributes:
        statistic: (N,) s / CONTACT_LEVEL; contact begins above 1.
        contact: (N,) whether something touches the arm.
        moving: (N,) whether the arm moves.
        baseline: (N, n) N m.
        sd: (N, n) N m, of tau - baseline without contact.
    """

    statistic: Array
    contact: Flags
    moving: Flags
    baseline: Array
    sd: Array


class TorqueContactDetector:
    """Detector of contact along a log of external torque, chunk after chunk.

    Args:
        error: error of this arm, of `learn_reported_torque_sd`.
        start: (n,) N m, the first baseline: the mean of the log's first START_TIME s.
    """

    def __init__(self, error: ReportedTorqueSd, start: Array) -> None:
        n = len(start)
        self.error = error
        self._state = _State(
            J_mean=np.zeros((6, n)),
            baseline=np.array(start, dtype=np.float64),
            peak=np.zeros(n),
            calmest=np.zeros(n),
            numbers=np.zeros(_NUM_NUMBERS),
        )
        self._state.numbers[[_TIME, _ABOVE]] = np.nan

    def run(self, t: Array, tau_ext: Array, J: Array) -> TorqueContact:
        """Takes the next N samples.

        A sample that is not finite is passed over: statistic 0, no contact.

        Args:
            t: (N,) s.
            tau_ext: (N, n) N m.
            J: (N, 6, n), rows [angular; linear], at E in axes of W.
        """
        N, n = tau_ext.shape
        out, baseline = np.zeros((N, _NUM_COLUMNS)), np.zeros((N, n))
        error = ReportedTorqueSd(
            np.ascontiguousarray(self.error.rest_sd, float),
            np.ascontiguousarray(self.error.moving_sd, float),
        )
        tau, jacobian = contiguous(tau_ext, J)
        samples = _Samples(np.asarray(t, float), tau, jacobian)
        torque_contact_log(error, self._state, samples, out, baseline)
        is_moving = out[:, _MOVING_COLUMN] == 1.0
        return TorqueContact(
            statistic=out[:, _STATISTIC_COLUMN],
            contact=out[:, _CONTACT_COLUMN] == 1.0,
            moving=is_moving,
            baseline=baseline,
            sd=np.where(is_moving[:, None], self.error.moving_sd, self.error.rest_sd),
        )


def first_baseline(t: Array, tau_ext: Array) -> Array:
    """(n,) N m, mean of the first START_TIME s of a log's finite samples; zero where there is
    none.
    """
    is_finite = np.isfinite(tau_ext).all(axis=1)
    if not is_finite.any():
        return np.zeros(tau_ext.shape[1])
    return np.asarray(tau_ext[is_finite & (t <= t[is_finite][0] + START_TIME)].mean(axis=0))


def learn_reported_torque_sd(t: Array, tau_ext: Array, J: Array) -> ReportedTorqueSd:
    """Finds the error of a log's torque from its stretches without contact.

    Which stretches these are depends on the error in turn. So the detector runs over the log with
    START_SD_RATIO times the sd of its calmest windows first, and then with that of the stretches in
    which it has found no contact, NUM_ROUNDS rounds in all. At rest the error is the noise there,
    plus what the baseline changes over a contact, which a detector cannot tell from a lasting one
    (of fewer than _MIN_STEPS contacts: as much as the noise again). Each sd has the joints' root
    mean square added (`_floored`).

    Args:
        t: (N,) s.
        tau_ext: (N, n) N m, as the arm's controller reports it.
        J: (N, 6, n) at E, rows [angular; linear].

    Returns:
        sd at rest and in motion, (n,) N m each, at least _MIN_SD; both this least where the log is
        too short.
    """
    is_finite = np.isfinite(tau_ext).all(axis=1) & np.isfinite(J).all(axis=(1, 2)) & np.isfinite(t)
    rows = np.flatnonzero(is_finite)[:MAX_SAMPLES]
    t, tau, J = t[rows], tau_ext[rows], J[rows]
    n = tau.shape[1]
    least_sd, endless_sd = np.full(n, _MIN_SD), np.full(n, np.inf)
    if len(t) < _MIN_MEDIAN_SAMPLES:
        return ReportedTorqueSd(least_sd, least_sd)
    start = first_baseline(t, tau)

    def run(rest_sd: Array, moving_sd: Array) -> TorqueContact:
        """The contacts of the whole log, by a detector with these sds."""
        return TorqueContactDetector(ReportedTorqueSd(rest_sd, moving_sd), start).run(t, tau, J)

    # With infinite sds no contact begins: the baseline is a low-pass all along.
    without_contacts = run(endless_sd, endless_sd)
    is_moving = without_contacts.moving
    moving_torque = (tau - without_contacts.baseline)[is_moving]
    moving_sd = _floored(_spread(moving_torque, least_sd))
    calm_sd = np.maximum(_windows_sd(t, tau, ~is_moving), least_sd)
    rest_sd = _floored(START_SD_RATIO * calm_sd)
    for _ in range(NUM_ROUNDS):
        contacts = run(rest_sd, moving_sd)
        free_torque = (tau - contacts.baseline)[_is_settled(t, contacts)]
        noise_sd = np.maximum(_spread(free_torque, calm_sd), calm_sd)
        steps = _baseline_steps(t, contacts)
        step_sd = noise_sd  # where contacts are too few for a median
        if len(steps) >= _MIN_STEPS:
            step_sd = SD_PER_MEDIAN * np.median(np.abs(steps), axis=0)
        rest_sd = _floored(np.hypot(noise_sd, step_sd))
    if not is_moving.any():
        moving_sd = rest_sd
    return ReportedTorqueSd(rest_sd, np.maximum(moving_sd, rest_sd))


class _Edges(NamedTuple):
    """Samples at which a contact begins, and those at which one has ended."""

    begins: NDArray[np.intp]
    ends: NDArray[np.intp]

    @classmethod
    def of(cls, contact: Flags) -> "_Edges":
        """The edges of flags (N,)."""
        last = np.flatnonzero(np.diff(contact.astype(int)))
        begins_next = contact[last + 1]
        return cls(last[begins_next] + 1, last[~begins_next] + 1)


def _is_settled(t: Array, contacts: TorqueContact) -> Flags:
    """(N,) samples at rest, without contact, and _SETTLING_TIME after the last one."""
    is_settled = np.asarray(~contacts.contact & ~contacts.moving)
    ends = _Edges.of(contacts.contact).ends
    if not len(ends):
        return is_settled
    last_end = np.searchsorted(ends, np.arange(len(t)), side="right") - 1
    since_end = np.where(last_end >= 0, t - t[ends[np.maximum(last_end, 0)]], np.inf)
    return np.asarray(is_settled & (since_end >= _SETTLING_TIME))


def _baseline_steps(t: Array, contacts: TorqueContact) -> Array:
    """(contacts, n) N m, change of the baseline over each contact that ends within the log."""
    begins, ends = _Edges.of(contacts.contact)
    settled = np.searchsorted(t, t[ends] + _SETTLING_TIME)
    steps = [
        contacts.baseline[settled[k]] - contacts.baseline[begin]
        for begin in begins
        if (k := int(np.searchsorted(ends, begin))) < len(ends) and settled[k] < len(t)
    ]
    return np.array(steps)


def _floored(sd: Array) -> Array:
    """(n,) the sds with their root mean square added in squares."""
    return np.asarray(np.sqrt(sd**2 + np.mean(sd**2)))


def _spread(x: Array, otherwise: Array) -> Array:
    """(n,) sd of x (N, n) by the median of |x|; `otherwise` where x has too few rows."""
    return (
        SD_PER_MEDIAN * np.median(np.abs(x), axis=0) if len(x) >= _MIN_MEDIAN_SAMPLES else otherwise
    )


def _windows_sd(t: Array, tau: Array, used: Flags) -> Array:
    """(n,) N m, lower quartile of the sds within windows of SD_WINDOW s.

    The windows are those whose samples are all used; where there is none, all of them.
    """
    step = float(np.median(np.diff(t)))
    size = max(4, round(SD_WINDOW / step)) if step > 0.0 else 4
    count = len(t) // size
    windows = tau[: count * size].reshape(count, size, -1).std(axis=1, ddof=1)
    whole = used[: count * size].reshape(count, size).all(axis=1)
    return np.asarray(np.percentile(windows[whole] if whole.any() else windows, 25.0, axis=0))


@kernel
def torque_contact_log(
    error: ReportedTorqueSd, state: _State, samples: _Samples, out: Array, base: Array
) -> None:
    """Detects contact at N samples.

    Args:
        error: sd of the torque, at rest and in motion.
        state: state of TorqueContactDetector, changed.
        samples: N of them; one that is not finite leaves the state and its row of `out` as they
            are.
        out: (N, _NUM_COLUMNS), written: statistic over its level for contact; 1 for contact; 1 for
            motion.
        base: (N, n) N m, the baseline after each sample, written.
    """
    t, tau_ext, J = samples.t, samples.tau_ext, samples.J
    z = np.empty(tau_ext.shape[1])
    for k in range(tau_ext.shape[0]):
        if _is_finite(t[k], tau_ext[k], J[k]):
            # In this order: each changes what the next one reads of the state.
            T = _period(state, t[k], J[k])
            moves = _moves(state, J[k], T)
            sd = error.moving_sd if moves else error.rest_sd
            norms = _take_torque(state, tau_ext[k], sd, T, z)
            _decide(state, tau_ext[k], norms, T, z)
            out[k, _STATISTIC_COLUMN] = np.sqrt(norms.square) / CONTACT_LEVEL
            out[k, _CONTACT_COLUMN] = state.numbers[_CONTACT]
            out[k, _MOVING_COLUMN] = 1.0 if moves else 0.0
        base[k] = state.baseline


class _Norms(NamedTuple):
    """z.z, z.p and p.p of one sample; p is the largest z of the contact."""

    square: float
    along_peak: float
    peak_square: float


@kernel
def _is_finite(t: float, tau_ext: Array, J: Array) -> bool:
    """Whether a sample is finite."""
    return bool(np.isfinite(t) and np.all(np.isfinite(tau_ext)) and np.all(np.isfinite(J)))


@kernel
def _period(state: _State, t: float, J: Array) -> float:
    """The time since the last sample, s; the first one starts the low-pass of J and gives 0."""
    T = 0.0
    if np.isfinite(state.numbers[_TIME]):
        T = max(t - state.numbers[_TIME], 0.0)
    else:
        state.J_mean[:] = J
    state.numbers[_TIME] = t
    return T


@kernel
def _moves(state: _State, J: Array, T: float) -> bool:
    """Takes J (6, n) into its low-pass; returns whether the arm moves, or has within REST_TIME."""
    J_mean, numbers = state.J_mean, state.numbers
    J_mean += (1.0 - np.exp(-T / MOTION_TIME)) * (J - J_mean)
    change = np.max(np.abs(J - J_mean))
    numbers[_MOVED] = REST_TIME if change > MIN_JACOBIAN_RATE * MOTION_TIME else numbers[_MOVED] - T
    return bool(numbers[_MOVED] > 0.0)


@kernel
def _take_torque(state: _State, tau_ext: Array, sd: Array, T: float, z: Array) -> _Norms:
    """Writes z (n,), and lets the peak fade."""
    peak = state.peak
    z[:] = (tau_ext - state.baseline) / sd
    peak *= np.exp(-T / PEAK_TIME)
    return _Norms(np.sum(z * z), np.sum(z * peak), np.sum(peak * peak))


@kernel
def _decide(state: _State, tau_ext: Array, norms: _Norms, T: float, z: Array) -> None:
    """Begins and ends contact; without contact takes the sample into the baseline."""
    numbers, s = state.numbers, np.sqrt(norms.square)
    ends = False
    if numbers[_CONTACT] == 0.0:
        _wait_for_contact(state, tau_ext, s, T, z)
    elif norms.square >= norms.peak_square:
        state.peak[:] = z
    else:
        ends = norms.along_peak < MIN_PEAK_SHARE * norms.peak_square
    if ends or (numbers[_CONTACT] == 1.0 and s < RELEASE_SHARE * CONTACT_LEVEL):
        numbers[_CONTACT], numbers[_WAIT], numbers[_SMALLEST] = 0.0, PAUSE_TIME, np.inf
    if s <= CONTACT_LEVEL or numbers[_CONTACT] == 1.0:
        numbers[_ABOVE] = np.nan


@kernel
def _wait_for_contact(state: _State, tau_ext: Array, s: float, T: float, z: Array) -> None:
    """The pause after a contact, the begin of one, or the baseline's low-pass."""
    numbers, baseline = state.numbers, state.baseline
    if numbers[_WAIT] > 0.0:
        numbers[_WAIT] -= T
        if s <= numbers[_SMALLEST]:
            numbers[_SMALLEST] = s
            state.calmest[:] = tau_ext
        if numbers[_WAIT] <= 0.0:
            baseline[:] = state.calmest
    elif s > CONTACT_LEVEL:
        numbers[_ABOVE] = numbers[_ABOVE] + T if np.isfinite(numbers[_ABOVE]) else 0.0
        if numbers[_ABOVE] >= ONSET_TIME:
            numbers[_CONTACT] = 1.0
            state.peak[:] = z
    else:
        baseline += (1.0 - np.exp(-T / BASELINE_TIME)) * (tau_ext - baseline)
