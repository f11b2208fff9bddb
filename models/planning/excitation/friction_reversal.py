"""Friction from motor torque without a torque sensor, by reversal (Lu et al., eqs. 13-19).

Where an arm passes the same posture twice with opposite velocity, Coriolis torque and gravity are
equal (eq. 14) and friction is opposite as far as it is odd (eq. 15), so that

    tau_f = (tau_J1 - tau_J2) / 2 - M (vdot_1 - vdot_2) / 2

which is eq. 19 where the accelerations are opposite too (eq. 16): M vdot. Half the sum,

    (tau_J1 + tau_J2) / 2 - [Cv + G + M (vdot_1 + vdot_2) / 2],

is the part of friction that eq. 15 neglects (plus the error of the model's gravity).

`reversal_motion` plans such passes: q(t) = phi + (speed / w) sin(w t), w = 2 pi / T, passes phi
with any chosen speed, however small, and half a period later with the opposite one, both times
without acceleration.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.planning.motion.paths import JointTrajectory
from wrenchsight.models.rigid_body.serial_chain import SerialChain
from wrenchsight.models.robot.robot import Robot

TIME_STEP = 1e-3  # s, of the trajectory
LEAST_POINTS = 4  # samples of a pass
OTHER_JOINTS = 0.05  # rad, by which the others may differ between the two passes
SPEED_TOLERANCE = 0.2  # of the speed, by which the two passes may differ in it


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

    def friction(self) -> tuple[Array, Array]:
        """Velocities and friction torques (2 K,) of both directions."""
        v = np.concatenate([self.speed, -self.speed])
        return v, np.concatenate(
            [self.asymmetric + self.symmetric, self.asymmetric - self.symmetric]
        )


def reversal_motion(
    robot: Robot, direction: ArrayLike, posture: ArrayLike, speeds: ArrayLike, period: float = 2.0
) -> JointTrajectory:
    """Plans passes through a posture, both ways, at every speed; at rest at both ends.

    Joints that move together pass it with opposite velocities, so that the friction of each
    separates from one motion. Speed k (from 0 on) takes two periods: one in which the motion
    changes smoothly from what it was, and one that holds the passes at its start,
    (2 k + 1) period, its middle and its end.

    Args:
        robot: sets the limits.
        direction: (n,) share of the motion that each joint makes.
        posture: (n,) rad, where the passes meet.
        speeds: rad/s, positive, times direction.
        period: s.

    Raises:
        InputError: a posture or motion beyond the joint's limits, or a speed that is not positive.
    """
    posture, joint_shares = np.asarray(posture, np.float64), np.asarray(direction, np.float64)
    levels = np.atleast_1d(np.asarray(speeds, np.float64))
    if (
        posture.shape != (robot.num_joints,)
        or joint_shares.shape != posture.shape
        or not len(levels)
    ):
        problem = f"expected a posture and a direction of {robot.num_joints} joints, and a speed"
        raise InputError("reversal", "", problem)
    if not np.all(np.isfinite(levels) & (levels > 0.0)):
        name = ", ".join(robot.joint_names[j] for j in np.flatnonzero(joint_shares))
        raise InputError("reversal", name, "speeds must be positive")
    omega = 2.0 * np.pi / period
    # Amplitudes at the end of each period; the motion starts and ends at rest.
    ends = np.append(0.0, levels / omega)
    steps = np.append(np.repeat(ends, 2)[1:], 0.0)
    count = len(steps) - 1
    # p = size sin(omega t) and its derivatives. The size goes from step to step along a quintic
    # that starts and ends without velocity or acceleration; u is the share of the period that is
    # over.
    t = np.arange(round(count * period / TIME_STEP) + 1) * TIME_STEP
    index = np.minimum((t / period).astype(int), count - 1)
    u = t / period - index
    change = steps[index + 1] - steps[index]
    size = steps[index] + change * (u**3 * (10.0 - 15.0 * u + 6.0 * u**2))
    rate = change * (30.0 * u**2 * (1.0 - u) ** 2 / period)
    bend = change * (60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / period**2)
    s, c = np.sin(omega * t), omega * np.cos(omega * t)
    p, dp = size * s, rate * s + size * c
    d2p = bend * s + 2.0 * rate * c + size * (-(omega**2) * s)
    q = np.outer(p, joint_shares) + posture
    v, vdot = np.outer(dp, joint_shares), np.outer(d2p, joint_shares)
    for values, low, high, quantity in (
        (q, robot.position_lower, robot.position_upper, "position"),
        (v, -robot.velocity_limit, robot.velocity_limit, "velocity"),
    ):
        is_beyond = (values.min(axis=0) < low) | (values.max(axis=0) > high)
        if is_beyond.any():
            j = int(np.argmax(is_beyond))
            raise InputError(
                "reversal",
                robot.joint_names[j],
                f"{quantity} {values[:, j].min():.3g} to {values[:, j].max():.3g}, the limits are "
                f"{low[j]:.3g} and {high[j]:.3g}",
                "choose a posture farther inside, lower speeds or a shorter period",
            )
    return JointTrajectory(np.asarray(t, dtype=np.float64), q, v, vdot)


class FilteredMotion(NamedTuple):
    """A log of motion and torque, low-passed.

    Attributes:
        t: (T,) s.
        q, v, vdot: (T, n) rad, rad/s, rad/s^2.
        tau: (T, n) N m, motor torque on the joint side.
    """

    t: Array
    q: Array
    v: Array
    vdot: Array
    tau: Array


def separate(
    chain: SerialChain,
    motion: FilteredMotion,
    joint: int,
    rest_speed: float = 1e-3,
    settle: float = 0.0,
    spacing: float = 0.002,
) -> ReversalSamples:
    """Pairs passes of a joint in opposite directions at equal positions and separates friction.

    Args:
        chain: chain of the identified model; its gravity enters the asymmetric part only.
        motion: with passes of the joint in both directions.
        joint: index.
        rest_speed: rad/s, below which the joint rests and belongs to no pass.
        settle: s, left out at both ends of a pass: there a low-pass mixes the friction of both
            directions. About one over its cutoff.
        spacing: rad, between the positions at which two passes are compared.

    Returns:
        The samples of all pairs; none where no two passes meet.
    """
    passes = _passes(motion.t, motion.v[:, joint], rest_speed, settle)
    n = motion.q.shape[1]
    signals = np.hstack([motion.q, motion.v, motion.vdot, motion.tau])
    rows: list[Array] = []
    for first, second in pairwise(passes):
        rows += _pair(signals, n, joint, first, second, spacing)
    if not rows:
        return ReversalSamples(
            joint=joint,
            position=np.zeros(0),
            speed=np.zeros(0),
            acceleration=np.zeros(0),
            symmetric=np.zeros(0),
            asymmetric=np.zeros(0),
        )
    pairs = np.stack(rows)  # (K, 2, 4 n): q, v, vdot, tau of the pass upwards, then downwards
    middle = pairs[:, :, :n].mean(axis=1)
    rigid = [
        chain.inverse_dynamics(
            middle, pairs[:, k, n : 2 * n].copy(), pairs[:, k, 2 * n : 3 * n].copy()
        )
        for k in range(2)
    ]
    torque_left = np.stack([pairs[:, k, 3 * n + joint] - rigid[k][:, joint] for k in range(2)])
    speeds, accelerations = pairs[:, :, n + joint], pairs[:, :, 2 * n + joint]
    return ReversalSamples(
        joint=joint,
        position=middle[:, joint],
        speed=0.5 * (speeds[:, 0] - speeds[:, 1]),
        acceleration=0.5 * (accelerations[:, 0] - accelerations[:, 1]),
        symmetric=0.5 * (torque_left[0] - torque_left[1]),
        asymmetric=0.5 * (torque_left[0] + torque_left[1]),
    )


def _passes(t: Array, v: Array, rest_speed: float, settle: float) -> list[slice]:
    """Stretches in which a joint moves one way, less `settle` at both ends."""
    direction = np.where(np.abs(v) > rest_speed, np.sign(v), 0.0)
    edges = np.flatnonzero(np.diff(direction)) + 1
    bounds = [0, *edges.tolist(), len(v)]
    passes = []
    for a, b in pairwise(bounds):
        first = int(np.searchsorted(t, t[a] + settle, "left"))
        end = int(np.searchsorted(t, t[b - 1] - settle, "right"))
        if direction[a] != 0.0 and end - first >= LEAST_POINTS:
            passes.append(slice(first, end))
    return passes


def _pair(
    signals: Array, n: int, joint: int, first: slice, second: slice, spacing: float
) -> Sequence[Array]:
    """Rows (2, 4 n) of signals (T, 4 n), upwards first, where two opposite passes agree."""
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
        positions_of_part = q[part, joint][order]
        values = signals[part][order]
        sides.append(
            np.stack(
                [np.interp(positions, positions_of_part, column) for column in values.T], axis=1
            )
        )
    rows = np.stack(sides, axis=1)
    speeds = rows[:, :, n + joint]
    is_speed_equal = np.abs(speeds.sum(axis=1)) <= SPEED_TOLERANCE * np.abs(speeds).min(axis=1)
    joint_distance = np.abs(rows[:, 0, :n] - rows[:, 1, :n]).max(axis=1)
    return list(rows[is_speed_equal & (joint_distance <= OTHER_JOINTS)])
