"""Friction out of motor torque without a torque sensor, by reversal (Lu et al., eqs. 13-19).

Where an arm passes the same posture twice with opposite velocity, Coriolis torque and gravity are
alike (eq. 14) and friction is opposite as far as it is odd (eq. 15), so that

    tau_f = (tau_J1 - tau_J2) / 2 - M (vdot_1 - vdot_2) / 2

which is eq. 19 where the accelerations are opposite too (eq. 16): M vdot. Half the sum,

    (tau_J1 + tau_J2) / 2 - [Cv + G + M (vdot_1 + vdot_2) / 2],

is the part of friction that eq. 15 neglects (plus the error of the model's gravity).

`reversal_motion` plans such passes. A motion q(t) = phi + p(t) with p(t + T/2) = -p(t) passes phi
half a period later with opposite velocity and opposite acceleration:

    p(t) = (speed / w) sin(w t) + acceleration / (8 w^2) [cos(w t) - cos(3 w t)],   w = 2 pi / T

passes it with any chosen speed, however small, and any acceleration.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.arrays import Array
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.motion.paths import JointTrajectory
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot

TIME_STEP = 1e-3  # s, of the trajectory
LEAST_POINTS = 4  # samples of a pass
OTHER_JOINTS = 0.05  # rad, by which the others may differ between the two passes
SPEEDS_ALIKE = 0.2  # of the speed, by which the two passes may differ in it


@dataclass(frozen=True, eq=False)
class ReversalSamples:
    """Friction of one joint where it passes a position both ways.

    Attributes:
        joint: index.
        position: (K,) rad.
        speed: (K,) rad/s, positive: the mean of the two.
        acceleration: (K,) rad/s^2, half the difference of the two.
        symmetric: (K,) N m, the odd part of friction, positive against the motion.
        asymmetric: (K,) N m, half the sum less the rigid-body torque.
    """

    joint: int
    position: Array
    speed: Array
    acceleration: Array
    symmetric: Array
    asymmetric: Array

    @property
    def asymmetric_share(self) -> float:
        """RMS of the asymmetric part over RMS of the symmetric one."""
        return float(np.sqrt(np.mean(self.asymmetric**2) / np.mean(self.symmetric**2)))

    def friction(self) -> tuple[Array, Array]:
        """Velocities and friction torques (2 K,) of both directions."""
        v = np.concatenate([self.speed, -self.speed])
        return v, np.concatenate(
            [self.asymmetric + self.symmetric, self.asymmetric - self.symmetric]
        )


@dataclass(frozen=True, eq=False)
class ReversalMotion:
    """A planned motion.

    Attributes:
        direction: (n,) share of the motion that each joint makes.
        trajectory: at rest at both ends.
        crossings: (K, 2) s, the two passes of each pair.
        posture: (n,) rad, where they meet.
        speed: (K,) rad/s planned there, times direction.
        acceleration: (K,) rad/s^2 planned there at the first pass, times direction; the second has
            its opposite.
    """

    direction: Array
    trajectory: JointTrajectory
    crossings: Array
    posture: Array
    speed: Array
    acceleration: Array


def reversal_motion(
    robot: Robot,
    direction: ArrayLike,
    posture: ArrayLike,
    speeds: ArrayLike,
    accelerations: ArrayLike = (0.0, 1.0),
    period: float = 2.0,
) -> ReversalMotion:
    """Plans passes through a posture, both ways, at every speed and acceleration.

    One joint moves, or several together: then all their velocities and accelerations are opposite
    at the two passes, so that each joint's friction separates from one motion.

    Each pair takes two periods: one in which the motion changes smoothly from what it was, and one
    that holds the passes at its start, middle and end.

    Args:
        robot: sets the limits.
        direction: index of the joint that moves, or (n,) share of the motion that each makes.
        posture: (n,) rad, where the passes meet.
        speeds: rad/s, positive, times direction.
        accelerations: rad/s^2, of the first pass of a pair, times direction.
        period: s.

    Raises:
        InputError: a posture or motion beyond the joint's limits, or a speed that is not positive.
    """
    posture = np.asarray(posture, dtype=np.float64)
    way = np.asarray(direction, dtype=np.float64)
    if way.ndim == 0:
        way = np.eye(robot.num_joints)[int(way)]
    name = ", ".join(robot.joint_names[j] for j in np.flatnonzero(way))
    levels = [
        (float(s), float(a))
        for s in np.atleast_1d(np.asarray(speeds, float))
        for a in np.atleast_1d(np.asarray(accelerations, float))
    ]
    if posture.shape != (robot.num_joints,) or way.shape != posture.shape or not levels:
        problem = f"expected a posture and a direction of {robot.num_joints} joints, and a speed"
        raise InputError("reversal", "", problem)
    if any(not (np.isfinite(s) and s > 0.0 and np.isfinite(a)) for s, a in levels):
        raise InputError("reversal", name, "speeds must be positive, accelerations finite")
    omega = 2.0 * np.pi / period
    # Amplitudes of the two shapes at the end of each period; the motion starts and ends at rest.
    ends = np.array([(0.0, 0.0)] + [(s / omega, a / (8.0 * omega**2)) for s, a in levels])
    steps = np.vstack([np.repeat(ends, 2, axis=0)[1:], [[0.0, 0.0], [0.0, 0.0]]])
    steps = steps[: 2 * len(levels) + 2]
    count = len(steps) - 1
    t = np.arange(round(count * period / TIME_STEP) + 1) * TIME_STEP
    index = np.minimum((t / period).astype(int), count - 1)
    u = t / period - index
    fade = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    dfade = 30.0 * u**2 * (1.0 - u) ** 2 / period
    d2fade = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / period**2
    change = steps[index + 1] - steps[index]
    size = steps[index] + change * fade[:, None]
    rate, bend = change * dfade[:, None], change * d2fade[:, None]
    phase = omega * t
    shape = np.stack([np.sin(phase), np.cos(phase) - np.cos(3.0 * phase)], axis=1)
    dshape = omega * np.stack([np.cos(phase), 3.0 * np.sin(3.0 * phase) - np.sin(phase)], axis=1)
    d2shape = omega**2 * np.stack(
        [-np.sin(phase), 9.0 * np.cos(3.0 * phase) - np.cos(phase)], axis=1
    )
    p = (size * shape).sum(axis=1)
    dp = (rate * shape + size * dshape).sum(axis=1)
    d2p = (bend * shape + 2.0 * rate * dshape + size * d2shape).sum(axis=1)
    q, v, vdot = (np.asarray(np.outer(x, way), dtype=np.float64) for x in (p, dp, d2p))
    q += posture
    for values, low, high, what in (
        (q, robot.position_lower, robot.position_upper, "position"),
        (v, -robot.velocity_limit, robot.velocity_limit, "velocity"),
    ):
        beyond = (values.min(axis=0) < low) | (values.max(axis=0) > high)
        if beyond.any():
            j = int(np.argmax(beyond))
            raise InputError(
                "reversal",
                robot.joint_names[j],
                f"{what} {values[:, j].min():.3g} to {values[:, j].max():.3g}, the limits are "
                f"{low[j]:.3g} and {high[j]:.3g}",
                "choose a posture farther inside, lower speeds or a shorter period",
            )
    start = period * (2.0 * np.arange(len(levels)) + 1.0)
    first = np.stack([start, start + 0.5 * period], axis=1)
    return ReversalMotion(
        direction=way,
        trajectory=JointTrajectory(np.asarray(t, dtype=np.float64), q, v, vdot),
        crossings=np.vstack([first, first + 0.5 * period]),
        posture=posture,
        speed=np.tile([s for s, _ in levels], 2),
        acceleration=np.concatenate([[a for _, a in levels], [-a for _, a in levels]]),
    )


def separate(
    chain: SerialChain,
    t: Array,
    q: Array,
    v: Array,
    vdot: Array,
    tau: Array,
    joint: int,
    rest: float = 1e-3,
    settle: float = 0.0,
    spacing: float = 0.002,
) -> ReversalSamples:
    """Pairs passes of a joint in opposite directions at equal positions and separates friction.

    Args:
        chain: of the identified model; its gravity enters the asymmetric part only.
        t: (T,) s.
        q: (T, n) filtered, as all signals.
        v: (T, n).
        vdot: (T, n).
        tau: (T, n) N m, motor torque on the joint side.
        joint: index.
        rest: rad/s, below which the joint rests and belongs to no pass.
        settle: s, left out at both ends of a pass: there a low-pass mixes the friction of both
            directions. About one over its cutoff.
        spacing: rad, between the positions at which two passes are compared.

    Returns:
        The samples of all pairs; none where no two passes meet.
    """
    passes = _passes(t, v[:, joint], rest, settle)
    n = q.shape[1]
    signals = np.hstack([q, v, vdot, tau])
    rows: list[Array] = []
    for first, second in pairwise(passes):
        rows += _pair(signals, n, joint, first, second, spacing)
    if not rows:
        return ReversalSamples(joint, *(np.zeros(0) for _ in range(5)))
    both = np.stack(rows)  # (K, 2, 4 n): q, v, vdot, tau of the pass upwards, then downwards
    middle = both[:, :, :n].mean(axis=1)
    rigid = [
        chain.inverse_dynamics(
            middle, both[:, k, n : 2 * n].copy(), both[:, k, 2 * n : 3 * n].copy()
        )
        for k in range(2)
    ]
    left = np.stack([both[:, k, 3 * n + joint] - rigid[k][:, joint] for k in range(2)])
    speeds, bends = both[:, :, n + joint], both[:, :, 2 * n + joint]
    return ReversalSamples(
        joint=joint,
        position=middle[:, joint],
        speed=0.5 * (speeds[:, 0] - speeds[:, 1]),
        acceleration=0.5 * (bends[:, 0] - bends[:, 1]),
        symmetric=0.5 * (left[0] - left[1]),
        asymmetric=0.5 * (left[0] + left[1]),
    )


def _passes(t: Array, v: Array, rest: float, settle: float) -> list[slice]:
    """Stretches in which a joint moves one way, less `settle` at both ends."""
    direction = np.where(np.abs(v) > rest, np.sign(v), 0.0)
    edges = np.flatnonzero(np.diff(direction)) + 1
    bounds = [0, *edges.tolist(), len(v)]
    passes = []
    for a, b in pairwise(bounds):
        first = int(np.searchsorted(t, t[a] + settle, "left"))
        last = int(np.searchsorted(t, t[b - 1] - settle, "right"))
        if direction[a] != 0.0 and last - first >= LEAST_POINTS:
            passes.append(slice(first, last))
    return passes


def _pair(
    signals: Array, n: int, joint: int, first: slice, second: slice, spacing: float
) -> Sequence[Array]:
    """Rows (2, 4 n) of signals (T, 4 n), upwards first, wherever two opposite passes agree."""
    q, v = signals[:, :n], signals[:, n : 2 * n]
    if v[first, joint][0] * v[second, joint][0] > 0.0:
        return []
    up, down = (first, second) if v[first, joint][0] > 0.0 else (second, first)
    low = max(q[up, joint].min(), q[down, joint].min())
    high = min(q[up, joint].max(), q[down, joint].max())
    if high <= low:
        return []
    positions = np.linspace(low, high, max(2, int((high - low) / spacing) + 1))
    sides = []
    for part in (up, down):
        order = np.argsort(q[part, joint], kind="stable")
        where = q[part, joint][order]
        values = signals[part][order]
        sides.append(np.stack([np.interp(positions, where, column) for column in values.T], axis=1))
    both = np.stack(sides, axis=1)
    speeds = both[:, :, n + joint]
    alike = np.abs(speeds.sum(axis=1)) <= SPEEDS_ALIKE * np.abs(speeds).min(axis=1)
    apart = np.abs(both[:, 0, :n] - both[:, 1, :n]).max(axis=1)
    return list(both[alike & (apart <= OTHER_JOINTS)])
