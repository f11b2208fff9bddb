"""The kernels of `presliding_friction`: slip elements with Stribeck, load and cubic terms.

All laws of this sub-package use these kernels. A law without memory has no rows of state, so that
the kernels return at once. One compiled estimator therefore serves all laws.
"""

from typing import Any, NamedTuple

import numpy as np

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel

# Columns of the slip table; then K weights and K displacements. The first seven are of sliding:
# level C, S, 1 / v_s, load; cubic, fitted speed, slope of the cubic part beyond it.
SLIDING_COLUMNS = 7
COULOMB, STRIBECK, INVERSE_SPEED, LOAD, CUBIC, SPEED_LIMIT, SLOPE_BEYOND = range(SLIDING_COLUMNS)
HALF_STEP, PERIOD, DECAY, ELEMENTS = range(SLIDING_COLUMNS, SLIDING_COLUMNS + 4)
# Rows of the state; then K slips z_k.
POSITION, TRANSMITTED, SLIPS = range(3)
# Share of its Coulomb friction that a joint at rest is taken to hold at least. Logs of fast motion
# hardly tell the level at a crawl: fits of short ones put C + S anywhere down to zero.
LEAST_HELD = 0.5


class FrictionKernels(NamedTuple):
    """The two kernels of a friction law, as `friction_law` states them.

    Attributes:
        add_torque, update: compiled.
        parts: the compiled functions that these two are composed of, if any.
    """

    add_torque: Any
    update: Any
    parts: tuple[Any, ...] = ()


def held_stribeck(coulomb: Array, stribeck: Array) -> Array:
    """S (n,) of the level at rest: the law's, but no less than LEAST_HELD of C (n,) requires."""
    return np.asarray(np.maximum(stribeck, (LEAST_HELD - 1.0) * np.maximum(coulomb, 0.0)))


@kernel
def within_rounding(previous: float, q: float, v: float, half_step: float, period: float) -> float:
    """The position after `previous` that velocity predicts and the rounded q allows.

    q itself for the first sample (`previous` not finite); NaN where q is NaN.
    """
    if half_step == 0.0 or not (np.isfinite(previous) and np.isfinite(q)):
        return q
    predicted = previous + v * period if np.isfinite(v) else previous
    return min(max(predicted, q - half_step), q + half_step)


@kernel
def bounded_cubic(v: float, cubic: float, limit: float, slope: float) -> float:
    """The torque cubic v^3; beyond the speed `limit` a line of this slope."""
    if abs(v) <= limit or not np.isfinite(limit):
        return cubic * v**3
    return float(np.sign(v)) * (cubic * limit**3 + slope * (abs(v) - limit))


@kernel
def _slip(table: Array, state: Array, i: int, k: int, q: float, v: float) -> float:
    """z_k of joint i at this sample; NaN where the position is NaN."""
    displacement = table[i, ELEMENTS + (table.shape[1] - ELEMENTS) // 2 + k]
    if displacement == 0.0:
        return float(np.sign(v))
    previous = state[POSITION, i]
    position = within_rounding(previous, q, v, table[i, HALF_STEP], table[i, PERIOD])
    if not np.isfinite(previous):  # the first sample: no displacement yet
        previous = position
    z = state[SLIPS + k, i] * table[i, DECAY] + (position - previous) / displacement
    if z > 1.0:
        return 1.0
    if z < -1.0:
        return -1.0
    return float(z)


@kernel
def add_slip_torque(table: Array, state: Array, q: Array, v: Array, tau_f: Array) -> None:
    """Single-sample kernel: adds the slip part of tau_f (n,); `state` stays as it is.

    Args:
        table: `FrictionLaw.slip_table`.
        state: (state_rows, n); without rows there is nothing to add.
        q, v: (n,) of this sample.
        tau_f: (n,), holds the velocity law's torque before.
    """
    if state.shape[0] == 0:
        return
    num_elements = (table.shape[1] - ELEMENTS) // 2
    for i in range(table.shape[0]):
        z = 0.0
        for k in range(num_elements):
            z += table[i, ELEMENTS + k] * _slip(table, state, i, k, q[i], v[i])
        x = v[i] * table[i, INVERSE_SPEED]
        level = table[i, COULOMB] + table[i, STRIBECK] * np.exp(-x * x)
        level += table[i, LOAD] * abs(state[TRANSMITTED, i])
        tau_f[i] += level * z + bounded_cubic(
            v[i], table[i, CUBIC], table[i, SPEED_LIMIT], table[i, SLOPE_BEYOND]
        )


@kernel
def update_slip(table: Array, state: Array, q: Array, v: Array, transmitted: Array) -> None:
    """Single-sample kernel: updates `state` with a sample, in place.

    A value that is not finite leaves its part of the state unchanged. The displacement over a gap
    is added when the next position arrives.

    Args:
        table: `FrictionLaw.slip_table`.
        state: (state_rows, n), changed.
        q, v: (n,) of this sample.
        transmitted: (n,) L for the next sample, N m.
    """
    if state.shape[0] == 0:
        return
    for i in range(table.shape[0]):
        if np.isfinite(q[i]):
            for k in range(state.shape[0] - SLIPS):
                z = _slip(table, state, i, k, q[i], v[i])
                if np.isfinite(z):
                    state[SLIPS + k, i] = z
            state[POSITION, i] = within_rounding(
                state[POSITION, i], q[i], v[i], table[i, HALF_STEP], table[i, PERIOD]
            )
        if np.isfinite(transmitted[i]):
            state[TRANSMITTED, i] = transmitted[i]


SLIP_KERNELS = FrictionKernels(add_slip_torque, update_slip)
