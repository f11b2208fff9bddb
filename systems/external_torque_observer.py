"""An observer of external joint torque as a block, whatever its kind."""

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, DependencyTicket, InputPort

from wrenchsight.models.estimation.torque_error_stage import TorqueError
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.observer import Observer, ObserverSamples
from wrenchsight.systems.declarations import (
    OBSERVED_WRENCH_SIZE,
    ObservedWrench,
    TunedParameters,
    declare_cached,
    declare_held_outputs,
    parts_of,
    terms_at,
    torque_error_size,
)
from wrenchsight.systems.sampled_block import SampledBlock


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
                wrench   (42,) F_E_W and its covariance, row by row, of an observer that reads the
                         wrench itself; others have no such port
                reading  these, one after the other, in one port; Drake's Demultiplexer splits it
                         with `reading_sizes`
                pole     (n,) 1/s, below 0 for an observer without one
    State:      memory, which `take_sample` updates at each tick: the observer's,
                `Observer.initial_state`
    Parameters: of the observer, in its order

    Args:
        observer: of `wrenchsight.models.observers.observer_kinds`.

    Attributes:
        reading_sizes: sizes of the parts of `reading`: tau_ext, valid, and wrench if there is one.

    Raises:
        ValueError: when a parameter is changed to what the observer does not accept and an output
            is then evaluated.
    """

    uses_sd: ClassVar[bool] = True
    """Whether there is an input torque_error."""

    def __init__(self, observer: Observer) -> None:
        SampledBlock.__init__(
            self, period=observer.time_step, initial_memory=observer.initial_state()
        )
        self._observer = observer
        self._n = observer.num_joints
        # The observer's parameters become numeric parameters of the Context, which may be changed
        # in a run. The observer with these is made anew when one changes, not at every tick.
        self._parameters = TunedParameters(self, observer.parameters)
        self._tuned_observer = declare_cached(
            self, "observer", self._calc_observer, self._parameters.tickets
        )
        self._declare_inputs()
        self._declare_outputs()

    def _declare_inputs(self) -> None:
        """Declares the inputs; torque_error is there only where the class has `uses_sd`."""
        n = self._n
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._tau_J = self.DeclareVectorInputPort("tau_J", n)
        self._tau_f = self.DeclareVectorInputPort("tau_f", n)
        self._torque_error: InputPort | None = None
        if self.uses_sd:
            self._torque_error = self.DeclareVectorInputPort("torque_error", torque_error_size(n))
        # Stand for inputs that are not read: as observers have them, logs of one sample.
        self._no_torque = np.zeros((1, n))  # N m
        self._no_error = TorqueError.of_flat(np.zeros(torque_error_size(n)), n)

    def _declare_outputs(self) -> None:
        """Declares `reading`, which is held from tick to tick, a port of each part, and `pole`."""
        sizes = {"tau_ext": self._n, "valid": 1}
        if self._observer.reads_wrench:
            sizes["wrench"] = OBSERVED_WRENCH_SIZE
        self.reading_sizes = list(sizes.values())
        self._parts = parts_of(sizes)  # of `reading`, by which `_observe` writes them
        self._reading = declare_held_outputs(
            self,
            sizes,
            self._calc_reading,
            self._tickets_of_reading(),
            whole_name="reading",
        )
        # Not held: it follows from the parameters alone.
        self.DeclareVectorOutputPort("pole", self._n, self._calc_pole, self._parameters.tickets)

    def _tickets_of_reading(self) -> set[DependencyTicket]:
        """What `_calc_reading` reads, besides time and memory: `declare_held_outputs` adds these.

        An observer that does not read the present torque does without the feedthrough from tau_J,
        so that a controller may make tau_J of the estimate without an algebraic loop. Zeros then
        stand for tau_J in the outputs; the update always reads it.
        """
        ports = [self._terms, self._tau_f]
        if self._torque_error is not None:
            ports.append(self._torque_error)
        if self._observer.reads_present_torque:
            ports.append(self._tau_J)
        return {port.ticket() for port in ports} | {self._tuned_observer.ticket()}

    def _calc_observer(self, context: Context) -> Observer:
        """The observer with the parameters of a context."""
        return self._observer.with_parameters(self._parameters.at(context))

    def _calc_pole(self, context: Context, output: BasicVector) -> None:
        pole = self._tuned_observer.EvalAbstract(context).get_value().pole
        output.SetFromVector(np.full(self._n, -1.0) if pole is None else pole)

    def _samples(self, context: Context, tau_J: Array) -> ObserverSamples:
        """The present sample; tau_J (1, n)."""
        error = self._no_error
        if self._torque_error is not None and self._torque_error.HasValue(context):
            error = TorqueError.of_flat(self._torque_error.Eval(context), self._n)
        terms = terms_at(self._terms, context, self._n).record
        return ObserverSamples(
            q=terms["q"],
            v=terms["v"],
            momentum=terms["momentum"],
            CTv=terms["CTv"],
            G=terms["G"],
            tau_J=tau_J,
            tau_f=self._tau_f.Eval(context)[None],
            J=terms["J"],
            sd=error.sd,
            stiction=error.stiction,
            drift=error.drift,
        )

    def _observe(self, context: Context, memory: Any, tau_J: Array, reading: Array) -> None:
        """Writes the reading of the present sample, which `memory` takes; tau_J (1, n)."""
        observer: Observer = self._tuned_observer.EvalAbstract(context).get_value()
        observed, parts = observer.observe(memory, self._samples(context, tau_J)), self._parts
        reading[parts["tau_ext"]] = observed.tau_ext
        reading[parts["valid"]] = observed.is_fresh.item()
        if observed.wrench is not None and observed.covariance is not None:
            written = ObservedWrench.of_flat(reading[parts["wrench"]])
            written.wrench[:], written.covariance[:] = observed.wrench[0], observed.covariance[0]

    def _calc_reading(self, context: Context, output: BasicVector) -> None:
        tau_J = self._no_torque
        if self._observer.reads_present_torque:
            tau_J = self._tau_J.Eval(context)[None]
        self._observe(context, self.memory(context), tau_J, output.get_mutable_value())

    def take_sample(self, context: Context, memory: Any) -> Sequence[Array]:
        reading = np.empty(self._reading.size())
        self._observe(context, memory, self._tau_J.Eval(context)[None], reading)
        return (reading,)
