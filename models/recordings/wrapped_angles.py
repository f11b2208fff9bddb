"""Angles that jump by a turn where they leave a range of one turn are continued beyond it."""

from dataclasses import replace

import numpy as np

from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.recording_checks import LIMIT_MARGIN
from wrenchsight.models.robot.robot import Robot

_FULL_TURN = 2.0 * np.pi
_TURN_TOLERANCE = 0.5 * np.pi  # rad, by which a jump may differ from a turn where no limit is known
_JUMP_MARGIN = 0.1  # rad beyond what twice the velocity limit allows
_LARGEST_ANGLE = 1e3  # rad, 160 turns: beyond are counts of an encoder, which no turn wraps
_MAX_SPEED = 20.0  # rad/s, where the robot states a higher limit or none


class Unwrapper:
    """Continues the angles of successive chunks.

    A jump between two samples counts as a turn where it differs from one by no more than the joint
    can move in between. Where a log counts its angles from 0 to 360 deg, a joint that it begins
    beyond its upper limit has a turn less, if that is within its limits. Joints that slide are left
    as they are.

    Args:
        robot: its limits; None: not known.
        is_stated: whether the user says that the angles are wrapped: every jump of more than half
            a turn is then one.

    Attributes:
        turns: (n,) jumps found so far; None before the first chunk.
        has_turn_less: (n,) whether a turn is taken off from the first sample on; None likewise.
    """

    def __init__(self, robot: Robot | None, is_stated: bool = False) -> None:
        self._robot = robot
        self._is_stated = is_stated
        self._last: tuple[float, Array] | None = None  # time and raw angles of the last sample
        self._offset: Array | None = None
        self.turns: Array | None = None
        self.has_turn_less: Flags | None = None

    def unwrapped(self, chunk: Recording) -> Recording:
        """The next chunk with continuous angles: whole turns are added from each wrap on.

        A sample without a position (NaN) ends a stretch: what jumps over it is no wrap. A chunk
        that holds one, or counts in place of angles, keeps the turns found so far, and is not
        looked at.
        """
        n = chunk.num_joints
        if not n or not chunk.num_samples:
            return chunk
        if self._offset is None or self.turns is None:
            self.has_turn_less = self._begins_a_turn_above(chunk.q)
            self._offset = np.where(self.has_turn_less, -_FULL_TURN, 0.0)
            self.turns = np.zeros(n, np.int64)
        # `_last` and jumps are of the raw angles; `_offset` is what a sample gains, rad.
        is_counted = not self._is_stated and np.abs(chunk.q).max() > _LARGEST_ANGLE
        if (
            is_counted or not np.isfinite(chunk.q).all()
        ):  # samples that lack a position end a stretch
            self._last = None
            return replace(chunk, q=chunk.q + self._offset) if self._offset.any() else chunk
        t, q = chunk.t, chunk.q
        if self._last is not None:
            t, q = np.append(self._last[0], t), np.vstack([self._last[1], q])
        jump = np.diff(q, axis=0)
        turns = np.rint(jump / _FULL_TURN)
        is_wrap = (np.abs(jump) > np.pi) & (
            np.abs(jump - _FULL_TURN * turns) <= self._reach(np.diff(t))
        )
        if self._robot is not None:
            is_wrap &= ~np.asarray(self._robot.chain.prismatic, bool)
        turns = np.where(is_wrap, turns, 0.0)
        offset = self._offset - _FULL_TURN * np.cumsum(turns, axis=0)  # rad, of each sample
        if self._last is None:  # no jump leads to the first sample
            offset = np.vstack([self._offset, offset])
        self._last = float(chunk.t[-1]), chunk.q[-1]
        self._offset = offset[-1]
        self.turns = self.turns + is_wrap.sum(axis=0)
        return replace(chunk, q=chunk.q + offset) if offset.any() else chunk

    def _begins_a_turn_above(self, q: Array) -> Flags:
        """(n,) joints that begin beyond their upper limit, and a turn below that within both.

        None of angles (T, n) that are not all from 0 to a turn, as such logs count.
        """
        none = np.zeros(q.shape[1], bool)
        if self._robot is None or len(self._robot.position_upper) != q.shape[1]:
            return none
        turns = ~np.asarray(self._robot.chain.prismatic, bool)
        angles = q[:, turns]
        if not ((angles >= 0.0) & (angles <= _FULL_TURN)).all():  # NaN neither
            return none
        below = q[0] - _FULL_TURN
        is_within = (below >= self._robot.position_lower) & (below <= self._robot.position_upper)
        return np.asarray(turns & (q[0] > self._robot.position_upper + LIMIT_MARGIN) & is_within)

    def _reach(self, steps: Array) -> Array:
        """(T - 1, n) by how much a jump may differ from a turn."""
        if self._is_stated:
            return np.full((len(steps), 1), np.pi)
        if self._robot is None:
            return np.full((len(steps), 1), _TURN_TOLERANCE)
        limit = np.minimum(self._robot.velocity_limit, _MAX_SPEED)
        return np.minimum(2.0 * limit * steps[:, None] + _JUMP_MARGIN, _TURN_TOLERANCE)

    def notice(self) -> tuple[str, ...]:
        """What was found, a sentence each."""
        notices = []
        if self.turns is not None and self.turns.any():
            counts = ", ".join(
                f"joint {j + 1} {count} times" for j, count in enumerate(self.turns) if count
            )
            notices.append(f"angles that jump by a turn are continued: {counts}")
        if self.has_turn_less is not None and self.has_turn_less.any():
            joints = ", ".join(f"joint {j + 1}" for j in np.flatnonzero(self.has_turn_less))
            notices.append(f"angles count from 0 to 360 deg: a turn is taken off at {joints}")
        return tuple(notices)
