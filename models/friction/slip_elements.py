"""The kernels of `presliding_friction`: slip elements with Stribeck, load and cubic terms.

They are the kernels of every law of this room: a law without memory has no rows of state, so that
they return at once, and one compiled estimator serves all.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Columns of the slip table; then K weights and K displacements.
COULOMB, STRIBECK, INVERSE_SPEED, LOAD, CUBIC, ELEMENTS = range(6)
# Rows of the state; then K slips z_k.
POSITION, TRANSMITTED, SLIPS = range(3)


class FrictionKernels(NamedTuple):
    """The two kernels of a kind of friction law, as `friction_law` states them."""

    add_torque: Any
    update: Any
    parts: tuple[Any, ...] = ()
    """The compiled functions that these two are composed of, where they are."""


@njit(cache=True, error_model="numpy")
def _slip(table: Array, state: Array, i: int, k: int, q: float, v: float) -> float:
    """z_k of joint i at this sample; NaN for a position that is."""
    reach = table[i, ELEMENTS + (table.shape[1] - ELEMENTS) // 2 + k]
    if reach == 0.0:
        return float(np.sign(v))
    before = state[POSITION, i]
    z = state[SLIPS + k, i]
    if not np.isfinite(before):  # the first sample: no displacement yet
        before = q
    z += (q - before) / reach
    if z > 1.0:
        return 1.0
    if z < -1.0:
        return -1.0
    return float(z)


@njit(cache=True, error_model="numpy")
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
    elements = (table.shape[1] - ELEMENTS) // 2
    for i in range(table.shape[0]):
        z = 0.0
        for k in range(elements):
            z += table[i, ELEMENTS + k] * _slip(table, state, i, k, q[i], v[i])
        x = v[i] * table[i, INVERSE_SPEED]
        level = table[i, COULOMB] + table[i, STRIBECK] * np.exp(-x * x)
        level += table[i, LOAD] * abs(state[TRANSMITTED, i])
        tau_f[i] += level * z + table[i, CUBIC] * v[i] ** 3


@njit(cache=True, error_model="numpy")
def update_slip(table: Array, state: Array, q: Array, v: Array, transmitted: Array) -> None:
    """Single-sample kernel: takes a sample into `state`, in place.

    What is not finite leaves its part of the state as it was: the displacement over a gap counts
    when the next position comes.

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
            state[POSITION, i] = q[i]
        if np.isfinite(transmitted[i]):
            state[TRANSMITTED, i] = transmitted[i]


SLIP_KERNELS = FrictionKernels(add_slip_torque, update_slip)
