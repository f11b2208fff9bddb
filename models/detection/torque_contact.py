"""Contact detection on an external torque that the controller reports, without a model.

Such a torque tau (`analyses.methods.external_torque`) is off by an offset that stays for seconds,
by noise, and by what friction and filters of the arm leave behind after each contact. A baseline
takes off the offset, and a log's own free stretches say how large the rest is:

    z = (tau - base) / sd,    s = |z|

**Baseline**: the mean of the first FIRST s; then, while nothing is found, a first-order low-pass of
SLOW s. During contact it stays.

**Contact** begins where s has exceeded LEVEL for HOLD s and two samples. It ends where s is below
RELEASE of that, or where of the largest z so far, p, less than LEFT remains, z.p < LEFT p.p: a hand
lets go within .1 s, and what is left then is the arm's own. p fades within FADE, so that a force
that falls slowly is followed.
For ANEW s after a contact none begins, and then the baseline starts again from the smallest s of
that time.

**Error.** Two sds for each joint, of an arm at rest and of one that moves (`moving_sd` where some
entry of J has changed by more than MOTION a second over MOTION_TIME within the last STILL s: a
touch shifts an arm less).
At rest sd^2 is the sum of the squares of

    noise   1.48 times the median of |tau - base| in free samples; no less than the lower quartile
            of the standard deviations within windows of WINDOW s
    step    the same of the baselines' changes over a contact
    floor   the root mean square of both over the joints: what a joint knows of its own error it
            knows from few contacts

found in ROUNDS rounds of detection, from START times the windows' sd. In motion the sd is as many
times the median of |tau - its low-pass|, over all moving samples, most of which are taken as free.

The constants were settled on five recordings of a Franka Panda that a hand touches (`link_contact`:
f2, d3, c2, b6, a4) and checked on five others. After these had been seen START was lowered from 3,
and STILL was set.
"""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.numerics.arrays import Array, Flags, contiguous
from wrenchsight.models.numerics.kernel import kernel

FIRST = 0.15  # s
SLOW = 1.0  # s
LEVEL = 6.0
HOLD = 0.005  # s
RELEASE = 0.7
LEFT = 0.15
FADE = 1.0  # s
ANEW = 0.12  # s
MOTION, MOTION_TIME = 0.05, 0.3  # 1/s (m/s where J is in metres), s
STILL = 0.5  # s
WINDOW = 0.15  # s
ROUNDS = 3
START = 2.0
MEDIAN = 1.4826  # sd over median of |x|, of a Gaussian
MOST_SAMPLES = 1 << 18  # that the error is learnt from
_LEAST_SD = 1e-4  # N m, where a log says nothing else
_FEWEST = 20  # samples of a kind that a median is taken of
_SETTLED = 0.15  # s after a contact, from when a sample counts as free
# Rows of the state after those of J's low-pass: (6 + NUM_ROWS, n).
_BASE, _PEAK, _LOWEST, _SINGLE, NUM_ROWS = range(5)
# Of `_SINGLE`; _TIME is NaN before the first sample, _ABOVE where s is not above LEVEL.
_TIME, _CONTACT, _WAIT, _SMALLEST, _ABOVE, _MOVED, _NUMBERS = range(7)


class TorqueError(NamedTuple):
    """N m, sd of what is read without contact, (n,) each: at rest, and in motion."""

    rest_sd: Array
    moving_sd: Array


class _Samples(NamedTuple):
    """N samples: t (N,) s, tau_ext (N, n) N m and J (N, 6, n)."""

    t: Array
    tau_ext: Array
    J: Array


class TorqueContact(NamedTuple):
    """Detection at N samples.

    Attributes:
        statistic: (N,) s / LEVEL: contact begins above 1.
        contact: (N,).
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
    """Contact along a log of external torque, chunk after chunk.

    Args:
        error: of this arm, as `learn_torque_error` finds it.
        start: (n,) N m, the first baseline: the mean of the log's first FIRST s.
    """

    def __init__(self, error: TorqueError, start: Array) -> None:
        n = len(start)
        self.error = error
        self._state = np.zeros((6 + NUM_ROWS, max(n, _NUMBERS)))
        self._state[6 + _BASE, :n] = start
        self._state[6 + _SINGLE, [_TIME, _ABOVE]] = np.nan

    def run(self, t: Array, tau_ext: Array, J: Array) -> TorqueContact:
        """Takes the next N samples: s, (N, n) N m, and (N, 6, n); what is not finite is passed."""
        N, n = tau_ext.shape
        out, baseline = np.zeros((N, 3)), np.zeros((N, n))
        error = TorqueError(
            np.ascontiguousarray(self.error.rest_sd, float),
            np.ascontiguousarray(self.error.moving_sd, float),
        )
        tau, jacobian = contiguous(tau_ext, J)
        samples = _Samples(np.asarray(t, float), tau, jacobian)
        torque_contact_log(error, self._state, samples, out, baseline)
        is_moving = out[:, 2] == 1.0
        sd = np.where(is_moving[:, None], self.error.moving_sd, self.error.rest_sd)
        return TorqueContact(out[:, 0], out[:, 1] == 1.0, is_moving, baseline, sd)


def first_baseline(t: Array, tau_ext: Array) -> Array:
    """(n,) N m, mean of the first FIRST s of a log's finite samples; zero where there is none."""
    is_finite = np.isfinite(tau_ext).all(axis=1)
    if not is_finite.any():
        return np.zeros(tau_ext.shape[1])
    return np.asarray(tau_ext[is_finite & (t <= t[is_finite][0] + FIRST)].mean(axis=0))


def learn_torque_error(t: Array, tau_ext: Array, J: Array) -> TorqueError:
    """Finds the error of a log's torque from its stretches without contact.

    Args:
        t: (N,) s.
        tau_ext: (N, n) N m.
        J: (N, 6, n).
    """
    is_finite = np.isfinite(tau_ext).all(axis=1) & np.isfinite(J).all(axis=(1, 2)) & np.isfinite(t)
    t, tau, J = (
        t[is_finite][:MOST_SAMPLES],
        tau_ext[is_finite][:MOST_SAMPLES],
        J[is_finite][:MOST_SAMPLES],
    )
    n = tau_ext.shape[1]
    if len(t) < _FEWEST:
        least = np.full(n, _LEAST_SD)
        return TorqueError(least, least)
    start = first_baseline(t, tau)
    least = np.full(n, _LEAST_SD)
    plain = TorqueContactDetector(TorqueError(np.full(n, np.inf), np.full(n, np.inf)), start)
    first_pass = plain.run(t, tau, J)
    moving_sd = _floored(_spread((tau - first_pass.baseline)[first_pass.moving], least))
    calm = np.maximum(_windows_sd(t, tau, ~first_pass.moving), least)
    sd = _floored(START * calm)
    for _ in range(ROUNDS):
        contacts = TorqueContactDetector(TorqueError(sd, moving_sd), start).run(t, tau, J)
        edges = np.flatnonzero(np.diff(contacts.contact.astype(int)))
        ends = edges[~contacts.contact[edges + 1]] + 1
        begins = edges[contacts.contact[edges + 1]] + 1
        settled = ~contacts.contact & ~contacts.moving
        last_end = np.searchsorted(ends, np.arange(len(t)), side="right") - 1
        since = (
            np.where(last_end >= 0, t - t[ends[np.maximum(last_end, 0)]], np.inf)
            if len(ends)
            else t
        )
        settled &= since >= (_SETTLED if len(ends) else -np.inf)
        noise = np.maximum(_spread((tau - contacts.baseline)[settled], calm), calm)
        after = np.searchsorted(t, t[ends] + _SETTLED)
        pairs = [
            (begin, int(after[k]))
            for begin in begins
            if (k := int(np.searchsorted(ends, begin))) < len(ends) and after[k] < len(t)
        ]
        steps = np.array([contacts.baseline[j] - contacts.baseline[i] for i, j in pairs])
        step = noise if len(pairs) < 3 else MEDIAN * np.median(np.abs(steps), axis=0)
        sd = _floored(np.hypot(noise, step))
    if not first_pass.moving.any():
        moving_sd = sd
    return TorqueError(sd, np.maximum(moving_sd, sd))


def _floored(sd: Array) -> Array:
    return np.asarray(np.sqrt(sd**2 + np.mean(sd**2)))


def _spread(x: Array, otherwise: Array) -> Array:
    """(n,) sd of (N, n) by the median of its size."""
    return MEDIAN * np.median(np.abs(x), axis=0) if len(x) >= _FEWEST else otherwise


def _windows_sd(t: Array, tau: Array, used: Flags) -> Array:
    """(n,) N m, lower quartile of the sds within windows of WINDOW s at rest; of all else."""
    step = float(np.median(np.diff(t)))
    size = max(4, round(WINDOW / step)) if step > 0.0 else 4
    count = len(t) // size
    windows = tau[: count * size].reshape(count, size, -1).std(axis=1, ddof=1)
    whole = used[: count * size].reshape(count, size).all(axis=1)
    return np.asarray(np.percentile(windows[whole] if whole.any() else windows, 25.0, axis=0))


@kernel
def torque_contact_log(
    error: TorqueError, state: Array, samples: _Samples, out: Array, base: Array
) -> None:
    """Detects contact at N samples.

    Args:
        error: of the torque.
        state: of TorqueContactDetector, changed.
        samples: N of them.
        out: (N, 3) statistic, contact and motion, written.
        base: (N, n) N m, the baseline, written.
    """
    rest_sd, moving_sd = error
    t, tau_ext, J = samples
    n = tau_ext.shape[1]
    z = np.empty(n)
    slow_J, rows = state[:6], state[6:]
    numbers = rows[_SINGLE]
    for k in range(tau_ext.shape[0]):
        finite = np.isfinite(t[k])
        for j in range(n):
            finite = finite and np.isfinite(tau_ext[k, j])
            for i in range(6):
                finite = finite and np.isfinite(J[k, i, j])
        if not finite:
            for j in range(n):
                base[k, j] = rows[_BASE, j]
            continue
        T = 0.0
        if np.isfinite(numbers[_TIME]):
            T = max(t[k] - numbers[_TIME], 0.0)
        else:
            for i in range(6):
                for j in range(n):
                    slow_J[i, j] = J[k, i, j]
        numbers[_TIME] = t[k]
        gain, change = 1.0 - np.exp(-T / MOTION_TIME), 0.0
        for i in range(6):
            for j in range(n):
                slow_J[i, j] += gain * (J[k, i, j] - slow_J[i, j])
                change = max(change, abs(J[k, i, j] - slow_J[i, j]))
        numbers[_MOVED] = STILL if change > MOTION * MOTION_TIME else numbers[_MOVED] - T
        moving = numbers[_MOVED] > 0.0
        square, along, peak = 0.0, 0.0, 0.0
        fade = np.exp(-T / FADE)
        for j in range(n):
            z[j] = (tau_ext[k, j] - rows[_BASE, j]) / (moving_sd[j] if moving else rest_sd[j])
            square += z[j] * z[j]
            rows[_PEAK, j] *= fade
            along += z[j] * rows[_PEAK, j]
            peak += rows[_PEAK, j] * rows[_PEAK, j]
        s = np.sqrt(square)
        if numbers[_CONTACT] == 0.0:
            if numbers[_WAIT] > 0.0:
                numbers[_WAIT] -= T
                if s <= numbers[_SMALLEST]:
                    numbers[_SMALLEST] = s
                    rows[_LOWEST, :n] = tau_ext[k]
                if numbers[_WAIT] <= 0.0:
                    rows[_BASE, :n] = rows[_LOWEST, :n]
            elif s > LEVEL:
                numbers[_ABOVE] = numbers[_ABOVE] + T if np.isfinite(numbers[_ABOVE]) else 0.0
                if numbers[_ABOVE] >= HOLD:
                    numbers[_CONTACT] = 1.0
                    rows[_PEAK, :n] = z
            else:
                for j in range(n):
                    rows[_BASE, j] += (1.0 - np.exp(-T / SLOW)) * (tau_ext[k, j] - rows[_BASE, j])
        elif square >= peak:
            rows[_PEAK, :n] = z
        elif along < LEFT * peak:
            numbers[_CONTACT], numbers[_WAIT], numbers[_SMALLEST] = 0.0, ANEW, np.inf
        if numbers[_CONTACT] == 1.0 and s < RELEASE * LEVEL:
            numbers[_CONTACT], numbers[_WAIT], numbers[_SMALLEST] = 0.0, ANEW, np.inf
        if s <= LEVEL or numbers[_CONTACT] == 1.0:
            numbers[_ABOVE] = np.nan
        out[k, 0], out[k, 1] = s / LEVEL, numbers[_CONTACT]
        out[k, 2] = 1.0 if moving else 0.0
        for j in range(n):
            base[k, j] = rows[_BASE, j]
