"""A friction law as a block, whatever its kind."""

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteStateIndex,
    DiscreteValues,
    LeafSystem,
    NumericParameterIndex,
    ValueProducer,
)

from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.velocity_friction import friction_torque


class FrictionLawSystem(LeafSystem):
    """Predicts the friction torque of every joint by the law that it is given.

                 +-------------------+
      q     -->  |                   | --> tau_f
      v     -->  | FrictionLawSystem |
      tau_J -->  |                   | --> law
                 +-------------------+

    Inputs:      q      (n,) rad (m if prismatic)
                 v      (n,) rad/s (m/s)
                 tau_J  (n,) motor torque on the joint side, N m; read by the update alone
                        q and tau_J of a law with memory only
    Outputs:     tau_f  (n,) N m, opposes motion: positive for positive velocity, on the left of
                        M vdot + C v + G + tau_f = tau_J + tau_ext; direct feedthrough of q and v,
                        not of tau_J
                 law    FrictionLaw (abstract) with the parameters as they are now
    State:       of the law, row by row, updated every `time_step`; none without memory
    Parameters:  of the law, in its order

    Position or velocity that is not finite gives a torque that is not finite, which the observer
    flags; the law keeps what it knew.

    Args:
        law: of `wrenchsight.models.friction`.
        time_step: s; of a law with memory only.

    Raises:
        ValueError: a law with memory has no period; or, when a parameter is changed to what the law
            does not accept and the output is then evaluated.
    """

    def __init__(self, law: FrictionLaw, time_step: float = 0.0) -> None:
        LeafSystem.__init__(self)
        self._law = law
        self._n = n = law.num_joints
        self._rows = law.state_rows
        if self._rows > 0 and not time_step > 0.0:
            raise ValueError(f"friction: time_step must be positive, not {time_step}")
        self._parameters = {
            name: NumericParameterIndex(self.DeclareNumericParameter(BasicVector(value.ravel())))
            for name, value in law.parameters.items()
        }
        self._shapes = {name: value.shape for name, value in law.parameters.items()}
        # The law's constants change only with the parameters, not at every tick.
        parameters = {self.numeric_parameter_ticket(index) for index in self._parameters.values()}
        self._tables = self.DeclareCacheEntry(
            "friction tables",
            ValueProducer(allocate=lambda: AbstractValue.Make(object()), calc=self._calc_tables),
            parameters or {self.nothing_ticket()},
        )
        if self._rows > 0:
            self._q = self.DeclareVectorInputPort("q", n)
        self._v = self.DeclareVectorInputPort("v", n)
        prerequisites = {self._v.ticket(), self._tables.ticket()}
        if self._rows > 0:
            self._tau_J = self.DeclareVectorInputPort("tau_J", n)
            self._state: DiscreteStateIndex = self.DeclareDiscreteState(law.initial_state().ravel())
            self.DeclarePeriodicDiscreteUpdateEvent(time_step, 0.0, self._update)
            prerequisites |= {self._q.ticket(), self.discrete_state_ticket(self._state)}
        # Kept, because the update at a tick needs the same torque.
        self._torque = self.DeclareVectorOutputPort("tau_f", n, self._calc_tau_f, prerequisites)
        self.DeclareAbstractOutputPort(
            "law",
            lambda: AbstractValue.Make(object()),
            lambda context, value: value.set_value(self._tuned(context)),
            parameters or {self.nothing_ticket()},
        )

    def _tuned(self, context: Context) -> FrictionLaw:
        """The law with the parameters of a context."""
        values = {
            name: np.array(context.get_numeric_parameter(index).value().reshape(self._shapes[name]))
            for name, index in self._parameters.items()
        }
        return self._law.with_parameters(values)

    def _calc_tables(self, context: Context, value: Value) -> None:
        law = self._tuned(context)
        value.set_value((law.velocity_law.table, law.slip_table))

    def _calc_tau_f(self, context: Context, output: BasicVector) -> None:
        velocity_table, slip_table = self._tables.EvalAbstract(context).get_value()
        v, tau_f = self._v.Eval(context), output.get_mutable_value()
        friction_torque(velocity_table, v, tau_f)
        if self._rows > 0:
            state = np.array(context.get_discrete_state(self._state).value())
            self._law.kernels.add_torque(
                slip_table, state.reshape(self._rows, self._n), self._q.Eval(context), v, tau_f
            )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        self._law.kernels.update(
            self._tables.Eval(context)[1],
            discrete_state.get_mutable_value().reshape(self._rows, self._n),
            self._q.Eval(context),
            self._v.Eval(context),
            self._tau_J.Eval(context) - self._torque.Eval(context),
        )
