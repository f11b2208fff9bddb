"""The wrench at the tool from the external joint torque, as a block."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, DependencyTicket, InputPort

from wrenchsight.models.estimation.torque_error_stage import (
    TorqueError,
    TorqueErrorStage,
)
from wrenchsight.models.estimation.wrench import WrenchEstimate
from wrenchsight.models.estimation.wrench_reading import (
    ReadingSamples,
    ReadingState,
    WrenchReading,
    are_readable,
    with_unseen_rests,
)
from wrenchsight.models.friction.sliding_friction import SlidingLaw
from wrenchsight.models.identification.torque_error_model import ConstantTorqueError
from wrenchsight.models.numerics.arrays import Array, Record
from wrenchsight.models.numerics.finite import LARGEST_INPUT, all_below
from wrenchsight.models.numerics.states import assign_state
from wrenchsight.systems.declarations import (
    OBSERVED_WRENCH_SIZE,
    ObservedWrench,
    ObserverLag,
    TunedParameters,
    declare_cached,
    declare_port_of_each_part,
    joined_ticket,
    parts_of,
    sliding_size,
    terms_at,
    torque_error_size,
)
from wrenchsight.systems.sampled_block import SampledBlock

# (1,) a flag as the row of one sample, by the flag: made once, as a reading takes two at each tick.
_FLAG_ROW = {flag: np.array([flag]) for flag in (False, True)}
_READING_PARTS = {"wrench": 6, "covariance": 36, "condition_number": 1, "valid": 1, "invalid": 1}
_READING_SIZE = sum(_READING_PARTS.values())
_READING_SLICES = parts_of(_READING_PARTS)


class _TunedReading(NamedTuple):
    """The reading with a context's parameters, pole and friction.

    Attributes:
        wrench_reading: with them.
        constant_error: torque error of one sample where the port torque_error is not connected; its
            J_seen is to be filled in.
        is_usable: whether pole and friction law are: `ObserverLag`, `SlidingLaw`.
        unseen_rest_table: `TorqueErrorStage.table`, by which `with_unseen_rests` finds a joint that
            rests and rested in no log of the model. None where no joint can, where friction is not
            known, or without a period: rests are then no reason against a reading.
    """

    wrench_reading: WrenchReading
    constant_error: TorqueError
    is_usable: bool
    unseen_rest_table: Array | None


def reading_parts(estimate: WrenchEstimate) -> Array:
    """(45,) of one sample: the outputs of JacobianWrenchReconstruction but the memory."""
    invalid = estimate.invalid.item()
    parts, slices = np.empty(_READING_SIZE), _READING_SLICES
    parts[slices["wrench"]] = estimate.wrench
    parts[slices["covariance"]] = estimate.covariance.ravel()
    parts[slices["condition_number"]] = estimate.condition_number.item()
    parts[slices["valid"]], parts[slices["invalid"]] = invalid == 0, invalid
    return parts


class JacobianWrenchReconstruction(SampledBlock):
    """Estimates the wrench at E from the external joint torque, with its uncertainty.

        Σ_F = (J Σ_tau⁻¹ Jᵀ + P⁻¹)⁻¹
        F   = Σ_F J Σ_tau⁻¹ tau_ext,     P = diag(prior_moment_sd² 1₃, prior_force_sd² 1₃)

    by default; the other methods (eq. 22 of Lu et al. among them) are those of
    `wrenchsight.models.estimation.wrench`. With the torque error of a model, Σ_tau is that of the
    sample and J is as the observer saw it. Σ_F then covers lag and scale
    (`wrenchsight.models.estimation.wrench_reading`).

                         +------------------------------+ --> wrench
      terms         -->  |                              | --> covariance
      tau_ext       -->  |                              | --> condition_number
      tau_ext_valid -->  | JacobianWrenchReconstruction | --> valid
      corrected     -->  |                              |
      fault         -->  |                              | --> invalid
      observed      -->  |                              | --> reading
      torque_error  -->  |                              |
      pole          -->  |                              |
      sliding       -->  |                              |
                         +------------------------------+

    Inputs:      terms              RigidBodyTerms (abstract): q, v, and J at E in axes of W
                 tau_ext            (n,) N m, positive along the motion it causes
                 tau_ext_valid      (1,) 0 where tau_ext is held or unknown; optional, else 1
                 corrected          (1,) 0 where tau_ext lacks a correction that it should have;
                                    optional, else 1
                 fault              (1,) fault codes of the sample; optional
                 observed           (42,) wrench and covariance, of an observer that reads them
                                    itself; to be left unconnected otherwise
                 torque_error       (ERROR_ROWS n,) of TorqueErrorSystem; left unconnected the error
                                    is of one covariance
                 pole               (n,) 1/s of the observer, below 0 for one without; with
                                    torque_error alone
                 sliding            (10 n,) of FrictionLawSystem; left unconnected, a rest that no
                                    log of the model has seen is no reason against a reading
    Outputs:     wrench             (6,) F_E_W = [mx my mz fx fy fz], N m and N, at E in axes of W,
                                    exerted by the environment on the robot
                 covariance         (36,) of the wrench, row by row, rotation first
                 condition_number   (1,) of J in m and rad; inf where J is singular
                 valid              (1,) 1, or 0 where there is a reason against the reading
                 invalid            (1,) the reasons, a sum of codes of `models.estimation.invalid`
                 reading            these five, one after the other, and then the memory after the
                                    sample, in one port; Drake's Demultiplexer splits it with
                                    `reading_sizes`
                 All with direct feedthrough, all from one computation.
    State:       memory, which `take_sample` updates at each tick: `WrenchReading.initial_state`
    Parameters:  prior_sd           (2,) force, N, and moment, N m; inf where nothing is known
                 torque_covariance  (n²,) Σ_tau, N² m², row by row; of a constant error alone
                 damping            (1,) of method "damped"
                 truncation         (1,) of method "truncated"

    The outputs are always finite, but for the condition number at a singular J. An input that is
    not finite gives a wrench of zero with the prior's covariance, and valid = 0; so does a pole of
    0 to `declarations.MIN_POLE`, behind which no reading settles. Of another input than `observed`
    that is not finite, the observed wrench stays, and is not valid. Of `torque_error` these entries
    count that `are_readable` checks: others are NaN before the first sample.

    Args:
        reading: of one estimator; `WrenchReading.constant(config, torque_covariance)` for errors of
            one covariance.
        time_step: s, period of the ticks; 0 for a reading whose memory decides nothing, as of a
            constant error: the block is then a function of its inputs at any time. A learnt error
            needs its period: its lag and faults are judged by the samples before.

    Attributes:
        reading_sizes: numbers of entries of the parts of `reading`, in their order.

    Raises:
        ValueError: an output is evaluated with a parameter that the reading does not accept.
    """

    def __init__(self, reading: WrenchReading, time_step: float = 0.0) -> None:
        SampledBlock.__init__(self, period=time_step, initial_memory=reading.initial_state())
        self._wrench_reading = reading
        self._n = reading.num_joints
        self._no_signal = np.full((1, self._n), np.nan)  # q, v or tau_ext of a missing sample
        # The reading's parameters become numeric parameters of the Context, which may be changed in
        # a run.
        self._parameters = TunedParameters(self, reading.parameters)
        self._declare_inputs()
        # The reading with parameters, pole and friction as they are now (whitening and prior follow
        # from them): made anew when one of these changes, not at every tick.
        tuned = self._parameters.tickets | {self._pole.ticket(), self._sliding.ticket()}
        self._tuned_reading = declare_cached(self, "tuned reading", self._calc_tuned, tuned)
        self._declare_outputs()

    def _declare_inputs(self) -> None:
        """Declares the inputs. All but terms and tau_ext may be left unconnected.

        A flag then counts as 1, a fault as 0, and a signal as one that no stage gives.
        """
        n = self._n
        self._terms = self.DeclareAbstractInputPort("terms", AbstractValue.Make(object()))
        self._tau_ext = self.DeclareVectorInputPort("tau_ext", n)
        self._tau_ext_valid = self.DeclareVectorInputPort("tau_ext_valid", 1)
        self._corrected = self.DeclareVectorInputPort("corrected", 1)
        self._observed = self.DeclareVectorInputPort("observed", OBSERVED_WRENCH_SIZE)
        self._fault = self.DeclareVectorInputPort("fault", 1)
        self._torque_error = self.DeclareVectorInputPort("torque_error", torque_error_size(n))
        self._pole = self.DeclareVectorInputPort("pole", n)
        self._sliding = self.DeclareVectorInputPort("sliding", sliding_size(n))

    def _declare_outputs(self) -> None:
        """Declares `reading`, which is held from tick to tick, and a port of each of its parts.

        Its last part, the memory after the sample, has none: `take_sample` takes it from there.
        """
        self.reading_sizes = [*_READING_PARTS.values(), self.memory_size]
        # `declare_held_output` would add time and memory to `reading` alone: the parts are held
        # with it, and need them, too. One ticket in the place of all saves Drake edges.
        joined = joined_ticket(self, self._tickets_of_reading() | self.time_and_memory_tickets)
        self._reading = self.declare_held_output(
            "reading", sum(self.reading_sizes), self._calc_reading, joined
        )
        declare_port_of_each_part(self, self._reading.Eval, _READING_PARTS, joined)

    def _tickets_of_reading(self) -> set[DependencyTicket]:
        """What `_calc_reading` evaluates at every tick; `pole` and `sliding` only when they change.

        The tuned reading depends on these two.
        """
        ports = [
            self._terms,
            self._tau_ext,
            self._tau_ext_valid,
            self._corrected,
            self._fault,
            self._observed,
            self._torque_error,
        ]
        return {port.ticket() for port in ports} | {self._tuned_reading.ticket()}

    def _calc_tuned(self, context: Context) -> _TunedReading:
        K_0, is_usable = None, True
        if not isinstance(self._wrench_reading.error, ConstantTorqueError):
            K_0, is_usable = ObserverLag.of(self._pole.Eval(context))
        if self._sliding.HasValue(context):
            is_usable &= SlidingLaw.of_flat(self._sliding.Eval(context)).is_usable
        reading = self._wrench_reading.with_parameters(self._parameters.at(context), K_0)
        error = TorqueError(*(np.zeros_like(part) for part in TorqueError.empty(1, self._n)))
        error.sd[:] = np.sqrt(reading.error.constant**2)  # as the torque error's kernel
        return _TunedReading(
            wrench_reading=reading,
            constant_error=error,
            is_usable=is_usable,
            unseen_rest_table=self._unseen_rest_table(context, K_0) if is_usable else None,
        )

    def _unseen_rest_table(self, context: Context, K_0: Array | None) -> Array | None:
        """`unseen_rest_table` of _TunedReading."""
        if self._period == 0.0 or not self._sliding.HasValue(context):
            return None
        sliding, error = SlidingLaw.of_flat(self._sliding.Eval(context)), self._wrench_reading.error
        stage = TorqueErrorStage(error, sliding, K_0, self._period, None)
        return stage.table if stage.may_rest_unseen else None

    def _calc_reading(self, context: Context, output: BasicVector) -> None:
        """Reads the present sample. `WrenchReading` reads logs: all arrays are logs of one row.

        A sample that cannot be used is read with NaN in the place of motion and torque, which the
        reading takes for a missing one: a zero wrench with the prior's covariance, not valid.
        """
        tuned: _TunedReading = self._tuned_reading.EvalAbstract(context).get_value()
        terms = terms_at(self._terms, context, self._n).record
        error = self._torque_error_at(context, tuned, J=terms["J"])  # checked by `_samples`
        samples = self._samples(context, terms, error, tuned.is_usable)
        entries = output.get_mutable_value()
        # `state` are views of the output's last entries, which this fills with the memory before
        # the sample. `run` makes of them the memory after it; the block's own stays as it is.
        state = self.memory(context, entries[_READING_SIZE:])
        estimate = tuned.wrench_reading.run(state, error, samples)
        if tuned.unseen_rest_table is not None:
            # The same reading, with one reason more against it where a joint that rested in no log
            # of the model rests and carries more than its friction.
            estimate = with_unseen_rests(
                estimate, tuned.unseen_rest_table, error.rows, samples.tau_ext
            )
        entries[:_READING_SIZE] = reading_parts(estimate)

    def _samples(
        self, context: Context, terms: Record, error: TorqueError, is_tuning_usable: bool
    ) -> ReadingSamples:
        """The present sample, of N = 1 row.

        Here are checked q, J, torque error, fault and observed wrench. Where one of them is
        of no use, q, v and tau_ext are NaN: the reading takes the sample for missing, whatever the
        other arrays hold. It does so by itself where v or tau_ext is not finite, or too large for
        its square.

        Args:
            terms: of the input, whose arrays have an axis of one row. tau_ext, which its port gives
                as (n,), gets such an axis here.
            error: of the torque, at the sample; it is only checked here.
            is_tuning_usable: `is_usable` of _TunedReading.
        """
        fault = self._fault_code(context)  # None: the input is no code
        observed = self._observed_wrench(context)  # None: the observer does not read a wrench
        is_observed_usable = observed is None or all_below(observed, LARGEST_INPUT)
        # `are_readable`: these arrays hold finite numbers alone, none beyond the largest input.
        is_readable = are_readable(LARGEST_INPUT, terms["q"], terms["J"], *error)
        is_usable = is_tuning_usable and fault is not None and is_readable and is_observed_usable
        if is_usable:
            q, v, tau_ext = terms["q"], terms["v"], self._tau_ext.Eval(context)[None]
        else:
            q = v = tau_ext = self._no_signal
        # A missing sample is not fresh, whatever the port says.
        is_fresh = is_usable and self._is_set(context, self._tau_ext_valid)
        # None: the reading is of tau_ext.
        observed_wrench, observed_covariance = None, None
        if observed is not None and is_observed_usable:
            parts = ObservedWrench.of_flat(observed)
            observed_wrench, observed_covariance = parts.wrench[None], parts.covariance[None]
        return ReadingSamples(
            J=terms["J"],
            tau_ext=tau_ext,
            is_fresh=_FLAG_ROW[is_fresh],
            q=q,
            v=v,
            is_corrected=_FLAG_ROW[self._is_set(context, self._corrected)],
            fault=np.array([0 if fault is None else fault]),  # None: a missing sample, as above
            wrench=observed_wrench,
            covariance=observed_covariance,
        )

    def _fault_code(self, context: Context) -> int | None:
        """The sum of fault codes of the sample, 0 for none; None where the input is no code.

        It arrives as a double: NaN or a huge number is none.
        """
        if not self._fault.HasValue(context):
            return 0
        fault = self._fault.Eval(context).item()
        return int(fault) if abs(fault) < LARGEST_INPUT else None

    def _torque_error_at(self, context: Context, tuned: _TunedReading, J: Array) -> TorqueError:
        """The torque error of the sample, N = 1; of an unconnected port the constant one."""
        if self._torque_error.HasValue(context):
            return TorqueError.of_flat(self._torque_error.Eval(context), self._n)
        # J_seen is J as it was when the forces acted that a lagging observer shows now. The
        # constant error knows of no lag: it is the sample's J.
        return tuned.constant_error._replace(J_seen=J)

    def _observed_wrench(self, context: Context) -> Array | None:
        """The flat ObservedWrench of an observer that reads it itself; None of any other."""
        return self._observed.Eval(context) if self._observed.HasValue(context) else None

    def _is_set(self, context: Context, port: InputPort) -> bool:
        """Whether a port is 1 or not connected."""
        return not port.HasValue(context) or port.Eval(context).item() == 1.0

    def take_sample(self, context: Context, memory: ReadingState) -> Sequence[Array]:
        entries = self._reading.Eval(context)
        assign_state(memory, self.memory_of(entries[_READING_SIZE:]))
        return (entries,)
