"""An observer of external joint torque as a block, whatever its kind."""

from typing import Any, ClassVar, cast

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

from wrenchsight.models.arrays import Array
from wrenchsight.models.estimation.torque_error_stage import ERROR_ROWS
from wrenchsight.models.observers.observer import (
    CTV,
    GRAVITY,
    MOMENTUM,
    NUM_SIGNALS,
    TAU_EXT,
    TAU_F,
    TAU_J,
    TORQUE_SD,
    Observer,
    Q,
    V,
)
from wrenchsight.models.rigid_body.rigid_body_terms import RigidBodyTerms
from wrenchsight.systems.last_tick import LastTick


class ExternalTorqueObserver(LeafSystem):
    """Estimates the external joint torque by the observer that it is given.

                        +------------------------+
      terms        -->  |                        | --> tau_ext
      tau_J        -->  | ExternalTorqueObserver | --> valid
      tau_f        -->  |                        | --> reading
      torque_error -->  |                        | --> pole
                        +------------------------+

    Inputs:     terms    RigidBodyTerms (abstract): q, v, momentum, CTv, G and J of the model
                tau_J    (n,) motor torque on the joint side, N m
                tau_f    (n,) friction torque that opposes motion, N m
                torque_error  (ERROR_ROWS n,) of TorqueErrorSystem, for an observer that uses its
                         sds; optional, and only with `uses_sd`
    Outputs:    tau_ext  (n,) N m, positive along the motion it causes; reflects everything up to
                         the present tick. It feeds through from tau_J only where the observer says
                         that it reads the present torque
                valid    (1,) 1, or 0 where tau_ext is the last one, held, and while it is still
                         settling after the start
                reading  (n + 1,) these two, one after the other, in one port
                pole     (n,) 1/s, below 0 for an observer without one
                wrench   (42,) F_E_W and its covariance, row by row, of an observer that reads the
                         wrench itself; others have no such port
    State:      of the observer, row by row
    Parameters: of the observer, in its order

    Between two ticks (t = 0, T, 2T...) the outputs are those of the last one.

    Args:
        observer: of `wrenchsight.models.observers.observer_kinds`.

    Raises:
        ValueError: when a parameter is changed to what the observer does not accept and an output
            is then evaluated.
    """

    uses_sd: ClassVar[bool] = True
    """Whether there is an input torque_error."""

    def __init__(self, observer: Observer) -> None:
        LeafSystem.__init__(self)
        self._observer = observer
        self._n = n = observer.num_joints
        self._parameters = {
            name: NumericParameterIndex(self.DeclareNumericParameter(BasicVector(value.ravel())))
            for name, value in observer.parameters.items()
        }
        self._shapes = {name: value.shape for name, value in observer.parameters.items()}
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._tau_J = self.DeclareVectorInputPort("tau_J", n)
        self._tau_f = self.DeclareVectorInputPort("tau_f", n)
        if self.uses_sd:
            self._torque_error = self.DeclareVectorInputPort("torque_error", ERROR_ROWS * n)
        state = observer.initial_state()
        self._state_shape = state.shape
        self._state: DiscreteStateIndex = self.DeclareDiscreteState(state.ravel())
        self.DeclarePeriodicDiscreteUpdateEvent(observer.time_step, 0.0, self._update)

        # The constants change only with the parameters, not at every tick.
        tickets = {self.numeric_parameter_ticket(index) for index in self._parameters.values()}
        parameters = tickets or {self.nothing_ticket()}
        self._table = self.DeclareCacheEntry(
            "observer table",
            ValueProducer(
                allocate=lambda: AbstractValue.Make(observer.table), calc=self._calc_table
            ),
            parameters,
        )
        self._has_wrench = observer.kernels.wrench is not None
        self._last = LastTick(self, observer.time_step, n + 1 + 42 * self._has_wrench)
        inputs = {self._terms.ticket(), self._tau_f.ticket()}
        if self.uses_sd:
            inputs.add(self._torque_error.ticket())
        # All but the torque of the motors and the estimate, which a tick's halves write.
        self._signals = self.DeclareCacheEntry(
            "signals",
            ValueProducer(allocate=lambda: AbstractValue.Make(object()), calc=self._calc_signals),
            inputs,
        )
        prerequisites = self._last.tickets | {
            self._signals.ticket(),
            self.discrete_state_ticket(self._state),
            self._table.ticket(),
        }
        if observer.reads_present_torque:
            prerequisites.add(self._tau_J.ticket())
        self.DeclareVectorOutputPort("tau_ext", n, self._calc_tau_ext, prerequisites)
        self.DeclareVectorOutputPort("valid", 1, self._calc_valid, prerequisites)
        self._reading = self.DeclareVectorOutputPort(
            "reading", n + 1, self._calc_reading, prerequisites
        )
        self.DeclareVectorOutputPort("pole", n, self._calc_pole, parameters)
        if self._has_wrench:
            self._wrench = self.DeclareVectorOutputPort(
                "wrench", 42, self._calc_wrench, prerequisites
            )

    def _tuned(self, context: Context) -> Observer:
        """The observer with the parameters of a context."""
        values = {
            name: context.get_numeric_parameter(index).value().reshape(self._shapes[name])
            for name, index in self._parameters.items()
        }
        return self._observer.with_parameters(values)

    def _calc_table(self, context: Context, value: Value) -> None:
        value.set_value(self._tuned(context).table)

    def _calc_pole(self, context: Context, output: BasicVector) -> None:
        pole = self._tuned(context).pole
        output.SetFromVector(np.full(self._n, -1.0) if pole is None else pole)

    def _calc_signals(self, context: Context, value: Value) -> None:
        terms = cast(RigidBodyTerms, self._terms.Eval(context))
        signals = np.empty((NUM_SIGNALS, self._n))
        signals[Q], signals[V] = terms.q, terms.v
        signals[MOMENTUM], signals[CTV], signals[GRAVITY] = terms.momentum, terms.CTv, terms.G
        signals[TAU_F] = self._tau_f.Eval(context)
        signals[TORQUE_SD:] = 0.0
        if self.uses_sd and self._torque_error.HasValue(context):
            sds = self._torque_error.Eval(context)[: (NUM_SIGNALS - TORQUE_SD) * self._n]
            signals[TORQUE_SD:] = sds.reshape(-1, self._n)
        value.set_value((signals, terms.J))

    def _signals_of(self, context: Context, with_torque: bool) -> tuple[Array, Array]:
        signals, J = self._signals.EvalAbstract(context).get_value()
        signals[TAU_J] = self._tau_J.Eval(context) if with_torque else 0.0
        return signals, J

    def _calc_reading(self, context: Context, output: BasicVector) -> None:
        if (kept := self._last.between(context)) is not None:
            output.SetFromVector(kept[: self._n + 1])
            return
        signals, J = self._signals_of(context, self._observer.reads_present_torque)
        state: Any = context.get_discrete_state(self._state).value()
        reading = output.get_mutable_value()
        reading[-1] = self._observer.kernels.output(
            self._table.Eval(context), np.array(state).reshape(self._state_shape), signals, J
        )
        reading[:-1] = signals[TAU_EXT]

    def _calc_wrench(self, context: Context, output: BasicVector) -> None:
        if (kept := self._last.between(context)) is not None:
            output.SetFromVector(kept[self._n + 1 :])
            return
        signals, J = self._signals_of(context, self._observer.reads_present_torque)
        state: Any = context.get_discrete_state(self._state).value()
        reading = output.get_mutable_value()
        self._observer.kernels.wrench(
            self._table.Eval(context),
            np.array(state).reshape(self._state_shape),
            *(signals, J, reading[:6], reading[6:].reshape(6, 6)),
        )

    def _calc_tau_ext(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._reading.Eval(context)[:-1])

    def _calc_valid(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self._reading.Eval(context)[-1])

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        last = [self._reading, self._wrench] if self._has_wrench else [self._reading]
        self._last.take(context, discrete_state, *(port.Eval(context) for port in last))
        signals, J = self._signals_of(context, True)
        signals[TAU_EXT] = self._reading.Eval(context)[:-1]
        self._observer.kernels.update(
            self._table.Eval(context),
            discrete_state.get_mutable_value(self._state).reshape(self._state_shape),
            signals,
            J,
        )
