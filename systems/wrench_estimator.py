"""The whole estimator in one block."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, DependencyTicket, InputPort

from wrenchsight.models.estimation.estimator import WrenchEstimator
from wrenchsight.models.estimation.estimator_arrays import (
    Packed,
    tick_sizes,
    workspace_of,
    workspace_size,
)
from wrenchsight.models.estimation.tick import (
    OVERRIDE_CORRECTION,
    OVERRIDE_COUNTS,
    OVERRIDE_SD,
    OVERRIDE_TAU_F,
    tick_output,
    tick_update,
)
from wrenchsight.models.friction.friction_law import FrictionLaw
from wrenchsight.models.friction.velocity_friction import friction_torque
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.observers.sample_check import check_current
from wrenchsight.systems.declarations import TunedParameters, declare_cached, declare_parts
from wrenchsight.systems.sampled_block import SampledBlock


class _Tuned(NamedTuple):
    """Parts that depend on a context's parameters.

    Attributes:
        packed: constants of the tick.
        law: friction law.
        pole: (n,) 1/s of the observer; None for one without.
    """

    packed: Packed
    law: FrictionLaw
    pole: Array | None


class WrenchEstimatorSystem(SampledBlock):
    """Estimates the wrench as `diagrams.estimator.make_estimator` does, in one block.

                        +-----------------------+ --> tau_ext
      q            -->  |                       | --> wrench
      v            -->  |                       | --> covariance
      current      -->  | WrenchEstimatorSystem | --> condition_number
                        |                       | --> valid
                        |                       | --> invalid
                        |                       | --> terms
                        |                       | --> fault
                        |                       | --> checked_current
                        +-----------------------+ --> reading

    Inputs:     as make_estimator's, with `corrected` those of a correction, too
    Outputs:    as make_estimator's: tau_ext, wrench, covariance, condition_number, valid, invalid,
                terms, fault; checked_current (n,) A, NaN where it is impossible;
                reading  the first six one after the other, in this order, then the fault and the
                         memory of the update, in one port; Drake's Demultiplexer splits it with
                         `reading_sizes`
                pole     (n,) 1/s of the observer, below 0 for one without
                law      FrictionLaw (abstract) as it is now
    State:      that of SampledBlock; its memory is `WrenchEstimator.initial_state`
    Parameters: `parameters` has their indices, by the name that they have in the diagram:
                motor.torque_per_ampere, friction.* of the law, observer.* of the observer,
                reconstruction.prior_sd, .damping, .truncation, and .torque_covariance of a model
                without a torque error

    The numbers are those of the diagram and of `WrenchEstimator.run`: the same kernels compute
    them. A tick takes two calls into Python instead of some fifteen: this block is for production.

    Args:
        estimator: robot, model and configuration.
        corrected: whether there are inputs for a correction of tau_ext.

    Raises:
        ValueError: an output is evaluated with a parameter that its part does not accept.
    """

    def __init__(self, estimator: WrenchEstimator, corrected: bool = False) -> None:
        n, period = estimator.num_joints, estimator.observer.time_step
        self._size = sum(tick_sizes(n).values())
        held = {"reading": self._size, "checked_current": n}
        SampledBlock.__init__(self, period, estimator.initial_state(), held)
        self._estimator, self._n = estimator, n
        self._choice = estimator.choice
        self._law = estimator.friction
        self._parameters = TunedParameters(
            self,
            {"motor.torque_per_ampere": estimator.robot.torque_per_ampere}
            | _named("friction.", self._law.parameters)
            | _named("observer.", estimator.observer.parameters)
            | _named("reconstruction.", estimator.reading.parameters),
        )
        self.parameters = self._parameters.indices
        parameters = self._parameters.tickets
        self._q = self.DeclareVectorInputPort("q", n)
        self._v = self.DeclareVectorInputPort("v", n)
        self._current = self.DeclareVectorInputPort("current", n)
        # They change only with the parameters.
        self._tuned = declare_cached(self, "constants, law and pole", self._calc_tuned, parameters)
        prerequisites = self.state_tickets | {
            self._q.ticket(),
            self._v.ticket(),
            self._tuned.ticket(),
        }
        self._correction = self._declare_correction() if corrected else {}
        prerequisites |= {port.ticket() for port in self._correction.values()}
        # An observer that does not read the present torque leaves a loop over it open.
        self._reads_current = estimator.observer.reads_present_torque
        if self._reads_current:
            prerequisites.add(self._current.ticket())
        self._declare_outputs(prerequisites)
        # Scratch memory, allocated once; nothing in it outlives a call.
        self._overrides = np.zeros((len(self._correction), n))
        self._unread = np.zeros(n)
        self._checked = np.zeros((3, n))
        self._scratch = np.empty(workspace_size(n))
        self._checked_in_tick = workspace_of(self._scratch, n).checked[2]  # after an update

    def _declare_correction(self) -> dict[int, InputPort]:
        """Declares the inputs of a correction, by the row of the overrides that they fill."""
        n = self._n
        ports = {
            OVERRIDE_CORRECTION: self.DeclareVectorInputPort("tau_correction", n),
            OVERRIDE_COUNTS: self.DeclareVectorInputPort("correction_valid", 1),
            OVERRIDE_SD: self.DeclareVectorInputPort("correction_sd", n),
        }
        if self._estimator.friction.state_rows == 0:
            ports[OVERRIDE_TAU_F] = self.DeclareVectorInputPort("v_planned", n)
        return ports

    def _declare_outputs(self, prerequisites: set[DependencyTicket]) -> None:
        """Declares the output ports.

        Args:
            prerequisites: of the reading.
        """
        n, parameters = self._n, self._parameters.tickets
        self._reading = self.DeclareVectorOutputPort(
            "reading", self._size, self._calc_reading, prerequisites
        )
        sizes = dict(list(tick_sizes(n).items())[:7])  # tau_ext to fault
        declare_parts(self, self._reading.Eval, sizes, prerequisites)
        drives = self.state_tickets | {self._current.ticket()}
        self._checked_current = self.DeclareVectorOutputPort(
            "checked_current", n, self._calc_checked_current, drives
        )
        self.DeclareAbstractOutputPort(
            "terms",
            lambda: AbstractValue.Make(object()),
            self._calc_terms,
            {self._q.ticket(), self._v.ticket()},
        )
        self.DeclareVectorOutputPort("pole", n, self._calc_pole, parameters)
        self.DeclareAbstractOutputPort(
            "law", lambda: AbstractValue.Make(object()), self._calc_law, parameters
        )

    @property
    def estimator(self) -> WrenchEstimator:
        """The estimator that the block was made of."""
        return self._estimator

    @property
    def reading_sizes(self) -> dict[str, int]:
        """Sizes of the parts of `reading`, in their order: of `tick_sizes`."""
        return tick_sizes(self._n)

    def _calc_tuned(self, context: Context) -> _Tuned:
        estimator, values = self._estimator, self._parameters.at(context)

        def parameters_of(prefix: str) -> dict[str, Array]:
            return {
                name.removeprefix(prefix): value
                for name, value in values.items()
                if name.startswith(prefix)
            }

        observer = estimator.observer.with_parameters(parameters_of("observer."))
        reading = estimator.reading.with_parameters(parameters_of("reconstruction."), observer.pole)
        law = self._law.with_parameters(parameters_of("friction."))
        gain = values["motor.torque_per_ampere"]
        return _Tuned(estimator.packed_with(gain, law, observer, reading), law, observer.pole)

    def _tuned_at(self, context: Context) -> _Tuned:
        tuned: _Tuned = self._tuned.EvalAbstract(context).get_value()
        return tuned

    def _calc_pole(self, context: Context, output: BasicVector) -> None:
        pole = self._tuned_at(context).pole
        output.SetFromVector(np.full(self._n, -1.0) if pole is None else pole)

    def _calc_law(self, context: Context, value: Value) -> None:
        value.set_value(self._tuned_at(context).law)

    def _correct(self, context: Context, packed: Packed) -> None:
        """Writes the overrides of a context's correction."""
        for row, port in self._correction.items():
            values = port.Eval(context)
            if row == OVERRIDE_TAU_F:
                friction_torque(packed.part("friction"), values, self._overrides[row])
            else:
                self._overrides[row] = values

    def _calc_reading(self, context: Context, output: BasicVector) -> None:
        out, held = output.get_mutable_value(), self.held(context, "reading")
        if held is not None:
            out[:] = held
            return
        packed = self._tuned_at(context).packed
        self._correct(context, packed)
        current = self._current.Eval(context) if self._reads_current else self._unread
        sample = (self._q.Eval(context), self._v.Eval(context), current, self._overrides)
        memory = self.memory(context)
        tick_output(self._choice, packed[:], memory, sample, out, self._scratch)

    def take_sample(self, context: Context, memory: Array) -> Sequence[Array]:
        reading, current = self._reading.Eval(context), self._current.Eval(context)
        packed = self._tuned_at(context).packed
        # Of the overrides an update reads only the number of rows.
        sample = (self._q.Eval(context), self._v.Eval(context), current, self._overrides)
        tick_update(self._choice, packed[:], memory, sample, reading, self._scratch)
        # Not the port of the checked current: a call into Python costs as much as a tick.
        return reading, self._checked_in_tick

    def _calc_checked_current(self, context: Context, output: BasicVector) -> None:
        held = self.held(context, "checked_current")
        if held is not None:
            output.SetFromVector(held)
            return
        current, check = self._current.Eval(context), self._estimator.check
        if check is not None:
            memory = self._estimator.parts(self.memory(context)).check
            period = self._estimator.observer.time_step
            check_current(check.table, memory, period, current, self._checked)
            current = self._checked[2]
        output.SetFromVector(current)

    def _calc_terms(self, context: Context, output: Value) -> None:
        output.set_value(self._estimator.chain.terms(self._q.Eval(context), self._v.Eval(context)))


def _named(part: str, values: dict[str, Array]) -> dict[str, Array]:
    """The parameters of a part, by the names that they have in the diagram."""
    return {part + name: value for name, value in values.items()}
