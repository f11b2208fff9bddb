"""The test whether the observed torque is the signature of a wrong signal rather than of a contact.

Any torque on six joints is that of some wrench at E. But a wrong signal leaves a trace that a
contact hardly ever leaves. With z = tau_ext / sd, joint by joint,

    one current wrong      z lies along the torque of that motor alone
    two exchanged          z lies along one ampere more in one motor and one less in another
    all late by d          z is need(t) - need(t - d), where need = tau_J + tau_ext is the torque
                           that an arm that nothing touches takes

z lies along such a line where |z|^2 > LOADED n and its part beside the line is below ALONE n and
ALONE_SHARE of it. Late currents are recognised by means over LATE_TIME. `once` and `twice` are need
behind one and two low-passes of time constant LATENESS. a (need - once) + b (once - twice) must be
LATE_SHARE of |z|^2. a and b must be those of a delay of .1 to .5 s, within LATE_SUM and
LATE_SECOND.

Suspicion is counted in seconds, up to MOST. From REPORTED on a reading is not valid, unless it is
free of force: |z|^2 < FREE n, as without any contact or fault. While z lies on none of these lines,
as in a contact, suspicion falls as fast as it rose. While readings are free, it falls by FORGOTTEN
of the time.

After samples beyond the joints' limits for LOST_TIME, readings are not valid as soon as samples are
possible again: two exchanged joints, or an encoder that slipped, give possible numbers. Until there
have been PROBATION seconds of free readings, only these are valid.

Faults with another trace are not detected: a fault while something pushes, one below LOADED, a
wrong position without a jump. The constants were chosen on one half of the motions of a simulated
and of the real UR10e, and checked on the other half.
"""

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel

LOADED, FREE, ALONE = 8.0, 3.0, 2.5  # of |z|^2, by joint
ALONE_SHARE = 0.12
LATE_SHARE, CONTACT_SHARE = 0.8, 0.5
LATENESS, LATE_TIME = 0.15, 0.15  # s
LATE_SUM, LATE_SECOND = (1.0, 3.0), (-1.5, 5.0)  # of a + b / 2, of b
REPORTED, MOST = 0.05, 0.5  # s
FORGOTTEN = 0.2
LOST_TIME, PROBATION = 0.05, 5.0  # s

_LARGEST = 1e50  # N m; beyond, nothing is known

# Of the table: these numbers, the observer's poles (n,), then lines (m, n), N m.
_PERIOD, _LOADED, _DECAY, _DECAY_LATE, _NUMBERS = range(5)
# Of the state: these numbers, then tau_J as the observer saw it, and need through one pole and two,
# (n,) each.
_SUSPICION, _LOST, _ZZ, _ZA, _ZB, _AA, _AB, _BB, FAULT_NUMBERS = range(9)
FAULT_ROWS = 3


def fault_table(
    torques: ArrayLike, K_0: ArrayLike | None, time_step: float, has_sd: bool = True
) -> Array:
    """Returns the constants that the kernel reads.

    Args:
        torques: (n, n) N m on the joints, a row for one ampere in each motor.
        K_0: (n,) 1/s of the observer; None for one without such a lag: lateness is not looked for.
        time_step: s.
        has_sd: whether sds are known; if not, no reading is rejected.
    """
    torques = np.atleast_2d(np.asarray(torques, float))
    n = len(torques)
    pairs = [torques[j] - torques[k] for j in range(n) for k in range(j)]
    poles = np.full(n, -1.0) if K_0 is None else np.exp(-np.asarray(K_0, float) * time_step)
    decays = np.exp(-time_step / np.array([LATENESS, LATE_TIME]))
    loaded = LOADED * n if has_sd else np.inf
    numbers = [time_step, loaded, *decays]
    return np.concatenate([numbers, np.broadcast_to(poles, n), *torques, *pairs])


def initial_fault_state(num_joints: int) -> Array:
    """Returns the state before the first sample: no suspicion, no torque."""
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
    is_measured: bool,
    is_implausible: bool,
) -> bool:
    """Whether a reading may be valid; updates `state` with the reading.

    Args:
        table: of `fault_table`.
        state: of `initial_fault_state`, changed.
        tau_ext, sd: (n,) N m.
        tau_J: (n,) N m, of the sample before.
        is_measured: whether tau_ext is of this sample.
        is_implausible: whether the sample is beyond what the joints can do.
    """
    if table[_LOADED] == np.inf:
        return True
    n, period = tau_ext.shape[0], table[_PERIOD]
    if is_implausible:
        state[_LOST] = min(state[_LOST] + period, LOST_TIME)
        if state[_LOST] > LOST_TIME - 0.5 * period:
            state[_SUSPICION] = PROBATION + MOST
    else:
        state[_LOST] = max(state[_LOST] - FORGOTTEN * period, 0.0)
    square = 0.0
    for j in range(n):
        square += (tau_ext[j] / sd[j]) ** 2 + 0.0 * tau_J[j]  # NaN before a torque is known
    if not (is_measured and square < _LARGEST):
        return True
    late_share = _lateness(table, state, tau_ext, sd, tau_J)
    is_free = square < FREE * n
    if square > table[_LOADED] and state[_SUSPICION] <= MOST:
        off_line = square - _along(table, tau_ext, sd)
        on_line = off_line < min(ALONE * n, ALONE_SHARE * square)
        if on_line or late_share > LATE_SHARE:
            state[_SUSPICION] = min(state[_SUSPICION] + period, MOST)
        elif off_line > ALONE * n and late_share < CONTACT_SHARE:
            state[_SUSPICION] = max(state[_SUSPICION] - period, 0.0)
    elif is_free:
        share = 1.0 if state[_SUSPICION] > MOST else FORGOTTEN
        state[_SUSPICION] = max(state[_SUSPICION] - share * period, 0.0)
    believed: bool = is_free or state[_SUSPICION] < REPORTED
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
    """The share of |z|^2 over LATE_TIME that late currents explain; 0 where they do not."""
    n, decay = tau_ext.shape[0], table[_DECAY]
    if table[_NUMBERS] < 0.0:
        return 0.0
    zz, za, zb, aa, ab, bb = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(n):
        tau_J_row = FAULT_NUMBERS + j
        pole_1_row, pole_2_row = tau_J_row + n, tau_J_row + 2 * n
        if not np.isfinite(state[tau_J_row]):
            state[tau_J_row] = tau_J[j]
            state[pole_1_row] = state[pole_2_row] = tau_J[j] + tau_ext[j]
        pole = table[_NUMBERS + j]
        state[tau_J_row] = pole * state[tau_J_row] + (1.0 - pole) * tau_J[j]
        need = state[tau_J_row] + tau_ext[j]
        state[pole_1_row] = decay * state[pole_1_row] + (1.0 - decay) * need
        state[pole_2_row] = decay * state[pole_2_row] + (1.0 - decay) * state[pole_1_row]
        z, a = tau_ext[j] / sd[j], (need - state[pole_1_row]) / sd[j]
        b = (state[pole_1_row] - state[pole_2_row]) / sd[j]
        zz, za, zb = zz + z * z, za + z * a, zb + z * b
        aa, ab, bb = aa + a * a, ab + a * b, bb + b * b
    decay, k = table[_DECAY_LATE], _ZZ
    for product in (zz, za, zb, aa, ab, bb):
        state[k] = decay * state[k] + (1.0 - decay) * product
        k += 1
    za, zb, aa, ab, bb = state[_ZA], state[_ZB], state[_AA], state[_AB], state[_BB]
    if state[_ZZ] < table[_LOADED]:
        return 0.0
    det = max(aa * bb - ab * ab, 1e-9 * aa * bb)
    a_fit, b_fit = (bb * za - ab * zb) / det, (aa * zb - ab * za) / det
    total = a_fit + 0.5 * b_fit
    if not (LATE_SUM[0] < total < LATE_SUM[1] and LATE_SECOND[0] < b_fit < LATE_SECOND[1]):
        return 0.0
    share: float = (a_fit * za + b_fit * zb) / state[_ZZ]
    return share
