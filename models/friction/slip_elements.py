"""The kernels of `presliding_friction`: slip elements with Stribeck, load and cubic terms.

All laws of this sub-package use these kernels. A law without memory has no rows of state, so that
the kernels of a sample return at once.
"""

from typing import NamedTuple, Protocol

import numpy as np

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.sparse_products import add_transposed_product, product

# Columns of the slip table, a row a joint (a motor). The first SLIDING_COLUMNS are of sliding.
SLIDING_COLUMNS = 7
(
    COULOMB,  # N m
    STRIBECK,  # N m
    INVERSE_SPEED,  # 1 / v_s, s/rad
    LOAD,  # N m per N m
    CUBIC,  # N m s^3/rad^3
    SPEED_LIMIT,  # rad/s, up to which the law was fitted
    SLOPE_BEYOND,  # N m s/rad, of the cubic part beyond it
    HALF_STEP,  # rad, half an encoder's step
    PERIOD,  # s
    DECAY,  # what a period of rest leaves of the slip
    ELEMENTS,  # from here on K weights, then K displacements
) = range(11)
# Rows of the state.
(
    POSITION,  # p, rad
    TRANSMITTED,  # L of the sample before, N m
    SLIPS,  # from here on K slips z_k
) = range(3)
# Share of its Coulomb friction that a joint at rest is taken to hold at least. Logs of fast motion
# hardly tell the level at a crawl: fits of short ones put C + S anywhere down to zero.
LEAST_HELD = 0.5


class SlipElements(NamedTuple):
    """The slip elements of a law, for `slip_rows`.

    Attributes:
        table: (n, 10 + 2 K), one row a joint, or a motor where motors move several joints.
        motor_rates: (n, n) D with v_motor = D v_joint; (0, n) where each motor moves its own joint.
        joint_rates: D^-1, or (0, n).
    """

    table: Array
    motor_rates: Array
    joint_rates: Array

    @classmethod
    def of_joints(cls, table: Array) -> "SlipElements":
        """Elements of motors that move a joint each."""
        none = np.zeros((0, len(table)))
        return cls(table, none, none)


class _FrictionLaw(Protocol):
    """What `run_friction` needs of a `friction_law.FrictionLaw`."""

    @property
    def state_rows(self) -> int: ...
    @property
    def elements(self) -> SlipElements: ...
    @property
    def resting(self) -> tuple[Array, Array]: ...
    def direct(self, q: Array, v: Array) -> Array: ...


def run_friction(
    law: _FrictionLaw, state: Array, q: Array, v: Array, tau_J: Array, rest: Array | None
) -> Array:
    """`friction_law.FrictionLaw.run` of a law whose memory are slip elements."""
    tau_f = law.direct(q, v)
    if law.state_rows > 0 or rest is not None:
        share = np.zeros_like(v) if rest is None else rest
        slip_rows(*law.elements, state, q, v, tau_J, share, *law.resting, tau_f)
    return tau_f


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
        table: of SlipElements.
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

    It comes after `add_slip_torque` of the same sample, which starts from the state before. A value
    that is not finite leaves its part of the state unchanged. The displacement over a gap is added
    when the next position arrives.

    Args:
        table: of SlipElements.
        state: (state_rows, n), changed.
        q, v: (n,) of this sample.
        transmitted: (n,) L for the next sample, N m.
    """
    if state.shape[0] == 0:
        return
    for i in range(table.shape[0]):
        if np.isfinite(q[i]):
            # The K slips first: they follow the change from the position before.
            for k in range(state.shape[0] - SLIPS):
                z = _slip(table, state, i, k, q[i], v[i])
                if np.isfinite(z):
                    state[SLIPS + k, i] = z
            state[POSITION, i] = within_rounding(
                state[POSITION, i], q[i], v[i], table[i, HALF_STEP], table[i, PERIOD]
            )
        if np.isfinite(transmitted[i]):
            state[TRANSMITTED, i] = transmitted[i]


@kernel
def slip_rows(
    table: Array,
    motor_rates: Array,
    joint_rates: Array,
    state: Array,
    q: Array,
    v: Array,
    tau_J: Array,
    rest: Array,
    offset: Array,
    viscous: Array,
    tau_f: Array,
) -> None:
    """Completes the friction of N samples, row by row: slip, then what a joint at rest hides.

    The load of a sample is what the gear transmitted at the one before, tau_J - tau_f, which the
    state holds. A joint that rests by the share r carries any torque within its stiction band,
    whatever the law says; of the law offset and viscous part alone are left there:

        tau_f <- (1 - r) tau_f + r (offset + viscous v)

    Args:
        table: of SlipElements.
        motor_rates: (n, n) of SlipElements, v_motor = motor_rates v_joint; empty where each motor
            moves its own joint. Slip elements are those of the motors.
        joint_rates: its inverse.
        state: (state_rows, n), changed; without rows there are no elements.
        q, v, tau_J: (N, n) rad, rad/s and N m.
        rest: (N, n) r.
        offset, viscous: (n,) N m and N m s/rad of the law.
        tau_f: (N, n) N m, changed: holds before what depends on q and v alone.
    """
    n = q.shape[1]
    has_slip, is_coupled = state.shape[0] > 0, motor_rates.shape[0] > 0
    motor_q, motor_v = np.empty(n), np.empty(n)
    slip_torque, joint_load, load = np.empty(n), np.empty(n), np.empty(n)
    for k in range(q.shape[0]):
        # Slip elements are of motors: their motion, their torque, and that on the joints.
        for i in range(n):
            motor_q[i], motor_v[i], slip_torque[i] = q[k, i], v[k, i], 0.0
        if is_coupled:
            product(motor_rates, q[k], motor_q)
            product(motor_rates, v[k], motor_v)
        add_slip_torque(table, state, motor_q, motor_v, slip_torque)
        if is_coupled:
            add_transposed_product(motor_rates, slip_torque, tau_f[k])
        for i in range(n):
            if not is_coupled:
                tau_f[k, i] += slip_torque[i]
            if rest[k, i] > 0.0:
                tau_f[k, i] += rest[k, i] * (offset[i] + viscous[i] * v[k, i] - tau_f[k, i])
        if not has_slip:
            continue
        # The load of the next sample, of each motor: the joints' where none is coupled.
        for i in range(n):
            joint_load[i] = tau_J[k, i] - tau_f[k, i]
            load[i] = 0.0 if is_coupled else joint_load[i]
        if is_coupled:
            add_transposed_product(joint_rates, joint_load, load)
        update_slip(table, state, motor_q, motor_v, load)
