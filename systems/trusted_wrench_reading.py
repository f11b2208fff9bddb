"""External joint torque to the wrench at the tool, with the torque error of each sample."""

from typing import cast

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    LeafSystem,
    ValueProducer,
)

from wrenchsight.models.estimation.trusted_reading import TrustedReading
from wrenchsight.models.rigid_body.rigid_body_terms import RigidBodyTerms
from wrenchsight.systems.jacobian_wrench_reconstruction import OBSERVED_SIZE, READING_SIZES
from wrenchsight.systems.last_tick import LastTick


class TrustedWrenchReading(LeafSystem):
    """Reads the wrench at E with what a model knows of its own error: `TrustedReading` as a block.

        Σ_F = (J Σ_tau(t)⁻¹ Jᵀ + P⁻¹)⁻¹,   F = Σ_F J Σ_tau(t)⁻¹ tau_ext

    with J seen through the observer's own pole.

                         +----------------------+
      q, v          -->  |                      |
      terms         -->  |                      |
      tau_ext       -->  | TrustedWrenchReading | --> reading
      tau_ext_valid -->  |                      |
      tau_J, tau_f  -->  |                      |
      observed      -->  |                      |
                         +----------------------+

    Inputs:  q, v           (n,) rad and rad/s
             terms          RigidBodyTerms (abstract): J at E in axes of W
             tau_ext        (n,) N m, positive along the motion it causes
             tau_ext_valid  (1,) 0 where tau_ext is held or unknown
             tau_J, tau_f   (n,) N m; what the gear transmits counts for the sample after
             observed       (42,) wrench and covariance, of an observer that reads them
                            itself; to be left unconnected otherwise
    Output:  reading        (44,) wrench, covariance, condition number, valid, in the order of
                            READING_SIZES; no direct feedthrough from tau_J and tau_f
    State:   `TrustedReading.state_rows` rows of n, flat

    Between two ticks the output is that of the last one. The numbers are those of
    `models.estimation.estimator.WrenchEstimator.run`.

    Args:
        trusted: the reading of one estimator.
        time_step: s.
    """

    def __init__(self, trusted: TrustedReading, time_step: float) -> None:
        LeafSystem.__init__(self)
        self._trusted = trusted
        n = trusted.num_joints
        self._shape = (trusted.state_rows, n)
        self._q = self.DeclareVectorInputPort("q", n)
        self._v = self.DeclareVectorInputPort("v", n)
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._tau_ext = self.DeclareVectorInputPort("tau_ext", n)
        self._tau_ext_valid = self.DeclareVectorInputPort("tau_ext_valid", 1)
        self._tau_J = self.DeclareVectorInputPort("tau_J", n)
        self._tau_f = self.DeclareVectorInputPort("tau_f", n)
        self._observed = self.DeclareVectorInputPort("observed", OBSERVED_SIZE)
        state = self.DeclareDiscreteState(trusted.initial_state().ravel())
        self._last = LastTick(self, time_step, sum(READING_SIZES))
        self.DeclarePeriodicDiscreteUpdateEvent(time_step, 0.0, self._update)
        ports = [self._q, self._v, self._terms, self._tau_ext, self._tau_ext_valid, self._observed]
        tickets = {port.ticket() for port in ports} | {self.discrete_state_ticket(state)}
        # The reading and the state after it, so that the update need not read again.
        self._tick = self.DeclareCacheEntry(
            "reading and state",
            ValueProducer(allocate=lambda: AbstractValue.Make(object()), calc=self._calc_tick),
            tickets,
        )
        self.DeclareVectorOutputPort(
            "reading",
            sum(READING_SIZES),
            self._calc_reading,
            self._last.tickets | {self._tick.ticket()},
        )

    def _calc_tick(self, context: Context, value: Value) -> None:
        state = context.get_discrete_state(0).value().reshape(self._shape).copy()
        reading = np.empty(sum(READING_SIZES))
        self._trusted.tick(
            state,
            self._q.Eval(context),
            self._v.Eval(context),
            cast(RigidBodyTerms, self._terms.Eval(context)).J,
            self._tau_ext.Eval(context),
            bool(self._tau_ext_valid.Eval(context)[0] == 1.0),
            reading,
            self._observed.Eval(context) if self._observed.HasValue(context) else None,
        )
        value.set_value((reading, state))

    def _calc_reading(self, context: Context, output: BasicVector) -> None:
        if self._last.is_between(context):
            output.SetFromVector(self._last.values(context))
            return
        reading, _ = self._tick.EvalAbstract(context).get_value()
        output.SetFromVector(reading)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        reading, state = self._tick.EvalAbstract(context).get_value()
        self._last.take(context, discrete_state, reading)
        state = state.copy()
        transmitted = self._tau_J.Eval(context) - self._tau_f.Eval(context)
        self._trusted.transmit(state, transmitted)
        discrete_state.set_value(0, state.ravel())
