"""The whole estimator in one block."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, InputPort

from wrenchsight.models.estimation.estimator import Correction, EstimatorState, WrenchEstimator
from wrenchsight.models.estimation.wrench_reading import ReadingState
from wrenchsight.models.friction.sliding_friction import SlidingLaw
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.systems.declarations import (
    TunedParameters,
    declare_cached,
    declare_port_of_each_part,
    sliding_size,
    torque_error_size,
)
from wrenchsight.systems.jacobian_wrench_reconstruction import reading_parts
from wrenchsight.systems.sampled_block import SampledBlock


class _Tick(NamedTuple):
    """The estimate of the present sample.

    Attributes:
        parts: of the port `reading`.
        reading: the state of the last stage, which has taken the sample.
    """

    parts: Array
    reading: ReadingState


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
                        |                       | --> tau_J
                        +-----------------------+ --> reading

    Inputs:     as make_estimator's, with `corrected` those of a correction, too
    Outputs:    as make_estimator's: tau_ext, wrench, covariance, condition_number, valid, invalid,
                terms, fault; tau_J (n,) N m, NaN where the current is impossible;
                reading  the first six one after the other, in this order, then fault,
                         tau_ext_valid, v (checked), tau_f and torque_error, in one port; Drake's
                         Demultiplexer splits it with `reading_sizes`
                pole     (n,) 1/s of the observer, below 0 for one without
                sliding  (10 n,) SlidingLaw of the friction as it is now, flat
    State:      that of SampledBlock; its memory is `WrenchEstimator.initial_state`
    Parameters: `parameters` has their indices, by the name that they have in the diagram:
                motor.torque_per_ampere, friction.* of the law, observer.* of the observer,
                reconstruction.prior_sd, .damping, .truncation, and .torque_covariance of a model
                without a torque error

    A tick calls the stages of `WrenchEstimator` one after another: up to the reading for the
    outputs, and up to the observer once more for the update, which knows the current. That takes
    two calls from Drake into Python instead of some fifteen.

    Args:
        estimator: robot, model and configuration.
        corrected: whether there are inputs for a correction of tau_ext.

    Attributes:
        reading_sizes: numbers of entries of the parts of `reading`, by name, in their order.
        parameters: indices of the numeric parameters, by name.

    Raises:
        ValueError: an output is evaluated with a parameter that its part does not accept.
    """

    def __init__(self, estimator: WrenchEstimator, corrected: bool = False) -> None:
        n = self._n = estimator.num_joints
        self.reading_sizes = _reading_sizes(n)
        SampledBlock.__init__(
            self,
            period=estimator.observer.time_step,
            initial_memory=estimator.initial_state(),
            # Outputs whose last values stand between two ticks, in the order in which `take_sample`
            # returns them. The output `terms` is not among them: it is of q and v as they are now.
            held_sizes={"reading": sum(self.reading_sizes.values()), "tau_J": n},
        )
        self._estimator = estimator
        # Numeric parameters of the Context, which may be changed in a run.
        self._parameters = TunedParameters(
            self,
            {"motor.torque_per_ampere": estimator.robot.torque_per_ampere}
            | _with_prefix("friction.", estimator.friction.parameters)
            | _with_prefix("observer.", estimator.observer.parameters)
            | _with_prefix("reconstruction.", estimator.reading.parameters),
        )
        self.parameters = self._parameters.indices
        # Drake computes a cache entry anew only when one of its prerequisites has changed. The
        # estimator with these parameters: when one of them changes, not at every tick.
        self._tuned = declare_cached(self, "estimator", self._calc_tuned, self._parameters.tickets)

        self._q = self.DeclareVectorInputPort("q", n)
        self._v = self.DeclareVectorInputPort("v", n)
        self._current = self.DeclareVectorInputPort("current", n)
        self._correction: dict[str, InputPort] = {}
        if corrected:
            self._declare_correction_inputs()

        ports = [self._q, self._v, *self._correction.values()]
        # An observer that does not read the present torque does without this feedthrough, so that a
        # controller may make the current of the wrench without an algebraic loop.
        self._reads_current = estimator.observer.reads_present_torque
        if self._reads_current:
            ports.append(self._current)
        self._unread = np.zeros(n)  # stands for an input that the outputs do without
        prerequisites = {port.ticket() for port in ports} | self.time_and_memory_tickets
        prerequisites.add(self._tuned.ticket())
        # The reading and the state after it: once a tick, whichever output or update asks first.
        self._tick = declare_cached(self, "tick", self._calc_tick, prerequisites)
        self._declare_outputs()

    def _declare_correction_inputs(self) -> None:
        """Declares the inputs of a correction, into `_correction`."""
        sizes = {"tau_correction": self._n, "correction_valid": 1, "correction_sd": self._n}
        if self._estimator.friction.is_of_speed_alone:
            sizes["v_planned"] = self._n
        self._correction = {
            name: self.DeclareVectorInputPort(name, size) for name, size in sizes.items()
        }

    def _declare_outputs(self) -> None:
        """Declares the output ports."""
        n, sizes = self._n, self.reading_sizes
        # They depend on all that the tick does: one edge a port in Drake's graph of dependencies.
        of_tick = {self._tick.ticket()}
        reading = self.DeclareVectorOutputPort(
            "reading", sum(sizes.values()), self._calc_reading, of_tick
        )
        declare_port_of_each_part(self, reading.Eval, sizes, of_tick)
        drives = self.time_and_memory_tickets | {self._current.ticket(), self._tuned.ticket()}
        self.DeclareVectorOutputPort("tau_J", n, self._calc_tau_J, drives)
        self.DeclareAbstractOutputPort(
            "terms",
            lambda: AbstractValue.Make(object()),
            self._calc_terms,
            {self._q.ticket(), self._v.ticket()},
        )
        tuned = {self._tuned.ticket()}
        self.DeclareVectorOutputPort("pole", n, self._calc_pole, tuned)
        self.DeclareVectorOutputPort("sliding", sliding_size(n), self._calc_sliding, tuned)

    @property
    def estimator(self) -> WrenchEstimator:
        """The estimator that the block was made of."""
        return self._estimator

    def _calc_tuned(self, context: Context) -> WrenchEstimator:
        """The estimator with a context's parameters."""
        estimator, values = self._estimator, self._parameters.at(context)

        def parameters_of(prefix: str) -> dict[str, Array]:
            return {
                name.removeprefix(prefix): value
                for name, value in values.items()
                if name.startswith(prefix)
            }

        observer = estimator.observer.with_parameters(parameters_of("observer."))
        return estimator.tuned(
            torque_per_ampere=values["motor.torque_per_ampere"],
            friction=estimator.friction.with_parameters(parameters_of("friction.")),
            observer=observer,
            reading=estimator.reading.with_parameters(
                parameters_of("reconstruction."), observer.pole
            ),
        )

    def _tuned_at(self, context: Context) -> WrenchEstimator:
        tuned: WrenchEstimator = self._tuned.EvalAbstract(context).get_value()
        return tuned

    def _calc_pole(self, context: Context, output: BasicVector) -> None:
        pole = self._tuned_at(context).observer.pole
        output.SetFromVector(np.full(self._n, -1.0) if pole is None else pole)

    def _calc_sliding(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(SlidingLaw.of(self._tuned_at(context).friction).flat)

    def _correction_at(self, context: Context) -> Correction | None:
        """The correction of the present sample."""
        if not self._correction:
            return None
        values = {name: port.Eval(context) for name, port in self._correction.items()}
        return Correction(
            tau_correction=values["tau_correction"][None],
            v_planned=values.get("v_planned", self._unread)[None],
            counts=values["correction_valid"],
            sd=values["correction_sd"][None],
        )

    def _calc_tick(self, context: Context) -> _Tick:
        estimator, state = self._tuned_at(context), self.memory(context)
        current = self._current.Eval(context) if self._reads_current else self._unread
        sample = (self._q.Eval(context)[None], self._v.Eval(context)[None], current[None])
        taken = estimator.take(state, *sample, correction=self._correction_at(context))
        reading = reading_parts(estimator.read(state.reading, taken))
        parts = (
            taken.tau_ext[0],
            reading,
            taken.fault,
            taken.counts,
            taken.samples.v[0],
            taken.samples.tau_f[0],
            taken.error.flat,
        )
        return _Tick(np.concatenate(parts), state.reading)

    def _calc_reading(self, context: Context, output: BasicVector) -> None:
        parts = self.held_output(context, "reading")
        if parts is None:
            parts = self._tick.EvalAbstract(context).get_value().parts
        output.SetFromVector(parts)

    def take_sample(self, context: Context, memory: EstimatorState) -> Sequence[Array]:
        parts, reading = self._tick.EvalAbstract(context).get_value()
        ports = (self._q, self._v, self._current)
        sample = [port.Eval(context)[None] for port in ports]
        correction = self._correction_at(context)
        taken = self._tuned_at(context).take(memory, *sample, correction=correction)
        for array, after in zip(memory.reading, reading, strict=True):
            array[:] = after
        return parts, taken.samples.tau_J[0]

    def _calc_tau_J(self, context: Context, output: BasicVector) -> None:
        tau_J = self.held_output(context, "tau_J")
        if tau_J is None:
            estimator, current = self._tuned_at(context), self._current.Eval(context)[None]
            tau_J = estimator.checked_torque(self.memory(context).check, current)[0]
        output.SetFromVector(tau_J)

    def _calc_terms(self, context: Context, output: Value) -> None:
        output.set_value(self._estimator.chain.terms(self._q.Eval(context), self._v.Eval(context)))


def _reading_sizes(n: int) -> dict[str, int]:
    """Sizes of the parts of `reading`, in their order."""
    return {
        "tau_ext": n,
        "wrench": 6,
        "covariance": 36,
        "condition_number": 1,
        "valid": 1,
        "invalid": 1,
        "fault": 1,
        "tau_ext_valid": 1,
        "v": n,
        "tau_f": n,
        "torque_error": torque_error_size(n),
    }


def _with_prefix(prefix: str, values: dict[str, Array]) -> dict[str, Array]:
    """The parameters of a part of the estimator, by the names that they have in the diagram."""
    return {prefix + name: value for name, value in values.items()}
