"""The estimator: its stages, one after another, for one sample or over a log.

    check     what of the sample cannot be           `models.observers.sample_check`
    terms     M v, C^T v, G, J; motor torque; friction of the velocity alone
    friction  what friction remembers                `models.friction`
    error     how far the observer may be off        `models.estimation.torque_error_stage`
    observer  tau_ext                                `models.observers`
    reading   wrench, covariance, valid              `models.estimation.wrench_reading`

`tick_output` is what is read right after a sample and leaves the state as it is, `tick_update`
takes the sample into the state; a log runs the same stages, those without memory in parallel over
its rows. Which observer and which friction law run is part of the first argument's type, see
`kernel_choice`. `known` without rows is the plain estimator. Otherwise it holds, row by row, what
is to be added to tau_ext (n,) N m, in its first entry 1 where the reading counts, else 0, the sd of
what is added (n,) N m, and where friction is known from elsewhere, so that the law has no say, its
torque (n,) N m.
"""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.estimation.estimator_arrays import (
    Packed,
    Parameters,
    State,
    parameters_of,
    state_of,
    tick_of,
    workspace_of,
)
from wrenchsight.models.estimation.kernel_choice import KernelChoice, chosen_kernel, has_kernel
from wrenchsight.models.estimation.torque_error_stage import TorqueError, torque_error_tick
from wrenchsight.models.estimation.wrench_reading import read_wrench
from wrenchsight.models.friction.velocity_friction import friction_torque
from wrenchsight.models.identification.torque_error_model import (
    posture_variance_of_links,
    take_transmitted,
)
from wrenchsight.models.numerics.arrays import Array, Flags
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.row_blocks import in_row_blocks
from wrenchsight.models.numerics.views import (
    Layout,
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
    BEYOND,
    check_current,
    check_motion,
    take_sample,
)
from wrenchsight.models.rigid_body.chain_kernels import SCRATCH_COLUMNS, observer_terms
from wrenchsight.models.robot.motors import joint_torque

GAIN, MOTOR_RATES = range(2)  # rows of `drives`; the last only of coupled joints
KNOWN_CORRECTION, KNOWN_COUNTS, KNOWN_SD, KNOWN_TAU_F = range(4)  # rows of `known`
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
_take = chosen_kernel(0, "update")
_add_torque = chosen_kernel(1, "add_torque")
_remember = chosen_kernel(1, "update")


# ----------------------------------------------------------------------------------------------
# The stages
# ----------------------------------------------------------------------------------------------


@kernel(inline="always")
def _terms(
    p: Parameters,
    q: Array,
    v: Array,
    current: Array,
    known: Array,
    signals: Array,
    J: Array,
    X: Array,
    bodies: Array,
) -> None:
    """What one sample says without memory: into `signals`, and J.

    signals[TORQUE_SD] holds the posture's variance until `torque_error_tick` makes the sd of it.
    """
    observer_terms(
        p.chain, q, v, signals[MOMENTUM], signals[CTV], signals[GRAVITY], J, X[:3], X[3], bodies
    )
    posture_variance_of_links(p.error, q, bodies, signals[TORQUE_SD])
    joint_torque(p.drives[GAIN], p.drives[MOTOR_RATES:], current, signals[TAU_J])
    if known.shape[0] <= KNOWN_TAU_F:
        friction_torque(p.friction, v, signals[TAU_F])
    for i in range(q.shape[0]):
        signals[Q, i] = q[i]
        signals[V, i] = v[i]
        if known.shape[0] > KNOWN_TAU_F:
            signals[TAU_F, i] = known[KNOWN_TAU_F, i]


class _Memory(NamedTuple):
    """The stages that remember: whose kernels, their constants and their state."""

    choice: KernelChoice
    p: Parameters
    observer: Array
    s: State


@kernel(inline="always")
def _observed(own: _Memory, known: Array, signals: Array, J: Array, wrench: Array) -> bool:
    """What friction remembers, then the observer; returns whether tau_ext is fresh.

    signals[TAU_F] holds the velocity law's torque before. `wrench` (OBSERVED,) or (0,) is written
    by an observer that reads it.
    """
    choice, p, observer, s = own
    if known.shape[0] <= KNOWN_TAU_F and s.friction.shape[0] > 0:
        _add_torque(choice)(p.slip, s.friction, signals[Q], signals[V], signals[TAU_F])
    fresh: bool = _observe(choice)(observer, s.observer, signals, J)
    if wrench.shape[0] > 0:
        covariance = view_2d(wrench, 6, 6, 6)
        _observe_wrench(choice)(observer, s.observer, signals, J, wrench[:6], covariance)
    return fresh


@kernel(inline="always")
def _taken(own: _Memory, known: Array, signals: Array, J: Array) -> None:
    """Takes the sample into what observer, friction law and torque error remember."""
    choice, p, observer, s = own
    _take(choice)(observer, s.observer, signals, J)
    if known.shape[0] <= KNOWN_TAU_F and s.friction.shape[0] > 0:
        load = signals[TAU_J] - signals[TAU_F]
        _remember(choice)(p.slip, s.friction, signals[Q], signals[V], load)
    take_transmitted(s.error, signals[TAU_J], signals[TAU_F])


@kernel(inline="always")
def _widen(known: Array, sd: Array) -> None:
    """Adds the sd of what is added to tau_ext to that of tau_ext (n,)."""
    if known.shape[0] > KNOWN_SD:
        for i in range(sd.shape[0]):
            sd[i] = np.sqrt(sd[i] ** 2 + known[KNOWN_SD, i] ** 2)


@kernel(inline="always")
def _corrected(known: Array, signals: Array, tau_ext: Array, fresh: bool) -> bool:
    """Writes what is read as tau_ext; returns whether it counts."""
    for i in range(tau_ext.shape[0]):
        tau_ext[i] = signals[TAU_EXT, i]
        if known.shape[0] > 0:
            if np.isfinite(known[KNOWN_CORRECTION, i]):
                tau_ext[i] += known[KNOWN_CORRECTION, i]
            else:
                fresh = False
    return fresh and (known.shape[0] == 0 or known[KNOWN_COUNTS, 0] == 1.0)


# ----------------------------------------------------------------------------------------------
# One sample
# ----------------------------------------------------------------------------------------------


@kernel
def tick_output(
    choice: KernelChoice,
    values: Array,
    layout: Layout,
    observer: Array,
    state: Array,
    q: Array,
    v: Array,
    current: Array,
    known: Array,
    out: Array,
    scratch: Array,
) -> None:
    """The first half of a tick: what is read right after a sample; `state` stays as it is.

    An observer that does not read the present torque reads no current either.

    Args:
        choice: of the observer's and the friction law's kernels.
        values, layout, observer: Packed.
        state: (`state_size`,).
        q, v, current: (n,).
        known: (0, n), (3, n) or (4, n), see above.
        out: (sum of `tick_sizes`,), written: a Tick.
        scratch: (`workspace_size`,), overwritten.
    """
    n = q.shape[0]
    q, v, current, known = borrowed(q), borrowed(v), borrowed(current), borrowed(known)
    observer, state = borrowed(observer), borrowed(state)
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
    _terms(p, checked[0], checked[1], checked[2], known, signals, J, work.X, work.bodies)
    copy_whole(tick.error_state, s.error)
    torque_error_tick(p.error, p.poles[0], tick.error_state, signals[Q], signals[V], J, tick.error)
    _widen(known, tick.error.sd)
    observed = tick.observed if _reads_wrench(choice) else tick.observed[:0]
    fresh = _observed(_Memory(choice, p, observer, s), known, signals, J, observed)
    counts = _corrected(known, signals, tick.tau_ext, fresh)
    tick.flags[COUNTS] = 1.0 if counts else 0.0
    copy_whole(tick.reading_state, s.reading)
    read_wrench(
        (p.read_load[0], p.lag[0], p.explained[0], p.faults[0], p.wrench),
        tick.reading_state,
        tick.error,
        J,
        tick.tau_ext,
        counts,
        int(tick.flags[FAULT]) & BEYOND != 0,
        observed,
        tick.reading,
        work.reading,
    )


@kernel
def tick_update(
    choice: KernelChoice,
    values: Array,
    layout: Layout,
    observer: Array,
    state: Array,
    q: Array,
    v: Array,
    current: Array,
    known: Array,
    out: Array,
    scratch: Array,
) -> None:
    """The second half of a tick: takes the sample into the state.

    Args:
        state: changed.
        out: what `tick_output` left for the same sample.
        others: as `tick_output`.
    """
    n = q.shape[0]
    q, v, current, known = borrowed(q), borrowed(v), borrowed(current), borrowed(known)
    observer, state = borrowed(observer), borrowed(state)
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
    _taken(_Memory(choice, p, observer, s), known, signals, tick.J)


@kernel
def estimate_tick(
    choice: KernelChoice,
    values: Array,
    layout: Layout,
    observer: Array,
    state: Array,
    sample: Array,
    known: Array,
    out: Array,
    scratch: Array,
) -> None:
    """Both halves of a tick; `sample` (3, n) q, v, current, the others as `tick_output`."""
    q, v, current = sample[0], sample[1], sample[2]
    before = read_only(state)
    tick_output(choice, values, layout, observer, before, q, v, current, known, out, scratch)
    tick_update(choice, values, layout, observer, state, q, v, current, known, out, scratch)


# ----------------------------------------------------------------------------------------------
# A log
# ----------------------------------------------------------------------------------------------


def terms_log(
    packed: Packed, q: Array, v: Array, current: Array, known: Array, signals: Array, J: Array
) -> None:
    """What N samples say without memory, by threads: signals (N, NUM_SIGNALS, n) and J (N, 6, n).

    Args:
        q, v, current: (N, n), checked.
        known: (N, 3, n), (N, 4, n) or (N, 0, n).
    """

    def run(rows: slice) -> None:
        own = (x[rows] for x in (q, v, current, known, signals, J))
        _terms_rows(packed.values, packed.layout, *own)

    in_row_blocks(run, len(q), _BLOCK)


@kernel(nogil=True)
def _terms_rows(
    values: Array,
    layout: Layout,
    q: Array,
    v: Array,
    current: Array,
    known: Array,
    signals: Array,
    J: Array,
) -> None:
    q, v, current, known = borrowed(q), borrowed(v), borrowed(current), borrowed(known)
    signals, J = borrowed(signals), borrowed(J)
    p = parameters_of(borrowed(values), layout)
    X, bodies = np.empty((4, 3)), np.empty((q.shape[1], SCRATCH_COLUMNS))
    for k in range(q.shape[0]):
        _terms(p, q[k], v[k], current[k], known[k], signals[k], J[k], X, bodies)


@kernel
def memory_log(
    choice: KernelChoice,
    packed: Packed,
    state: Array,
    known: Array,
    signals: Array,
    J: Array,
    error: TorqueError,
    tau_ext: Array,
    counts: Flags,
    observed: Array,
) -> None:
    """Takes N samples of `terms_log` into `state`.

    Args:
        error: of N samples, written; the sds into `signals`, too.
        tau_ext, counts: (N, n), (N,), written: N m, and which of them count.
        observed: (N, OBSERVED), written by an observer that reads the wrench itself; else (N, 0).
    """
    n, observer = signals.shape[2], borrowed(packed.observer)
    known, signals, J = borrowed(known), borrowed(signals), borrowed(J)
    seen, rows, tau_ext = borrowed(error.J_seen), borrowed(error.rows), borrowed(tau_ext)
    sd, stiction, drift = borrowed(error.sd), borrowed(error.stiction), borrowed(error.drift)
    observed = borrowed(observed)
    p = parameters_of(borrowed(packed.values), packed.layout)
    s = state_of(borrowed(state), packed.layout, n)
    memory = _Memory(choice, p, observer, s)
    for k in range(signals.shape[0]):
        own = signals[k]
        now = TorqueError(own[TORQUE_SD], own[STICTION], own[DRIFT], seen[k], rows[k])
        torque_error_tick(p.error, p.poles[0], s.error, own[Q], own[V], J[k], now)
        _widen(known[k], now.sd)
        copy_to(sd[k], now.sd)
        copy_to(stiction[k], now.stiction)
        copy_to(drift[k], now.drift)
        fresh = _observed(memory, known[k], own, J[k], observed[k])
        _taken(memory, known[k], own, J[k])
        counts[k] = _corrected(known[k], own, tau_ext[k], fresh)
