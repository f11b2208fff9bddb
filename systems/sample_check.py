"""The check of samples against the joints' limits, as a block."""

from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import BasicVector, Context

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.sample_check import (
    SampleCheck,
    check_current,
    check_motion,
    take_sample,
)
from wrenchsight.systems.sampled_block import SampledBlock


class SampleCheckSystem(SampledBlock):
    """Passes on plausible samples of the joints, and NaN in place of impossible ones.

                    +-------------------+
      q        -->  |                   | --> motion
      v        -->  | SampleCheckSystem |
      current  -->  |                   | --> checked_current
                    +-------------------+

    Inputs:   q, v             (n,) rad and rad/s (m and m/s)
              current          (n,) A, as the drives report it
    Outputs:  motion           (4 n + 1,) `fault`: what is wrong with q and v, and with the current
                               of the sample before, a sum of the codes of
                               `models.observers.sample_check`; q and v as they came, which the
                               update takes; q and v. Drake's Demultiplexer splits it with
                               `motion_sizes`; no feedthrough from current
              checked_current  (n,) A; no feedthrough from q and v
    State:    that of SampledBlock; its memory is `SampleCheck.initial_state`, flat

    Args:
        check: the rule; None: every sample is passed on.
        num_joints: n.
        time_step: s.
    """

    def __init__(self, check: SampleCheck | None, num_joints: int, time_step: float) -> None:
        n = num_joints
        self._sizes = [1, 2 * n, n, n]
        self._motion_size = sum(self._sizes)
        initial = np.empty((0, n)) if check is None else check.initial_state()
        held = {"motion": self._motion_size, "checked_current": n}
        SampledBlock.__init__(self, time_step, initial, held)
        self._check, self._time_step, self._n = check, time_step, n
        self._checked = np.empty((3, n))  # nothing in it outlives a call
        self._q = self.DeclareVectorInputPort("q", n)
        self._v = self.DeclareVectorInputPort("v", n)
        self._current = self.DeclareVectorInputPort("current", n)
        motion = self.state_tickets | {self._q.ticket(), self._v.ticket()}
        self._motion = self.DeclareVectorOutputPort(
            "motion", self._motion_size, self._calc_motion, motion
        )
        drives = self.state_tickets | {self._current.ticket()}
        self._checked_current = self.DeclareVectorOutputPort(
            "checked_current", n, self._calc_current, drives
        )

    @property
    def motion_sizes(self) -> list[int]:
        """Sizes of the parts of `motion`: fault; q and v as received; q; v."""
        return list(self._sizes)

    def _calc_motion(self, context: Context, output: BasicVector) -> None:
        motion, n = output.get_mutable_value(), self._n
        held = self.held(context, "motion")
        if held is not None:
            motion[:] = held
            return
        motion[1 : n + 1] = q = self._q.Eval(context)
        motion[n + 1 : 2 * n + 1] = v = self._v.Eval(context)
        if self._check is None:
            motion[0] = 0.0
            motion[2 * n + 1 :] = motion[1 : 2 * n + 1]
            return
        checked = motion[2 * n + 1 :].reshape(2, n)
        motion[0] = check_motion(
            self._check.table, self.memory(context), self._time_step, q, v, checked
        )

    def _calc_current(self, context: Context, output: BasicVector) -> None:
        held = self.held(context, "checked_current")
        if held is not None:
            output.SetFromVector(held)
            return
        current = self._current.Eval(context)
        if self._check is not None:
            check_current(
                self._check.table,
                self.memory(context),
                self._time_step,
                current,
                self._checked,
            )
            current = self._checked[2]
        output.SetFromVector(current)

    def take_sample(self, context: Context, memory: Array) -> Sequence[Array]:
        n, motion = self._n, self._motion.Eval(context)
        current = self._checked_current.Eval(context)
        if self._check is not None:
            checked = np.concatenate([motion[2 * n + 1 :], current]).reshape(3, n)
            take_sample(
                self._check.table,
                memory,
                self._time_step,
                motion[1 : n + 1],
                motion[n + 1 : 2 * n + 1],
                self._current.Eval(context),
                checked,
            )
        return motion, current
