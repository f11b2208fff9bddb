"""Samples checked against what the joints can do."""

import numpy as np
from numpy.typing import NDArray
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

Array = NDArray[np.float64]


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

    Args:
        check: the rule.
        time_step: s.
    """

    def __init__(self, check: SampleCheck, time_step: float) -> None:
        LeafSystem.__init__(self)
        self._check, self._time_step = check, time_step
        self._n = n = check.num_joints
        initial = check.initial_state()
        self._shape = initial.shape
        self._checked = np.empty((3, n))  # nothing in it outlives a call
        self._q, self._v, self._current = (
            self.DeclareVectorInputPort(name, n) for name in ("q", "v", "current")
        )
        state: DiscreteStateIndex = self.DeclareDiscreteState(initial.ravel())
        self.DeclarePeriodicDiscreteUpdateEvent(time_step, 0.0, self._update)
        memory = self.discrete_state_ticket(state)
        motion = {self._q.ticket(), self._v.ticket(), memory}
        self.DeclareVectorOutputPort("motion", 2 * n + 1, self._calc_motion, motion)
        current = {self._current.ticket(), memory}
        self.DeclareVectorOutputPort("checked_current", n, self._calc_current, current)

    def _calc_motion(self, context: Context, output: BasicVector) -> None:
        memory = context.get_discrete_state_vector().value().reshape(self._shape)
        q, v, n = self._q.Eval(context), self._v.Eval(context), self._n
        fault = check_motion(self._check.table, memory, self._time_step, q, v, self._checked)
        motion = output.get_mutable_value()
        motion[: 2 * n] = self._checked[:2].ravel()
        motion[2 * n] = fault

    def _calc_current(self, context: Context, output: BasicVector) -> None:
        memory = context.get_discrete_state_vector().value().reshape(self._shape)
        current = self._current.Eval(context)
        check_current(self._check.table, memory, self._time_step, current, self._checked)
        output.SetFromVector(self._checked[2])

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        memory = discrete_state.get_mutable_value().reshape(self._shape)
        sample = np.stack([port.Eval(context) for port in (self._q, self._v, self._current)])
        check_sample(self._check.table, memory, self._time_step, sample, self._checked)
