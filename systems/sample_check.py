"""The check of samples against the joints' limits, as a block."""

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    LeafSystem,
)

from wrenchsight.models.observers.sample_check import (
    SampleCheck,
    check_current,
    check_motion,
    take_sample,
)
from wrenchsight.systems.last_tick import LastTick


class SampleCheckSystem(LeafSystem):
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
    State:    `SampleCheck.initial_state`, flat

    Between two ticks the outputs are those of the last one: a sample is taken once.

    Args:
        check: the rule; None: every sample is passed on.
        num_joints: n.
        time_step: s.
    """

    def __init__(self, check: SampleCheck | None, num_joints: int, time_step: float) -> None:
        LeafSystem.__init__(self)
        self._check, self._time_step = check, time_step
        self._n = n = num_joints
        initial = np.empty((0, n)) if check is None else check.initial_state()
        self._shape = initial.shape
        self._checked = np.empty((3, n))  # nothing in it outlives a call
        self._q = self.DeclareVectorInputPort("q", n)
        self._v = self.DeclareVectorInputPort("v", n)
        self._current = self.DeclareVectorInputPort("current", n)
        self.DeclarePeriodicDiscreteUpdateEvent(time_step, 0.0, self._update)
        self._sizes = [1, 2 * n, n, n]
        self._motion_size = sum(self._sizes)
        # Stored: `motion`, which ends with the checked q and v; then the checked current.
        self._last = LastTick(self, initial, time_step, self._motion_size + n)
        motion = self._last.tickets | {self._q.ticket(), self._v.ticket()}
        self._motion = self.DeclareVectorOutputPort(
            "motion", self._motion_size, self._calc_motion, motion
        )
        drives = self._last.tickets | {self._current.ticket()}
        self._checked_current = self.DeclareVectorOutputPort(
            "checked_current", n, self._calc_current, drives
        )

    @property
    def motion_sizes(self) -> list[int]:
        """Sizes of the parts of `motion`: fault; q and v as received; q; v."""
        return list(self._sizes)

    def _calc_motion(self, context: Context, output: BasicVector) -> None:
        memory, last_output = self._last.at(context)
        motion, n = output.get_mutable_value(), self._n
        if last_output is not None:
            motion[:] = last_output[: self._motion_size]
            return
        motion[1 : n + 1] = q = self._q.Eval(context)
        motion[n + 1 : 2 * n + 1] = v = self._v.Eval(context)
        if self._check is None:
            motion[0] = 0.0
            motion[2 * n + 1 :] = motion[1 : 2 * n + 1]
            return
        checked = motion[2 * n + 1 :].reshape(2, n)
        motion[0] = check_motion(
            self._check.table, memory.reshape(self._shape), self._time_step, q, v, checked
        )

    def _calc_current(self, context: Context, output: BasicVector) -> None:
        memory, last_output = self._last.at(context)
        if last_output is not None:
            output.SetFromVector(last_output[-self._n :])
            return
        current = self._current.Eval(context)
        if self._check is not None:
            check_current(
                self._check.table,
                memory.reshape(self._shape),
                self._time_step,
                current,
                self._checked,
            )
            current = self._checked[2]
        output.SetFromVector(current)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        n, motion = self._n, self._motion.Eval(context)
        current = self._checked_current.Eval(context)
        memory, outputs = self._last.take(context, discrete_state, motion, current)
        if self._check is not None:
            take_sample(
                self._check.table,
                memory.reshape(self._shape),
                self._time_step,
                motion[1 : n + 1],
                motion[n + 1 : 2 * n + 1],
                self._current.Eval(context),
                outputs[2 * n + 1 :].reshape(3, n),
            )
