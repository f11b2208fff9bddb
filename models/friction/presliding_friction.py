"""Joint friction with memory: elastic slip over joint displacement, Stribeck, load, cubic viscous.

    tau_f = velocity_law(v) + cubic v^3 + (coulomb + stribeck exp(-(v / v_s)^2) + load |L|) z
    z     = sum_k weight_k z_k,    z_k <- clip(z_k + dq / displacement_k, -1, 1)

Each z_k is a Prandtl element, a spring in series with a slider (several of them: Maxwell-slip;
Al-Bender, Lampaert and Swevers, IEEE Trans. Automatic Control 50(11), 2005): below its
displacement the joint creeps elastically, beyond it the element slides. A joint at rest so keeps
the torque that it stopped with, anything within its stiction band, which no function of velocity
alone can express. With a displacement of zero an element is rigid, z_k = sgn v, and the law has no
memory: that is the plain Stribeck and the plain load-dependent law.

L is the torque that the gear transmits, tau_J - tau_f. The causal estimator takes it from the
motor torque and the friction of the tick before: it holds the load of whatever the arm carries,
which the model's own rigid-body torque does not (on the UR10e with a payload, the force error at
the flange is 3.6 4.4 5.6 N with the former, 6.6 7.5 6.9 N with the latter), and at a tick tau_f
does not depend on the motor torque commanded at that tick. |load| < 1 keeps this recursion stable.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from models.friction.velocity_friction import CoulombViscous, SemiParametricFriction

Array = NDArray[np.float64]

# Columns of the slip table; then K weights and K displacements.
_COULOMB, _STRIBECK, _INVERSE_SPEED, _LOAD, _CUBIC, _ELEMENTS = range(6)
# Rows of the state; then K slips z_k.
_POSITION, _TRANSMITTED, _SLIPS = range(3)


class FrictionLaw(Protocol):
    """What the estimator, the identification and a controller ask of a friction law."""

    @property
    def num_joints(self) -> int:
        """How many joints, n."""

    @property
    def coulomb_viscous(self) -> CoulombViscous:
        """The law's Coulomb, viscous and offset coefficients."""

    @property
    def feedforward(self) -> SemiParametricFriction:
        """A function of velocity alone near the law: for feed-forward on a desired velocity."""

    @property
    def velocity_law(self) -> SemiParametricFriction:
        """The part of the law that is a function of velocity alone."""

    @property
    def slip_table(self) -> Array:
        """(n, 5 + 2 K): the other part, as `add_slip_torque` reads it."""

    @property
    def state_rows(self) -> int:
        """Rows of the state, 2 + K; 0 for a law without memory and load dependence."""

    def torque_along(self, q: Array, v: Array, load: Array) -> Array:
        """tau_f (N, n) in N m along a log that starts at rest, for the transmitted torque L."""


@dataclass(frozen=True, eq=False)
class PreslidingFriction:
    """The law of this module; K elements a joint.

    Attributes:
        velocity_law: function of v alone: viscous and offset, its Coulomb zero; networks on top.
        coulomb: (n,) N m.
        stribeck: (n,) N m at standstill on top of coulomb; may be negative.
        stribeck_velocity: (n,) v_s, rad/s, positive.
        load: (n,) N m per N m, in [0, 1).
        cubic: (n,) N m s^3/rad^3; negative where viscous friction grows less than linearly.
        weight: (n, K) shares of the elements, zero or more, with sum 1.
        displacement: (n, K) rad (m) from rest to sliding; 0 is rigid.

    Raises:
        ValueError: shapes that disagree, a value that is not finite or out of its range.
    """

    velocity_law: SemiParametricFriction
    coulomb: Array
    stribeck: Array
    stribeck_velocity: Array
    load: Array
    cubic: Array
    weight: Array
    displacement: Array

    def __post_init__(self) -> None:
        n = self.velocity_law.num_joints
        for key in ("coulomb", "stribeck", "stribeck_velocity", "load", "cubic"):
            self._keep(key, (n,))
        for key in ("weight", "displacement"):
            self._keep(key, (n, np.shape(self.weight)[-1] if np.ndim(self.weight) == 2 else 1))
        if not (self.stribeck_velocity > 0.0).all():
            raise ValueError("friction: stribeck_velocity must be positive")
        if not ((self.load >= 0.0) & (self.load < 1.0)).all():
            raise ValueError(f"friction: load must be in [0, 1), not {self.load}")
        if (self.displacement < 0.0).any():
            raise ValueError("friction: displacement must be zero or more")
        if (self.weight < 0.0).any() or not np.allclose(self.weight.sum(axis=1), 1.0):
            raise ValueError("friction: weights must be zero or more and have sum 1")
        if self.velocity_law.coulomb_viscous.coulomb.any():
            raise ValueError("friction: coulomb belongs to the slip, not to velocity_law")

    def _keep(self, key: str, shape: tuple[int, ...]) -> None:
        value = np.array(getattr(self, key), float)
        if value.shape != shape:
            raise ValueError(f"friction: {key} must have shape {shape}, not {value.shape}")
        if not np.isfinite(value).all():
            raise ValueError(f"friction: {key} has a value that is not finite: {value}")
        object.__setattr__(self, key, value)

    @property
    def num_joints(self) -> int:
        """How many joints, n."""
        return int(self.coulomb.shape[0])

    @property
    def coulomb_viscous(self) -> CoulombViscous:
        """The Coulomb, viscous and offset coefficients."""
        law = self.velocity_law.coulomb_viscous
        return CoulombViscous(self.coulomb, law.viscous, law.offset)

    @property
    def feedforward(self) -> SemiParametricFriction:
        """Sliding friction without load, Stribeck and memory."""
        return SemiParametricFriction(self.coulomb_viscous)

    @cached_property
    def slip_table(self) -> Array:
        """(n, 5 + 2 K) contiguous, one row a joint."""
        own = (self.coulomb, self.stribeck, 1.0 / self.stribeck_velocity, self.load, self.cubic)
        return np.ascontiguousarray(
            np.hstack([np.stack(own, axis=1), self.weight, self.displacement])
        )

    @property
    def state_rows(self) -> int:
        """Rows of the state: last position, transmitted torque, K slips."""
        return _SLIPS + int(self.weight.shape[1])

    def torque_along(self, q: ArrayLike, v: ArrayLike, load: ArrayLike) -> Array:
        """tau_f (N, n) in N m along a log that starts at rest with relaxed elements.

        Args:
            q: (N, n) rad (m).
            v: (N, n) rad/s (m/s).
            load: (N, n) transmitted torque L at the same samples, N m.
        """
        q, v, load = (np.require(x, float, ("C", "W")) for x in (q, v, load))
        if not (q.ndim == 2 and q.shape == v.shape == load.shape and q.shape[1] == self.num_joints):
            shapes = f"{q.shape}, {v.shape} and {load.shape}"
            raise ValueError(f"friction: expected (N, {self.num_joints}) three times, not {shapes}")
        tau_f = self.velocity_law.torque(v)
        _slip_log(self.slip_table, initial_friction_state(self), q, v, load, tau_f)
        return tau_f


def initial_friction_state(law: FrictionLaw) -> Array:
    """Returns the (state_rows, n) state before the first sample: relaxed, no position yet."""
    state = np.zeros((law.state_rows, law.num_joints))
    state[: _POSITION + 1] = np.nan
    return state


def slip_path(displacement: Array, q: Array, v: Array) -> Array:
    """z (N, n) along a log of one element a joint, displacement (n,) rad (m); 0 gives sgn v."""
    law = PreslidingFriction(
        SemiParametricFriction(CoulombViscous.zero(q.shape[1])),
        coulomb=np.ones(q.shape[1]),
        stribeck=np.zeros(q.shape[1]),
        stribeck_velocity=np.ones(q.shape[1]),
        load=np.zeros(q.shape[1]),
        cubic=np.zeros(q.shape[1]),
        weight=np.ones((q.shape[1], 1)),
        displacement=displacement[:, None],
    )
    return law.torque_along(q, v, np.zeros_like(q))


@njit(cache=True, error_model="numpy")
def _slip(table, state, i, k, q, v):  # type: ignore[no-untyped-def]
    """z_k of joint i at this sample; NaN for a position that is."""
    reach = table[i, _ELEMENTS + (table.shape[1] - _ELEMENTS) // 2 + k]
    if reach == 0.0:
        return np.sign(v)
    before = state[_POSITION, i]
    z = state[_SLIPS + k, i]
    if not np.isfinite(before):  # the first sample: no displacement yet
        before = q
    z += (q - before) / reach
    if z > 1.0:
        return 1.0
    if z < -1.0:
        return -1.0
    return z


@njit(cache=True, error_model="numpy")
def add_slip_torque(table, state, q, v, tau_f):  # type: ignore[no-untyped-def]
    """Single-sample kernel: adds the slip part of tau_f (n,); `state` stays as it is.

    Args:
        table: `FrictionLaw.slip_table`.
        state: (state_rows, n); without rows there is nothing to add.
        q, v: (n,) of this sample.
        tau_f: (n,), holds the velocity law's torque before.
    """
    if state.shape[0] == 0:
        return
    elements = (table.shape[1] - _ELEMENTS) // 2
    for i in range(table.shape[0]):
        z = 0.0
        for k in range(elements):
            z += table[i, _ELEMENTS + k] * _slip(table, state, i, k, q[i], v[i])
        x = v[i] * table[i, _INVERSE_SPEED]
        level = table[i, _COULOMB] + table[i, _STRIBECK] * np.exp(-x * x)
        level += table[i, _LOAD] * abs(state[_TRANSMITTED, i])
        tau_f[i] += level * z + table[i, _CUBIC] * v[i] ** 3


@njit(cache=True, error_model="numpy")
def update_slip(table, state, q, v, transmitted):  # type: ignore[no-untyped-def]
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
            for k in range(state.shape[0] - _SLIPS):
                z = _slip(table, state, i, k, q[i], v[i])
                if np.isfinite(z):
                    state[_SLIPS + k, i] = z
            state[_POSITION, i] = q[i]
        if np.isfinite(transmitted[i]):
            state[_TRANSMITTED, i] = transmitted[i]


@njit(cache=True, error_model="numpy")
def _slip_log(table, state, q, v, load, tau_f):  # type: ignore[no-untyped-def]
    for k in range(q.shape[0]):
        for i in range(q.shape[1]):
            state[_TRANSMITTED, i] = load[k, i]
        add_slip_torque(table, state, q[k], v[k], tau_f[k])
        update_slip(table, state, q[k], v[k], load[k])
