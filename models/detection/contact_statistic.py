"""Contact statistic: detects contact, and contact away from E, from tau_ext, sample by sample.

Here are the whitening, the norms and the misfit; the rule itself, when a contact begins and when it
ends, is `contact_decision`.

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
REST_TIME and this one rests rather than creeps to its stop, w >= MIN_REST_SHARE: at some mrad/s
that may take longer. A joint that starts releases its friction later than it is seen to move, and
the mean still holds it: until then the part is at least LP(w b)^2 / 3. Nor is s'^2 below the square
of the white noise that speeds and currents show, as the observer reads it,

    noise^2 = -LP(d_p d_p' + d_L d_L') / 4
    d_p = (1 - pole) (p - 2 p' + p'') / T,    d_L = (1 - pole) (L - 2 L' + L'') / sqrt(1 - pole^2)

of momentum p and transmitted torque L: in white noise of sd 1 successive second differences have
the covariance -4, in smooth motion a positive one. Logs of fast motion hardly contain a slow joint,
and their fit may give it a tenth of this noise. In the first MEAN_TIME of a log there is no mean,
hence no change. Over the UR10e's other days, in units of those of the fit, the size of z ranges
from .9 to 3.6 and that of its changes from .9 to 2.5. For a model without s' `sample` takes the
place of `change`.

**Mean** has a level OTHER_DAYS (`contact_detector`) times that of the held-out motion. Correlated
errors differ from day to day, and the fitted motion covers few days. Without this factor the mean
exceeded its level two to three times too often. This was seen on five logs of the UR10e's other
weeks and motions, and on its three runs, each read by a model of the others. With the factor
contacts come as often as stated (10 to 360 an hour).

**Contact** begins where `change` or `mean` exceeds its level, each set for half of the stated rate.
The noise of a velocity reads as K_0 M(q) times it, and M of a stretched arm is larger than in the
fitted motion. So `change` counts where two successive samples exceed its level, as a push does that
the observer's lag holds, or a single one exceeds SINGLE_SAMPLE_RATIO times it. Contact lasts until
`sample` and `mean` have been below RELEASE_SHARE of their levels, or below what noise often
reaches, for RELEASE_TIME. So that the mean does not outlast a contact, it does not count where the
present sample has less than MIN_MEAN_SHARE of it. After a contact it restarts from the next sample
and begins no contact for MEAN_PAUSE. A torque whose mean over LOCAL_TIME vanishes is no contact but
an error larger than any previous one: after that time g follows it, as slowly as usual.

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

from wrenchsight.models.detection.contact_decision import (
    BEGUN,
    ENDED,
    IN_CONTACT,
    LARGEST_RATIO,
    NUM_MEMORY,
    ContactLevels,
    ContactNorms,
    decide_contact,
)
from wrenchsight.models.estimation.torque_error_stage import TorqueError
from wrenchsight.models.identification.torque_error_model import (
    NUM_FEATURES,
    REST_ROW,
    STICTION_PART,
    TRANSMITTED_ROW,
    UNKNOWN_SHARE_ROW,
    breakaway,
    hidden_torque,
    variance_parts,
)
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.small_matrices import factorise_in_place, solve_lower

MEAN_TIME = 0.3  # s
MISFIT_WINDOW = 0.1  # s
LOCAL_TIME = 10.0  # s
UNIT_SCALE_TIME = 1.0  # s
MAX_SCALE_RATIO = 3.0
ONE_SIDED_SHARE = 0.15  # share of a reading's mean square, beyond which its mean is not chance
MAX_UNTOUCHED_RMS = 2.0  # root mean square over MEAN_TIME
REST_SPEED = 0.01  # rad/s (m/s)
REST_TIME = 0.3  # s
MIN_REST_SHARE = 0.5  # w of a joint that rests; of one that creeps at 3 mrad/s it is .3

# Rows of the state, (n,) each; symbols as above.
(
    _MOMENTUM,  # p of the last sample
    _PREVIOUS_MOMENTUM,  # p of the one before
    _TORQUE,  # L of the last sample, transmitted torque
    _PREVIOUS_TORQUE,  # L of the one before
    _BASE,  # LP(x) without contact, N m: from it the change counts
    _JUMP2,  # jump^2, (N m)^2
    _LOCAL2,  # g^2
    _SLOW,  # mean of z over LOCAL_TIME, through contacts and all
    _SQUARE,  # mean square of z likewise
    _MEAN,  # LP(z / g)
    _POWER,  # LP(y^2)
    _CHANGE2,  # g'^2
    _STOP,  # N m, sd of the friction that a stopping joint releases
    _NOISE2,  # noise^2, (N m)^2
    _LAST_P,  # d_p of the last sample
    _LAST_TAU,  # d_L of it
    _START,  # N m, sd of the friction that a starting joint has carried
) = range(17)
NUM_UNKNOWN = _JUMP2  # rows before it are not known before the first sample
_SINGLE_ROW = _START + 1  # first of the rows that hold single numbers
# The single numbers: the memory of `decide_contact`, then these.
(
    _MISFIT,  # LP(D) since the contact began
    _RESTING,  # s, for which all joints have rested
    _TOUCHED,  # s, of the present contact
    _SEEN,  # s, since the log began
    NUM_SINGLE,
) = range(NUM_MEMORY, NUM_MEMORY + 5)

# Rows of `joints`, (n,) each.
(
    JUMP_POLE,  # the observer's pole, per tick
    USUAL_JUMP,  # N m, torque jump that most samples stay below
    MEAN_SCALE,  # mean_scale
    FITTED_SPEED,  # rad/s, of the fitted logs; inf: any
    FITTED_LOAD,  # N m, likewise
    CHANGE,  # first of NUM_FEATURES: shares of s'^2 in the parts of sd^2 (`variance_parts`)
) = range(6)
JUMP_SHARE = CHANGE + NUM_FEATURES  # row of the share of s'^2 in the square of the torque jump
NUM_JOINT_ROWS = JUMP_SHARE + 1
# Entries of `settings`.
(
    PERIOD,  # s
    SAMPLE_LEVEL,  # of the norm `sample`, as the others of theirs
    MEAN_LEVEL,
    POWER_LEVEL,
    MOMENT_SD,  # N m, prior of a contact at E
    SCALE,  # relative sd of what is read
    SAMPLE_RELEASE,  # of `sample`, below which contact may end
    MEAN_RELEASE,  # of `mean`, likewise
    CHANGE_LEVEL,
    PRESENT,  # 1: tau_ext depends on the motor torque of its own sample
    MISFIT_LEVEL,
    NUM_SETTINGS,
) = range(12)
# Entries of a detection.
(
    STATISTIC,  # largest norm over its level
    CONTACT,  # 1 or 0
    MISFIT,  # 1 or 0
    LINK,  # touched, from 1; 0: at E, or not known
    REST,  # 1 or 0
    OUT_OF_RANGE,  # 1 or 0
    SAMPLE_LENGTH,  # the norm `sample`, as the others theirs; 0 where it is not read
    MEAN_LENGTH,
    POWER_LENGTH,
    CHANGE_LENGTH,
    NUM_OUT,
) = range(11)

_MIN_VARIANCE_SHARE = 1e-6  # of sd^2, left of it at rest
_FORCE_SD = 1e4  # N; stands for unknown, small enough that 1 is not lost beside its square
UNKNOWN_MOMENT = 1e4  # N m, likewise


class DetectorTables(NamedTuple):
    """Constants of `detect_tick` for an arm with n joints.

    Attributes:
        error: table of the torque error, of `torque_error_stage`.
        joints: (NUM_JOINT_ROWS, n), rows JUMP_POLE to JUMP_SHARE.
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
    return _SINGLE_ROW - (-NUM_SINGLE // num_joints)


class Whitened(NamedTuple):
    """A sample of tau_ext over its sd, as the module defines it; each (n,).

    Attributes:
        sd: N m, g s.
        z: the whitened torque.
        y: U z.
        change: N m, of the torque over its mean.
        change_sd: N m, s' with the jump.
        scaled_change: c, the change over its sd.
    """

    sd: Array
    z: Array
    y: Array
    change: Array
    change_sd: Array
    scaled_change: Array


@kernel
def misfit_square(white: Array, J: Array, s: Array, tau_y: Array, moment_sd: float) -> float:
    """The misfit D of a torque to a force at E: y^T (1 + A^T A)^-1 y with A = P J diag(1 / s) U^T.

    Args:
        white: (n, n) U.
        J: (6, n), rows [angular; linear], at E in axes of W.
        s: (n,) N m, sd of tau_ext.
        tau_y: (n,) y = U z, the whitened torque.
        moment_sd: N m, prior of a moment at E: P has it three times, then the prior of a force.
    """
    n = J.shape[1]
    A = (J / s) @ white.T
    A[:3] *= moment_sd
    A[3:] *= _FORCE_SD
    factor, x = np.eye(n) + A.T @ A, tau_y.copy()
    factorise_in_place(factor, n, 0.0)
    solve_lower(factor, n, x)
    return float(np.sum(x * x))


@kernel
def detect_tick(
    tables: DetectorTables, state: Array, sample: ArmSamples, out: Array, whitened: Whitened
) -> None:
    """Single-sample kernel: takes a sample into `state` and writes the detection.

    Args:
        tables: tables of ContactDetector.
        state: (state_rows, n), changed; the rows from _SINGLE_ROW on hold what is not of a joint,
            one number after another.
        sample: without the first axis.
        out: (NUM_OUT,), written, entries STATISTIC to CHANGE_LENGTH: the statistic; 1 or 0 for
            contact and misfit; the link that is touched, from 1, or 0; 1 or 0 for rest and out of
            the fitted range; the norms, 0 where the sample is not read.
        whitened: written, where the sample is read.
    """
    joints, settings = tables.joints, tables.settings
    error, v, tau_ext = sample.error, sample.v, sample.tau_ext
    load = error.rows[TRANSMITTED_ROW].copy()
    keep = np.exp(-settings[PERIOD] / MEAN_TIME)
    single = state[_SINGLE_ROW:].reshape(-1)
    detector = _Detector(tables, keep, state, single)

    # What does not depend on tau_ext: the range of the fit, the torque jump, rest. The variance of
    # a change has the noise of the samples before; the noise is taken before the jumps, which move
    # the remembered momenta and torques on.
    is_out = np.any(np.abs(v) > joints[FITTED_SPEED]) or np.any(np.abs(load) > joints[FITTED_LOAD])
    out[OUT_OF_RANGE] = 1.0 if is_out else 0.0
    change_variance = _change_variance(detector, error.rows, v, load)
    _take_noise(detector, sample.momentum, load)
    _take_jumps(detector, sample.momentum, load, sample.transmitted)
    single[_RESTING] = (
        single[_RESTING] + settings[PERIOD] if np.all(np.abs(v) < REST_SPEED) else 0.0
    )
    out[REST] = 1.0 if single[_RESTING] >= REST_TIME else 0.0

    # Contact, which stays as it was where tau_ext is not of this sample.
    is_read = sample.fresh and np.all(np.isfinite(tau_ext))
    norms = ContactNorms(
        sample=0.0, mean=0.0, power=0.0, change=0.0, square_of_mean=0.0, along_mean=0.0
    )
    if is_read:
        _whiten(detector, error, tau_ext, change_variance, whitened)
        norms = _norms(detector, whitened)
        _take_contact(detector, norms, whitened)
    out[SAMPLE_LENGTH], out[MEAN_LENGTH] = norms.sample, norms.mean
    out[POWER_LENGTH], out[CHANGE_LENGTH] = norms.power, norms.change
    out[STATISTIC], out[CONTACT] = single[LARGEST_RATIO], single[IN_CONTACT]

    # Where the contact is: at E, or else on which link. D is averaged from the begin of the contact
    # on, where `_take_contact` has set the average to 0.
    out[MISFIT], out[LINK] = 0.0, 0.0
    if single[IN_CONTACT] == 1.0 and is_read:
        gain = 1.0 - np.exp(-settings[PERIOD] / MISFIT_WINDOW)
        D = _unexplained(tables, error.J_seen, tau_ext, whitened)
        single[_MISFIT] += gain * (D - single[_MISFIT])
    if single[IN_CONTACT] == 1.0 and np.sqrt(single[_MISFIT]) > settings[MISFIT_LEVEL]:
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


@kernel
def _change_variance(detector: _Detector, rows: Array, v: Array, load: Array) -> Array:
    """s'^2 (n,), the variance of a change without its jump; takes friction's release in.

    The parts of the torque error's variance count with the shares that `joints` has from CHANGE on.
    Stiction, the last of them, counts until the joint is surely at rest. Until then it is at least
    the friction that a stop releases, faded as the observer reads it (pole), and that of the last
    rest, faded as the mean holds it (keep).

    Args:
        detector: its state is changed; its noise is that of the samples before.
        rows: of the torque error's stage, of this sample.
        v: (n,) rad/s.
        load: (n,) N m, transmitted at the sample before.
    """
    table, joints = detector.tables.error, detector.tables.joints
    keep, state, single = detector.keep, detector.state, detector.single
    variance, parts = np.zeros(v.shape[0]), np.empty(NUM_FEATURES)
    for j in range(v.shape[0]):
        variance_parts(table, rows, j, v[j], load[j], parts)
        for m in range(STICTION_PART):
            variance[j] += joints[CHANGE + m, j] * parts[m]
        # Friction that a stopping joint releases, and that a starting one has carried.
        pole, speed_ratio = joints[JUMP_POLE, j], v[j] / REST_SPEED
        stiction_sd = breakaway(table, rows, j) / np.sqrt(3.0)
        stop = stiction_sd
        if np.isfinite(speed_ratio):
            stop *= np.exp(-speed_ratio * speed_ratio)
        state[_STOP, j] = pole * state[_STOP, j] + (1.0 - pole) * stop
        start = rows[UNKNOWN_SHARE_ROW, j] * stiction_sd
        state[_START, j] = keep * state[_START, j] + (1.0 - keep) * start
        # A joint that still creeps to its stop has not released its friction.
        if single[_RESTING] < REST_TIME or rows[UNKNOWN_SHARE_ROW, j] < MIN_REST_SHARE:
            part = joints[CHANGE + STICTION_PART, j] * parts[STICTION_PART]
            released = max(state[_STOP, j], state[_START, j])
            variance[j] += max(part, released * released)
        # No joint is read with less noise than its speeds and its current have.
        variance[j] = max(variance[j], state[_NOISE2, j])
    return variance


@kernel
def _take_noise(detector: _Detector, momentum: Array, load: Array) -> None:
    """Takes second differences of momentum and motor torque into the square of the noise."""
    joints, settings, state = detector.tables.joints, detector.tables.settings, detector.state
    for j in range(momentum.shape[0]):
        pole = joints[JUMP_POLE, j]
        gain = 1.0 - pole
        p = momentum[j] - 2.0 * state[_MOMENTUM, j] + state[_PREVIOUS_MOMENTUM, j]
        tau = load[j] - 2.0 * state[_TORQUE, j] + state[_PREVIOUS_TORQUE, j]
        read_p, read_tau = gain * p / settings[PERIOD], gain * tau / np.sqrt(1.0 - pole * pole)
        product = read_p * state[_LAST_P, j] + read_tau * state[_LAST_TAU, j]
        if np.isfinite(product):
            state[_NOISE2, j] += (1.0 - detector.keep) * (-product / 4.0 - state[_NOISE2, j])
        state[_LAST_P, j], state[_LAST_TAU, j] = read_p, read_tau


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
            state[_PREVIOUS_TORQUE, j], state[_TORQUE, j] = state[_TORQUE, j], load[j]
        state[_PREVIOUS_MOMENTUM, j], state[_MOMENTUM, j] = state[_MOMENTUM, j], momentum[j]


@kernel
def _whiten(
    detector: _Detector,
    error: TorqueError,
    tau_ext: Array,
    change_variance: Array,
    whitened: Whitened,
) -> None:
    """Writes all of `whitened` but y; takes the sample into the local scales, base and LP(z).

    z is the torque beyond what friction at rest may hide, over its sd; the change is that since the
    base, its low-pass without contact. z and the scaled change are smaller where their recent
    squares (_LOCAL2 with this sample, _CHANGE2 without) are above 1, as of a day that is noisier
    than the model's.

    Args:
        detector: its state is changed.
        error: of the sample.
        tau_ext: (n,) N m, finite.
        change_variance: (n,) (N m)^2, of a change.
        whitened: written.
    """
    keep, state, single = detector.keep, detector.state, detector.single
    T, in_contact = detector.tables.settings[PERIOD], single[IN_CONTACT] == 1.0
    scale_follows = _follows_noise(state, single, tau_ext.shape[0])
    single[_SEEN] += T
    if in_contact:
        single[_TOUCHED] += T
    # Of low-passes; those of scales and base are means since the start of a log at first.
    slow_gain = 1.0 - np.exp(-T / LOCAL_TIME)
    scale_gain = 1.0 - np.exp(-T / min(max(single[_SEEN], UNIT_SCALE_TIME), LOCAL_TIME))
    base_gain = 1.0 - np.exp(-T / min(single[_SEEN], MEAN_TIME))
    for j in range(tau_ext.shape[0]):
        # Writes sd, which gets its factor g below, and change_sd of this joint.
        _take_torque_sd(detector, error, j, change_variance[j], whitened)
        # The part that friction at rest cannot carry.
        hidden = hidden_torque(detector.tables.error, error.rows, j)
        beyond_stiction = np.sign(tau_ext[j]) * max(abs(tau_ext[j]) - hidden, 0.0)
        if not np.isfinite(state[_BASE, j]):
            state[_BASE, j] = beyond_stiction
        elif not in_contact:
            state[_BASE, j] += base_gain * (beyond_stiction - state[_BASE, j])
        # The change since the base, and z, each with its scale of the day.
        change, change_sd = beyond_stiction - state[_BASE, j], whitened.change_sd[j]
        scaled_change = change / change_sd if change_sd > 0.0 else 0.0
        whitened.change[j] = change
        whitened.scaled_change[j] = scaled_change / np.sqrt(max(state[_CHANGE2, j], 1.0))
        z = beyond_stiction / whitened.sd[j]
        state[_SLOW, j] += slow_gain * (z - state[_SLOW, j])
        state[_SQUARE, j] += slow_gain * (z * z - state[_SQUARE, j])
        if scale_follows:
            state[_LOCAL2, j] += scale_gain * _excess_square(z, state[_LOCAL2, j])
        if not in_contact:
            state[_CHANGE2, j] += scale_gain * _excess_square(scaled_change, state[_CHANGE2, j])
        g = np.sqrt(max(state[_LOCAL2, j], 1.0))
        whitened.sd[j] *= g
        whitened.z[j] = z / g
        state[_MEAN, j] = keep * state[_MEAN, j] + (1.0 - keep) * z / g


@kernel
def _take_torque_sd(
    detector: _Detector, error: TorqueError, j: int, change_variance: float, whitened: Whitened
) -> None:
    """Writes s and s' of joint j with the torque jump, without the local scale."""
    joints, jump2 = detector.tables.joints, detector.state[_JUMP2, j]
    sd, stiction = error.sd[j], error.stiction[j]
    rest_share = max(error.rows[UNKNOWN_SHARE_ROW, j], error.rows[REST_ROW, j])
    jump = max(np.sqrt(jump2) - joints[USUAL_JUMP, j], 0.0)
    # sd^2 may hold a smaller share of the stiction than the larger of both, which is subtracted.
    variance = max(sd * sd - rest_share * stiction * stiction, _MIN_VARIANCE_SHARE * sd * sd)
    whitened.sd[j] = np.sqrt(variance + jump * jump)
    change_variance += joints[JUMP_SHARE, j] * jump2 + jump * jump
    whitened.change_sd[j] = np.sqrt(change_variance)


@kernel
def _follows_noise(state: Array, single: Array, n: int) -> bool:
    """Whether g follows the sample: without contact, or in one that is an error.

    A contact is an error where it outlasts LOCAL_TIME and its mean over that time vanishes.
    """
    if single[IN_CONTACT] == 0.0:
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
def _norms(detector: _Detector, whitened: Whitened) -> ContactNorms:
    """The norms of the whitened sample; writes its y and takes it into the power."""
    joints, white = detector.tables.joints, detector.tables.white
    keep, state = detector.keep, detector.state
    whitened.y[:] = white @ whitened.z
    mean = white @ state[_MEAN]
    scaled_mean = white @ (state[_MEAN] / joints[MEAN_SCALE])
    change = white @ whitened.scaled_change
    state[_POWER] = keep * state[_POWER] + (1.0 - keep) * whitened.y**2
    return ContactNorms(
        sample=np.sqrt(np.sum(whitened.y**2)),
        mean=np.sqrt(np.sum(scaled_mean**2)),
        power=np.sqrt(np.sum(state[_POWER])),
        change=np.sqrt(np.sum(change**2)),
        square_of_mean=np.sum(mean**2),
        along_mean=np.sum(whitened.y * mean),
    )


@kernel
def _take_contact(detector: _Detector, norms: ContactNorms, whitened: Whitened) -> None:
    """Applies the rule of contact; restarts misfit and duration, or mean, power and base."""
    settings, state, single = detector.tables.settings, detector.state, detector.single
    levels = ContactLevels(
        sample=settings[SAMPLE_LEVEL],
        mean=settings[MEAN_LEVEL],
        change=settings[CHANGE_LEVEL],
        sample_release=settings[SAMPLE_RELEASE],
        mean_release=settings[MEAN_RELEASE],
    )
    has_mean = single[_SEEN] > MEAN_TIME
    event = decide_contact(norms, levels, has_mean, settings[PERIOD], single[:NUM_MEMORY])
    if event == BEGUN:
        single[_MISFIT], single[_TOUCHED] = 0.0, 0.0
    elif event == ENDED:
        state[_MEAN], state[_POWER] = whitened.z, whitened.y**2
        state[_BASE] += whitened.change


@kernel
def _unexplained(
    tables: DetectorTables, J_seen: Array, tau_ext: Array, whitened: Whitened
) -> float:
    """D of a sample, its sd widened by the model's scale error."""
    settings = tables.settings
    total_sd = np.sqrt(whitened.sd**2 + (settings[SCALE] * tau_ext) ** 2)
    tau_y = tables.white @ (whitened.z * whitened.sd / total_sd)
    return misfit_square(tables.white, J_seen, total_sd, tau_y, settings[MOMENT_SD])


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
        tables: tables of ContactDetector.
        state: (state_rows, n), changed.
        samples: N of them.
        out: (N, NUM_OUT), written.
        white: written for the fit of the contact noise; not written where it has no rows.
    """
    error, tau_ext = samples.error, samples.tau_ext
    slow_D = 0.0  # LP(D) of `white`; the detector's own begins anew with each contact
    gain = 1.0 - np.exp(-tables.settings[PERIOD] / MISFIT_WINDOW)
    n = tau_ext.shape[1]
    # Of the last sample that was read: one that is not leaves it as it is.
    whitened = Whitened(
        sd=np.ones(n),
        z=np.zeros(n),
        y=np.zeros(n),
        change=np.zeros(n),
        change_sd=np.zeros(n),
        scaled_change=np.zeros(n),
    )
    for k in range(tau_ext.shape[0]):
        sample_error = TorqueError(
            sd=error.sd[k],
            stiction=error.stiction[k],
            drift=error.drift[k],
            J_seen=error.J_seen[k],
            rows=error.rows[k],
        )
        sample = ArmSamples(
            error=sample_error,
            v=samples.v[k],
            transmitted=samples.transmitted[k],
            momentum=samples.momentum[k],
            tau_ext=tau_ext[k],
            fresh=samples.fresh[k],
        )
        detect_tick(tables, state, sample, out[k], whitened)
        if white.misfit.shape[0] > 0:
            white.z[k], white.change[k] = whitened.z, whitened.change
            white.mean[k] = state[_MEAN]
            if np.all(np.isfinite(tau_ext[k])):
                D = _unexplained(tables, sample_error.J_seen, tau_ext[k], whitened)
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
