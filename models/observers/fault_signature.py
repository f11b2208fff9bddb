"""The test whether the observed torque is the signature of a wrong signal rather than of a contact.

Any torque on six joints is that of some wrench at E. But a wrong signal leaves a trace that a
contact hardly ever leaves. With z = tau_ext / sd, joint by joint,

    one current wrong      z lies along the torque of that motor alone
    two exchanged          z lies along one ampere more in one motor and one less in another
    all late or early      z is a change of the torque that an arm takes which nothing touches
                           (`models.observers.shifted_torque`)

z lies along a line of the first two where |z|^2 > MIN_LOADED_SQUARE n and its part beside the line
is below MAX_OTHERS_SQUARE n and ALONE_SHARE of it.

Suspicion is counted in seconds, up to MAX_REPORT_TIME. From REPORT_TIME on a reading is not valid,
unless it is free of force: |z|^2 < MAX_FREE_SQUARE n, as without any contact or fault. Where a
wrench at E leaves less of the torque than the line of a wrong current does, both by the same
covariance, it is likelier a push that crosses the line: suspicion then grows by AMBIGUOUS_SHARE of
the time. Late and early currents do as a wrench does, and no push looks like them for long: there
it grows by all of the time. While z is none of these traces, as in a contact, suspicion falls as
fast as it rose. While readings are free, it falls by FORGETTING_SHARE of the time.

After samples beyond the joints' limits for LOST_TIME, readings are not valid as soon as samples are
possible again: two exchanged joints, or an encoder that slipped, give possible numbers. Until there
have been PROBATION_TIME seconds of free readings, only these are valid.

Faults with another trace are not detected: a fault while something pushes, one below
MIN_LOADED_SQUARE, a wrong position without a jump. A lead that begins has its trace only after its
own length: before, the positions that it foretells have not come. The constants were chosen on one
half of the motions of a simulated and of the real UR10e, and checked on the other half;
MIN_LOADED_SQUARE on faults and pushes put into one recording, checked on five others.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import NO_NEW_ARRAYS, kernel
from wrenchsight.models.observers.explained_torque import beside_lines
from wrenchsight.models.observers.shifted_torque import (
    ShiftNumbers,
    ShiftState,
    are_shifted,
    initial_shift_state,
    shift_numbers,
)

MIN_LOADED_SQUARE, MAX_FREE_SQUARE, MAX_OTHERS_SQUARE = 4.5, 3.0, 2.5  # of |z|^2, by joint
ALONE_SHARE = 0.12
REPORT_TIME, MAX_REPORT_TIME = 0.05, 0.5  # s
FORGETTING_SHARE, AMBIGUOUS_SHARE = 0.2, 0.2
LOST_TIME, PROBATION_TIME = 0.05, 5.0  # s

_MAX_SQUARE = 1e50  # of |tau_ext / sd|^2 and |tau_J / sd|^2; beyond, or NaN, nothing is known

_SUSPICION, _LOST, _NUM_TIMES = range(3)  # of FaultState.times


class FaultNumbers(NamedTuple):
    """Numbers of the test.

    Attributes:
        period: s between samples.
        loaded_square: bound of |z|^2, above which z may be the trace of a fault; inf: no reading is
            ever rejected.
        scale_squared: square of the relative sd of the reading's scale.
        shift: of `models.observers.shifted_torque`.
    """

    period: float
    loaded_square: float
    scale_squared: float
    shift: ShiftNumbers


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
        times: (_NUM_TIMES,) s, of suspicion and of impossible samples.
        means, torques: ShiftState.
    """

    times: Array
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
    loaded_square = MIN_LOADED_SQUARE * n if has_sd else np.inf
    return FaultConstants(
        numbers=FaultNumbers(
            period=float(time_step),
            loaded_square=loaded_square,
            scale_squared=float(scale**2),
            shift=shift_numbers(time_step, loaded_square),
        ),
        poles=np.broadcast_to(poles, n).copy(),
        lines=np.array([*torques, *pairs]),
        correlation=np.eye(n) if correlation is None else np.array(correlation, float),
    )


def initial_fault_state(constants: FaultConstants) -> FaultState:
    """Returns the state before the first sample: no suspicion, no torque."""
    shift = initial_shift_state(constants.numbers.shift, len(constants.poles))
    return FaultState(np.zeros(_NUM_TIMES), *shift)


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

    `times[_SUSPICION]`, in s, grows by a period while z = tau_ext / sd is the trace of a wrong
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
    numbers, times = constants.numbers, state.times
    if numbers.loaded_square == np.inf:
        return True
    n, period = tau_ext.shape[0], numbers.period
    if is_implausible:
        times[_LOST] = min(times[_LOST] + period, LOST_TIME)
        if times[_LOST] > LOST_TIME - 0.5 * period:  # LOST_TIME, whatever its sum rounds to
            times[_SUSPICION] = PROBATION_TIME + MAX_REPORT_TIME
    else:
        times[_LOST] = max(times[_LOST] - FORGETTING_SHARE * period, 0.0)
    square, motor_square = 0.0, 0.0  # |z|^2; of tau_J: NaN before a torque is known
    for j in range(n):
        square += (tau_ext[j] / sd[j]) ** 2
        motor_square += (tau_J[j] / sd[j]) ** 2
    is_known = is_measured and square < _MAX_SQUARE and motor_square < _MAX_SQUARE
    is_shifted, has_lag = False, constants.poles[0] >= 0.0
    if has_lag:
        shift = ShiftState(state.means, state.torques)
        is_shifted = are_shifted(
            numbers.shift, constants.poles, shift, tau_ext, sd, tau_J, is_known
        )
    if not is_known:
        return True
    is_free = square < MAX_FREE_SQUARE * n
    if square > numbers.loaded_square and times[_SUSPICION] <= MAX_REPORT_TIME:
        off_line = square - _along(constants.lines, tau_ext, sd)
        on_line = off_line < min(MAX_OTHERS_SQUARE * n, ALONE_SHARE * square)
        if on_line or is_shifted:
            share = 1.0
            # An observer that reads the wrench (no poles) has no torque but that of a wrench.
            if has_lag and not is_shifted:
                scale_squared, correlation = numbers.scale_squared, constants.correlation
                left = beside_lines(scale_squared, correlation, constants.lines, tau_ext, sd)
                if unexplained < left:
                    share = AMBIGUOUS_SHARE
            times[_SUSPICION] = min(times[_SUSPICION] + share * period, MAX_REPORT_TIME)
        elif off_line > MAX_OTHERS_SQUARE * n:
            # As in a contact. In between, suspicion stays.
            times[_SUSPICION] = max(times[_SUSPICION] - period, 0.0)
    elif is_free:
        is_on_probation = times[_SUSPICION] > MAX_REPORT_TIME
        forgotten_time = period if is_on_probation else FORGETTING_SHARE * period
        times[_SUSPICION] = max(times[_SUSPICION] - forgotten_time, 0.0)
    believed: bool = is_free or times[_SUSPICION] < REPORT_TIME
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
