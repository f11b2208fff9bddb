"""The force of a tool that presses on a workpiece, from joint torque, by a Kalman filter.

How well a torque shows a force depends on the joint's motion. A joint at rest carries any friction
within its stiction, a joint that reverses is between two directions, and the error of a sliding one
is a share of its sliding friction; and such errors last. So they are states of the filter, beside
the wrench:

    y_k = H_k F_k + e_k + o + s f_k + w_k

    y   torque from outside, mean over a block of samples (`models.contact.torque_blocks`)
    F   wrench in axes of the tool: force along it, positive where the tool presses; two forces
        across it; three moments. H: its joint torque, per newton and newton metre
    e   error of each joint's friction, a first-order Gauss-Markov process, of the sd and the
        time constant of the joint's state; it starts afresh where the joint starts or stops
    o   constant offset of each joint: gravity, friction that differs between directions
    s   share by which all sliding friction f is larger or smaller: temperature
    w   error within the block: vibration, and a motion that is not known exactly

o and s are considered, not estimated (Schmidt, in Advances in Control Systems 3, 1966): a joint at
rest says nothing about them, and errors elsewhere would corrupt them.

The force along the tool wanders, and now and then changes at once: a contact. That is decided
block by block from the likelihood of both. Across the tool a roller that rolls carries little;
one that stands is held by friction. At rest a part of the sliding friction is expected to remain
with the sign of the last motion.

The force of a block is read `lag` later, when the torque of the blocks after it is known too: the
filter carries the forces of that time along as states. The other components are read at once.

The stated sd is that of the filter, larger where the recent innovations were larger than they
should be (their normalised square above 1). A reading whose 95 % band holds zero says nothing
about the contact: it is not valid.

Assumed: joints err independently but for s; errors are Gaussian; a standing joint's friction is
normal with `rest` of its sliding level as sd (uniform between the two directions would be 0.58).
"""

from dataclasses import dataclass, field

import numpy as np

from wrenchsight.models.arrays import Array, Flags

SIGMA_95 = 1.959963984540054
_NORMAL, _ACROSS, _MOMENTS, _WRENCH = 0, slice(1, 3), slice(3, 6), 6
_HIGHEST_MISFIT = 50.0  # so that one impact does not hide the next second


@dataclass
class FrictionErrorConfig:
    """How the friction of a joint errs; shares are of its sliding level (N m)."""

    sliding: float = 0.15  # share, sd while the joint slides
    sliding_time: float = 0.1  # s, over which that error lasts
    reversal: float = 0.4  # share, sd between two directions
    slow: float = 0.6  # share, sd near standstill
    slow_speed: float = 0.01  # rad/s, of "near"
    carried: float = 0.1  # share of a sliding friction that was not found on this robot
    rest: float = 0.42  # share, sd at rest
    rest_time: float = 1.0  # s
    rest_speed: float = 0.002  # rad/s, below which a joint rests
    kept: float = 0.25  # share of the sliding friction that stays at rest, on the side of before
    common: float = 0.2  # share by which friction of all joints is larger or smaller
    offset: float = 1.5  # N m, of a joint whose friction was found on this robot; gravity too
    carried_offset: float = 0.25  # N m, of the others


@dataclass
class ContactForceConfig:
    """What is known of the contact beforehand, and how the torque errs."""

    normal_sd: float = 61.0  # N, before anything is known, and after a jump
    normal_rate: float = 18.0  # N/sqrt(s), how fast the force wanders
    jump_rate: float = 0.1  # 1/s, how often it changes at once
    across_sd: float = 2.5  # N, of a tool that moves along the workpiece
    across_time: float = 0.1  # s
    standing_across_sd: float = 8.0  # N, of a tool that stands
    standing_across_time: float = 1.0  # s
    standing_speed: float = 0.005  # m/s, below which it stands
    moment_sd: float = 1.4  # N m about the contact: a roller touches anywhere along its width
    white: float = 0.4  # N m, of a block
    spread: float = 0.5  # sd of a block's mean, as a share of the sd within it
    inertial: float = 0.2  # share of the inertial torque
    inertial_time: float = 0.1  # s, over which a large one is remembered
    lag: float = 0.06  # s after which the force of a block is read
    misfit_time: float = 0.3  # s, over which innovations are judged
    gap: float = 0.05  # s without a known motion, after which the force may be any
    friction: FrictionErrorConfig = field(default_factory=FrictionErrorConfig)


@dataclass(frozen=True, eq=False)
class TorqueBlocks:
    """Signals of an arm with n joints, means over N successive blocks of samples.

    Attributes:
        t: (N,) s.
        tau_ext: (N, n) N m, torque from outside by the model and its friction.
        H: (N, n, 6) joint torque per newton along and across the tool and per newton metre.
        v: (N, n) rad/s.
        tool_speed: (N,) m/s.
        level: (N, n) N m, sliding friction without its viscous part.
        slip: (N, n) -1 to 1, side that the friction is on.
        friction: (N, n) N m, as taken off tau_ext.
        inertial: (N, n) N m, largest inertial torque of the block.
        spread: (N, n) N m, sd of tau_ext within the block.
        known: (N,) whether the motion is known all through the block.
        period: s between blocks.
    """

    t: Array
    tau_ext: Array
    H: Array
    v: Array
    tool_speed: Array
    level: Array
    slip: Array
    friction: Array
    inertial: Array
    spread: Array
    known: Flags
    period: float


@dataclass(frozen=True, eq=False)
class ContactForce:
    """Readings of each of N blocks.

    Attributes:
        t: (N,) s.
        normal: (N,) N along the tool, positive where it presses.
        normal_sd: (N,) N.
        wrench: (N, 6) N and N m, as `TorqueBlocks.H`: along the tool, across it, moments; read
            right after the block.
        friction_error: (N, n) N m, what the filter holds for the error of each joint's friction.
        jump: (N,) where the force was found to change at once.
    """

    t: Array
    normal: Array
    normal_sd: Array
    wrench: Array
    friction_error: Array
    jump: Flags

    @property
    def valid(self) -> Flags:
        """(N,) whether the 95 % band of the force along the tool leaves out zero."""
        return np.asarray(np.abs(self.normal) > SIGMA_95 * self.normal_sd)


def read_contact_force(
    blocks: TorqueBlocks, config: ContactForceConfig | None = None, found: Flags | None = None
) -> ContactForce:
    """Reads a log from its first block to its last; each block when `config.lag` has passed.

    Args:
        blocks: of the log.
        config: what is known beforehand.
        found: (n,) joints whose friction was found on this very robot; None for all.
    """
    config = config if config is not None else ContactForceConfig()
    n = blocks.v.shape[1]
    found = np.ones(n, bool) if found is None else np.asarray(found, bool)
    filtered = _Filter(config, n, found, blocks.period)
    N, lag = len(blocks.t), filtered.lag
    wrench, error, jump = np.empty((N, _WRENCH)), np.empty((N, n)), np.zeros(N, bool)
    normal, sd = np.empty(N), np.empty(N)
    for k in range(N):
        filtered.predict(blocks, k)
        if blocks.known[k]:
            jump[k] = filtered.update(blocks, k)
        else:
            filtered.skip()
        wrench[k], error[k] = filtered.x[:_WRENCH], filtered.x[_WRENCH : _WRENCH + n]
        # The last block of a log gives all that are still waiting.
        for past in range(lag if k + 1 < N else 0, min(lag, k) + 1):
            normal[k - past], sd[k - past] = filtered.normal(past)
    return ContactForce(blocks.t, normal, sd, wrench, error, jump)


class _Filter:
    """State x = [F, e, o, s, past forces] and its covariance P; o and s are considered only."""

    def __init__(self, config: ContactForceConfig, n: int, found: Flags, period: float) -> None:
        self._config, self._n, self._period = config, n, period
        own = config.friction
        self._carried = np.where(found, 0.0, own.carried)
        offset = np.where(found, own.offset, own.carried_offset)
        self._errors = slice(_WRENCH, _WRENCH + n)
        self._considered = slice(_WRENCH + n, _WRENCH + 2 * n + 1)
        self.lag = round(config.lag / period)
        across, moments = [config.standing_across_sd] * 2, [config.moment_sd] * 3
        past = [config.normal_sd] * self.lag
        sd = [config.normal_sd, *across, *moments, *np.zeros(n), *offset, own.common, *past]
        self.x: Array = np.zeros(len(sd))
        self._P: Array = np.diag(np.square(sd))
        self._resting: Flags | None = None  # of the last block
        self._transient = np.zeros(n)  # N m, of large inertial torques just past
        self._misfit = 1.0
        self._unknown = 0.0  # s since the motion was known

    def normal(self, past: int) -> tuple[float, float]:
        """Force along the tool that many blocks ago and its stated sd, N."""
        i = _NORMAL if past == 0 else self._considered.stop + past - 1
        return float(self.x[i]), float(np.sqrt(self._P[i, i] * max(self._misfit, 1.0)))

    def predict(self, blocks: TorqueBlocks, k: int) -> None:
        """Takes x and P to block k."""
        config, own, T = self._config, self._config.friction, self._period
        speed, level = np.abs(blocks.v[k]), blocks.level[k]
        resting = speed < own.rest_speed
        stands = blocks.tool_speed[k] < config.standing_speed
        time = np.where(resting, own.rest_time, own.sliding_time)
        decay = np.ones(len(self.x))
        decay[_ACROSS] = np.exp(
            -T / (config.standing_across_time if stands else config.across_time)
        )
        decay[_MOMENTS] = decay[1]
        decay[self._errors] = np.exp(-T / time)
        variance = np.zeros(len(self.x))
        variance[_ACROSS] = (config.standing_across_sd if stands else config.across_sd) ** 2
        variance[_MOMENTS] = config.moment_sd**2
        sliding = (
            (own.sliding * level) ** 2
            + (self._carried * blocks.friction[k]) ** 2
            + (1.0 - blocks.slip[k] ** 2) * (own.reversal * level) ** 2
            + (own.slow * level) ** 2 * np.exp(-((speed / own.slow_speed) ** 2))
        )
        errors = np.where(resting, (own.rest * level) ** 2, sliding)
        variance[self._errors] = errors
        self._remember()
        self.x *= decay
        self._P *= decay[:, None] * decay
        noise = (1.0 - decay**2) * variance
        noise[_NORMAL] = config.normal_rate**2 * T
        self._P[np.diag_indices_from(self._P)] += noise
        fresh = np.ones(self._n, bool) if self._resting is None else resting != self._resting
        for j in np.flatnonzero(fresh):
            i = _WRENCH + j
            self.x[i] = 0.0
            self._P[i, :] = self._P[:, i] = 0.0
            self._P[i, i] = errors[j]
        self._resting = resting

    def _remember(self) -> None:
        """Shifts the past forces by one block."""
        first = self._considered.stop
        order = np.arange(len(self.x))
        order[first:] = np.array([_NORMAL, *order[first:]])[: self.lag]
        self.x = self.x[order]
        self._P = self._P[np.ix_(order, order)]

    def update(self, blocks: TorqueBlocks, k: int) -> bool:
        """Takes the torque of block k in; returns whether the force was found to jump."""
        config, own, T, n = self._config, self._config.friction, self._period, self._n
        assert self._resting is not None
        y = blocks.tau_ext[k] - np.where(
            self._resting, (1.0 - own.kept) * blocks.level[k] * blocks.slip[k], 0.0
        )
        self._transient = np.maximum(
            config.inertial * blocks.inertial[k],
            self._transient * np.exp(-T / config.inertial_time),
        )
        R = config.white**2 + self._transient**2 + (config.spread * blocks.spread[k]) ** 2
        f = np.where(self._resting, 0.0, blocks.friction[k])
        H = np.hstack([blocks.H[k], np.eye(n), np.eye(n), f[:, None], np.zeros((n, self.lag))])
        innovation = y - H @ self.x
        S = H @ self._P @ H.T + np.diag(R)
        after_gap = self._unknown > config.gap
        jumps = not after_gap and self._has_jumped(H[:, _NORMAL], S, innovation)
        if jumps:
            S = S + config.normal_sd**2 * np.outer(H[:, _NORMAL], H[:, _NORMAL])
            self._P[_NORMAL, _NORMAL] += config.normal_sd**2
        gain = np.linalg.solve(S, H @ self._P).T
        misfit = float(innovation @ np.linalg.solve(S, innovation)) / n
        share = np.exp(-T / config.misfit_time)
        self._misfit = share * self._misfit + (1.0 - share) * min(misfit, _HIGHEST_MISFIT)
        gain[self._considered] = 0.0
        self.x += gain @ innovation
        A = np.eye(len(self.x)) - gain @ H
        self._P = A @ self._P @ A.T + (gain * R) @ gain.T
        self._unknown = 0.0
        return jumps

    def skip(self) -> None:
        """Passes a block without a known motion; after a gap of them the force is unknown."""
        is_gap = self._unknown > self._config.gap
        self._unknown += self._period
        if self._unknown > self._config.gap and not is_gap:
            self._P[_NORMAL, _NORMAL] += self._config.normal_sd**2

    def _has_jumped(self, h: Array, S: Array, innovation: Array) -> bool:
        """Whether the innovation is likelier with a jump of the force, weighed by its rate."""
        config = self._config
        Sh = np.linalg.solve(S, h)
        more = config.normal_sd**2 * float(h @ Sh)
        gained = 0.5 * (
            config.normal_sd**2 * float(Sh @ innovation) ** 2 / (1.0 + more) - np.log1p(more)
        )
        return bool(gained + np.log(config.jump_rate * self._period) > 0.0)
