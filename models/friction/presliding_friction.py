"""Joint friction with memory: elastic slip over joint displacement, Stribeck, load, cubic viscous.

    tau_f = velocity_law(v) + cubic v^3 + (coulomb + stribeck exp(-(v / v_s)^2) + load |L|) z
    z     = sum_k weight_k z_k,    z_k <- clip(z_k + dq / displacement_k, -1, 1)

Each z_k is a Prandtl element, a spring in series with a slider. Several of them are a Maxwell-slip
model (Al-Bender, Lampaert and Swevers, IEEE Trans. Automatic Control 50(11), 2005). Below its
displacement the joint creeps elastically, beyond it the element slides. A joint at rest therefore
keeps the torque with which it stopped, which is anywhere within its stiction band. No function of
velocity alone can express this. With a displacement of zero an element is rigid, z_k = sgn v, and
the law has no memory: it is then the plain Stribeck or the plain load-dependent law.

L is the torque that the gear transmits, tau_J - tau_f. The causal estimator takes it from the
motor torque and the friction of the tick before. This torque includes everything that the arm
carries, unlike the model's own rigid-body torque. On the UR10e with a payload, the force error at
the flange is 3.6 4.4 5.6 N with the former and 6.6 7.5 6.9 N with the latter. At a tick, tau_f also
does not depend on the motor torque commanded at that tick. |load| < 1 keeps this recursion stable.

**Beyond the fitted speed** the part that depends on velocity alone, viscous v + cubic v^3, is
continued along its tangent, with a slope of at least zero. A cubic term would grow too fast: for
the UR10e's third joint at 1.6 rad/s, fitted up to 1.1, the error is 1.8 N m with the cubic and 1.0
with the tangent.

**The displacement of a tick** is not the difference of two rounded positions. An encoder with steps
of .1 mrad would move an element that slides after .1 mrad from end to end. Position follows
velocity and stays within the interval that the rounded one allows,

    p <- clip(p + v dt, q - resolution / 2, q + resolution / 2),    dq = change of p

a continuous function of q and v; with resolution 0 it is q. Slip relaxes with the time constant
RELAXATION_TIME: vibration and the controller release the torque that a joint kept when it stopped.
At rest on the UR10e the true slip (motor torque minus gravity, over the band) has an rms of .45 for
any memory of the law. Memory helps for less than about a second.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.friction.coulomb_viscous import CoulombViscous
from wrenchsight.models.friction.semi_parametric_friction import SemiParametricFriction
from wrenchsight.models.friction.slip_elements import (
    COULOMB,
    CUBIC,
    ELEMENTS,
    HALF_STEP,
    INVERSE_SPEED,
    LOAD,
    PERIOD,
    POSITION,
    SLIPS,
    SPEED_LIMIT,
    STRIBECK,
    TRANSMITTED,
    SlipElements,
    add_slip_torque,
    run_friction,
    update_slip,
)
from wrenchsight.models.numerics.arrays import Array, contiguous
from wrenchsight.models.numerics.kernel import kernel

RELAXATION_TIME = 1.0  # s in which the slip of a joint at rest fades to 1/e


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
        speed_limit: (n,) rad/s, up to which the law was fitted; None: everywhere.
        resolution: (n,) rad, the step of the encoders; None: 0.
        time_step: s between ticks; 0: positions are low-passed, nothing relaxes.

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
    speed_limit: Array = None  # type: ignore[assignment]  # None: no limit
    resolution: Array = None  # type: ignore[assignment]  # None: zero
    time_step: float = 0.0

    def __post_init__(self) -> None:
        """Brings the parameters into their shapes; raises ValueError where one is out of range.

        Each is copied into an array of its own; `_set` also refuses numbers that are not finite,
        which a speed limit may be.
        """
        n = self.velocity_law.num_joints
        for key in ("coulomb", "stribeck", "stribeck_velocity", "load", "cubic"):
            self._set(key, (n,))
        for key, default in (("speed_limit", np.inf), ("resolution", 0.0)):
            value = getattr(self, key)
            value = np.full(n, default) if value is None else np.array(value, float)
            if value.shape != (n,):
                raise ValueError(f"friction: {key} must have shape {(n,)}, not {value.shape}")
            object.__setattr__(self, key, value)
        if not (self.speed_limit > 0.0).all() or not (self.resolution >= 0.0).all():
            raise ValueError("friction: speed_limit must be positive, resolution zero or more")
        num_elements = np.shape(self.weight)[-1] if np.ndim(self.weight) == 2 else 1
        for key in ("weight", "displacement"):
            self._set(key, (n, num_elements))
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

    def _set(self, key: str, shape: tuple[int, ...]) -> None:
        """Replaces an attribute by its array; ValueError where its shape or a value is wrong."""
        value = np.array(getattr(self, key), float)
        if value.shape != shape:
            raise ValueError(f"friction: {key} must have shape {shape}, not {value.shape}")
        if not np.isfinite(value).all():
            raise ValueError(f"friction: {key} has a value that is not finite: {value}")
        object.__setattr__(self, key, value)

    @property
    def num_joints(self) -> int:
        """Number of joints, n."""
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

    @property
    def resting(self) -> tuple[Array, Array]:
        """Offset (n,) in N m and viscous coefficient (n,) in N m s/rad."""
        return self.velocity_law.resting

    @property
    def is_of_speed_alone(self) -> bool:
        """False."""
        return False

    @cached_property
    def slip_table(self) -> Array:
        """(n, 10 + 2 K) contiguous, one row a joint."""
        n = self.num_joints
        speed_limit = np.where(np.isfinite(self.speed_limit), self.speed_limit, 0.0)
        viscous = self.velocity_law.coulomb_viscous.viscous
        joint_columns = (
            self.coulomb,
            self.stribeck,
            1.0 / self.stribeck_velocity,
            self.load,
            self.cubic,
            self.speed_limit,
            np.maximum(3.0 * self.cubic * speed_limit**2, -viscous),  # no total slope below zero
            0.5 * self.resolution,
            np.full(n, self.time_step),
            np.full(n, np.exp(-self.time_step / RELAXATION_TIME)),
        )
        return np.ascontiguousarray(
            np.hstack([np.stack(joint_columns, axis=1), self.weight, self.displacement])
        )

    def sampled(self, time_step: float, resolution: ArrayLike | None = None) -> Self:
        """Returns the law for positions as encoders report them, every `time_step` s.

        Args:
            time_step: s.
            resolution: (n,) or () rad, the encoders' step; None: the law's own.
        """
        step = self.resolution if resolution is None else np.asarray(resolution, float)
        step = np.broadcast_to(step, (self.num_joints,))
        return replace(self, time_step=time_step, resolution=step)

    @property
    def state_rows(self) -> int:
        """Rows of the state: last position, transmitted torque, K slips."""
        return SLIPS + int(self.weight.shape[1])

    @cached_property
    def elements(self) -> SlipElements:
        """The slip elements, joint by joint."""
        return SlipElements.of_joints(self.slip_table)

    def direct(self, q: Array, v: Array) -> Array:
        """The velocity law's torque (N, n) in N m."""
        return self.velocity_law.direct(q, v)

    def run(
        self, state: Array, q: Array, v: Array, tau_J: Array, rest: Array | None = None
    ) -> Array:
        """tau_f (N, n) in N m of N samples; see `FrictionLaw`."""
        return run_friction(self, state, q, v, tau_J, rest)

    @property
    def parameters(self) -> dict[str, Array]:
        """The slip table, see `slip_elements`; the velocity law is fixed."""
        return {"slip": self.slip_table}

    def with_parameters(self, values: dict[str, Array]) -> Self:
        """Returns the law with another slip table."""
        table = values["slip"].reshape(self.num_joints, -1)
        K = (table.shape[1] - ELEMENTS) // 2
        law = replace(
            self,
            coulomb=table[:, COULOMB],
            stribeck=table[:, STRIBECK],
            stribeck_velocity=1.0 / table[:, INVERSE_SPEED],
            load=table[:, LOAD],
            cubic=table[:, CUBIC],
            speed_limit=table[:, SPEED_LIMIT],
            resolution=2.0 * table[:, HALF_STEP],
            time_step=float(table[0, PERIOD]),
            weight=table[:, ELEMENTS : ELEMENTS + K],
            displacement=table[:, ELEMENTS + K :],
        )
        law.__dict__["slip_table"] = np.array(table)  # as it stands, without rounding of 1 / v_s
        return law

    def initial_state(self) -> Array:
        """Returns the state before the first sample: relaxed, no position yet."""
        state = np.zeros((self.state_rows, self.num_joints))
        state[: POSITION + 1] = np.nan
        return state

    def torque_along(self, q: ArrayLike, v: ArrayLike, load: ArrayLike) -> Array:
        """tau_f (N, n) in N m along a log that starts at rest with relaxed elements.

        Args:
            q: (N, n) rad (m).
            v: (N, n) rad/s (m/s).
            load: (N, n) transmitted torque L at the same samples, N m.

        Raises:
            ValueError: shapes that disagree.
        """
        q, v, load = contiguous(q, v, load)
        if not (q.ndim == 2 and q.shape == v.shape == load.shape and q.shape[1] == self.num_joints):
            shapes = f"{q.shape}, {v.shape} and {load.shape}"
            raise ValueError(f"friction: expected (N, {self.num_joints}) three times, not {shapes}")
        tau_f = self.velocity_law.torque(v)
        _slip_log(self.slip_table, self.initial_state(), q, v, load, tau_f)
        return tau_f


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


@kernel
def _slip_log(table: Array, state: Array, q: Array, v: Array, load: Array, tau_f: Array) -> None:
    for k in range(q.shape[0]):
        for i in range(q.shape[1]):
            state[TRANSMITTED, i] = load[k, i]
        add_slip_torque(table, state, q[k], v[k], tau_f[k])
        update_slip(table, state, q[k], v[k], load[k])
