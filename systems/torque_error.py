"""The error of the observed torque, as a block: for the wrench and the contact detector."""

from typing import cast

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    LeafSystem,
)

from wrenchsight.models.estimation.torque_error_stage import (
    ERROR_ROWS,
    STAGE_ROWS,
    TorqueErrorStage,
    torque_error_sample,
)
from wrenchsight.models.identification.torque_error_model import take_transmitted
from wrenchsight.models.numerics.arrays import Array, contiguous
from wrenchsight.models.rigid_body.rigid_body_terms import RigidBodyTerms
from wrenchsight.systems.declarations import declare_cached
from wrenchsight.systems.last_tick import LastTick


class TorqueErrorSystem(LeafSystem):
    """States the torque error of each sample, and J as the observer saw it.

                       +-------------------+
      q, v        -->  |                   |
      terms       -->  |                   |
      tau_J, tau_f --> | TorqueErrorSystem | --> torque_error
      pole        -->  |                   |
      law         -->  |                   |
                       +-------------------+

    Inputs:  q, v          (n,) rad and rad/s
             terms         RigidBodyTerms (abstract): J at E in axes of W
             tau_J, tau_f  (n,) N m; what the gear transmits counts for the sample after
             pole          (n,) 1/s of the observer, below 0 for one without such a lag
             law           FrictionLaw (abstract) as it is now, whose level is the stiction band
    Output:  torque_error  (ERROR_ROWS n,) a `TorqueError`, flat: sd, stiction, drift, J_seen row by
                           row, rows of its state; no direct feedthrough from tau_J and tau_f
    State:   (STAGE_ROWS, n), flat

    Between two ticks the output is that of the last one. K_0 and friction that are changed while a
    simulation runs reach it through `pole` and `law`.

    Args:
        stage: of one estimator.
        time_step: s.
    """

    def __init__(self, stage: TorqueErrorStage, time_step: float) -> None:
        LeafSystem.__init__(self)
        self._stage = stage
        self._n = n = stage.num_joints
        self._q = self.DeclareVectorInputPort("q", n)
        self._v = self.DeclareVectorInputPort("v", n)
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._tau_J = self.DeclareVectorInputPort("tau_J", n)
        self._tau_f = self.DeclareVectorInputPort("tau_f", n)
        self._pole = self.DeclareVectorInputPort("pole", n)
        self._law = self.DeclareAbstractInputPort("law", AbstractValue.Make(object()))
        self._last = LastTick(self, stage.initial_state(), time_step, ERROR_ROWS * n)
        self.DeclarePeriodicDiscreteUpdateEvent(time_step, 0.0, self._update)
        self._tables = declare_cached(
            self, "tables", self._calc_tables, {self._pole.ticket(), self._law.ticket()}
        )
        ports = self._q, self._v, self._terms
        tickets = {port.ticket() for port in ports} | self._last.tickets
        # The error and the state after it, so that the update need not compute them again.
        self._tick = declare_cached(
            self, "torque error and state", self._calc_tick, tickets | {self._tables.ticket()}
        )
        self._error = self.DeclareVectorOutputPort(
            "torque_error",
            ERROR_ROWS * n,
            self._calc_error,
            self._last.tickets | {self._tick.ticket()},
        )

    def _calc_tables(self, context: Context) -> tuple[Array, Array]:
        pole = self._pole.Eval(context)
        stage = self._stage.retuned(self._law.Eval(context), pole if (pole >= 0.0).all() else None)
        return stage.table, stage.poles

    def _calc_tick(self, context: Context) -> tuple[Array, Array]:
        state = np.array(self._last.at(context)[0]).reshape(STAGE_ROWS, self._n)
        error = np.empty(ERROR_ROWS * self._n)
        J = cast(RigidBodyTerms, self._terms.Eval(context)).J
        table, poles = self._tables.EvalAbstract(context).get_value()
        q, v = self._q.Eval(context), self._v.Eval(context)
        torque_error_sample(table, poles, state, q, v, contiguous(J)[0], error)
        return error, state

    def _calc_error(self, context: Context, output: BasicVector) -> None:
        _, last_output = self._last.at(context)
        if last_output is not None:
            output.SetFromVector(last_output)
            return
        error, _ = self._tick.EvalAbstract(context).get_value()
        output.SetFromVector(error)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        error, state = self._tick.EvalAbstract(context).get_value()
        memory, _ = self._last.take(context, discrete_state, error)
        memory[:] = state.ravel()
        tau_J, tau_f = self._tau_J.Eval(context), self._tau_f.Eval(context)
        take_transmitted(memory.reshape(STAGE_ROWS, self._n), tau_J, tau_f)
