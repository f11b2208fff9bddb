"""Samples checked against what the joints can do."""

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteStateIndex,
    DiscreteValues,
    LeafSystem,
)

from wrenchsight.models.observers.sample_check import (
    SampleCheck,
    check_current,
    check_motion,
    check_sample,
)
from wrenchsight.systems.last_tick import LastTick


class SampleCheckSystem(LeafSystem):
    """Passes on possible samples of the joints, and NaN in place of impossible ones.

                    +-------------------+
      q        -->  |                   | --> motion
      v        -->  | SampleCheckSystem |
      current  -->  |                   | --> checked_current
                    +-------------------+

    Inputs:   q, v             (n,) rad and rad/s (m and m/s)
              current          (n,) A, as the drives report it
    Outputs:  motion           (2 n + 1,) q and v, then `fault`: what is wrong with them and with
                               the current of the sample before, a sum of the codes of
                               `models.observers.sample_check`; no feedthrough from current
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
        self._sample, self._checked = np.empty((2, 3, n))  # nothing in them outlives a call
        self._q, self._v, self._current = (
            self.DeclareVectorInputPort(name, n) for name in ("q", "v", "current")
        )
        state: DiscreteStateIndex = self.DeclareDiscreteState(initial.ravel())
        self.DeclarePeriodicDiscreteUpdateEvent(time_step, 0.0, self._update)
        self._last = LastTick(self, time_step, 3 * n + 1)
        memory = self._last.tickets | {self.discrete_state_ticket(state)}
        motion = memory | {self._q.ticket(), self._v.ticket()}
        self._motion = self.DeclareVectorOutputPort("motion", 2 * n + 1, self._calc_motion, motion)
        drives = memory | {self._current.ticket()}
        self._checked_current = self.DeclareVectorOutputPort(
            "checked_current", n, self._calc_current, drives
        )

    def _calc_motion(self, context: Context, output: BasicVector) -> None:
        if (kept := self._last.between(context)) is not None:
            output.SetFromVector(kept[: 2 * self._n + 1])
            return
        q, v, n = self._q.Eval(context), self._v.Eval(context), self._n
        if self._check is None:
            output.SetFromVector(np.concatenate([q, v, [0.0]]))
            return
        memory = context.get_discrete_state(0).value().reshape(self._shape)
        fault = check_motion(self._check.table, memory, self._time_step, q, v, self._checked)
        motion = output.get_mutable_value()
        motion[: 2 * n] = self._checked[:2].ravel()
        motion[2 * n] = fault

    def _calc_current(self, context: Context, output: BasicVector) -> None:
        if (kept := self._last.between(context)) is not None:
            output.SetFromVector(kept[-self._n :])
            return
        current = self._current.Eval(context)
        if self._check is None:
            output.SetFromVector(current)
            return
        memory = context.get_discrete_state(0).value().reshape(self._shape)
        check_current(self._check.table, memory, self._time_step, current, self._checked)
        output.SetFromVector(self._checked[2])

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        last = [self._motion, self._checked_current]
        self._last.take(context, discrete_state, *(port.Eval(context) for port in last))
        if self._check is None:
            return
        memory = discrete_state.get_mutable_value(0).reshape(self._shape)
        for row, port in zip(self._sample, (self._q, self._v, self._current), strict=True):
            row[:] = port.Eval(context)
        check_sample(self._check.table, memory, self._time_step, self._sample, self._checked)
