"""Does something touch the arm, and at E? A statistic of what an observer reads, sample by sample.

**Whitened torque.** What joint j reads, over its standard deviation where nothing touches the arm:

    z = sign(tau) (|tau| - w b)+ / (g s),    s^2 = sd^2 - w stiction^2 + jolt^2

with sd and stiction of `models.identification.torque_error_model`, w its share of a joint at rest
and b = sqrt(3) stiction the breakaway torque: at rest friction carries anything up to b and nothing
beyond. Two things that the torque error does not hold:

    jolt    where inertial torque jumps within a sample, as in an abrupt stop, speed and current
            that are not of the same instant read as K_0 times the jump of momentum. Root of the
            sum of squares of (1 - pole) |p - 2 p' + p''| / T, fading with the observer's pole; what
            it exceeds `usual_jolt` by. So does motor torque that jumps, as where a drive brakes: a
            mean over a period is anywhere between its ends, D apart, which is D / sqrt(3) from
            the end that an observer holds and D / sqrt(12) from the middle of both
    local   g >= 1: root mean square of z over LOCAL_TIME without contact, as in a radar's constant
            false-alarm rate. Friction that has drifted widens the threshold in place of a false
            alarm; outliers count as OUTLIER times g, where there is contact g stays, and in the
            first LOCAL_TIME of a log it is the mean since the start, g = 1 counting for FIRST

With y = U z, U upper triangular and U R U^T = 1 for the correlation R of the joints' errors, so
that y_j.. depends on joints j and beyond alone, norms are compared with the level that each exceeds
at a stated rate per hour (`models.signals.exceedance_tail`, of the logs that the model was fitted
on, held out):

    change  |U c|                        a push, at once
    mean    |U LP(z) / mean_scale|       one that is weak, over WINDOW; LP is a first-order low-pass
    sample  |y|                          whether it is still there
    power   sqrt(LP(|y|^2))              whether it is at E

**Change** is what a sample has beyond the recent mean, c_j = (x - LP(x))_j / (g' s')_j with
x = sign(tau) (|tau| - w b)+. Friction errors are slow: half of a reading's error in sliding lasts
longer than WINDOW, and so does nearly all that drifts from day to day, while a push comes within
the observer's lag. Its variance s'^2 is of the parts that sd^2 has, with shares of their own, and
of the jolt's square, and g' is its own local scale. A joint that comes to rest lets go of what it
carried within some samples, sooner than sd^2 knows that it rests: below REST_SPEED the stiction
part is b^2 / 3 exp(-(v / REST_SPEED)^2), low-passed as the reading is, if that is more, until all
joints have rested for REST_TIME. A joint that starts lets go likewise, later than it is known to
move, and what it carried stays in the mean: till then the part is no less than LP(w b)^2 / 3.
In the first WINDOW of a log there is no mean yet, and so no change. Over the UR10e's other days,
in units of those of the fit, the size of z goes from .9 to 3.6 and that of its changes from .9 to
2.5. A model that does not know s' takes `sample` in the place of `change`.

**Mean** has a level OTHER_DAYS (`contact_detector`) times the one that the held-out motion states.
What lasts is what differs from day to day, and the motion that a model was fitted on knows few
days: on five logs of the UR10e's other weeks and motions and on its three runs, each read by a
model of the others, the mean exceeded its own level two to three times too often, and with this
factor contacts come as often as stated (10 to 360 an hour).

**Contact** begins where `change` or `mean` exceeds its level, each of half of the stated rate, and
lasts until `sample` and `mean` have been below RELEASE of it, or what noise often reaches, for
QUIET. So that the mean does not outlast a contact, it does not count where the present sample is
less than LEFT of it; as it begins anew from the sample after a contact, it is no mean before ANEW
has passed and begins no contact till then. A reading whose mean over LOCAL_TIME vanishes is not a
contact but an error larger than any before: after that time g follows it, as slowly as before.

**Misfit**: what no force at E, with a moment within its prior, explains,

    D = min_F |y - U J^T F / (g s)|^2 + |moment / moment_sd|^2

with J as the observer saw it and s widened by the model's scale error. sqrt(LP(D)) over
MISFIT_WINDOW is compared with a level of its own, learnt where no moment is known beforehand to be
other than zero: any other prior makes D smaller. It is looked at in contact alone, so that the
level is one that a contact at E that lasts a second exceeds once in a hundred times, whatever the
stated rate. A model that does not know it takes the level of `power`: D <= |y|^2.
With six joints and an unknown moment a force at E explains everything: D = 0.

**Link**: a force on link k loads joints 1 to k alone. Where the contact is not at E and joints
beyond k are within LOUD of their errors while k and beyond exceed the level of `power`, the contact
is on link k, or its line meets the axes of all joints beyond. Else the joints cannot tell.

WINDOW and LOCAL_TIME were chosen on the held-out readings of the UR10e's three fitted runs, to
which pushes and a drift of friction were added. Neither a high-pass nor more windows helped there.
"""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.estimation.torque_error_stage import TorqueError
from wrenchsight.models.identification.torque_error_model import (
    NUM_FEATURES,
    TRANSMITTED_ROW,
    UNKNOWN_SHARE_ROW,
    breakaway,
    variance_parts,
)
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.small_matrices import factorise_in_place, solve_lower
from wrenchsight.models.numerics.views import borrowed, copy_to

WINDOW = 0.3  # s
MISFIT_WINDOW = 0.1  # s
LOCAL_TIME = 10.0  # s
FIRST = 1.0  # s
OUTLIER = 3.0
RELEASE, LARGEST_RELEASE = 0.5, 0.8
LEFT = 0.3
QUIET = 0.1  # s
ANEW = 0.5  # s
ONE_SIDED = 0.15  # share of a reading's mean square, beyond which its mean is not chance
_STICTION = NUM_FEATURES - 1  # among what a variance is made of
LOUD = 2.0  # root mean square over WINDOW
REST_SPEED = 0.01  # rad/s (m/s)
REST_TIME = 0.3  # s

# Rows of the state.
_LAST, _BEFORE, _TORQUE, _BASE, _JOLT2, _LOCAL2 = range(6)
_SLOW, _SQUARE, _MEAN, _POWER, _CHANGE2, _STOP, _START = range(6, 13)
NUM_UNKNOWN = _JOLT2  # rows before it are not known before the first sample
_SINGLE = _START + 1  # first of the rows that hold single numbers
_CONTACT, _QUIET, _MISFIT, _RESTING, _RATIO, _TOUCHED, _SEEN, _ANEW, NUM_SINGLE = range(9)

# Rows of `joints`: the observer's pole for a jolt, per tick, ...
JOLT_POLE, USUAL_JOLT, MEAN_SCALE, FITTED_SPEED, FITTED_LOAD, CHANGE = range(6)
NUM_JOINT_ROWS = CHANGE + NUM_FEATURES + 1  # the last: shares of a change's variance, and jolt's
# Entries of `settings`.
PERIOD, SAMPLE_LEVEL, MEAN_LEVEL, POWER_LEVEL, MOMENT_SD, SCALE = range(6)
SAMPLE_RELEASE, MEAN_RELEASE, CHANGE_LEVEL, PRESENT, MISFIT_LEVEL, NUM_SETTINGS = range(6, 12)
# Entries of what is written.
STATISTIC, CONTACT, MISFIT, LINK, REST, OUT_OF_RANGE = range(6)
SAMPLE_LENGTH, MEAN_LENGTH, POWER_LENGTH, CHANGE_LENGTH, NUM_OUT = range(6, 11)
WORK_ROWS = 12  # and n more

_FORCE_SD = 1e4  # N; stands for unknown, small enough that 1 is not lost beside its square
UNKNOWN_MOMENT = 1e4  # N m, likewise


class TorqueWhite(NamedTuple):
    """What `detect_log` leaves for what learns, see there."""

    z: Array
    mean: Array
    change: Array
    misfit: Array


class ArmSamples(NamedTuple):
    """What an estimator knows of N samples, or of one without the first axis.

    Attributes:
        error: of the torque.
        v: (N, n) rad/s.
        transmitted: (N, n) N m; counts for the sample after.
        momentum: (N, n) kg m^2/s, of the model.
        tau_ext: (N, n) N m.
        fresh: (N,) whether tau_ext is of this sample; otherwise contact and misfit stay as they
            were.
    """

    error: TorqueError
    v: Array
    transmitted: Array
    momentum: Array
    tau_ext: Array
    fresh: Flags


def state_rows(num_joints: int) -> int:
    """Rows of the state, (rows, n)."""
    return _SINGLE - (-NUM_SINGLE // num_joints)


@kernel
def misfit_square(
    white: Array, J: Array, s: Array, tau_y: Array, moment_sd: float, M: Array
) -> float:
    """D of y (n,) = U z: y^T (1 + A^T P A)^-1 y with A = J diag(1 / s) U^T.

    Args:
        white: (n, n) U.
        J: (6, n).
        s: (n,) N m.
        tau_y: (n,) y.
        moment_sd: N m.
        M: (n + 7, n), scratch.
    """
    n = J.shape[1]
    A = M[n : n + 6]
    for i in range(6):
        known = moment_sd if i < 3 else _FORCE_SD
        for j in range(n):
            total = 0.0
            for k in range(j, n):
                total += white[j, k] * J[i, k] / s[k]
            A[i, j] = known * total
    x = M[n + 6]
    for i in range(n):
        for j in range(i + 1):
            total = 1.0 if i == j else 0.0
            for k in range(6):
                total += A[k, i] * A[k, j]
            M[i, j] = total
        x[i] = tau_y[i]
    factorise_in_place(M, n, 0.0)
    solve_lower(M, n, x)
    square = 0.0
    for i in range(n):
        square += x[i] * x[i]
    return square


@kernel
def detect_tick(
    tables: tuple[Array, Array, Array, Array],
    state: Array,
    own: ArmSamples,
    out: Array,
    work: Array,
) -> None:
    """Single-sample kernel: takes a sample into `state` and writes what it says.

    Args:
        tables: of the torque error; `joints` (NUM_JOINT_ROWS, n), `settings` (NUM_SETTINGS,) and
            U (n, n) of ContactDetector.
        state: (state_rows, n), changed.
        own: the sample.
        out: (NUM_OUT,), written.
        work: (n + WORK_ROWS, max(n, NUM_FEATURES)), overwritten; its row 1 is left with z, row 3
            with the change in N m.
    """
    _, joints, settings, white = tables
    error, v, tau_ext = own.error, own.v, own.tau_ext
    n, keep = v.shape[0], np.exp(-settings[PERIOD] / WINDOW)
    single = state[_SINGLE:].reshape(-1)
    detector = _Detector(tables, keep, state, single)
    load = work[2, :n]
    beyond = False
    for j in range(n):
        load[j] = error.rows[TRANSMITTED_ROW, j]
        beyond = beyond or abs(v[j]) > joints[FITTED_SPEED, j]
        beyond = beyond or abs(load[j]) > joints[FITTED_LOAD, j]
    out[OUT_OF_RANGE] = 1.0 if beyond else 0.0
    _change_variance(detector, error.rows, v, load, work)
    _take_jolts(detector, own.momentum, load, own.transmitted)
    single[_RESTING] += settings[PERIOD]
    finite = own.fresh
    for j in range(n):
        if not abs(v[j]) < REST_SPEED:
            single[_RESTING] = 0.0
        finite = finite and np.isfinite(tau_ext[j])
    out[REST] = 1.0 if single[_RESTING] >= REST_TIME else 0.0
    lengths = _Lengths(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if finite:
        _whiten(detector, error, tau_ext, work)
        lengths = _lengths(detector, work)
        _decide(detector, lengths, work)
    out[SAMPLE_LENGTH], out[MEAN_LENGTH] = lengths.sample, lengths.mean
    out[POWER_LENGTH], out[CHANGE_LENGTH] = lengths.power, lengths.change
    out[STATISTIC], out[CONTACT] = single[_RATIO], single[_CONTACT]
    out[MISFIT], out[LINK] = 0.0, 0.0
    if single[_CONTACT] == 1.0 and finite:
        single[_MISFIT] += (1.0 - np.exp(-settings[PERIOD] / MISFIT_WINDOW)) * (
            _unexplained(settings, white, error.J_seen, tau_ext, work) - single[_MISFIT]
        )
    if single[_CONTACT] == 1.0 and np.sqrt(single[_MISFIT]) > settings[MISFIT_LEVEL]:
        out[MISFIT] = 1.0
        out[LINK] = _link(state[_POWER], settings[POWER_LEVEL])


class _Detector(NamedTuple):
    """What the parts of a tick share: tables and state as `detect_tick`, the share that LP keeps of
    a sample, and the state's single numbers.
    """

    tables: tuple[Array, Array, Array, Array]
    keep: float
    state: Array
    single: Array


class _Lengths(NamedTuple):
    """Norms of one sample: of y, LP(z) scaled and plain, LP(y^2) and the change; y . U LP(z)."""

    sample: float
    mean: float
    power: float
    change: float
    plain_mean: float  # squared
    along: float


@kernel
def _change_variance(own: _Detector, rows: Array, v: Array, load: Array, work: Array) -> None:
    """Writes s'^2 (n,), the variance of a change without its jolt, into row 0 of `work`."""
    (table, joints, _, _), keep, state, single = own
    s, parts = work[0], work[4]
    for j in range(v.shape[0]):
        variance_parts(table, rows, j, v[j], load[j], parts)
        s[j] = 0.0
        for m in range(_STICTION):
            s[j] += joints[CHANGE + m, j] * parts[m]
        # What a joint that stops lets go of, and what one that starts has carried.
        pole, slow = joints[JOLT_POLE, j], v[j] / REST_SPEED
        held = breakaway(table, rows, j) / np.sqrt(3.0)
        stop = held * np.exp(-slow * slow) if np.isfinite(slow) else held
        state[_STOP, j] = pole * state[_STOP, j] + (1.0 - pole) * stop
        rested = rows[UNKNOWN_SHARE_ROW, j] * held
        state[_START, j] = keep * state[_START, j] + (1.0 - keep) * rested
        if single[_RESTING] < REST_TIME:
            part = joints[CHANGE + _STICTION, j] * parts[_STICTION]
            let_go = max(state[_STOP, j], state[_START, j])
            s[j] += max(part, let_go * let_go)


@kernel
def _take_jolts(own: _Detector, momentum: Array, load: Array, transmitted: Array) -> None:
    """Takes jumps of momentum and of motor torque into the jolt's square."""
    (_, joints, settings, _), _, state, _ = own
    for j in range(momentum.shape[0]):
        if not np.isfinite(momentum[j]):
            continue
        pole, jump = joints[JOLT_POLE, j], 0.0
        if np.isfinite(state[_BEFORE, j]):
            jump = (momentum[j] - 2.0 * state[_LAST, j] + state[_BEFORE, j]) / settings[PERIOD]
        square = jump * jump
        first, last, share = state[_TORQUE, j], load[j], 1.0 / 3.0
        if settings[PRESENT] != 0.0:
            first, last, share = load[j], transmitted[j], 1.0 / 12.0
        if np.isfinite(state[_TORQUE, j]) and np.isfinite(last):
            square += share * (last - first) ** 2
        gain = 1.0 - pole
        state[_JOLT2, j] = pole * pole * state[_JOLT2, j] + gain * gain * square
        if np.isfinite(state[_LAST, j]):
            state[_TORQUE, j] = load[j]
        state[_BEFORE, j], state[_LAST, j] = state[_LAST, j], momentum[j]


@kernel
def _whiten(own: _Detector, error: TorqueError, tau_ext: Array, work: Array) -> None:
    """Writes s, z, the change over its sd and the change in N m into rows 0 to 3 of `work`, whose
    row 0 holds s'^2 before; takes the sample into both local scales and LP(z).
    """
    (_, joints, settings, _), keep, state, single = own
    n, T = tau_ext.shape[0], settings[PERIOD]
    s, z, y, change = work[0, :n], work[1, :n], work[2, :n], work[3, :n]
    single[_SEEN] += T
    pace = 1.0 - np.exp(-T / LOCAL_TIME)
    early = 1.0 - np.exp(-T / min(max(single[_SEEN], FIRST), LOCAL_TIME))
    begins = 1.0 - np.exp(-T / min(single[_SEEN], WINDOW))
    # g stays in contact, but for an error whose mean over LOCAL_TIME vanishes.
    follows = single[_CONTACT] == 0.0 or single[_TOUCHED] > LOCAL_TIME
    if single[_CONTACT] == 1.0:
        single[_TOUCHED] += T
        for j in range(n):
            square = state[_SLOW, j] * state[_SLOW, j]
            follows = follows and square <= ONE_SIDED * max(state[_SQUARE, j], 1.0)
    for j in range(n):
        sd, stiction, w = error.sd[j], error.stiction[j], error.rows[UNKNOWN_SHARE_ROW, j]
        jolt = max(np.sqrt(state[_JOLT2, j]) - joints[USUAL_JOLT, j], 0.0)
        square = max(sd * sd - w * stiction * stiction, 1e-6 * sd * sd)
        change_sd = s[j] + joints[CHANGE + NUM_FEATURES, j] * state[_JOLT2, j] + jolt * jolt
        change_sd = np.sqrt(change_sd)
        s[j] = np.sqrt(square + jolt * jolt)
        # What friction at rest does not carry.
        left = max(abs(tau_ext[j]) - w * np.sqrt(3.0) * stiction, 0.0)
        left = left if tau_ext[j] > 0.0 else -left
        z[j] = left / s[j]
        if not np.isfinite(state[_BASE, j]):
            state[_BASE, j] = left
        elif single[_CONTACT] == 0.0:
            state[_BASE, j] += begins * (left - state[_BASE, j])
        change[j] = left - state[_BASE, j]
        state[_SLOW, j] += pace * (z[j] - state[_SLOW, j])
        state[_SQUARE, j] += pace * (z[j] * z[j] - state[_SQUARE, j])
        if follows:
            local = max(state[_LOCAL2, j], 1.0)
            new = min(z[j] * z[j], OUTLIER * OUTLIER * local)
            state[_LOCAL2, j] += early * (new - state[_LOCAL2, j])
        unit = change[j] / change_sd if change_sd > 0.0 else 0.0
        usual = max(state[_CHANGE2, j], 1.0)
        y[j] = unit / np.sqrt(usual)
        if single[_CONTACT] == 0.0:
            new = min(unit * unit, OUTLIER * OUTLIER * usual)
            state[_CHANGE2, j] += early * (new - state[_CHANGE2, j])
        local = np.sqrt(max(state[_LOCAL2, j], 1.0))
        s[j] *= local
        z[j] /= local
        state[_MEAN, j] = keep * state[_MEAN, j] + (1.0 - keep) * z[j]


@kernel
def _lengths(own: _Detector, work: Array) -> _Lengths:
    """The norms of what `_whiten` wrote; row 2 of `work` is left with y = U z."""
    (_, joints, _, white), keep, state, _ = own
    n = white.shape[0]
    z, y = work[1, :n], work[2, :n]
    sample = power = mean = plain_mean = along = changed = 0.0
    for j in range(n):
        total = 0.0
        for k in range(j, n):
            total += white[j, k] * y[k]
        changed += total * total
    for j in range(n):
        y[j] = 0.0
        of_mean, of_plain = 0.0, 0.0
        for k in range(j, n):
            y[j] += white[j, k] * z[k]
            of_mean += white[j, k] * state[_MEAN, k] / joints[MEAN_SCALE, k]
            of_plain += white[j, k] * state[_MEAN, k]
        sample += y[j] * y[j]
        mean += of_mean * of_mean
        plain_mean += of_plain * of_plain
        along += y[j] * of_plain
        state[_POWER, j] = keep * state[_POWER, j] + (1.0 - keep) * y[j] * y[j]
        power += state[_POWER, j]
    return _Lengths(
        np.sqrt(sample), np.sqrt(mean), np.sqrt(power), np.sqrt(changed), plain_mean, along
    )


@kernel
def _decide(own: _Detector, lengths: _Lengths, work: Array) -> None:
    """Begins and ends contact."""
    (_, _, settings, _), _, state, single = own
    T, touched = settings[PERIOD], single[_CONTACT] == 1.0
    single[_ANEW] -= T
    # The mean does not outlast a contact, nor begin one before it is a mean again.
    mean = lengths.mean
    if touched and lengths.along < LEFT * lengths.plain_mean:
        mean = 0.0
    if not touched and single[_ANEW] > 0.0:
        mean = 0.0
    quick = lengths.sample / settings[SAMPLE_LEVEL]
    if not touched and settings[CHANGE_LEVEL] < np.inf:
        quick = lengths.change / settings[CHANGE_LEVEL] if single[_SEEN] > WINDOW else 0.0
    single[_RATIO] = max(quick, mean / settings[MEAN_LEVEL])
    if single[_RATIO] > 1.0:
        if not touched:
            single[_MISFIT], single[_TOUCHED] = 0.0, 0.0
        single[_CONTACT], single[_QUIET] = 1.0, 0.0
    elif touched:
        if mean >= settings[MEAN_RELEASE] or lengths.sample >= settings[SAMPLE_RELEASE]:
            single[_QUIET] = 0.0
        else:
            single[_QUIET] += T
        if single[_QUIET] >= QUIET:
            single[_CONTACT], single[_ANEW] = 0.0, ANEW
            for j in range(state.shape[1]):
                z, y, change = work[1, j], work[2, j], work[3, j]
                state[_MEAN, j], state[_POWER, j] = z, y * y
                state[_BASE, j] += change


@kernel
def _unexplained(settings: Array, white: Array, seen: Array, tau_ext: Array, work: Array) -> float:
    """D of the sample that `detect_tick` left in `work`, which is changed but for the change."""
    n = tau_ext.shape[0]
    s, z, y = work[0, :n], work[1, :n], work[2, :n]
    for j in range(n):
        wide = settings[SCALE] * tau_ext[j]
        wider = np.sqrt(s[j] * s[j] + wide * wide)
        z[j] *= s[j] / wider
        s[j] = wider
    for j in range(n):
        y[j] = 0.0
        for k in range(j, n):
            y[j] += white[j, k] * z[k]
    return misfit_square(white, seen, s, y, settings[MOMENT_SD], work[5:])


@kernel
def _link(power: Array, level: float) -> float:
    """The link (1 to n) that a force away from E acts on, or 0 where the joints cannot tell."""
    beyond = 0.0
    for j in range(power.shape[0] - 1, -1, -1):
        beyond += power[j]
        if np.sqrt(beyond) > level:
            return j + 1.0
        if power[j] > LOUD * LOUD:
            return 0.0
    return 0.0


@kernel
def detect_log(
    tables: tuple[Array, Array, Array, Array],
    state: Array,
    samples: ArmSamples,
    out: Array,
    white: TorqueWhite,
) -> None:
    """`detect_tick` for N samples, one after another; out (N, NUM_OUT).

    `white` is written, for what learns: z, LP(z) and the change, (N, n) each, and sqrt(LP(D)) of
    every sample; without rows it is not.
    """
    state, v, transmitted = borrowed(state), borrowed(samples.v), borrowed(samples.transmitted)
    momentum, tau_ext, fresh = borrowed(samples.momentum), borrowed(samples.tau_ext), samples.fresh
    error, out = samples.error, borrowed(out)
    sd, stiction, drift = borrowed(error.sd), borrowed(error.stiction), borrowed(error.drift)
    seen, rows = borrowed(error.J_seen), borrowed(error.rows)
    n, slow = v.shape[1], 0.0
    gain = 1.0 - np.exp(-tables[2][PERIOD] / MISFIT_WINDOW)
    work = np.zeros((n + WORK_ROWS, max(n, NUM_FEATURES)))
    for k in range(v.shape[0]):
        known = TorqueError(sd[k], stiction[k], drift[k], seen[k], rows[k])
        own = ArmSamples(known, v[k], transmitted[k], momentum[k], tau_ext[k], fresh[k])
        detect_tick(tables, state, own, out[k], work)
        if white.misfit.shape[0] > 0:
            copy_to(white.z[k], work[1, :n])
            copy_to(white.mean[k], state[_MEAN])
            copy_to(white.change[k], work[3, :n])
            if np.isfinite(tau_ext[k]).all():
                D = _unexplained(tables[2], tables[3], known.J_seen, tau_ext[k], work)
                slow += gain * (D - slow)
            white.misfit[k] = np.sqrt(slow)


def jolts(momentum: Array, transmitted: Array, pole: Array, time_step: float) -> Array:
    """(N, n) N m, the root of the jolt's sum of squares along a log of momentum and of torque that
    is held from one sample to the next, (N, n) each.
    """
    from scipy.signal import lfilter

    square = np.zeros_like(momentum)
    square[2:] = (np.diff(momentum, 2, axis=0) / time_step) ** 2
    square[2:] += np.diff(transmitted[:-1], axis=0) ** 2 / 3.0
    square *= (1.0 - pole) ** 2
    filtered = [lfilter([1.0], [1.0, -p * p], own) for p, own in zip(pole, square.T, strict=True)]
    return np.asarray(np.sqrt(np.stack(filtered, axis=1)))
