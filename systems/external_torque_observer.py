"""An observer of external joint torque as a block, whatever its kind."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context

from wrenchsight.models.estimation.torque_error_stage import ERROR_ROWS
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.observer import NUM_SIGNALS, TAU_EXT, TAU_J, Observer
from wrenchsight.models.observers.signals import signals_size, write_signals
from wrenchsight.systems.declarations import TunedParameters, declare_cached, declare_parts
from wrenchsight.systems.sampled_block import SampledBlock

_NO_VALUES = np.empty(0)


class ExternalTorqueObserver(SampledBlock):
    """Estimates the external joint torque with any observer of `models.observers`.

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
                reading  these two, one after the other, then what the update takes, in one port;
                         Drake's Demultiplexer splits it with `reading_sizes`
                pole     (n,) 1/s, below 0 for an observer without one
                wrench   (42,) F_E_W and its covariance, row by row, of an observer that reads the
                         wrench itself; others have no such port
    State:      that of SampledBlock; its memory is the observer's, row by row
    Parameters: of the observer, in its order

    Args:
        observer: of `wrenchsight.models.observers.observer_kinds`.

    Raises:
        ValueError: when a parameter is changed to what the observer does not accept and an output
            is then evaluated.
    """

    uses_sd: ClassVar[bool] = True
    """Whether there is an input torque_error."""

    def __init__(self, observer: Observer) -> None:
        n = observer.num_joints
        self._has_wrench = observer.kernels.wrench is not None
        held = {"estimate": n + 1} | ({"wrench": 42} if self._has_wrench else {})
        SampledBlock.__init__(self, observer.time_step, observer.initial_state(), held)
        self._observer = observer
        self._n = n
        self._parameters = TunedParameters(self, observer.parameters)
        parameters = self._parameters.tickets
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._tau_J = self.DeclareVectorInputPort("tau_J", n)
        self._tau_f = self.DeclareVectorInputPort("tau_f", n)
        if self.uses_sd:
            self._torque_error = self.DeclareVectorInputPort("torque_error", ERROR_ROWS * n)

        # The constants change only with the parameters, not at every tick.
        self._table = declare_cached(
            self, "observer table", lambda context: self._tuned(context).table, parameters
        )
        prerequisites = self.state_tickets | {
            self._terms.ticket(),
            self._tau_f.ticket(),
            self._table.ticket(),
        }
        if self.uses_sd:
            prerequisites.add(self._torque_error.ticket())
        if observer.reads_present_torque:
            prerequisites.add(self._tau_J.ticket())
        self._reading = self.DeclareVectorOutputPort(
            "reading", sum(self.reading_sizes), self._calc_reading, prerequisites
        )
        parts = {"tau_ext": n, "valid": 1}
        declare_parts(self, self._reading.Eval, parts, prerequisites)
        self.DeclareVectorOutputPort("pole", n, self._calc_pole, parameters)
        if self._has_wrench:
            self._wrench = self.DeclareVectorOutputPort(
                "wrench", 42, self._calc_wrench, prerequisites
            )

    @property
    def reading_sizes(self) -> list[int]:
        """Sizes of the parts of `reading`: tau_ext, valid, signals of the update."""
        return [self._n, 1, signals_size(self._n)]

    def _tuned(self, context: Context) -> Observer:
        """The observer with the parameters of a context."""
        return self._observer.with_parameters(self._parameters.at(context))

    def _calc_pole(self, context: Context, output: BasicVector) -> None:
        pole = self._tuned(context).pole
        output.SetFromVector(np.full(self._n, -1.0) if pole is None else pole)

    def _signals(self, reading: Array) -> tuple[Array, Array]:
        """The signals and J of a reading, as views."""
        n = self._n
        J_and_signals = reading[n + 1 :]
        signals = J_and_signals[6 * n :].reshape(NUM_SIGNALS, n)
        return signals, J_and_signals[: 6 * n].reshape(6, n)

    def _calc_reading(self, context: Context, output: BasicVector) -> None:
        n, reading = self._n, output.get_mutable_value()
        held = self.held(context, "estimate")
        if held is not None:
            reading[: n + 1] = held
            return
        error = _NO_VALUES
        if self.uses_sd and self._torque_error.HasValue(context):
            error = self._torque_error.Eval(context)
        terms, tau_f = self._terms.Eval(context), self._tau_f.Eval(context)
        write_signals(terms.record, tau_f, error, reading[n + 1 :])
        signals, J = self._signals(reading)
        if self._observer.reads_present_torque:
            signals[TAU_J] = self._tau_J.Eval(context)
        table = self._table.EvalAbstract(context).get_value()
        reading[n] = self._observer.kernels.output(table, self.memory(context), signals, J)
        reading[:n] = signals[TAU_EXT]

    def _calc_wrench(self, context: Context, output: BasicVector) -> None:
        held = self.held(context, "wrench")
        if held is not None:
            output.SetFromVector(held)
            return
        signals, J = self._signals(self._reading.Eval(context))
        wrench = output.get_mutable_value()
        self._observer.kernels.wrench(
            self._table.EvalAbstract(context).get_value(),
            self.memory(context),
            signals,
            J,
            wrench[:6],
            wrench[6:].reshape(6, 6),
        )

    def take_sample(self, context: Context, memory: Array) -> Sequence[Array]:
        reading = self._reading.Eval(context)
        outputs = [reading[: self._n + 1]]
        if self._has_wrench:
            outputs.append(self._wrench.Eval(context))
        signals, J = self._signals(reading)
        signals[TAU_J] = self._tau_J.Eval(context)
        table = self._table.EvalAbstract(context).get_value()
        self._observer.kernels.update(table, memory, signals, J)
        return outputs
