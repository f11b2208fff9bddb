"""The check of samples against the joints' limits, as a block."""

from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import BasicVector, Context

from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.sample_check import SampleCheck
from wrenchsight.systems.sampled_block import SampledBlock, ticking_period


class SampleCheckSystem(SampledBlock):
    """Passes on plausible samples of the joints, and NaN in place of impossible ones.

                    +-------------------+
      q        -->  |                   | --> motion
      v        -->  | SampleCheckSystem |
      current  -->  |                   | --> checked_current
                    +-------------------+

    Inputs:   q, v             (n,) rad and rad/s (m and m/s)
              current          (n,) A, as the drives report it
    Outputs:  motion           (2 n + 1,) `fault`: what is wrong with q and v, and with the current
                               of the sample before, a sum of the codes of
                               `models.observers.sample_check`; q and v. Drake's Demultiplexer
                               splits it with `motion_sizes`; no feedthrough from current
              checked_current  (n,) A; no feedthrough from q and v
    State:    memory, which `take_sample` updates at each tick: `SampleCheck.initial_state`, flat

    Args:
        check: the rule; None: every sample is passed on.
        num_joints: n.
        time_step: s.

    Raises:
        ValueError: time_step is not positive.
    """

    def __init__(self, check: SampleCheck | None, num_joints: int, time_step: float) -> None:
        n = num_joints
        self._sizes = [1, n, n]
        self._motion_size = sum(self._sizes)
        initial = np.empty((0, n)) if check is None else check.initial_state()
        period = ticking_period(time_step, "sample check")
        SampledBlock.__init__(self, period=period, initial_memory=initial)
        self._check, self._time_step, self._n = check, time_step, n
        self._q = self.DeclareVectorInputPort("q", n)
        self._v = self.DeclareVectorInputPort("v", n)
        self._current = self.DeclareVectorInputPort("current", n)
        # `take_sample` returns these two in this order.
        self._motion = self.declare_held_output(
            "motion", self._motion_size, self._calc_motion, {self._q.ticket(), self._v.ticket()}
        )
        self._checked_current = self.declare_held_output(
            "checked_current", n, self._calc_current, {self._current.ticket()}
        )

    @property
    def motion_sizes(self) -> list[int]:
        """Sizes of the parts of `motion`: fault; q; v."""
        return list(self._sizes)

    def _calc_motion(self, context: Context, output: BasicVector) -> None:
        q, v, motion = self._q.Eval(context), self._v.Eval(context), output.get_mutable_value()
        checked = motion[1:].reshape(2, self._n)
        if self._check is None:
            motion[0], checked[0], checked[1] = 0.0, q, v
        else:
            state = self.memory(context)
            motion[0] = self._check.motion(state, q, v, self._time_step, checked)

    def _calc_current(self, context: Context, output: BasicVector) -> None:
        current = self._current.Eval(context)
        if self._check is None:
            output.SetFromVector(current)
            return
        checked = output.get_mutable_value()
        self._check.current(self.memory(context), current, self._time_step, checked)

    def take_sample(self, context: Context, memory: Array) -> Sequence[Array]:
        motion, current = self._motion.Eval(context), self._checked_current.Eval(context)
        if self._check is not None:
            self._check.take(
                memory,
                self._q.Eval(context),
                self._v.Eval(context),
                self._current.Eval(context),
                self._time_step,
                motion[1:].reshape(2, self._n),
                current,
            )
        return motion, current
