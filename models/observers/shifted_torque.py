"""The test whether the observed torque is that of currents which are late or early.

With need = tau_J + tau_ext, the torque that an arm that nothing touches takes, currents shifted by
d against the positions leave

    late     tau_ext(t) = need(t) - need(t - d)
    early    tau_ext(t) = need(t) - need(t + d): what it was d ago foretold how need changed since

A push does not know how need changes. Where it moves the arm itself, need changes with its sign:
the early currents' change has the opposite one.

Both are tried for every d of SHIFTS, by means over SHIFT_TIME of the products of the two sides,
joint by joint divided by the sd of the error. Their correlation squared is the share that is
explained: MIN_SHARE, or MIN_NOISY_SHARE where no more is left than MAX_LEFT_SQUARE, as of the error
alone. Their ratio, the gain, must be within GAIN_LIMITS. While a shift begins the lag makes
the gain small, which leaves the correlation as it is. Both sides must be above the same bound. Late
currents show from their begin on, early ones once d has passed.

What is compared are entries, ENTRY_PERIOD apart or a sample, where that is longer. A force that an
arm follows freely changes need as late currents do, with a gain of 1; that of an arm whose drives
hold against it is larger.

The constants were settled on shifts and pushes put into three recordings of a UR10e, and on what
two others showed (the experiment `faults`, which has four more, from which no rule was taken).
"""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import NO_NEW_ARRAYS, kernel

# s. Between two of them the nearer one explains a shift, as need changes little in half a step
# beside what it changes in the whole shift: the longer the shift, the longer a step may be.
SHIFTS = np.concatenate([np.linspace(0.1, 0.45, 8), np.linspace(0.5, 1.0, 6)])
SHIFT_TIME = 0.02  # s
MIN_SHARE, MIN_NOISY_SHARE = 0.95, 0.88
MAX_LEFT_SQUARE = 1.0  # of |tau_ext / sd|^2, by joint
GAIN_LIMITS = (0.8, 1.4)
ENTRY_PERIOD = 0.01  # s

# Entries of ShiftState.means.
(
    _COUNT,  # samples since the last entry
    _SQUARE,  # mean of |tau_ext / sd|^2
    _IS_SHIFTED,  # 1 where the last entry is that of a shift
    _FIRST,  # from here on _NUM_PRODUCTS means for each shift
) = range(4)
# These, joint by joint divided by sd^2; "change": need(t) - need(t - d).
(
    _LATE_PRODUCT,  # tau_ext(t) change
    _CHANGE,  # change^2
    _EARLY_PRODUCT,  # -tau_ext(t - d) change
    _BEFORE,  # tau_ext(t - d)^2
    _NUM_PRODUCTS,
) = range(5)
_SEEN_ROW, _NEED_ROW = 0, 1  # of ShiftState.torques; tau_ext of the newest entry: _NEED_ROW + M


class ShiftNumbers(NamedTuple):
    """Numbers of the test.

    Attributes:
        entry_samples: samples from one entry to the next.
        entry_period: s from one entry to the next.
        decay: factor per entry of the means over SHIFT_TIME.
        min_square: bound of |tau_ext / sd|^2, above which it is explained.
    """

    entry_samples: float
    entry_period: float
    decay: float
    min_square: float


class ShiftState(NamedTuple):
    """What the test remembers.

    Attributes:
        means: (_FIRST + len(SHIFTS) * _NUM_PRODUCTS,) count, verdict and means of products.
        torques: (1 + 2 M, n) N m: tau_J as the observer saw it; need of the last M entries, the
            newest first; tau_ext of them. NaN where there is none.
    """

    means: Array
    torques: Array


def shift_numbers(time_step: float, min_square: float) -> ShiftNumbers:
    """Returns the numbers of a test of samples that are `time_step` s apart.

    Args:
        time_step: s.
        min_square: bound of |tau_ext / sd|^2.
    """
    entry_samples = max(1, round(ENTRY_PERIOD / time_step))
    entry_period = entry_samples * time_step
    decay = float(np.exp(-entry_period / SHIFT_TIME))
    return ShiftNumbers(float(entry_samples), entry_period, decay, min_square)


def initial_shift_state(numbers: ShiftNumbers, num_joints: int) -> ShiftState:
    """Returns the state before the first sample: no torque, no share."""
    num_entries = 1 + round(SHIFTS[-1] / numbers.entry_period)
    return ShiftState(
        means=np.zeros(_FIRST + len(SHIFTS) * _NUM_PRODUCTS),
        torques=np.full((1 + 2 * num_entries, num_joints), np.nan),
    )


@kernel(**NO_NEW_ARRAYS)
def are_shifted(
    numbers: ShiftNumbers,
    poles: Array,
    state: ShiftState,
    tau_ext: Array,
    sd: Array,
    tau_J: Array,
    is_measured: bool,
) -> bool:
    """Whether tau_ext is that of late or early currents, as the last entry shows.

    Args:
        numbers: these, or their record (`record_of`).
        poles: (n,) of the observer. tau_J goes through them, so that it is as late as tau_ext is.
        state: of `initial_shift_state`, changed.
        tau_ext, sd: (n,) N m, the observed torque and the sd of its error.
        tau_J: (n,) N m, of the sample before.
        is_measured: whether tau_ext, sd and tau_J are those of this sample, and finite.
    """
    means, torques, n = state.means, state.torques, tau_ext.shape[0]
    if is_measured:
        for j in range(n):
            if np.isnan(torques[_SEEN_ROW, j]):
                torques[_SEEN_ROW, j] = tau_J[j]
            seen = torques[_SEEN_ROW, j]
            torques[_SEEN_ROW, j] = poles[j] * seen + (1.0 - poles[j]) * tau_J[j]
    means[_COUNT] += 1.0
    if means[_COUNT] >= numbers.entry_samples:
        means[_COUNT] = 0.0
        _take_entry(torques, tau_ext, is_measured)
        if is_measured:
            means[_IS_SHIFTED] = 1.0 if _is_shift(numbers, state, sd) else 0.0
    is_shifted: bool = means[_IS_SHIFTED] > 0.0
    return is_shifted


@kernel(**NO_NEW_ARRAYS)
def _take_entry(torques: Array, tau_ext: Array, is_measured: bool) -> None:
    """Puts need and tau_ext before those of the entries before, of which the last one goes."""
    n, num_entries = tau_ext.shape[0], (torques.shape[0] - 1) // 2
    tau_row = _NEED_ROW + num_entries
    # Both at once: the oldest need comes to tau_row, where it is replaced.
    for row in range(2 * num_entries, _NEED_ROW, -1):
        for j in range(n):
            torques[row, j] = torques[row - 1, j]
    for j in range(n):
        torques[_NEED_ROW, j] = torques[_SEEN_ROW, j] + tau_ext[j] if is_measured else np.nan
        torques[tau_row, j] = tau_ext[j] if is_measured else np.nan


@kernel(**NO_NEW_ARRAYS)
def _is_shift(numbers: ShiftNumbers, state: ShiftState, sd: Array) -> bool:
    """Takes the newest entry into the means; whether one of the shifts explains it.

    Args:
        numbers: of the test.
        state: with the newest entry, which is measured; its means are changed.
        sd: (n,) N m, of tau_ext.
    """
    means, torques, n = state.means, state.torques, sd.shape[0]
    tau_row = _NEED_ROW + (torques.shape[0] - 1) // 2
    decay, square, is_shift = numbers.decay, 0.0, False
    for j in range(n):
        square += (torques[tau_row, j] / sd[j]) ** 2
    means[_SQUARE] = decay * means[_SQUARE] + (1.0 - decay) * square
    for shift in range(len(SHIFTS)):
        before = round(SHIFTS[shift] / numbers.entry_period)  # entries
        if np.isnan(torques[_NEED_ROW + before, 0]):  # there was none, or it was not measured
            continue
        products = means[_FIRST + shift * _NUM_PRODUCTS : _FIRST + (shift + 1) * _NUM_PRODUCTS]
        for product in range(_NUM_PRODUCTS):
            products[product] *= decay
        for j in range(n):
            weight = (1.0 - decay) / (sd[j] * sd[j])
            change = torques[_NEED_ROW, j] - torques[_NEED_ROW + before, j]
            now, then = torques[tau_row, j], torques[tau_row + before, j]
            products[_LATE_PRODUCT] += weight * now * change
            products[_CHANGE] += weight * change * change
            products[_EARLY_PRODUCT] -= weight * then * change
            products[_BEFORE] += weight * then * then
        changed, late, early = products[_CHANGE], products[_LATE_PRODUCT], products[_EARLY_PRODUCT]
        if changed > numbers.min_square:
            is_shift = is_shift or _explains(numbers, n, late, changed, means[_SQUARE])
            is_shift = is_shift or _explains(numbers, n, early, changed, products[_BEFORE])
    return is_shift


@kernel(**NO_NEW_ARRAYS)
def _explains(
    numbers: ShiftNumbers, num_joints: int, product: float, change: float, square: float
) -> bool:
    """Whether a change of need explains a torque.

    Args:
        product: mean of the product of change and torque, each divided by the sd.
        change, square: means of their squares.
    """
    if square < numbers.min_square or not GAIN_LIMITS[0] < product / change < GAIN_LIMITS[1]:
        return False
    share = product * product / (change * square)
    is_noise_left = (1.0 - share) * square < MAX_LEFT_SQUARE * num_joints
    return share > (MIN_NOISY_SHARE if is_noise_left else MIN_SHARE)
