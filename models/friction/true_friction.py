"""Joint friction of the simulated true robot: stiction, Stribeck, Coulomb, viscous, load, ripple.

It holds more than any model in this project does, on purpose. It comes in three parts, by how a
time-stepping simulation can compute them:

    held       at most `stiction`, whatever keeps the joint at rest; solved implicitly
    explicit   g(v) (load_dependence |load| - (stiction - coulomb)) + ripple sin(periods q)
    viscous    viscous v; solved implicitly, as joint damping

    g(v) = sgn(v) (1 - exp(-(v / stribeck_velocity)^2))

g is continuously differentiable at v = 0 and vanishes there, so that the explicit part never
chatters and breakaway happens at the stiction torque. Sliding at velocity v the sum is

    tau_f = sgn(v) (coulomb + (stiction - coulomb) exp(-(v / stribeck_velocity)^2)) + viscous v
            + g(v) load_dependence |load| + ripple sin(periods q)

(Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30(7), 1994, eq. 6 for the first term.)
"""

import dataclasses
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.arrays import Array
from wrenchsight.models.kernel import kernel
from wrenchsight.models.rigid_body.small_matrices import factorise_in_place, solve_factorised

_STICTION, _COULOMB, _SPEED, _VISCOUS, _LOAD, _RIPPLE, _PERIODS = range(7)


@dataclass(frozen=True, eq=False)
class DryFriction:
    """Parameters of the law, one of each a joint (n,).

    Attributes:
        stiction: breakaway torque, N m; not below coulomb.
        coulomb: sliding torque at high velocity, N m.
        stribeck_velocity: rad/s, positive.
        viscous: N m s/rad.
        load_dependence: friction torque per transmitted torque, -.
        ripple_amplitude: torque over one turn, N m.
        ripple_periods: periods of it in a full turn of the joint, -.

    Raises:
        ValueError: shapes that disagree, a negative number, stiction below coulomb, a
            stribeck_velocity of zero.
    """

    stiction: Array
    coulomb: Array
    stribeck_velocity: Array
    viscous: Array
    load_dependence: Array
    ripple_amplitude: Array
    ripple_periods: Array

    def __post_init__(self) -> None:
        shape = np.shape(self.stiction)
        for field in dataclasses.fields(self):
            value = np.array(getattr(self, field.name), dtype=np.float64)
            if value.ndim != 1 or value.shape != shape:
                raise ValueError(f"true friction: {field.name} must have one value per joint")
            if not np.all(np.isfinite(value) & (value >= 0.0)):
                raise ValueError(f"true friction: {field.name} must not be negative: {value}")
            object.__setattr__(self, field.name, value)
        if np.any(self.stiction < self.coulomb):
            raise ValueError("true friction: stiction must not be below coulomb")
        if np.any(self.stribeck_velocity == 0.0):
            raise ValueError("true friction: stribeck_velocity must be positive")

    @cached_property
    def table(self) -> Array:
        """(n, 7) contiguous, in the order of the fields: what the kernels read."""
        columns = [getattr(self, field.name) for field in dataclasses.fields(self)]
        return np.ascontiguousarray(np.stack(columns, axis=1))

    def sliding_torque(self, v: ArrayLike, load: ArrayLike = 0.0) -> Array:
        """tau_f in N m at v ((n,) or (N, n), rad/s, not 0) under `load` (N m), without ripple."""
        v = np.asarray(v, dtype=np.float64)
        bump = np.exp(-((v / self.stribeck_velocity) ** 2))
        dry = self.coulomb + (self.stiction - self.coulomb) * bump
        dry = dry + (1.0 - bump) * self.load_dependence * np.abs(np.asarray(load, np.float64))
        return np.asarray(np.sign(v) * dry + self.viscous * v)


@kernel
def explicit_friction(table: Array, q: Array, v: Array, load: Array, out: Array) -> None:
    """Writes the explicit part (n,), N m, positive where it opposes positive motion."""
    for i in range(table.shape[0]):
        x = v[i] / table[i, _SPEED]
        g = np.copysign(-np.expm1(-x * x), v[i])
        level = table[i, _LOAD] * abs(load[i]) - (table[i, _STICTION] - table[i, _COULOMB])
        out[i] = g * level + table[i, _RIPPLE] * np.sin(table[i, _PERIODS] * q[i])


@kernel
def explicit_torque(table: Array, state: Array, load: Array, out: Array) -> None:
    """Writes minus the explicit part (n,), N m, at state (2n,): q, then v."""
    n = load.shape[0]
    explicit_friction(table, state[:n], state[n:], load, out)
    for i in range(n):
        out[i] = -out[i]


@kernel
def total_friction(
    table: Array, q: Array, v: Array, load: Array, holding: Array, out: Array
) -> None:
    """Writes tau_f (n,), N m: explicit and viscous part less what the holding drive puts on."""
    explicit_friction(table, q, v, load, out)
    for i in range(table.shape[0]):
        out[i] += table[i, _VISCOUS] * v[i] - holding[i]


@kernel
def holding_torque(
    table: Array,
    damping: float,
    time_step: float,
    M: Array,
    force: Array,
    v: Array,
    out: Array,
) -> None:
    """Writes what holds or slows the joints in the coming tick: (n,), N m, opposing motion.

    The part `held` of the law as a strong damper that gives way at stiction, f(v) = clip(damping v,
    -stiction, stiction), taken at the velocity v+ at the end of the tick, like viscous friction:

        M (v+ - v) / time_step + viscous v+ + f(v+) = force

    v+ is the minimum of a strictly convex function whose gradient is this equation; Newton's method
    with a line search finds it, exactly once it knows which joints stick.

    Args:
        table: of DryFriction.
        damping: N m s/rad, of a joint that sticks.
        M: (n, n) kg m^2.
        force: (n,) all other torque of the tick, N m: motors, gravity, Coriolis, environment.
        v: (n,) at the beginning of the tick, rad/s.
    """
    n = v.shape[0]
    A, b = np.empty((n, n)), np.empty(n)
    for i in range(n):
        b[i] = force[i]
        for j in range(n):
            A[i, j] = M[i, j] / time_step
            b[i] += A[i, j] * v[j]
        A[i, i] += table[i, _VISCOUS]
    after = v.copy()
    L, step, residual = np.empty((n, n)), np.empty(n), np.empty(n)
    value = _potential(table, damping, A, b, after, residual)
    for _ in range(50):
        size = 0.0
        for i in range(n):
            size = max(size, abs(residual[i]) / (1.0 + abs(b[i])))
        if size < 1e-13:
            break
        _newton_step(table, damping, A, after, residual, L, step)
        slope = 0.0
        for i in range(n):
            slope += residual[i] * step[i]
        share, trial = 1.0, after + step
        lower = _potential(table, damping, A, b, trial, residual)
        while lower > value + 1e-4 * share * slope and share > 1e-6:
            share *= 0.5
            trial = after + share * step
            lower = _potential(table, damping, A, b, trial, residual)
        after, value = trial, lower
    for i in range(n):
        limit = table[i, _STICTION]
        out[i] = min(max(damping * after[i], -limit), limit)


@kernel
def free_friction(
    table: Array,
    damping: float,
    time_step: float,
    M: Array,
    Cv: Array,
    G: Array,
    q: Array,
    v: Array,
    tau_J: Array,
    tau_ext: Array,
    out: Array,
) -> None:
    """Writes minus (explicit + held) (n,), N m, of a robot that nothing but tau_ext touches.

    The load of the gears is tau_J; M, Cv, G of the true robot at q, v.
    """
    n = v.shape[0]
    explicit, force = np.empty(n), np.empty(n)
    explicit_friction(table, q, v, tau_J, explicit)
    for i in range(n):
        force[i] = tau_J[i] + tau_ext[i] - Cv[i] - G[i] - explicit[i]
    holding_torque(table, damping, time_step, M, force, v, out)
    for i in range(n):
        out[i] = -(out[i] + explicit[i])


@kernel
def _potential(
    table: Array, damping: float, A: Array, b: Array, v: Array, gradient: Array
) -> float:
    value = 0.0
    for i in range(v.shape[0]):
        gradient[i] = -b[i]
        for j in range(v.shape[0]):
            gradient[i] += A[i, j] * v[j]
        value += 0.5 * v[i] * (gradient[i] - b[i])
        limit = table[i, _STICTION]
        edge = limit / damping
        if abs(v[i]) <= edge:
            value += 0.5 * damping * v[i] * v[i]
            gradient[i] += damping * v[i]
        else:
            value += limit * (abs(v[i]) - 0.5 * edge)
            gradient[i] += np.copysign(limit, v[i])
    return value


@kernel
def _newton_step(
    table: Array, damping: float, A: Array, v: Array, gradient: Array, L: Array, step: Array
) -> None:
    """Solves (A + diag(damping of the joints that stick)) step = -gradient by Cholesky."""
    n = v.shape[0]
    for i in range(n):
        for j in range(i + 1):
            L[i, j] = A[i, j]
        if damping * abs(v[i]) <= table[i, _STICTION]:
            L[i, i] += damping
        step[i] = -gradient[i]
    factorise_in_place(L, n, 0.0)
    solve_factorised(L, n, step)
