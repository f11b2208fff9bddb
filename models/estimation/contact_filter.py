"""The force of a tool on a workpiece of known direction, from joint torque, by a Kalman filter.

How well a torque shows a force depends on the joint's motion. A joint at rest carries any friction
within its stiction, a joint that reverses is between two directions, and the error of a sliding one
grows with its speed. Such errors are correlated in time: they are states of the filter, beside the
wrench:

    y_k = H_k F_k + e_k + o + w_k

    y   torque from outside, mean over a block of samples
    F   wrench at the contact: force along the axis, positive where the tool presses; two forces
        across it; three moments. H: its joint torque, per newton and newton metre
    e   error of each joint's torque, a first-order Gauss-Markov process of time constant
        `error_time`, whose sd is the one that the model states for the joint's motion
    o   constant offset of each joint: gravity, and friction that differs between directions
    w   error within the block: vibration

o is considered, not estimated (Schmidt, in Advances in Control Systems 3, 1966): a joint at rest
does not show it, and errors elsewhere would corrupt it. Where the sd of e falls by a factor, e
falls with it: a joint that slides no longer carries the friction of its rest.

The force along the axis is a random walk. Across it a tool that slides carries little. One that
stands carries friction, in proportion to the force along the axis (`held_across`). The wrench of a
block is read `lag` later, when the torque of the next blocks is known too. The wrenches of that
time are further states of the filter.

Where the rigid body's torque changes from block to block, w grows by a share of that change, and
fades (`drive_error`). The drive's current and the joint's speed are not of one instant, and the arm
rings afterwards. At the corners of a path this is most of the error.

A block is blind where its torque determines the force hardly better than its prior does
(`blind_share`). In force control the force may then change faster than the random walk. For
`misfit_time` after a blind block no reading is explained.

Two misfits of the recent innovations z are judged. They are the means over `misfit_time` of

    z^T S^-1 z / n    and    (h^T S^-1 z)^2 / (h^T S^-1 h),    h = H_1

Both are 1 in the mean where the errors are as stated. The stated covariance is that of the filter
times the first one, or times 1 where it is less. The second one, along the force, is large where
the force changes faster than the random walk. It is also large where the joints move otherwise than
the log states. Above `largest_misfit` the reading is not explained.

The filter smooths a force that bounces within tenths of a second: the reading misses a part of it.
The innovations along the force show by how much the force differs from its prediction,

    d = h^T S^-1 z / (h^T S^-1 h + 1 / force_sd^2)    N

The band adds `innovation_share` times their RMS over `innovation_time`. So it holds for the mean of
the force over one block, not only for the slow part of the force.

The model states a joint's whole stiction band as its sd at rest. `contact_reading` subtracts the
expected share of that friction, and the force across has its own states. So the stated sd at rest
is multiplied by `rest_share`.

`innovation_share` and `innovation_time` were settled on the half of the runs of experiment
`ur10e-contact` that its `settled_on` lists: by the likelihood of the sensor's force, block by
block, from the touch to the lift. `rest_share` was lowered on them only so far that no further hold
left its band: an error at rest lasts as long as the hold, so that 43 holds are 43 observations.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.numerics.arrays import Array

TOOL_AXES = ("tool_x", "tool_y", "tool_z")
WRENCH_SIZE = 6  # [along, across, across, moments about the axes]
_ALONG, _ACROSS, _MOMENTS = 0, slice(1, 3), slice(3, 6)
_HIGHEST_MISFIT = 50.0  # so that one impact does not hide the next second
_LEAST_LENGTH = 1e-6  # norm of an axis given by numbers
_LEAST_VARIANCE = 1e-12  # (N m)^2, of a joint without error, for a division
_LEAST_INFORMATION = 1e-12  # 1/N^2, of a force that no joint feels, for a division
_WHITE_SHARE = 0.1  # of a joint's stated sd: error within a block, beside vibration and drive


@dataclass
class ContactConfig:
    """Configuration of a contact of known direction: prior of its wrench, errors of the torque."""

    axis: str = ""
    """Direction in which the tool presses: tool_x, tool_y or tool_z of E, with a minus sign for the
    opposite one, or three numbers in axes of W ("0,0,-1"); empty: not known."""
    point: list[float] = field(default_factory=list)
    """Where the tool touches, m in axes of E; empty: at E."""
    force_rate: float = 18.0
    """N/sqrt(s), of the random walk of the force along the axis"""
    across_sd: float = 2.5
    """N, across the axis, of a tool that moves along the workpiece"""
    across_time: float = 0.1
    """s"""
    standing_across_sd: float = 4.0
    """N, of a tool that stands"""
    held_across: float = 0.15
    """sd across, of a tool that stands, per newton along the axis"""
    standing_across_time: float = 0.3
    """s"""
    standing_speed: float = 0.005
    """m/s, below which it stands"""
    moment_sd: float = 1.0
    """N m about the contact: a tool touches anywhere along its width"""
    error_time: float = 0.1
    """s, over which the error of a joint's torque lasts"""
    rest_speed: float = 0.002
    """rad/s, below which a joint rests"""
    offset_sd: float = 1.5
    """N m, of a joint's constant error"""
    vibration: float = 0.5
    """sd of a block's mean, as a share of the sd within it"""
    vibration_time: float = 0.1
    """s, over which a large one is remembered"""
    drive_error: float = 0.3
    """sd of a block's mean, as a share of the rigid torque's change"""
    drive_time: float = 0.1
    """s, over which a large one is remembered"""
    block: float = 0.02
    """s, over which torque is averaged"""
    lag: float = 0.06
    """s after which a block is read"""
    rest_share: float = 0.75
    """of the stated sd that is left where no joint moves"""
    innovation_share: float = 0.9
    """Sd of what a reading misses of a force that bounces, as a share of the recent innovations."""
    innovation_time: float = 0.1
    """s, over which the RMS of innovations is taken"""
    misfit_time: float = 0.3
    """s, over which innovations are judged"""
    largest_misfit: float = 2.0
    """along the force, above which a reading is not valid"""
    blind_share: float = 0.25
    """of the prior's force sd: a block with a larger one is blind"""
    gap: float = 0.05
    """s without a block that is known and not blind, after which the prior holds"""


class ContactFrame(NamedTuple):
    """Axes of the contact.

    Attributes:
        R: (3, 3) columns: the direction in which the tool presses, and two across it.
        is_tool_frame: whether R is given in axes of E; else in axes of W.
        point: (3,) m, the contact in axes of E.
    """

    R: Array
    is_tool_frame: bool
    point: Array

    @classmethod
    def of(cls, config: ContactConfig) -> "ContactFrame":
        """The frame that the configuration states: x along the contact's axis, y and z across it.

        A tool axis (`tool_z`, `-tool_x` ...) gives a frame fixed to E, three numbers one fixed to
        W. With a minus sign x alone is turned round: R is then a reflection, as what lies across
        has no sign. The force is along x; the point is in axes of E, m.

        Raises:
            InputError: an axis that is no direction, or a point that is not three numbers.
        """
        point = np.array(config.point or [0.0, 0.0, 0.0], float)
        if point.shape != (3,) or not np.isfinite(point).all():
            stated = ",".join(f"{x:g}" for x in config.point)
            problem = f"is {stated}, expected three numbers"
            raise InputError("estimate", "--contact-point", problem, "give m in axes of E: 0,0,0.1")
        name = config.axis.removeprefix("-")
        if name in TOOL_AXES:
            # Columns: the axes of E, from the named one on.
            R = np.roll(np.eye(3), -TOOL_AXES.index(name), axis=1)
            R[:, 0] *= -1.0 if config.axis.startswith("-") else 1.0
            return cls(R, is_tool_frame=True, point=point)
        try:
            axis = np.array([float(x) for x in config.axis.split(",")])
        except ValueError:
            axis = np.zeros(0)  # refused below
        length = float(np.linalg.norm(axis)) if axis.shape == (3,) else 0.0
        if not (np.isfinite(length) and length > _LEAST_LENGTH):
            problem = f'is "{config.axis}", expected {", ".join(TOOL_AXES)} or three numbers'
            remedy = "give the direction in which the tool presses, such as tool_z or 0,0,-1"
            raise InputError("estimate", "--contact-axis", problem, remedy)
        axis = axis / length
        most_across = np.eye(3)[np.argmin(np.abs(axis))]
        across = most_across - axis * float(axis @ most_across)
        across = across / np.linalg.norm(across)
        R = np.stack([axis, across, np.cross(axis, across)], axis=1)
        return cls(R, is_tool_frame=False, point=point)

    def wrench_map(self, R_WE: Array) -> Array:
        """Returns the map (N, 6, 6) from F to F_E_W.

        Column by column it is the wrench F_E_W, rotation first, of a unit of each component of F.

        Args:
            R_WE: (N, 3, 3).
        """
        R_WC = R_WE @ self.R if self.is_tool_frame else np.broadcast_to(self.R, R_WE.shape)
        force = R_WC * np.array([-1.0, 1.0, 1.0])  # the workpiece pushes against the tool
        lever = np.einsum("kij,j->ki", R_WE, self.point)
        moment = np.cross(lever[:, :, None], force, axis=1)
        moments = np.concatenate([moment, R_WC], axis=2)
        forces = np.concatenate([force, np.zeros_like(R_WC)], axis=2)
        return np.concatenate([moments, forces], axis=1)


class Block(NamedTuple):
    """A block of samples of an arm with n joints, as the filter takes it.

    Attributes:
        tau_ext: (n,) N m, external torque, mean.
        H: (n, 6) joint torque per unit of F, N m per N and per N m.
        sd: (n,) N m, of the torque's error.
        tool_speed: m/s.
        spread: (n,) N m, sd of tau_ext within the block.
        is_known: whether the motion is known all through the block.
        rigid: (n,) N m, torque of the rigid body, mean.
        is_resting: whether no joint moves all through the block.
    """

    tau_ext: Array
    H: Array
    sd: Array
    tool_speed: float
    spread: Array
    is_known: bool
    rigid: Array
    is_resting: bool = False


class BlockReading(NamedTuple):
    """The wrench of one block.

    Attributes:
        F: (6,) wrench at the contact, N and N m, force first, in axes of the contact.
        covariance: (6, 6) of F.
        is_explained: whether recent innovations along the force agree with the filter, and no
            recent block was blind.
    """

    F: Array
    covariance: Array
    is_explained: bool


class ContactFilter:
    """Kalman filter of the state x = [F, e, o, past F], of which o is only considered.

    Args:
        config: configuration of the contact.
        force_sd: N, prior of the force along the axis.
        num_joints: n.
        period: s between blocks.
    """

    def __init__(
        self, config: ContactConfig, force_sd: float, num_joints: int, period: float
    ) -> None:
        """Starts the state at zero with the prior's covariance.

        Args:
            config: of the contact.
            force_sd: N, prior of the force along the axis.
            num_joints: n.
            period: s of a block; the configuration's `lag` is rounded to whole ones.
        """
        # Order of the state: F (force along the axis, two across, three moments), errors e (n),
        # offsets o (n), and F of the last `lag` blocks, the newest first.
        n, self._n = num_joints, num_joints
        self._config, self._force_sd, self._period = config, force_sd, period
        self.lag = round(config.lag / period)  # blocks
        self._errors = slice(WRENCH_SIZE, WRENCH_SIZE + n)
        self._offsets = slice(WRENCH_SIZE + n, WRENCH_SIZE + 2 * n)
        across_sd, moments_sd = [config.standing_across_sd] * 2, [config.moment_sd] * 3
        wrench_sd = [force_sd, *across_sd, *moments_sd]
        # Errors begin with the first block.
        errors_sd, offsets_sd = [0.0] * n, [config.offset_sd] * n
        past_sd = wrench_sd * self.lag  # the list, so many times
        sd = [*wrench_sd, *errors_sd, *offsets_sd, *past_sd]
        # Where each entry of the next block's state comes from: F also becomes the newest past F,
        # past ones move on by one, and the oldest is dropped.
        self._order = np.arange(len(sd))
        if self.lag:
            first = self._offsets.stop
            self._order[first:] = np.r_[0:WRENCH_SIZE, first : len(sd) - WRENCH_SIZE]
        self._x: Array = np.zeros(len(sd))
        self._P: Array = np.diag(np.square(sd))
        self._error_variance: Array | None = None  # (n,) (N m)^2, of e at the last block
        self._vibration = np.zeros(n)  # N m
        self._drive_error = np.zeros(n)  # N m
        self._rigid: Array | None = None  # (n,) N m, of the last block
        # Mean squares of innovations over what the filter expects, of all joints and along the
        # force; 1: as expected.
        self._misfit, self._force_misfit = 1.0, 1.0
        self._innovation_variance = 0.0  # N^2, along the force
        self._resting_blocks = 0  # blocks since a joint moved
        self._unknown_time = 0.0  # s since a block that was known and not blind
        self._visible_time = np.inf  # s since a blind block

    def read(self, blocks_ago: int) -> BlockReading:
        """Returns the wrench of an earlier block.

        Args:
            blocks_ago: 0 to `lag`.
        """
        first = 0 if blocks_ago == 0 else self._offsets.stop + WRENCH_SIZE * (blocks_ago - 1)
        columns = slice(first, first + WRENCH_SIZE)
        config = self._config
        is_resting = self._resting_blocks > blocks_ago
        scale = max(self._misfit, 1.0)
        if is_resting:
            scale *= config.rest_share**2
        covariance = self._P[columns, columns] * scale
        covariance[_ALONG, _ALONG] += config.innovation_share**2 * self._innovation_variance
        is_visible = self._visible_time >= config.misfit_time
        is_explained = is_visible and self._force_misfit <= config.largest_misfit
        return BlockReading(self._x[columns].copy(), covariance, is_explained)

    def take(self, block: Block) -> None:
        """Takes the next block."""
        self._resting_blocks = self._resting_blocks + 1 if block.is_resting else 0
        self._predict(block)
        is_blind = block.is_known and not self._update(block)
        self._rigid = block.rigid if block.is_known else None
        self._visible_time = 0.0 if is_blind else self._visible_time + self._period
        if block.is_known and not is_blind:
            self._unknown_time = 0.0
            return
        config = self._config
        was_gap = self._unknown_time > config.gap
        self._unknown_time += self._period
        if self._unknown_time > config.gap and not was_gap:
            self._P[_ALONG, _ALONG] += self._force_sd**2

    def _predict(self, block: Block) -> None:
        """Moves the state on by one block.

        Each component is a first-order process with a decay d and a stationary variance v, but for
        the force along the axis, a random walk:

            x <- d x,    P <- (d d^T) P + diag((1 - d^2) v),    (d d^T) P entry by entry

        The wrench before becomes the newest of the past ones, which stay as they are. The state is
        [F: force along the axis, two across, three moments; errors e (n); offsets o (n); past F].

        Args:
            block: of its speed and the sd of its torque the decays follow; its torque is not read.
        """
        config, T = self._config, self._period
        decay, variance = np.ones(len(self._x)), np.zeros(len(self._x))
        # Force across and moments. A tool that stands is held by friction.
        if block.tool_speed < config.standing_speed:
            across_time = config.standing_across_time
            friction_sd = config.held_across * max(float(self._x[_ALONG]), 0.0)
            across_sd = float(np.hypot(config.standing_across_sd, friction_sd))
        else:
            across_time, across_sd = config.across_time, config.across_sd
        decay[1:WRENCH_SIZE] = np.exp(-T / across_time)
        variance[_ACROSS] = across_sd**2
        variance[_MOMENTS] = config.moment_sd**2
        # Errors of the torque. One whose sd falls shrinks with it; the first ones are drawn anew.
        error_variance = block.sd**2
        if self._error_variance is None:
            decay[self._errors] = 0.0
        else:
            ratio = error_variance / np.maximum(self._error_variance, _LEAST_VARIANCE)
            shrinking = np.sqrt(np.minimum(1.0, ratio))
            decay[self._errors] = np.exp(-T / config.error_time) * shrinking
        variance[self._errors] = error_variance
        self._error_variance = error_variance
        # Offsets and past wrenches keep a decay of one, and gain no noise.
        noise = (1.0 - decay**2) * variance
        noise[_ALONG] = config.force_rate**2 * T
        # Past wrenches move on by one place; then everything decays, they by one.
        order = self._order
        self._x = self._x[order] * decay
        self._P = self._P[np.ix_(order, order)] * (decay[:, None] * decay)
        self._P[np.diag_indices_from(self._P)] += noise

    def _update(self, block: Block) -> bool:
        """Takes the torque of a block; returns whether it shows the force, see `blind_share`."""
        n = self._n
        R = self._noise(block)
        H = np.hstack([block.H, np.eye(n), np.eye(n), np.zeros((n, WRENCH_SIZE * self.lag))])
        innovation = block.tau_ext - H @ self._x
        S = H @ self._P @ H.T + np.diag(R)
        solved = np.linalg.solve(S, np.column_stack([H @ self._P, innovation, H[:, _ALONG]]))
        gain, weighted_innovation, weighted_force = solved[:, :-2].T, solved[:, -2], solved[:, -1]
        misfit = float(innovation @ weighted_innovation) / n
        information = float(H[:, _ALONG] @ weighted_force)  # zero where no joint feels the force
        along_force = float(H[:, _ALONG] @ weighted_innovation)
        self._take_misfits(misfit, along_force**2 / max(information, _LEAST_INFORMATION))
        self._take_innovation(along_force / (information + 1.0 / self._force_sd**2))
        gain[self._offsets] = 0.0
        self._x = self._x + gain @ innovation
        A = np.eye(len(self._x)) - gain @ H
        self._P = A @ self._P @ A.T + (gain * R) @ gain.T
        least_information = 1.0 / (self._config.blind_share * self._force_sd) ** 2
        return bool(np.sum(block.H[:, _ALONG] ** 2 / R) >= least_information)

    def _noise(self, block: Block) -> Array:
        """(n,) N^2 m^2, variance of the error w within a block; its memory is moved on."""
        config, T = self._config, self._period
        self._vibration = np.maximum(
            config.vibration * block.spread, self._vibration * np.exp(-T / config.vibration_time)
        )
        change = 0.0 if self._rigid is None else np.abs(block.rigid - self._rigid)
        self._drive_error = np.maximum(
            config.drive_error * change, self._drive_error * np.exp(-T / config.drive_time)
        )
        white = _WHITE_SHARE * block.sd
        return np.asarray(self._vibration**2 + self._drive_error**2 + white**2)

    def _take_misfits(self, misfit: float, force_misfit: float) -> None:
        """Takes the misfits of one block into their means over `misfit_time`."""
        pole = np.exp(-self._period / self._config.misfit_time)
        self._misfit = pole * self._misfit + (1.0 - pole) * min(misfit, _HIGHEST_MISFIT)
        self._force_misfit *= pole
        self._force_misfit += (1.0 - pole) * min(force_misfit, _HIGHEST_MISFIT)

    def _take_innovation(self, along_force: float) -> None:
        """Takes the innovation of one block along the force, N, into the mean of their squares."""
        pole = np.exp(-self._period / self._config.innovation_time)
        square = min(abs(along_force), self._force_sd) ** 2
        self._innovation_variance = pole * self._innovation_variance + (1.0 - pole) * square
