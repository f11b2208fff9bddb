"""The test whether the observed torque is the signature of a wrong signal rather than of a contact.

Any torque on six joints is that of some wrench at E. But a wrong signal leaves a trace that a
contact hardly ever leaves. With z = tau_ext / sd, joint by joint,

    one current wrong      z lies along the torque of that motor alone
    two exchanged          z lies along one ampere more in one motor and one less in another
    all late by d          z is need(t) - need(t - d), where need = tau_J + tau_ext is the torque
                           that an arm that nothing touches takes
    all early by d         z is tau_J(t - d) - tau_J(t), as need(t) is tau_J(t - d)

z lies along such a line where |z|^2 > MIN_LOADED_SQUARE n and its part beside the line is below
MAX_OTHERS_SQUARE n and ALONE_SHARE of it. Late and early currents are recognised by means over
LATE_TIME. `once` and `twice` are need, or tau_J, behind one and two low-passes of time constant
MAX_LATENESS. a (need - once) + b (once - twice) must be LATE_SHARE of |z|^2. a and b must be those
of a delay of .1 to .5 s, within LATE_SUM and LATE_SECOND. A push, too, changes tau_J by -z while it
begins. So currents count as early only where need has changed as well, by MIN_NEED_SHARE of what
tau_J has: need does not change by a push.

Suspicion is counted in seconds, up to MAX_REPORT_TIME. From REPORT_TIME on a reading is not valid,
unless it is free of force: |z|^2 < MAX_FREE_SQUARE n, as without any contact or fault. Where a
wrench at E leaves less of the torque than the line of a wrong current does, both by the same
covariance, it is likelier a push that crosses the line: suspicion then grows by AMBIGUOUS_SHARE of
the time, and by EARLY_AMBIGUOUS_SHARE where currents look early. Late currents do as a wrench does,
and no push looks late for long: there it grows by all of the time. While z lies on none of these
lines, as in a contact, suspicion falls as fast as it rose. While readings are free, it falls by
FORGETTING_SHARE of the time.

After samples beyond the joints' limits for LOST_TIME, readings are not valid as soon as samples are
possible again: two exchanged joints, or an encoder that slipped, give possible numbers. Until there
have been PROBATION_TIME seconds of free readings, only these are valid.

Faults with another trace are not detected: a fault while something pushes, one below
MIN_LOADED_SQUARE, a wrong position without a jump. A delay or a lead that begins has its trace only
after its own length: the currents before it were right. The constants were chosen on one half of
the motions of a simulated and of the real UR10e, and checked on the other half; MIN_LOADED_SQUARE
and those of early currents on faults and pushes put into one recording, checked on five others.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import NO_NEW_ARRAYS, kernel
from wrenchsight.models.observers.explained_torque import beside_lines

MIN_LOADED_SQUARE, MAX_FREE_SQUARE, MAX_OTHERS_SQUARE = 4.5, 3.0, 2.5  # of |z|^2, by joint
ALONE_SHARE = 0.12
LATE_SHARE, CONTACT_SHARE = 0.8, 0.5
MAX_LATENESS, LATE_TIME = 0.15, 0.15  # s
LATE_SUM, LATE_SECOND = (1.0, 3.0), (-1.5, 5.0)  # of a + b / 2, of b
MIN_NEED_SHARE = 0.5  # of the mean square by which tau_J changes
REPORT_TIME, MAX_REPORT_TIME = 0.05, 0.5  # s
FORGETTING_SHARE, AMBIGUOUS_SHARE, EARLY_AMBIGUOUS_SHARE = 0.2, 0.2, 0.5
LOST_TIME, PROBATION_TIME = 0.05, 5.0  # s

_MAX_SQUARE = 1e50  # of |z|^2; beyond, nothing is known

# Entries of FaultState.means: suspicion and time of impossible samples, s; then the means over
# LATE_TIME of |z|^2, and of the products of z with a and b, and of a and b: of late currents, then
# of early ones.
_SUSPICION, _LOST, _ZZ, _LATE, _EARLY, _NUM_MEANS = 0, 1, 2, 3, 8, 13
_ZA, _ZB, _AA, _AB, _BB = range(5)  # from _LATE or _EARLY on
# Rows of FaultState.torques: tau_J as the observer saw it; need behind one and two low-passes, and
# tau_J behind them.
_SEEN, _ONCE, _TWICE, _SEEN_ONCE, _SEEN_TWICE, _NUM_TORQUES = range(6)


class FaultNumbers(NamedTuple):
    """Numbers of the test.

    Attributes:
        period: s between samples.
        loaded_square: bound of |z|^2, above which z may be the trace of a fault; inf: no reading is
            ever rejected.
        need_decay: factor per sample of the low-passes of need and tau_J, of time constant
            MAX_LATENESS.
        late_decay: factor per sample of the means over LATE_TIME.
        scale_squared: square of the relative sd of the reading's scale.
    """

    period: float
    loaded_square: float
    need_decay: float
    late_decay: float
    scale_squared: float


class FaultConstants(NamedTuple):
    """Constants of the test.

    Attributes:
        numbers: these, or their record (`record_of`).
        poles: (n,) of the observer; -1: it reads the wrench itself; late and early currents are not
            looked for, and that a wrench explains its torque says nothing.
        lines: (m, n) N m, along which the torque of a wrong current lies.
        correlation: (n, n) of the joints' errors.
    """

    numbers: FaultNumbers
    poles: Array
    lines: Array
    correlation: Array


class FaultState(NamedTuple):
    """What the test remembers.

    Attributes:
        means: (_NUM_MEANS,) suspicion and time of impossible samples, s; means over LATE_TIME.
        torques: (5, n) N m, tau_J as the observer saw it; need through one pole and two; tau_J
            through one and two.
    """

    means: Array
    torques: Array


def fault_constants(
    torques: ArrayLike,
    K_0: ArrayLike | None,
    time_step: float,
    has_sd: bool = True,
    correlation: ArrayLike | None = None,
    scale: float = 0.0,
) -> FaultConstants:
    """Returns the constants that the kernel reads.

    Args:
        torques: (n, n) N m on the joints, a row for one ampere in each motor.
        K_0: (n,) 1/s of the observer; None for one without such a lag: late and early currents are
            not looked for.
        time_step: s.
        has_sd: whether sds are known; if not, no reading is rejected.
        correlation, scale: as `models.observers.explained_torque.explained_constants`; None:
            independent errors.
    """
    torques = np.atleast_2d(np.asarray(torques, float))
    n = len(torques)
    pairs = [torques[j] - torques[k] for j in range(n) for k in range(j)]
    poles = np.full(n, -1.0) if K_0 is None else np.exp(-np.asarray(K_0, float) * time_step)
    need_decay, late_decay = np.exp(-time_step / np.array([MAX_LATENESS, LATE_TIME]))
    return FaultConstants(
        numbers=FaultNumbers(
            period=float(time_step),
            loaded_square=MIN_LOADED_SQUARE * n if has_sd else np.inf,
            need_decay=float(need_decay),
            late_decay=float(late_decay),
            scale_squared=float(scale**2),
        ),
        poles=np.broadcast_to(poles, n).copy(),
        lines=np.array([*torques, *pairs]),
        correlation=np.eye(n) if correlation is None else np.array(correlation, float),
    )


def initial_fault_state(num_joints: int) -> FaultState:
    """Returns the state before the first sample: no suspicion, no torque."""
    return FaultState(np.zeros(_NUM_MEANS), np.full((_NUM_TORQUES, num_joints), np.nan))


@kernel(**NO_NEW_ARRAYS)
def is_believed(
    constants: FaultConstants,
    state: FaultState,
    tau_ext: Array,
    sd: Array,
    tau_J: Array,
    unexplained: float,
    is_measured: bool,
    is_implausible: bool,
) -> bool:
    """Whether a reading may be valid; updates `state` with the reading.

    `means[_SUSPICION]`, in s, grows by a period while z = tau_ext / sd is the trace of a wrong
    signal, and falls in contacts and while nothing pushes; from REPORT_TIME on only readings free
    of force are believed. Impossible samples for LOST_TIME set it beyond MAX_REPORT_TIME, for
    PROBATION_TIME: then it falls in free readings alone.

    Args:
        constants: of `fault_constants`.
        state: of `initial_fault_state`, changed.
        tau_ext, sd: (n,) N m, the observed torque and the sd of its error.
        tau_J: (n,) N m, of the sample before; NaN before it is known.
        unexplained: D of `models.observers.explained_torque`: the squared length of the torque by
            the covariance of its error and of the wrench's prior.
        is_measured: whether tau_ext is of this sample.
        is_implausible: whether the sample is beyond what the joints can do.
    """
    numbers, means = constants.numbers, state.means
    if numbers.loaded_square == np.inf:
        return True
    n, period = tau_ext.shape[0], numbers.period
    if is_implausible:
        means[_LOST] = min(means[_LOST] + period, LOST_TIME)
        if means[_LOST] > LOST_TIME - 0.5 * period:  # LOST_TIME, whatever its sum rounds to
            means[_SUSPICION] = PROBATION_TIME + MAX_REPORT_TIME
    else:
        means[_LOST] = max(means[_LOST] - FORGETTING_SHARE * period, 0.0)
    square = 0.0  # |z|^2
    for j in range(n):
        square += (tau_ext[j] / sd[j]) ** 2 + 0.0 * tau_J[j]  # NaN before a torque is known
    if not (is_measured and square < _MAX_SQUARE):  # NaN, too: nothing is known
        return True
    # Of every measured reading, whatever is suspected: it takes the reading into its means.
    late_share, early_share = _time_shares(constants, state, tau_ext, sd, tau_J)
    is_free = square < MAX_FREE_SQUARE * n
    if square > numbers.loaded_square and means[_SUSPICION] <= MAX_REPORT_TIME:
        off_line = square - _along(constants.lines, tau_ext, sd)
        on_line = off_line < min(MAX_OTHERS_SQUARE * n, ALONE_SHARE * square)
        is_late, is_early = late_share > LATE_SHARE, early_share > LATE_SHARE
        if on_line or is_late or is_early:
            share = 1.0
            # An observer that reads the wrench (no poles) has no torque but that of a wrench.
            if constants.poles[0] >= 0.0 and not is_late:
                scale_squared, correlation = numbers.scale_squared, constants.correlation
                left = beside_lines(scale_squared, correlation, constants.lines, tau_ext, sd)
                if unexplained < left:
                    share = EARLY_AMBIGUOUS_SHARE if is_early else AMBIGUOUS_SHARE
            means[_SUSPICION] = min(means[_SUSPICION] + share * period, MAX_REPORT_TIME)
        elif off_line > MAX_OTHERS_SQUARE * n and late_share < CONTACT_SHARE:
            # As in a contact. In between, suspicion stays.
            means[_SUSPICION] = max(means[_SUSPICION] - period, 0.0)
    elif is_free:
        is_on_probation = means[_SUSPICION] > MAX_REPORT_TIME
        forgotten_time = period if is_on_probation else FORGETTING_SHARE * period
        means[_SUSPICION] = max(means[_SUSPICION] - forgotten_time, 0.0)
    believed: bool = is_free or means[_SUSPICION] < REPORT_TIME
    return believed


@kernel(**NO_NEW_ARRAYS)
def _along(lines: Array, tau_ext: Array, sd: Array) -> float:
    """The largest part of |z|^2 along one of the lines."""
    n, largest = tau_ext.shape[0], 0.0
    for line in range(lines.shape[0]):
        along, length = 0.0, 0.0
        for j in range(n):
            if lines[line, j] != 0.0:  # of most arms one motor moves one joint
                u = lines[line, j] / sd[j]
                along += u * tau_ext[j] / sd[j]
                length += u * u
        largest = max(largest, along * along / length)
    return largest


@kernel(**NO_NEW_ARRAYS)
def _time_shares(
    constants: FaultConstants, state: FaultState, tau_ext: Array, sd: Array, tau_J: Array
) -> tuple[float, float]:
    """The shares of |z|^2 over LATE_TIME that late and that early currents explain.

    Late currents leave z = a_fit a + b_fit b, all divided by sd, joint by joint:

        need = tau_J + tau_ext, the torque of an arm that nothing touches
        a = need - once,  b = once - twice,  once and twice need behind one and two low-passes

    Early currents leave the same of -tau_J in the place of need.

    Args:
        constants: as `is_believed`; a first pole below 0: neither is looked for.
        state: its torques and its means of products are updated. tau_J goes through the observer's
            own low-pass, so that it is as late as tau_ext is.
        tau_ext, sd, tau_J: as `is_believed`, finite.

    Returns:
        Each 0 where it does not explain z.
    """
    n, numbers = tau_ext.shape[0], constants.numbers
    decay, late_decay = numbers.need_decay, numbers.late_decay
    means, torques = state.means, state.torques
    if constants.poles[0] < 0.0:
        return 0.0, 0.0
    for entry in range(_ZZ, _NUM_MEANS):
        means[entry] *= late_decay
    entry_share = 1.0 - late_decay
    for j in range(n):
        if not np.isfinite(torques[_SEEN, j]):
            torques[_SEEN, j] = torques[_SEEN_ONCE, j] = torques[_SEEN_TWICE, j] = tau_J[j]
            torques[_ONCE, j] = torques[_TWICE, j] = tau_J[j] + tau_ext[j]
        pole = constants.poles[j]
        torques[_SEEN, j] = pole * torques[_SEEN, j] + (1.0 - pole) * tau_J[j]
        z, need = tau_ext[j] / sd[j], torques[_SEEN, j] + tau_ext[j]
        means[_ZZ] += entry_share * (z * z)
        for first, once, value, sign in (
            (_LATE, _ONCE, need, 1.0),
            (_EARLY, _SEEN_ONCE, torques[_SEEN, j], -1.0),
        ):
            twice = once + 1
            torques[once, j] = decay * torques[once, j] + (1.0 - decay) * value
            torques[twice, j] = decay * torques[twice, j] + (1.0 - decay) * torques[once, j]
            a = sign * (value - torques[once, j]) / sd[j]
            b = sign * (torques[once, j] - torques[twice, j]) / sd[j]
            means[first + _ZA] += entry_share * (z * a)
            means[first + _ZB] += entry_share * (z * b)
            means[first + _AA] += entry_share * (a * a)
            means[first + _AB] += entry_share * (a * b)
            means[first + _BB] += entry_share * (b * b)
    if means[_ZZ] < numbers.loaded_square:
        return 0.0, 0.0
    need_change = means[_LATE + _AA] + means[_LATE + _BB]
    change = means[_EARLY + _AA] + means[_EARLY + _BB]
    early_share = _delay_share(means, _EARLY) if need_change > MIN_NEED_SHARE * change else 0.0
    return _delay_share(means, _LATE), early_share


@kernel(**NO_NEW_ARRAYS)
def _delay_share(means: Array, first: int) -> float:
    """The share of |z|^2 that a and b explain; 0 where they are not those of a delay.

    Args:
        means: of `FaultState`.
        first: entry of the products' means: _LATE or _EARLY.
    """
    za, zb = means[first + _ZA], means[first + _ZB]
    aa, ab, bb = means[first + _AA], means[first + _AB], means[first + _BB]
    # Least squares z = a_fit a + b_fit b over LATE_TIME. Where a and b are alike but for rounding,
    # det is that of a part in 1e9: a_fit and b_fit are then large, and no delay's.
    det = max(aa * bb - ab * ab, 1e-9 * aa * bb)
    if det <= 0.0:
        return 0.0
    a_fit, b_fit = (bb * za - ab * zb) / det, (aa * zb - ab * za) / det
    # Whether it is the fit of a delay of .1 to .5 s.
    fit_sum = a_fit + 0.5 * b_fit
    if not (LATE_SUM[0] < fit_sum < LATE_SUM[1] and LATE_SECOND[0] < b_fit < LATE_SECOND[1]):
        return 0.0
    share: float = (a_fit * za + b_fit * zb) / means[_ZZ]
    return share
