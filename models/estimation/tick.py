"""The estimator: its stages, one after another, for one sample or over a log.

    check     faults of the sample                   `models.observers.sample_check`
    terms     M v, C^T v, G, J; motor torque; friction of the velocity alone
    friction  its part with memory                   `models.friction`
    error     uncertainty of the observer's torque   `models.estimation.torque_error_stage`
    observer  tau_ext                                `models.observers`
    reading   wrench, covariance, invalid            `models.estimation.wrench_reading`

`tick_output` computes the estimate right after a sample and leaves the state as it is.
`tick_update` takes the sample into the state. A log runs the same stages; those without memory run
in parallel over its rows. The type of the first argument selects the observer and the friction
law, see `kernel_choice`.

`overrides` replaces parts of the chain from outside. Without rows it changes nothing. Its rows are

    OVERRIDE_CORRECTION  (n,) N m, added to tau_ext
    OVERRIDE_COUNTS      1 in its first entry where the reading counts, else 0
    OVERRIDE_SD          (n,) N m, sd of the correction
    OVERRIDE_TAU_F       (n,) N m, friction in place of the law's; without this row the law holds
"""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.estimation.estimator_arrays import (
    Packed,
    PackedArrays,
    Parameters,
    State,
    parameters_of,
    state_of,
    tick_of,
    workspace_of,
)
from wrenchsight.models.estimation.kernel_choice import KernelChoice, chosen_kernel, has_kernel
from wrenchsight.models.estimation.torque_error_stage import TorqueError, torque_error_tick
from wrenchsight.models.estimation.wrench_reading import (
    ReadingSample,
    ReadingTables,
    read_wrench,
)
from wrenchsight.models.friction.velocity_friction import friction_torque
from wrenchsight.models.identification.torque_error_model import (
    OFFSET,
    REST_ROW,
    VISCOUS,
    friction_at_rest,
    posture_variance_of_links,
    take_transmitted,
)
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.row_blocks import in_row_blocks
from wrenchsight.models.numerics.views import (
    borrowed,
    copy_to,
    copy_whole,
    read_only,
    view_2d,
)
from wrenchsight.models.observers.observer import (
    CTV,
    DRIFT,
    GRAVITY,
    MOMENTUM,
    STICTION,
    TAU_EXT,
    TAU_F,
    TAU_J,
    TORQUE_SD,
    Q,
    V,
)
from wrenchsight.models.observers.sample_check import (
    check_current,
    check_motion,
    take_sample,
)
from wrenchsight.models.rigid_body.chain_kernels import SCRATCH_COLUMNS, observer_terms
from wrenchsight.models.robot.motors import joint_torque

GAIN, MOTOR_RATES = range(2)  # rows of `drives`; the last only of coupled joints
OVERRIDE_CORRECTION, OVERRIDE_COUNTS, OVERRIDE_SD, OVERRIDE_TAU_F = range(4)
FAULT, COUNTS = range(2)  # of a tick's flags

_BLOCK = 1024  # rows a thread takes at a time


@kernel
def _no_wrench(
    table: Array, state: Array, signals: Array, J: Array, wrench: Array, covariance: Array
) -> None:
    """`wrench` of an observer that does not read it."""


_observe = chosen_kernel(0, "output")
_observe_wrench = chosen_kernel(0, "wrench", _no_wrench)
_reads_wrench = has_kernel(0, "wrench")
_update_observer = chosen_kernel(0, "update")
_add_friction = chosen_kernel(1, "add_torque")
_update_friction = chosen_kernel(1, "update")


class TickSample(NamedTuple):
    """One sample as the stages take it; N samples with a first axis.

    Attributes:
        q, v: (n,) rad and rad/s (m and m/s).
        current: (n,) A.
        overrides: (0, n), (3, n) or (4, n), see the module.
    """

    q: Array
    v: Array
    current: Array
    overrides: Array


SampleArrays = tuple[Array, Array, Array, Array]
"""The fields of a TickSample as a plain tuple, for a call from Python, as PackedArrays."""


class TickLog(NamedTuple):
    """Input and output of `memory_log` for N samples.

    Attributes:
        signals, J: (N, NUM_SIGNALS, n) and (N, 6, n) of `terms_log`; the sds are written.
        error: of N samples, written.
        tau_ext: (N, n) N m, written.
        fresh, corrected: (N,) whether tau_ext belongs to the sample, and whether the correction of
            an air pass holds or there is none; written.
        observed: (N, OBSERVED), written by an observer that reads the wrench itself; else (N, 0).
    """

    signals: Array
    J: Array
    error: TorqueError
    tau_ext: Array
    fresh: Flags
    corrected: Flags
    observed: Array


# ----------------------------------------------------------------------------------------------
# The stages
# ----------------------------------------------------------------------------------------------


@kernel(inline="always")
def _terms(
    p: Parameters, sample: TickSample, signals: Array, J: Array, X: Array, bodies: Array
) -> None:
    """Terms that need no memory: writes rows of `signals`, and J.

    signals[TORQUE_SD] holds the posture's variance until `torque_error_tick` makes it an sd.
    """
    q, v, current, overrides = sample
    observer_terms(
        p.chain, q, v, signals[MOMENTUM], signals[CTV], signals[GRAVITY], J, X[:3], X[3], bodies
    )
    posture_variance_of_links(p.error, q, bodies, signals[TORQUE_SD])
    joint_torque(p.drives[GAIN], p.drives[MOTOR_RATES:], current, signals[TAU_J])
    if overrides.shape[0] <= OVERRIDE_TAU_F:
        friction_torque(p.friction, v, signals[TAU_F])
    for i in range(q.shape[0]):
        signals[Q, i] = q[i]
        signals[V, i] = v[i]
        if overrides.shape[0] > OVERRIDE_TAU_F:
            signals[TAU_F, i] = overrides[OVERRIDE_TAU_F, i]


class _Memory(NamedTuple):
    """The stages with memory: the choice of their kernels, their constants and their state."""

    choice: KernelChoice
    p: Parameters
    observer: Array
    s: State


@kernel(inline="always")
def _observed(
    memory: _Memory, overrides: Array, rest: Array, signals: Array, J: Array, wrench: Array
) -> bool:
    """Completes the friction, then runs the observer; returns whether tau_ext is fresh.

    On entry signals[TAU_F] holds the velocity law's torque. `rest` (n,) is the share by which each
    joint rests. An observer that estimates the wrench itself writes `wrench` (OBSERVED,); for any
    other it is (0,).
    """
    choice, p, observer, s = memory
    if overrides.shape[0] <= OVERRIDE_TAU_F:
        if s.friction.shape[0] > 0:
            _add_friction(choice)(p.slip, s.friction, signals[Q], signals[V], signals[TAU_F])
        offset, viscous = p.error[:, OFFSET], p.error[:, VISCOUS]
        friction_at_rest(offset, viscous, rest, signals[V], signals[TAU_F])
    fresh: bool = _observe(choice)(observer, s.observer, signals, J)
    if wrench.shape[0] > 0:
        covariance = view_2d(wrench, 6, 6, 6)
        _observe_wrench(choice)(observer, s.observer, signals, J, wrench[:6], covariance)
    return fresh


@kernel(inline="always")
def _take_sample(memory: _Memory, overrides: Array, signals: Array, J: Array) -> None:
    """Takes the sample into the state of observer, friction law and torque error."""
    choice, p, observer, s = memory
    _update_observer(choice)(observer, s.observer, signals, J)
    if overrides.shape[0] <= OVERRIDE_TAU_F and s.friction.shape[0] > 0:
        load = signals[TAU_J] - signals[TAU_F]
        _update_friction(choice)(p.slip, s.friction, signals[Q], signals[V], load)
    take_transmitted(s.error, signals[TAU_J], signals[TAU_F])


@kernel(inline="always")
def _add_correction_sd(overrides: Array, sd: Array) -> None:
    """Adds the sd of the correction to that of tau_ext (n,)."""
    if overrides.shape[0] > OVERRIDE_SD:
        for i in range(sd.shape[0]):
            sd[i] = np.sqrt(sd[i] ** 2 + overrides[OVERRIDE_SD, i] ** 2)


@kernel(inline="always")
def _corrected(overrides: Array, signals: Array, tau_ext: Array) -> bool:
    """Writes the corrected tau_ext (n,); returns whether its correction holds."""
    holds: bool = overrides.shape[0] == 0 or overrides[OVERRIDE_COUNTS, 0] == 1.0
    for i in range(tau_ext.shape[0]):
        tau_ext[i] = signals[TAU_EXT, i]
        if overrides.shape[0] > 0:
            if np.isfinite(overrides[OVERRIDE_CORRECTION, i]):
                tau_ext[i] += overrides[OVERRIDE_CORRECTION, i]
            else:
                holds = False
    return holds


@kernel(inline="always")
def _is_finite(x: Array, y: Array) -> bool:
    """Whether all entries of both (n,) are finite."""
    total = 0.0
    for i in range(x.shape[0]):
        total += 0.0 * x[i] + 0.0 * y[i]
    return total == 0.0


@kernel(inline="always")
def _borrowed_sample(sample: SampleArrays) -> TickSample:
    """The same arrays, without reference counts."""
    q, v, current, overrides = sample
    return TickSample(borrowed(q), borrowed(v), borrowed(current), borrowed(overrides))


# ----------------------------------------------------------------------------------------------
# One sample
# ----------------------------------------------------------------------------------------------


@kernel
def tick_output(
    choice: KernelChoice,
    packed: PackedArrays,
    state: Array,
    sample: SampleArrays,
    out: Array,
    scratch: Array,
) -> None:
    """First half of a tick: estimates right after a sample; `state` stays as it is.

    The current plays no part for an observer that does not read the present torque.

    Args:
        choice: of the observer's and the friction law's kernels.
        packed: the constants, a Packed.
        state: (`state_size`,).
        sample: a TickSample.
        out: (sum of `tick_sizes`,), written: a Tick.
        scratch: (`workspace_size`,), overwritten.
    """
    q, v, current, overrides = _borrowed_sample(sample)
    n = q.shape[0]
    values, layout, table = packed
    observer, state = borrowed(table), borrowed(state)
    p, s = parameters_of(borrowed(values), layout), state_of(state, layout, n)
    tick, work = tick_of(borrowed(out), n), workspace_of(borrowed(scratch), n)
    checked = work.checked
    tick.flags[FAULT] = 0.0
    if p.check.shape[0] > 0:
        tick.flags[FAULT] = check_motion(p.check, s.check, p.period[0, 0], q, v, checked)
        check_current(p.check, s.check, p.period[0, 0], current, checked)
    else:
        copy_to(checked[0], q)
        copy_to(checked[1], v)
        copy_to(checked[2], current)
    signals, J = tick.signals, tick.J
    checked_sample = TickSample(checked[0], checked[1], checked[2], overrides)
    _terms(p, checked_sample, signals, J, work.X, work.bodies)
    copy_whole(tick.error_state, s.error)
    torque_error_tick(p.error, p.poles[0], tick.error_state, signals[Q], signals[V], J, tick.error)
    _add_correction_sd(overrides, tick.error.sd)
    observed = tick.observed if _reads_wrench(choice) else tick.observed[:0]
    memory, rest = _Memory(choice, p, observer, s), tick.error.rows[REST_ROW]
    fresh = _observed(memory, overrides, rest, signals, J, observed)
    is_corrected = _corrected(overrides, signals, tick.tau_ext)
    tick.flags[COUNTS] = 1.0 if fresh and is_corrected else 0.0
    copy_whole(tick.reading_state, s.reading)
    read_wrench(
        ReadingTables(p.read_load[0], p.lag[0], p.explained[0], p.faults[0], p.wrench),
        tick.reading_state,
        tick.error,
        ReadingSample(
            J,
            tick.tau_ext,
            fresh,
            not _is_finite(signals[Q], signals[V]),
            is_corrected,
            int(tick.flags[FAULT]),
            observed,
        ),
        tick.reading,
        work.reading,
    )


@kernel
def tick_update(
    choice: KernelChoice,
    packed: PackedArrays,
    state: Array,
    sample: SampleArrays,
    out: Array,
    scratch: Array,
) -> None:
    """Second half of a tick: takes the sample into the state.

    Args:
        state: changed.
        out: of `tick_output` for the same sample.
        others: as `tick_output`.
    """
    q, v, current, overrides = _borrowed_sample(sample)
    n = q.shape[0]
    values, layout, table = packed
    observer, state = borrowed(table), borrowed(state)
    p, s = parameters_of(borrowed(values), layout), state_of(state, layout, n)
    tick, work = tick_of(borrowed(out), n), workspace_of(borrowed(scratch), n)
    checked, signals = work.checked, tick.signals
    if p.check.shape[0] > 0:
        copy_to(checked[0], signals[Q])
        copy_to(checked[1], signals[V])
        check_current(p.check, s.check, p.period[0, 0], current, checked)
        take_sample(p.check, s.check, p.period[0, 0], q, v, current, checked)
    else:
        copy_to(checked[2], current)
    joint_torque(p.drives[GAIN], p.drives[MOTOR_RATES:], checked[2], signals[TAU_J])
    copy_whole(s.error, tick.error_state)
    copy_whole(s.reading, tick.reading_state)
    _take_sample(_Memory(choice, p, observer, s), overrides, signals, tick.J)


@kernel
def estimate_tick(
    choice: KernelChoice,
    packed: PackedArrays,
    state: Array,
    sample: Array,
    overrides: Array,
    out: Array,
    scratch: Array,
) -> None:
    """Both halves of a tick; `sample` (3, n) q, v and current, the others as `tick_output`."""
    # A plain tuple, as the blocks pass it: a kernel is compiled anew for each type of argument.
    arrays = (sample[0], sample[1], sample[2], overrides)
    tick_output(choice, packed, read_only(state), arrays, out, scratch)
    tick_update(choice, packed, state, arrays, out, scratch)


# ----------------------------------------------------------------------------------------------
# A log
# ----------------------------------------------------------------------------------------------


def terms_log(packed: Packed, samples: TickSample, signals: Array, J: Array) -> None:
    """Terms of N samples that need no memory, by threads.

    Args:
        packed: the constants.
        samples: (N, n) each, checked; overrides (N, 0, n), (N, 3, n) or (N, 4, n).
        signals: (N, NUM_SIGNALS, n), written but for the rows of the stages with memory.
        J: (N, 6, n), written.
    """

    def run(rows: slice) -> None:
        block = TickSample(
            samples.q[rows], samples.v[rows], samples.current[rows], samples.overrides[rows]
        )
        _terms_rows(packed, block, signals[rows], J[rows])

    in_row_blocks(run, len(samples.q), _BLOCK)


@kernel(nogil=True)
def _terms_rows(packed: Packed, samples: TickSample, signals: Array, J: Array) -> None:
    q, v, current, overrides = _borrowed_sample(samples)
    signals, J = borrowed(signals), borrowed(J)
    p = parameters_of(borrowed(packed.values), packed.layout)
    X, bodies = np.empty((4, 3)), np.empty((q.shape[1], SCRATCH_COLUMNS))
    for k in range(q.shape[0]):
        sample = TickSample(q[k], v[k], current[k], overrides[k])
        _terms(p, sample, signals[k], J[k], X, bodies)


@kernel
def memory_log(
    choice: KernelChoice, packed: Packed, state: Array, overrides: Array, log: TickLog
) -> None:
    """Runs the stages with memory over N samples of `terms_log`.

    Args:
        choice, packed: as `tick_output`.
        state: changed.
        overrides: (N, 0, n), (N, 3, n) or (N, 4, n).
        log: written.
    """
    n, observer = log.signals.shape[2], borrowed(packed.observer)
    overrides, signals_log, J = borrowed(overrides), borrowed(log.signals), borrowed(log.J)
    error, tau_ext, observed = log.error, borrowed(log.tau_ext), borrowed(log.observed)
    J_seen, error_rows = borrowed(error.J_seen), borrowed(error.rows)
    sd, stiction, drift = borrowed(error.sd), borrowed(error.stiction), borrowed(error.drift)
    p = parameters_of(borrowed(packed.values), packed.layout)
    s = state_of(borrowed(state), packed.layout, n)
    memory = _Memory(choice, p, observer, s)
    for k in range(signals_log.shape[0]):
        signals = signals_log[k]
        sample_error = TorqueError(
            signals[TORQUE_SD], signals[STICTION], signals[DRIFT], J_seen[k], error_rows[k]
        )
        torque_error_tick(p.error, p.poles[0], s.error, signals[Q], signals[V], J[k], sample_error)
        _add_correction_sd(overrides[k], sample_error.sd)
        copy_to(sd[k], sample_error.sd)
        copy_to(stiction[k], sample_error.stiction)
        copy_to(drift[k], sample_error.drift)
        rest = sample_error.rows[REST_ROW]
        fresh = _observed(memory, overrides[k], rest, signals, J[k], observed[k])
        _take_sample(memory, overrides[k], signals, J[k])
        log.fresh[k] = fresh
        log.corrected[k] = _corrected(overrides[k], signals, tau_ext[k])
