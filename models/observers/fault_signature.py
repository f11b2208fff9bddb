"""Is what an observer reads the trace of a wrong signal, rather than of a contact?

Any torque on six joints is that of some wrench at E. But a wrong signal leaves a trace that a
contact hardly ever does. With z = tau_ext / sd, joint by joint,

    one current wrong      z lies along the torque of that motor alone
    two exchanged          z lies along one ampere more in one motor and one less in another
    all late by d          z is need(t) - need(t - d), where need = tau_J + tau_ext is the torque
                           that an arm that nothing touches takes

z lies along such a line where |z|^2 > LOADED n, and what is left of it beside the line is below
ALONE n and ALONE_SHARE of it. Late currents are told by means over LATE_TIME: with need seen
through one pole of LATENESS and through two, a (need - once) + b (once - twice) is LATE_SHARE of
|z|^2, and a and b are those of a delay of .1 to .5 s, within LATE_SUM and LATE_SECOND.

Suspicion is counted in seconds, up to MOST. From TOLD on a reading is not valid, unless it is free:
|z|^2 < FREE n, which is what nothing at all reads. Suspicion falls as fast as it rose while z lies
on none of these lines, which is a contact, and by FORGOTTEN of the time while readings are free.

Where samples were beyond what joints can do for LOST_TIME, the arm is not believed as soon as they
are possible again: two joints exchanged, or an encoder that slipped, leave possible numbers behind.
Until there have been PROBATION seconds of free readings no other is valid.

Not told is what leaves another trace: a fault while something pushes, one below LOADED, a wrong
position without a jump. The numbers were settled on motions of a simulated and of the real UR10e,
half of them kept to check.
"""

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.arrays import Array
from wrenchsight.models.kernel import kernel

LOADED, FREE, ALONE = 8.0, 3.0, 2.5  # of |z|^2, by joint
ALONE_SHARE = 0.12
LATE_SHARE, CONTACT_SHARE = 0.8, 0.5
LATENESS, LATE_TIME = 0.15, 0.15  # s
LATE_SUM, LATE_SECOND = (1.0, 3.0), (-1.5, 5.0)  # of a + b / 2, of b
TOLD, MOST = 0.05, 0.5  # s
FORGOTTEN = 0.2
LOST_TIME, PROBATION = 0.05, 5.0  # s

_LARGEST = 1e50  # N m; beyond, nothing is known

# Of the table: these numbers, the observer's poles (n,), then lines (m, n), N m.
_PERIOD, _LOADED, _KEEP, _KEEP_LATE, _NUMBERS = range(5)
# Of the state: these numbers, then tau_J as the observer saw it, and need through one pole and two,
# (n,) each.
_SUSPICION, _LOST, _ZZ, _ZA, _ZB, _AA, _AB, _BB, FAULT_NUMBERS = range(9)
FAULT_ROWS = 3


def fault_table(
    torques: ArrayLike, K_0: ArrayLike | None, time_step: float, asked: bool = True
) -> Array:
    """Returns the constants that the kernel reads.

    Args:
        torques: (n, n) N m on the joints, a row for one ampere in each motor.
        K_0: (n,) 1/s of the observer; None for one without such a lag: lateness is not looked for.
        time_step: s.
        asked: whether sds are known; if not, everything is believed.
    """
    torques = np.atleast_2d(np.asarray(torques, float))
    n = len(torques)
    pairs = [torques[j] - torques[k] for j in range(n) for k in range(j)]
    poles = np.full(n, -1.0) if K_0 is None else np.exp(-np.asarray(K_0, float) * time_step)
    keep = np.exp(-time_step / np.array([LATENESS, LATE_TIME]))
    loaded = LOADED * n if asked else np.inf
    numbers = [time_step, loaded, *keep]
    return np.concatenate([numbers, np.broadcast_to(poles, n), *torques, *pairs])


def initial_fault_state(num_joints: int) -> Array:
    """Returns the state before the first sample: nothing is suspected, no torque known."""
    state = np.zeros(FAULT_NUMBERS + FAULT_ROWS * num_joints)
    state[FAULT_NUMBERS:] = np.nan
    return state


@kernel
def is_believed(
    table: Array,
    state: Array,
    tau_ext: Array,
    sd: Array,
    tau_J: Array,
    counts: bool,
    lost: bool,
) -> bool:
    """Whether a reading may be valid; takes it into `state`.

    Args:
        table: of `fault_table`.
        state: of `initial_fault_state`, changed.
        tau_ext, sd: (n,) N m.
        tau_J: (n,) N m, of the sample before.
        counts: whether tau_ext is of this sample.
        lost: whether the sample is beyond what the joints can do.
    """
    if table[_LOADED] == np.inf:
        return True
    n, period = tau_ext.shape[0], table[_PERIOD]
    if lost:
        state[_LOST] = min(state[_LOST] + period, LOST_TIME)
        if state[_LOST] > LOST_TIME - 0.5 * period:
            state[_SUSPICION] = PROBATION + MOST
    else:
        state[_LOST] = max(state[_LOST] - FORGOTTEN * period, 0.0)
    square = 0.0
    for j in range(n):
        square += (tau_ext[j] / sd[j]) ** 2 + 0.0 * tau_J[j]  # NaN before a torque is known
    if not (counts and square < _LARGEST):
        return True
    late = _lateness(table, state, tau_ext, sd, tau_J)
    free = square < FREE * n
    if square > table[_LOADED] and state[_SUSPICION] <= MOST:
        rest = square - _along(table, tau_ext, sd)
        alone = rest < min(ALONE * n, ALONE_SHARE * square)
        if alone or late > LATE_SHARE:
            state[_SUSPICION] = min(state[_SUSPICION] + period, MOST)
        elif rest > ALONE * n and late < CONTACT_SHARE:
            state[_SUSPICION] = max(state[_SUSPICION] - period, 0.0)
    elif free:
        share = 1.0 if state[_SUSPICION] > MOST else FORGOTTEN
        state[_SUSPICION] = max(state[_SUSPICION] - share * period, 0.0)
    believed: bool = free or state[_SUSPICION] < TOLD
    return believed


@kernel
def _along(table: Array, tau_ext: Array, sd: Array) -> float:
    """The largest part of |z|^2 along one of the table's lines."""
    n, largest = tau_ext.shape[0], 0.0
    for start in range(_NUMBERS + n, table.shape[0], n):
        along, length = 0.0, 0.0
        for j in range(n):
            if table[start + j] != 0.0:  # of most arms one motor moves one joint
                u = table[start + j] / sd[j]
                along += u * tau_ext[j] / sd[j]
                length += u * u
        largest = max(largest, along * along / length)
    return largest


@kernel
def _lateness(table: Array, state: Array, tau_ext: Array, sd: Array, tau_J: Array) -> float:
    """The share of |z|^2 over LATE_TIME that currents that are late explain; 0 where none do."""
    n, keep = tau_ext.shape[0], table[_KEEP]
    if table[_NUMBERS] < 0.0:
        return 0.0
    zz, za, zb, aa, ab, bb = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(n):
        seen = FAULT_NUMBERS + j
        first, second = seen + n, seen + 2 * n
        if not np.isfinite(state[seen]):
            state[seen] = tau_J[j]
            state[first] = state[second] = tau_J[j] + tau_ext[j]
        pole = table[_NUMBERS + j]
        state[seen] = pole * state[seen] + (1.0 - pole) * tau_J[j]
        need = state[seen] + tau_ext[j]
        state[first] = keep * state[first] + (1.0 - keep) * need
        state[second] = keep * state[second] + (1.0 - keep) * state[first]
        z, a = tau_ext[j] / sd[j], (need - state[first]) / sd[j]
        b = (state[first] - state[second]) / sd[j]
        zz, za, zb = zz + z * z, za + z * a, zb + z * b
        aa, ab, bb = aa + a * a, ab + a * b, bb + b * b
    keep, k = table[_KEEP_LATE], _ZZ
    for product in (zz, za, zb, aa, ab, bb):
        state[k] = keep * state[k] + (1.0 - keep) * product
        k += 1
    za, zb, aa, ab, bb = state[_ZA], state[_ZB], state[_AA], state[_AB], state[_BB]
    if state[_ZZ] < table[_LOADED]:
        return 0.0
    det = max(aa * bb - ab * ab, 1e-9 * aa * bb)
    once, twice = (bb * za - ab * zb) / det, (aa * zb - ab * za) / det
    total = once + 0.5 * twice
    if not (LATE_SUM[0] < total < LATE_SUM[1] and LATE_SECOND[0] < twice < LATE_SECOND[1]):
        return 0.0
    share: float = (once * za + twice * zb) / state[_ZZ]
    return share
