"""Contact statistic: detects contact, and contact away from E, from tau_ext, sample by sample.

**Whitened torque.** The torque of joint j over its standard deviation without contact:

    z = sign(tau) (|tau| - hidden)+ / (g s),    s^2 = sd^2 - w stiction^2 + jump^2

with sd, stiction and `hidden` of `models.identification.torque_error_model`, the torque that
friction at rest can hide, and w the larger of its shares of a joint at rest. Two effects are not in
the torque error:

    jump    Inertial torque may jump within a sample, as in an abrupt stop. Speed and current of
            different instants then read as K_0 times the jump of momentum: the root of the sum of
            squares of (1 - pole) |p - 2 p' + p''| / T, fading with the observer's pole. Its excess
            over the usual jump counts. So does a jump D of motor torque, as of a braking drive. The
            mean over a period lies anywhere between both ends: its sd is D / sqrt(3) about the end
            that an observer holds, and D / sqrt(12) about the middle.
    local   g >= 1: root mean square of z over LOCAL_TIME without contact, as in a radar's constant
            false-alarm rate. Drifted friction raises the threshold instead of a false alarm.
            Outliers count as MAX_SCALE_RATIO times g. During contact g stays. In the first
            LOCAL_TIME of a log it is the mean since the start, where g = 1 counts for
            UNIT_SCALE_TIME.

y = U z with U upper triangular and U R U^T = 1 for the correlation R of the joints' errors; so y_j
depends on joints j and beyond alone. Each norm has a threshold, set so that it is exceeded at the
stated rate per hour (`models.signals.exceedance_tail`, on held-out logs of the model's fit):

    change  |U c|                        detects a push at once
    mean    |U LP(z) / mean_scale|       detects a weak push, over MEAN_TIME; LP: first-order
    low-pass
    sample  |y|                          decides whether the contact lasts
    power   sqrt(LP(|y|^2))              decides whether the contact is at E

**Change** is the excess of a sample over the recent mean, c_j = (x - LP(x))_j / (g' s')_j with
x = sign(tau) (|tau| - hidden)+. Friction errors are slow: half of the error in sliding lasts longer
than MEAN_TIME, and so does nearly all drift from day to day. A push comes within the observer's
lag. The variance s'^2 has the parts of sd^2, with other shares, and the square of the jump; g' is
the local scale of the change. A joint that comes to rest releases its friction within some samples,
sooner than sd^2 shows rest. Below REST_SPEED the stiction part is therefore at least
b^2 / 3 exp(-(v / REST_SPEED)^2), low-passed as the reading, until all joints have rested for
REST_TIME. A joint that starts releases its friction later than it is seen to move, and the mean
still holds it: until then the part is at least LP(w b)^2 / 3. In the first MEAN_TIME of a log there
is no mean, hence no change. Over the UR10e's other days, in units of those of the fit, the size of
z ranges from .9 to 3.6 and that of its changes from .9 to 2.5. For a model without s' `sample`
takes the place of `change`.

**Mean** has a level OTHER_DAYS (`contact_detector`) times that of the held-out motion. Correlated
errors differ from day to day, and the fitted motion covers few days. Without this factor the mean
exceeded its level two to three times too often. This was seen on five logs of the UR10e's other
weeks and motions, and on its three runs, each read by a model of the others. With the factor
contacts come as often as stated (10 to 360 an hour).

**Contact** begins where `change` or `mean` exceeds its level, each set for half of the stated rate.
It lasts until `sample` and `mean` have been below RELEASE_SHARE of their levels, or below what
noise often reaches, for RELEASE_TIME. So that the mean does not outlast a contact, it does not
count where the present sample has less than MIN_MEAN_SHARE of it. After a contact it restarts from
the next sample and begins no contact for MEAN_PAUSE. A torque whose mean over LOCAL_TIME vanishes
is no contact but an error larger than any previous one: after that time g follows it, as slowly as
usual.

**Misfit** is the part that no force at E, with a moment within its prior, explains,

    D = min_F |y - U J^T F / (g s)|^2 + |moment / moment_sd|^2

with J as the observer saw it and s widened by the model's scale error. sqrt(LP(D)) over
MISFIT_WINDOW has a level that was learnt with a moment prior of zero; any other prior makes D
smaller. It matters in contact alone. So the level is one that a contact of a second at E exceeds
once in a hundred times, whatever the stated rate. A model without this level takes that of `power`,
since D <= |y|^2. With six joints and an unknown moment a force at E explains everything: D = 0.

**Link**: a force on link k loads joints 1 to k alone. Let the contact be away from E, the joints
beyond k within MAX_UNTOUCHED_RMS of their errors, and k and beyond exceed the level of `power`.
Then the contact is on link k, or its line meets the axes of all joints beyond. Otherwise the link
is unknown.

MEAN_TIME and LOCAL_TIME were chosen on the held-out readings of the UR10e's three fitted runs, with
pushes and a drift of friction added. Neither a high-pass nor more windows helped there.
"""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.estimation.torque_error_stage import TorqueError
from wrenchsight.models.identification.torque_error_model import (
    NUM_FEATURES,
    REST_ROW,
    TRANSMITTED_ROW,
    UNKNOWN_SHARE_ROW,
    breakaway,
    hidden_torque,
    variance_parts,
)
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.small_matrices import factorise_in_place, solve_lower
from wrenchsight.models.numerics.views import borrowed, copy_to

MEAN_TIME = 0.3  # s
MISFIT_WINDOW = 0.1  # s
LOCAL_TIME = 10.0  # s
UNIT_SCALE_TIME = 1.0  # s
MAX_SCALE_RATIO = 3.0
RELEASE_SHARE, MAX_RELEASE_SHARE = 0.5, 0.8
MIN_MEAN_SHARE = 0.3
RELEASE_TIME = 0.1  # s
MEAN_PAUSE = 0.5  # s
ONE_SIDED_SHARE = 0.15  # share of a reading's mean square, beyond which its mean is not chance
_STICTION = NUM_FEATURES - 1  # among the parts of a variance
MAX_UNTOUCHED_RMS = 2.0  # root mean square over MEAN_TIME
REST_SPEED = 0.01  # rad/s (m/s)
REST_TIME = 0.3  # s

# Rows of the state.
_MOMENTUM, _PREVIOUS_MOMENTUM, _TORQUE, _BASE, _JUMP2, _LOCAL2 = range(6)
_SLOW, _SQUARE, _MEAN, _POWER, _CHANGE2, _STOP, _START = range(6, 13)
NUM_UNKNOWN = _JUMP2  # rows before it are not known before the first sample
_SINGLE = _START + 1  # first of the rows that hold single numbers
_CONTACT, _QUIET, _MISFIT, _RESTING, _RATIO, _TOUCHED, _SEEN, _NOT_BEFORE, NUM_SINGLE = range(9)

# Rows of `joints`; JUMP_POLE: the observer's pole, per tick.
JUMP_POLE, USUAL_JUMP, MEAN_SCALE, FITTED_SPEED, FITTED_LOAD, CHANGE = range(6)
# From CHANGE on: the shares of a change's variance, and that of the torque jump.
NUM_JOINT_ROWS = CHANGE + NUM_FEATURES + 1
# Entries of `settings`.
PERIOD, SAMPLE_LEVEL, MEAN_LEVEL, POWER_LEVEL, MOMENT_SD, SCALE = range(6)
SAMPLE_RELEASE, MEAN_RELEASE, CHANGE_LEVEL, PRESENT, MISFIT_LEVEL, NUM_SETTINGS = range(6, 12)
# Entries of a detection.
STATISTIC, CONTACT, MISFIT, LINK, REST, OUT_OF_RANGE = range(6)
SAMPLE_LENGTH, MEAN_LENGTH, POWER_LENGTH, CHANGE_LENGTH, NUM_OUT = range(6, 11)
WORK_ROWS = 12  # and n more

_FORCE_SD = 1e4  # N; stands for unknown, small enough that 1 is not lost beside its square
UNKNOWN_MOMENT = 1e4  # N m, likewise


class DetectorTables(NamedTuple):
    """Constants of `detect_tick` for an arm with n joints.

    Attributes:
        error: table of the torque error, of `torque_error_stage`.
        joints: (NUM_JOINT_ROWS, n), rows JUMP_POLE to CHANGE and beyond.
        settings: (NUM_SETTINGS,), entries PERIOD to MISFIT_LEVEL.
        white: (n, n) U, upper triangular.
    """

    error: Array
    joints: Array
    settings: Array
    white: Array


class TorqueWhite(NamedTuple):
    """Whitened torque of N samples, from which the contact noise is fitted.

    Attributes:
        z: (N, n).
        mean: (N, n) LP(z).
        change: (N, n) N m.
        misfit: (N,) sqrt(LP(D)).
    """

    z: Array
    mean: Array
    change: Array
    misfit: Array


class ArmSamples(NamedTuple):
    """Estimates that the statistic needs, at N samples; at one sample without the first axis.

    Attributes:
        error: uncertainty of tau_ext.
        v: (N, n) rad/s (m/s).
        transmitted: (N, n) N m, torque that the gears transmit; it counts for the next sample.
        momentum: (N, n) kg m^2/s, of the model.
        tau_ext: (N, n) N m, positive along the motion that it causes.
        fresh: (N,) whether tau_ext is of this sample; otherwise contact and misfit stay.
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
    """The misfit D of a torque to a force at E: y^T (1 + A^T P A)^-1 y with A = J diag(1 / s) U^T.

    Args:
        white: (n, n) U.
        J: (6, n), rows [angular; linear], at E in axes of W.
        s: (n,) N m, sd of tau_ext.
        tau_y: (n,) y = U z, the whitened torque.
        moment_sd: N m, prior of a moment at E.
        M: (n + 7, n), overwritten.
    """
    n = J.shape[1]
    A = M[n : n + 6]
    for i in range(6):
        prior_sd = moment_sd if i < 3 else _FORCE_SD
        for j in range(n):
            total = 0.0
            for k in range(j, n):
                total += white[j, k] * J[i, k] / s[k]
            A[i, j] = prior_sd * total
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
    tables: DetectorTables,
    state: Array,
    sample: ArmSamples,
    out: Array,
    work: Array,
) -> None:
    """Single-sample kernel: takes a sample into `state` and writes the detection.

    Args:
        tables: of ContactDetector.
        state: (state_rows, n), changed.
        sample: without the first axis.
        out: (NUM_OUT,), written.
        work: (n + WORK_ROWS, max(n, NUM_FEATURES)), overwritten; its row 1 is left with z, row 3
            with the change in N m.
    """
    joints, settings = tables.joints, tables.settings
    error, v, tau_ext = sample.error, sample.v, sample.tau_ext
    n, keep = v.shape[0], np.exp(-settings[PERIOD] / MEAN_TIME)
    single = state[_SINGLE:].reshape(-1)
    detector = _Detector(tables, keep, state, single)
    load = work[2, :n]
    out_of_range = False
    for j in range(n):
        load[j] = error.rows[TRANSMITTED_ROW, j]
        out_of_range = out_of_range or abs(v[j]) > joints[FITTED_SPEED, j]
        out_of_range = out_of_range or abs(load[j]) > joints[FITTED_LOAD, j]
    out[OUT_OF_RANGE] = 1.0 if out_of_range else 0.0
    _change_variance(detector, error.rows, v, load, work)
    _take_jumps(detector, sample.momentum, load, sample.transmitted)
    single[_RESTING] += settings[PERIOD]
    is_read = sample.fresh
    for j in range(n):
        if not abs(v[j]) < REST_SPEED:
            single[_RESTING] = 0.0
        is_read = is_read and np.isfinite(tau_ext[j])
    out[REST] = 1.0 if single[_RESTING] >= REST_TIME else 0.0
    lengths = _Lengths(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if is_read:
        _whiten(detector, error, tau_ext, work)
        lengths = _lengths(detector, work)
        _decide(detector, lengths, work)
    out[SAMPLE_LENGTH], out[MEAN_LENGTH] = lengths.sample, lengths.mean
    out[POWER_LENGTH], out[CHANGE_LENGTH] = lengths.power, lengths.change
    out[STATISTIC], out[CONTACT] = single[_RATIO], single[_CONTACT]
    out[MISFIT], out[LINK] = 0.0, 0.0
    if single[_CONTACT] == 1.0 and is_read:
        gain = 1.0 - np.exp(-settings[PERIOD] / MISFIT_WINDOW)
        D = _unexplained(tables, error.J_seen, tau_ext, work)
        single[_MISFIT] += gain * (D - single[_MISFIT])
    if single[_CONTACT] == 1.0 and np.sqrt(single[_MISFIT]) > settings[MISFIT_LEVEL]:
        out[MISFIT] = 1.0
        out[LINK] = _link(state[_POWER], settings[POWER_LEVEL])


class _Detector(NamedTuple):
    """Arguments that the parts of a tick share.

    Attributes:
        tables, state: as `detect_tick`.
        keep: pole of LP per tick.
        single: the state's single numbers, as a view.
    """

    tables: DetectorTables
    keep: float
    state: Array
    single: Array


class _Lengths(NamedTuple):
    """Norms of one sample; the module describes the first four.

    Attributes:
        sample: |y|.
        mean: |U LP(z) / mean_scale|.
        power: sqrt(LP(|y|^2)).
        change: |U c|.
        square_of_mean: |U LP(z)|^2.
        along_mean: y . U LP(z).
    """

    sample: float
    mean: float
    power: float
    change: float
    square_of_mean: float
    along_mean: float


@kernel
def _change_variance(detector: _Detector, rows: Array, v: Array, load: Array, work: Array) -> None:
    """Writes s'^2 (n,), the variance of a change without its jump, into row 0 of `work`."""
    table, joints = detector.tables.error, detector.tables.joints
    keep, state, single = detector.keep, detector.state, detector.single
    s, parts = work[0], work[4]
    for j in range(v.shape[0]):
        variance_parts(table, rows, j, v[j], load[j], parts)
        s[j] = 0.0
        for m in range(_STICTION):
            s[j] += joints[CHANGE + m, j] * parts[m]
        # Friction that a stopping joint releases, and that a starting one has carried.
        pole, speed_ratio = joints[JUMP_POLE, j], v[j] / REST_SPEED
        stiction_sd = breakaway(table, rows, j) / np.sqrt(3.0)
        stop = stiction_sd
        if np.isfinite(speed_ratio):
            stop *= np.exp(-speed_ratio * speed_ratio)
        state[_STOP, j] = pole * state[_STOP, j] + (1.0 - pole) * stop
        start = rows[UNKNOWN_SHARE_ROW, j] * stiction_sd
        state[_START, j] = keep * state[_START, j] + (1.0 - keep) * start
        if single[_RESTING] < REST_TIME:
            part = joints[CHANGE + _STICTION, j] * parts[_STICTION]
            released = max(state[_STOP, j], state[_START, j])
            s[j] += max(part, released * released)


@kernel
def _take_jumps(detector: _Detector, momentum: Array, load: Array, transmitted: Array) -> None:
    """Takes jumps of momentum and of motor torque into the square of the torque jump."""
    joints, settings, state = detector.tables.joints, detector.tables.settings, detector.state
    for j in range(momentum.shape[0]):
        if not np.isfinite(momentum[j]):
            continue
        pole, jump = joints[JUMP_POLE, j], 0.0
        if np.isfinite(state[_PREVIOUS_MOMENTUM, j]):
            jump = (
                momentum[j] - 2.0 * state[_MOMENTUM, j] + state[_PREVIOUS_MOMENTUM, j]
            ) / settings[PERIOD]
        square = jump * jump
        begin, end, share = state[_TORQUE, j], load[j], 1.0 / 3.0
        if settings[PRESENT] != 0.0:
            begin, end, share = load[j], transmitted[j], 1.0 / 12.0
        if np.isfinite(state[_TORQUE, j]) and np.isfinite(end):
            square += share * (end - begin) ** 2
        gain = 1.0 - pole
        state[_JUMP2, j] = pole * pole * state[_JUMP2, j] + gain * gain * square
        if np.isfinite(state[_MOMENTUM, j]):
            state[_TORQUE, j] = load[j]
        state[_PREVIOUS_MOMENTUM, j], state[_MOMENTUM, j] = state[_MOMENTUM, j], momentum[j]


@kernel
def _whiten(detector: _Detector, error: TorqueError, tau_ext: Array, work: Array) -> None:
    """Writes s, z, the change over its sd and the change in N m into rows 0 to 3 of `work`.

    On entry row 0 holds s'^2. The sample is taken into both local scales, the base and LP(z).
    """
    joints, settings = detector.tables.joints, detector.tables.settings
    keep, state, single = detector.keep, detector.state, detector.single
    n, T = tau_ext.shape[0], settings[PERIOD]
    s, z, y, change = work[0, :n], work[1, :n], work[2, :n], work[3, :n]
    in_contact = single[_CONTACT] == 1.0
    follows = _follows_noise(state, single, n)
    single[_SEEN] += T
    if in_contact:
        single[_TOUCHED] += T
    pace = 1.0 - np.exp(-T / LOCAL_TIME)
    early = 1.0 - np.exp(-T / min(max(single[_SEEN], UNIT_SCALE_TIME), LOCAL_TIME))
    base_gain = 1.0 - np.exp(-T / min(single[_SEEN], MEAN_TIME))
    for j in range(n):
        sd, stiction = error.sd[j], error.stiction[j]
        w = max(error.rows[UNKNOWN_SHARE_ROW, j], error.rows[REST_ROW, j])
        jump = max(np.sqrt(state[_JUMP2, j]) - joints[USUAL_JUMP, j], 0.0)
        square = max(sd * sd - w * stiction * stiction, 1e-6 * sd * sd)
        change_sd = s[j] + joints[CHANGE + NUM_FEATURES, j] * state[_JUMP2, j] + jump * jump
        change_sd = np.sqrt(change_sd)
        s[j] = np.sqrt(square + jump * jump)
        # The part that friction at rest cannot carry.
        hidden = hidden_torque(detector.tables.error, error.rows, j)
        beyond_stiction = max(abs(tau_ext[j]) - hidden, 0.0)
        beyond_stiction = beyond_stiction if tau_ext[j] > 0.0 else -beyond_stiction
        z[j] = beyond_stiction / s[j]
        if not np.isfinite(state[_BASE, j]):
            state[_BASE, j] = beyond_stiction
        elif not in_contact:
            state[_BASE, j] += base_gain * (beyond_stiction - state[_BASE, j])
        change[j] = beyond_stiction - state[_BASE, j]
        state[_SLOW, j] += pace * (z[j] - state[_SLOW, j])
        state[_SQUARE, j] += pace * (z[j] * z[j] - state[_SQUARE, j])
        if follows:
            state[_LOCAL2, j] += early * _excess_square(z[j], state[_LOCAL2, j])
        scaled_change = change[j] / change_sd if change_sd > 0.0 else 0.0
        y[j] = scaled_change / np.sqrt(max(state[_CHANGE2, j], 1.0))
        if not in_contact:
            state[_CHANGE2, j] += early * _excess_square(scaled_change, state[_CHANGE2, j])
        g = np.sqrt(max(state[_LOCAL2, j], 1.0))
        s[j] *= g
        z[j] /= g
        state[_MEAN, j] = keep * state[_MEAN, j] + (1.0 - keep) * z[j]


@kernel
def _follows_noise(state: Array, single: Array, n: int) -> bool:
    """Whether g follows the sample: without contact, or in one that is an error.

    A contact is an error where it outlasts LOCAL_TIME and its mean over that time vanishes.
    """
    if single[_CONTACT] == 0.0:
        return True
    follows = single[_TOUCHED] > LOCAL_TIME
    for j in range(n):
        square = state[_SLOW, j] * state[_SLOW, j]
        follows = follows and square <= ONE_SIDED_SHARE * max(state[_SQUARE, j], 1.0)
    return bool(follows)


@kernel
def _excess_square(x: float, mean_square: float) -> float:
    """The square of x, at most that of an outlier, less the mean square so far."""
    largest = MAX_SCALE_RATIO * MAX_SCALE_RATIO * max(mean_square, 1.0)
    return min(x * x, largest) - mean_square


@kernel
def _lengths(detector: _Detector, work: Array) -> _Lengths:
    """The norms of the whitened sample in `work`; row 2 is left with y = U z."""
    joints, white = detector.tables.joints, detector.tables.white
    keep, state = detector.keep, detector.state
    n = white.shape[0]
    z, y = work[1, :n], work[2, :n]
    sample = power = mean = square_of_mean = along_mean = change = 0.0
    for j in range(n):
        total = 0.0
        for k in range(j, n):
            total += white[j, k] * y[k]
        change += total * total
    for j in range(n):
        y[j] = 0.0
        scaled_mean, plain_mean = 0.0, 0.0
        for k in range(j, n):
            y[j] += white[j, k] * z[k]
            scaled_mean += white[j, k] * state[_MEAN, k] / joints[MEAN_SCALE, k]
            plain_mean += white[j, k] * state[_MEAN, k]
        sample += y[j] * y[j]
        mean += scaled_mean * scaled_mean
        square_of_mean += plain_mean * plain_mean
        along_mean += y[j] * plain_mean
        state[_POWER, j] = keep * state[_POWER, j] + (1.0 - keep) * y[j] * y[j]
        power += state[_POWER, j]
    return _Lengths(
        np.sqrt(sample),
        np.sqrt(mean),
        np.sqrt(power),
        np.sqrt(change),
        square_of_mean,
        along_mean,
    )


@kernel
def _decide(detector: _Detector, lengths: _Lengths, work: Array) -> None:
    """Begins and ends contact."""
    settings, state, single = detector.tables.settings, detector.state, detector.single
    T, in_contact = settings[PERIOD], single[_CONTACT] == 1.0
    single[_NOT_BEFORE] -= T
    # The mean does not outlast a contact, nor begin one before it is a mean again.
    mean = lengths.mean
    if in_contact and lengths.along_mean < MIN_MEAN_SHARE * lengths.square_of_mean:
        mean = 0.0
    if not in_contact and single[_NOT_BEFORE] > 0.0:
        mean = 0.0
    quick = lengths.sample / settings[SAMPLE_LEVEL]
    if not in_contact and settings[CHANGE_LEVEL] < np.inf:
        quick = lengths.change / settings[CHANGE_LEVEL] if single[_SEEN] > MEAN_TIME else 0.0
    single[_RATIO] = max(quick, mean / settings[MEAN_LEVEL])
    if single[_RATIO] > 1.0:
        if not in_contact:
            single[_MISFIT], single[_TOUCHED] = 0.0, 0.0
        single[_CONTACT], single[_QUIET] = 1.0, 0.0
    elif in_contact:
        if mean >= settings[MEAN_RELEASE] or lengths.sample >= settings[SAMPLE_RELEASE]:
            single[_QUIET] = 0.0
        else:
            single[_QUIET] += T
        if single[_QUIET] >= RELEASE_TIME:
            single[_CONTACT], single[_NOT_BEFORE] = 0.0, MEAN_PAUSE
            for j in range(state.shape[1]):
                z, y, change = work[1, j], work[2, j], work[3, j]
                state[_MEAN, j], state[_POWER, j] = z, y * y
                state[_BASE, j] += change


@kernel
def _unexplained(tables: DetectorTables, J_seen: Array, tau_ext: Array, work: Array) -> float:
    """D of the sample in the `work` of `detect_tick`, which is overwritten but for row 3."""
    settings, white, n = tables.settings, tables.white, tau_ext.shape[0]
    s, z, y = work[0, :n], work[1, :n], work[2, :n]
    for j in range(n):
        scale_sd = settings[SCALE] * tau_ext[j]
        total_sd = np.sqrt(s[j] * s[j] + scale_sd * scale_sd)
        z[j] *= s[j] / total_sd
        s[j] = total_sd
    for j in range(n):
        y[j] = 0.0
        for k in range(j, n):
            y[j] += white[j, k] * z[k]
    return misfit_square(white, J_seen, s, y, settings[MOMENT_SD], work[5:])


@kernel
def _link(power: Array, level: float) -> float:
    """The link (1 to n) that a force away from E acts on; 0: unknown."""
    power_beyond = 0.0
    for j in range(power.shape[0] - 1, -1, -1):
        power_beyond += power[j]
        if np.sqrt(power_beyond) > level:
            return j + 1.0
        if power[j] > MAX_UNTOUCHED_RMS * MAX_UNTOUCHED_RMS:
            return 0.0
    return 0.0


@kernel
def detect_log(
    tables: DetectorTables,
    state: Array,
    samples: ArmSamples,
    out: Array,
    white: TorqueWhite,
) -> None:
    """`detect_tick` for N samples, one after another.

    Args:
        tables: of ContactDetector.
        state: (state_rows, n), changed.
        samples: N of them.
        out: (N, NUM_OUT), written.
        white: written for the fit of the contact noise; not written where it has no rows.
    """
    state, v, transmitted = borrowed(state), borrowed(samples.v), borrowed(samples.transmitted)
    momentum, tau_ext, fresh = borrowed(samples.momentum), borrowed(samples.tau_ext), samples.fresh
    error, out = samples.error, borrowed(out)
    sd, stiction, drift = borrowed(error.sd), borrowed(error.stiction), borrowed(error.drift)
    J_seen, rows = borrowed(error.J_seen), borrowed(error.rows)
    n, slow_D = v.shape[1], 0.0
    gain = 1.0 - np.exp(-tables.settings[PERIOD] / MISFIT_WINDOW)
    work = np.zeros((n + WORK_ROWS, max(n, NUM_FEATURES)))
    for k in range(v.shape[0]):
        sample_error = TorqueError(sd[k], stiction[k], drift[k], J_seen[k], rows[k])
        sample = ArmSamples(sample_error, v[k], transmitted[k], momentum[k], tau_ext[k], fresh[k])
        detect_tick(tables, state, sample, out[k], work)
        if white.misfit.shape[0] > 0:
            copy_to(white.z[k], work[1, :n])
            copy_to(white.mean[k], state[_MEAN])
            copy_to(white.change[k], work[3, :n])
            if np.isfinite(tau_ext[k]).all():
                D = _unexplained(tables, sample_error.J_seen, tau_ext[k], work)
                slow_D += gain * (D - slow_D)
            white.misfit[k] = np.sqrt(slow_D)


def torque_jumps(momentum: Array, transmitted: Array, pole: Array, time_step: float) -> Array:
    """The torque jumps (N, n) N m along a log, as the module defines them.

    Args:
        momentum: (N, n) kg m^2/s.
        transmitted: (N, n) N m, held from one sample to the next.
        pole: (n,) of the observer, per tick.
        time_step: s.
    """
    from scipy.signal import lfilter

    square = np.zeros_like(momentum)
    square[2:] = (np.diff(momentum, 2, axis=0) / time_step) ** 2
    square[2:] += np.diff(transmitted[:-1], axis=0) ** 2 / 3.0
    square *= (1.0 - pole) ** 2
    filtered = [
        lfilter([1.0], [1.0, -p * p], joint_square)
        for p, joint_square in zip(pole, square.T, strict=True)
    ]
    return np.asarray(np.sqrt(np.stack(filtered, axis=1)))
