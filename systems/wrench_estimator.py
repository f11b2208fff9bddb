"""The whole estimator in one block."""

from dataclasses import replace

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
from wrenchsight.models.estimation.estimator import EstimatorTables, WrenchEstimator
from wrenchsight.models.estimation.kernel_choice import KernelChoice
from wrenchsight.models.estimation.tick import (
    KNOWN_CORRECTION,
    KNOWN_COUNTS,
    KNOWN_TAU_F,
    output_size,
    scratch_size,
    tick_output,
    tick_update,
    trusted_output,
    trusted_update,
)
from wrenchsight.models.estimation.wrench import WrenchReconstruction
from wrenchsight.models.friction.velocity_friction import friction_torque
from wrenchsight.models.observers.sample_check import check_current, check_motion, check_sample
from wrenchsight.systems.last_tick import LastTick

_Taking = tuple[KernelChoice, Array, Array, Array, int, int, Array, int, Array, Array]


class WrenchEstimatorSystem(LeafSystem):
    """What `diagrams.estimator.make_estimator` builds out of blocks, as one: for production.

                        +-----------------------+ --> tau_ext
      q            -->  |                       | --> wrench
      v            -->  |                       | --> covariance
      current      -->  | WrenchEstimatorSystem | --> condition_number
                        |                       | --> valid
                        |                       | --> terms
                        |                       | --> fault
                        |                       | --> checked_current
                        +-----------------------+ --> reading

    Inputs:     as make_estimator's, those of `taught` among them
    Outputs:    as make_estimator's: tau_ext, wrench, covariance, condition_number, valid, terms,
                fault; checked_current (n,) A, NaN where it is impossible;
                reading  (n + 44 + ...,) the first five one after the other, in this order, then
                         what the update takes, in one port; Drake's Demultiplexer splits it with
                         `reading_sizes`
    State:      the observer's rows, then the friction law's, then those of the reading that knows
                the torque error and of the check of samples, flat
    Parameters: `parameters` has their indices, by the name that they have in the diagram:
                motor.torque_per_ampere, friction.* of the law, observer.* of the observer,
                reconstruction.prior_sd, .torque_covariance, .damping, .truncation, the latter
                for a model without a torque error

    Between two ticks the outputs are those of the last one.

    The numbers are those of the diagram and of `WrenchEstimator.run`: the same kernels compute
    them. A tick takes two calls into Python, in the place of some fifteen.

    Args:
        estimator: robot, model and configuration.
        taught: whether there are inputs tau_correction, v_planned and counts.

    Raises:
        ValueError: when a parameter is changed to what its part does not accept and an output is
            then evaluated.
    """

    def __init__(self, estimator: WrenchEstimator, taught: bool = False) -> None:
        LeafSystem.__init__(self)
        self._estimator = estimator
        self._taught = taught
        self._trusted = estimator.trusted
        self._n = n = estimator.num_joints
        self._choice, self._rows = estimator.choice, estimator.observer_rows
        # A law without memory is taken at the speeds that were planned.
        self._planned = taught and estimator.friction.state_rows == 0
        self._law = estimator.friction
        self._shapes: dict[str, tuple[int, ...]] = {}
        self.parameters: dict[str, NumericParameterIndex] = {}
        self._declare_parameters()
        self._q, self._v, self._current = (
            self.DeclareVectorInputPort(name, n) for name in ("q", "v", "current")
        )
        initial = estimator.initial_state()[: estimator.tick_rows]
        self._tick_rows = len(initial)
        if self._trusted is not None:
            initial = np.vstack([initial, self._trusted.initial_state()])
        self._end = initial.size  # of what the tick's kernels take
        self._check = estimator.check
        if self._check is not None:
            initial = np.vstack([initial, self._check.initial_state()])
        self._initial = initial.ravel()
        state: DiscreteStateIndex = self.DeclareDiscreteState(self._initial)
        self.DeclarePeriodicDiscreteUpdateEvent(estimator.observer.time_step, 0.0, self._update)
        self._tables = self.DeclareCacheEntry(
            "estimator tables",
            ValueProducer(allocate=lambda: AbstractValue.Make(object()), calc=self._calc_tables),
            {self.numeric_parameter_ticket(index) for index in self.parameters.values()},
        )
        # Kept: `reading`, the checked current, `fault`.
        self._last = LastTick(self, estimator.observer.time_step, sum(self.reading_sizes) + n + 1)
        prerequisites = self._last.tickets | {
            self._q.ticket(),
            self._v.ticket(),
            self.discrete_state_ticket(state),
            self._tables.ticket(),
        }
        # An observer that does not read the present torque leaves a loop over it open.
        self._reads_current = estimator.observer.reads_present_torque
        if self._reads_current:
            prerequisites.add(self._current.ticket())
        if taught:
            self._correction = self.DeclareVectorInputPort("tau_correction", n)
            self._v_planned = self.DeclareVectorInputPort("v_planned", n)
            self._counts = self.DeclareVectorInputPort("counts", 1)
            for port in (self._correction, self._v_planned, self._counts):
                prerequisites.add(port.ticket())
        self._reading = self.DeclareVectorOutputPort(
            "reading", sum(self.reading_sizes), self._calc_reading, prerequisites
        )
        start = 0
        for name, size in zip(
            ("tau_ext", "wrench", "covariance", "condition_number", "valid"),
            self.reading_sizes,
            strict=False,
        ):
            part = slice(start, start + size)
            self.DeclareVectorOutputPort(
                name,
                size,
                lambda context, output, part=part: output.SetFromVector(
                    self._reading.Eval(context)[part]
                ),
                prerequisites,
            )
            start += size
        memory = self._last.tickets | {self.discrete_state_ticket(state)}
        motion = memory | {self._q.ticket(), self._v.ticket()}
        self._fault = self.DeclareVectorOutputPort("fault", 1, self._calc_fault, motion)
        drives = memory | {self._current.ticket()}
        self._checked_current = self.DeclareVectorOutputPort(
            "checked_current", n, self._calc_checked_current, drives
        )
        self.DeclareAbstractOutputPort(
            "terms",
            lambda: AbstractValue.Make(object()),
            self._calc_terms,
            {self._q.ticket(), self._v.ticket()},
        )
        # Memory that is settled once; nothing in it outlives a call.
        self._known = np.zeros((2 + self._planned if taught else 0, n))
        self._unread = np.zeros(n)
        self._checked = np.zeros((3, n))
        self._given = np.zeros((3, n))
        self._scratch = np.empty(scratch_size(n))

    @property
    def estimator(self) -> WrenchEstimator:
        """Robot, model and configuration."""
        return self._estimator

    @property
    def reading_sizes(self) -> list[int]:
        """Of tau_ext, wrench, covariance, condition_number, valid and the rest in `reading`."""
        sizes = [self._n, 6, 36, 1, 1]
        more = 0 if self._trusted is None else self._trusted.state_rows * self._n
        return [*sizes, output_size(self._n) - sum(sizes) + more]

    def _declare_parameters(self) -> None:
        estimator = self._estimator
        reconstruction = estimator.config.reconstruction
        prior = (reconstruction.prior_force_sd, reconstruction.prior_moment_sd)
        reading = {
            "reconstruction.prior_sd": np.array([np.inf if sd is None else sd for sd in prior]),
            "reconstruction.torque_covariance": estimator.reconstruction.torque_covariance,
            "reconstruction.damping": np.array([reconstruction.damping]),
            "reconstruction.truncation": np.array([reconstruction.truncation]),
        }
        values: dict[str, Array] = {
            "motor.torque_per_ampere": estimator.robot.torque_per_ampere,
            **{f"friction.{name}": value for name, value in self._law.parameters.items()},
            **{f"observer.{name}": value for name, value in estimator.observer.parameters.items()},
            **(reading if self._trusted is None else {}),
        }
        for name, value in values.items():
            self._shapes[name] = value.shape
            self.parameters[name] = NumericParameterIndex(
                self.DeclareNumericParameter(BasicVector(value.ravel()))
            )

    def _calc_tables(self, context: Context, value: Value) -> None:
        estimator = self._estimator
        values = {
            name: np.array(context.get_numeric_parameter(index).value()).reshape(self._shapes[name])
            for name, index in self.parameters.items()
        }

        def own(part: str) -> dict[str, Array]:
            return {
                name.removeprefix(part): found
                for name, found in values.items()
                if name.startswith(part)
            }

        reconstruction = estimator.reconstruction
        if self._trusted is None:
            wrench = own("reconstruction.")
            config = replace(
                estimator.config.reconstruction,
                prior_force_sd=float(wrench["prior_sd"][0]),
                prior_moment_sd=float(wrench["prior_sd"][1]),
                damping=float(wrench["damping"][0]),
                truncation=float(wrench["truncation"][0]),
            )
            reconstruction = WrenchReconstruction(config, wrench["torque_covariance"])
        tables = estimator.tables_of(
            values["motor.torque_per_ampere"],
            self._law.with_parameters(own("friction.")),
            estimator.observer.with_parameters(own("observer.")),
            reconstruction,
        )
        value.set_value(tables)

    def initial_state(self) -> Array:
        """Flat: before the first sample."""
        return self._initial.copy()

    def default_tables(self) -> EstimatorTables:
        """The constants of the estimator as it was given, whatever a context holds."""
        return self._estimator.tables

    @property
    def taking(self) -> _Taking:
        """What an update gives its kernels of an estimator as it was given, for one kernel of all.

        Choice, drives, slip, observer, the observer's rows, those before a trusted reading's or -1,
        the table of the check of samples or one without rows, entries that the update takes, and
        memory: `known` and (3, n) to work in.
        """
        tables, check = self._estimator.tables, self._check
        return (
            *(self._choice, tables.drives, tables.slip, tables.observer, self._rows),
            -1 if self._trusted is None else self._tick_rows,
            np.empty((0, self._n)) if check is None else check.table,
            *(self._end, self._known, self._checked),
        )

    def read(
        self,
        tables: EstimatorTables,
        state: Array,
        q: Array,
        v: Array,
        current: Array,
        taught: tuple[Array, Array, float] | None,
        reading: Array,
    ) -> None:
        """The first half of a tick: writes the port `reading` of a sample; `state` stays.

        Args:
            tables: constants.
            state: flat.
            q, v, current: (n,); current counts where the observer reads the present torque.
            taught: tau_correction (n,), v_planned (n,) and counts; None where nothing is taught.
        """
        if taught is not None:
            correction, v_planned, counts = taught
            if self._planned:
                friction_torque(tables.friction, v_planned, self._known[KNOWN_TAU_F])
            self._known[KNOWN_CORRECTION] = correction
            self._known[KNOWN_COUNTS] = counts
        if self._check is not None:
            checked, memory = self._checked, self._memory(state)
            table, T = self._check.table, self._estimator.observer.time_step
            check_motion(table, memory, T, q, v, checked)
            if self._reads_current:
                check_current(table, memory, T, current, checked)
                current = checked[2]
            q, v = checked[0], checked[1]
        sample = (state[: self._end], q, v, current, self._known, reading, self._scratch)
        if self._trusted is None:
            tick_output(self._choice, *tables, self._rows, *sample)
        else:
            trusted_output(
                self._choice,
                *tables[:-1],
                *self._trusted.tables,
                self._rows,
                self._tick_rows,
                *sample,
            )

    def _calc_reading(self, context: Context, output: BasicVector) -> None:
        if self._last.is_between(context):
            output.SetFromVector(self._last.values(context)[: sum(self.reading_sizes)])
            return
        taught = None
        if self._taught:
            taught = (
                self._correction.Eval(context),
                self._v_planned.Eval(context),
                self._counts.Eval(context)[0],
            )
        self.read(
            self._tables.EvalAbstract(context).get_value(),
            context.get_discrete_state(0).value(),
            self._q.Eval(context),
            self._v.Eval(context),
            self._current.Eval(context) if self._reads_current else self._unread,
            taught,
            output.get_mutable_value(),
        )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        last = [self._reading, self._checked_current, self._fault]
        self._last.take(context, discrete_state, *(port.Eval(context) for port in last))
        tables = self._tables.EvalAbstract(context).get_value()
        parts = (self._choice, tables.drives, tables.slip, tables.observer, self._rows)
        state, current = discrete_state.get_mutable_value(0), self._current.Eval(context)
        if self._check is not None:
            given = self._given
            given[0], given[1], given[2] = self._q.Eval(context), self._v.Eval(context), current
            period = self._estimator.observer.time_step
            check_sample(self._check.table, self._memory(state), period, given, self._checked)
            current = self._checked[2]
        # Of `known` an update asks no more than how many rows it has.
        sample = (state[: self._end], current, self._known, self._reading.Eval(context))
        if self._trusted is None:
            tick_update(*parts, *sample)
        else:
            trusted_update(*parts, self._tick_rows, *sample)

    def _memory(self, state: Array) -> Array:
        """The state's rows of the check of samples."""
        return state[self._end :].reshape(-1, self._n)

    def _calc_fault(self, context: Context, output: BasicVector) -> None:
        if self._last.is_between(context):
            output.SetAtIndex(0, self._last.values(context)[-1])
            return
        fault = 0
        if self._check is not None:
            memory = self._memory(context.get_discrete_state(0).value())
            fault = check_motion(
                *(self._check.table, memory, self._estimator.observer.time_step),
                *(self._q.Eval(context), self._v.Eval(context), self._checked),
            )
        output.SetAtIndex(0, fault)

    def _calc_checked_current(self, context: Context, output: BasicVector) -> None:
        if self._last.is_between(context):
            output.SetFromVector(self._last.values(context)[-1 - self._n : -1])
            return
        current = self._current.Eval(context)
        if self._check is not None:
            memory = self._memory(context.get_discrete_state(0).value())
            period = self._estimator.observer.time_step
            check_current(self._check.table, memory, period, current, self._checked)
            current = self._checked[2]
        output.SetFromVector(current)

    def _calc_terms(self, context: Context, output: Value) -> None:
        output.set_value(self._estimator.chain.terms(self._q.Eval(context), self._v.Eval(context)))
