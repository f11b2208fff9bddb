"""The whole estimator in one block."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, InputPort

from wrenchsight.models.estimation.estimator import (
    Correction,
    EstimatorState,
    TakenSamples,
    WrenchEstimator,
)
from wrenchsight.models.friction.sliding_friction import SlidingLaw
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.states import assign_state
from wrenchsight.systems.declarations import (
    TunedParameters,
    declare_cached,
    declare_port_of_each_part,
    sliding_size,
    torque_error_size,
)
from wrenchsight.systems.jacobian_wrench_reconstruction import reading_parts
from wrenchsight.systems.sampled_block import SampledBlock


class _TakenSample(NamedTuple):
    """The present sample, which the stages have taken on a copy of the memory.

    Attributes:
        reading: entries of the port of that name.
        taken: what the stages have found.
        state: of all stages, after the sample where its current was read.
    """

    reading: Array
    taken: TakenSamples
    state: EstimatorState


class WrenchEstimatorSystem(SampledBlock):
    """Estimates the wrench as `diagrams.estimator.make_estimator` does, in one block.

                              +-----------------------+ --> tau_ext
      q                  -->  |                       | --> wrench
      v                  -->  |                       | --> covariance
      current            -->  |                       | --> condition_number
      (tau_correction)   -->  |                       | --> valid
      (correction_valid) -->  | WrenchEstimatorSystem | --> invalid
      (correction_sd)    -->  |                       | --> terms
      (v_planned)        -->  |                       | --> fault
                              |                       | --> tau_J
                              |                       | --> reading
                              |                       | --> pole
                              +-----------------------+ --> sliding

    Inputs:     as make_estimator's; those in brackets with `corrected` alone, v_planned only where
                friction is of the speed alone (`FrictionLaw.is_of_speed_alone`)
    Outputs:    as make_estimator's: tau_ext, wrench, covariance, condition_number, valid, invalid,
                terms, fault; tau_J (n,) N m, NaN where the current is impossible;
                reading  the first six one after the other, in this order, then fault,
                         tau_ext_valid, v (checked), tau_f and torque_error, in one port; Drake's
                         Demultiplexer splits it with `reading_sizes`
                pole     (n,) 1/s of the observer, below 0 for one without
                sliding  (10 n,) SlidingLaw of the friction as it is now, flat
    State:      memory, which `take_sample` updates at each tick: `WrenchEstimator.initial_state`, a
                part for each stage
    Parameters: `parameters` has their indices, by the name that they have in the diagram:
                motor.torque_per_ampere, friction.* of the law, observer.* of the observer,
                reconstruction.prior_sd, .damping, .truncation, and .torque_covariance of a model
                without a torque error

    A tick calls the stages of `WrenchEstimator` one after another for the outputs, without the
    current where the observer does not read the present torque. The update then takes the current
    into the memory (`WrenchEstimator.take_current`), without the stages that do not depend on it.
    That takes two calls from Drake into Python instead of some fifteen.

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
        SampledBlock.__init__(
            self,
            period=estimator.observer.time_step,
            initial_memory=estimator.initial_state(),  # of all stages
        )
        self._estimator = estimator
        self._n = estimator.num_joints
        self.reading_sizes = _reading_sizes(self._n)
        self._declare_parameters()
        self._declare_inputs(corrected)
        self._declare_taken_sample()
        self._declare_outputs()

    def _declare_parameters(self) -> None:
        """Declares the numeric parameters, and the estimator with those of a Context.

        They are the parameters of the estimator's parts, and may be changed in a run. The estimator
        with these is made anew when one changes, not at every tick. `_calc_tuned` gives each part
        its own, by the prefix.
        """
        estimator = self._estimator
        self._parameters = TunedParameters(
            self,
            {"motor.torque_per_ampere": estimator.robot.torque_per_ampere}
            | _with_prefix("friction.", estimator.friction.parameters)
            | _with_prefix("observer.", estimator.observer.parameters)
            | _with_prefix("reconstruction.", estimator.reading.parameters),
        )
        self.parameters = self._parameters.indices
        self._tuned = declare_cached(self, "estimator", self._calc_tuned, self._parameters.tickets)

    def _declare_inputs(self, corrected: bool) -> None:
        """Declares q, v and current, and with `corrected` the inputs of a correction."""
        n = self._n
        self._q = self.DeclareVectorInputPort("q", n)
        self._v = self.DeclareVectorInputPort("v", n)
        self._current = self.DeclareVectorInputPort("current", n)
        # By name; empty where the estimator is not corrected.
        self._correction_ports = self._declare_correction_inputs() if corrected else {}
        # Stands for v_planned where there is no such input: a friction law that is not of the speed
        # alone (`is_of_speed_alone`) does not read it.
        self._no_planned_speed = np.zeros(n)

    def _declare_taken_sample(self) -> None:
        """Declares the cache entry of the present sample's reading, and the state after it.

        It is computed once a tick, by whichever asks first: the port `reading` or the update.

        An observer that does not read the present torque does without feedthrough from the current,
        so that a controller may make the current of the wrench without an algebraic loop. The
        update always reads the current.
        """
        # Exactly the inputs that `_calc_taken_sample` evaluates: Drake takes one that is missing
        # here for unchanged, and one too many for feedthrough.
        ports_of_sample = [self._q, self._v, *self._correction_ports.values()]
        self._reads_current = self._estimator.observer.reads_present_torque
        if self._reads_current:
            ports_of_sample.append(self._current)
        self._taken_sample = declare_cached(
            self,
            "taken sample",
            self._calc_taken_sample,
            {port.ticket() for port in ports_of_sample}
            | {self._tuned.ticket()}
            | self.time_and_memory_tickets,  # which nobody adds to a cache entry
        )

    def _declare_correction_inputs(self) -> dict[str, InputPort]:
        """Declares the inputs of a correction; returns them by name."""
        sizes = {"tau_correction": self._n, "correction_valid": 1, "correction_sd": self._n}
        if self._estimator.friction.is_of_speed_alone:
            sizes["v_planned"] = self._n
        return {name: self.DeclareVectorInputPort(name, size) for name, size in sizes.items()}

    def _declare_outputs(self) -> None:
        """Declares the output ports. Held are `reading`, then `tau_J`: as `take_sample` returns."""
        n, sizes = self._n, self.reading_sizes
        of_reading = {self._taken_sample.ticket()}
        reading = self.declare_held_output(
            "reading", sum(sizes.values()), self._calc_reading, of_reading
        )
        declare_port_of_each_part(self, reading.Eval, sizes, of_reading)
        self.declare_held_output(
            "tau_J", n, self._calc_tau_J, {self._current.ticket(), self._tuned.ticket()}
        )
        # Not held: of q and v as they are now.
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
        if not self._correction_ports:
            return None
        values = {name: port.Eval(context) for name, port in self._correction_ports.items()}
        return Correction(
            tau_correction=values["tau_correction"][None],
            v_planned=values.get("v_planned", self._no_planned_speed)[None],
            counts=values["correction_valid"],
            sd=values["correction_sd"][None],
        )

    def _calc_taken_sample(self, context: Context) -> _TakenSample:
        """Runs all stages over the present sample, on a copy of the memory."""
        estimator, state = self._tuned_at(context), self.memory(context)
        q, v = self._q.Eval(context)[None], self._v.Eval(context)[None]
        correction = self._correction_at(context)
        if self._reads_current:
            current = self._current.Eval(context)[None]
            taken = estimator.take(state, q, v, current, correction=correction)
        else:
            taken = estimator.take_motion(state, q, v, correction)
        wrench_parts = reading_parts(estimator.read(state.reading, taken))
        parts = (  # in the order of `reading_sizes`; `wrench_parts` are five of them
            taken.tau_ext[0],
            wrench_parts,
            taken.fault,
            taken.counts,
            taken.samples.v[0],
            taken.samples.tau_f[0],
            taken.error.flat,
        )
        return _TakenSample(np.concatenate(parts), taken, state)

    def _calc_reading(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._taken_sample.EvalAbstract(context).get_value().reading)

    def take_sample(self, context: Context, memory: EstimatorState) -> Sequence[Array]:
        of_sample: _TakenSample = self._taken_sample.EvalAbstract(context).get_value()
        taken = of_sample.taken
        if self._reads_current:  # the stages have taken the whole sample already
            assign_state(memory, of_sample.state)
            return of_sample.reading, taken.samples.tau_J[0]
        q, v, current = (port.Eval(context)[None] for port in (self._q, self._v, self._current))
        estimator = self._tuned_at(context)
        tau_J = estimator.take_current(memory, of_sample.state, taken, q, v, current)
        return of_sample.reading, tau_J[0]

    def _calc_tau_J(self, context: Context, output: BasicVector) -> None:
        estimator, current = self._tuned_at(context), self._current.Eval(context)[None]
        output.SetFromVector(estimator.checked_torque(self.memory(context).check, current)[0])

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
