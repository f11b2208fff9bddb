"""The kernels of the estimator: the chain for one sample, whole or in halves, and over a log.

    terms    M v, C^T v, G and J of the model, motor torque, friction of the velocity alone
    memory   what friction remembers, and the observer: `observer` and `friction_law` say how
    wrench   the reading of tau_ext with its covariance

Which observer and which friction law run is part of the first argument's type, see
`kernel_choice`. `known` without rows is the plain estimator. Otherwise it holds, row by row, what
is to be added to tau_ext (n,) N m, in its first entry 1 where the reading counts, else 0, and where
friction is known from elsewhere, so that the law has no say, its torque (n,) N m.
"""

from typing import Any

import numpy as np
from numba import prange
from numba.extending import overload

from wrenchsight.models.arrays import Array, Flags
from wrenchsight.models.estimation.kernel_choice import KernelChoice, chosen
from wrenchsight.models.estimation.trusted_reading import (
    OBSERVED,
    READING,
    TRUSTED_WORK_ROWS,
    trusted_reading_tick,
)
from wrenchsight.models.estimation.wrench_kernels import reconstruct
from wrenchsight.models.friction.velocity_friction import friction_torque
from wrenchsight.models.identification.torque_error_model import TRANSMITTED_ROW
from wrenchsight.models.kernel import kernel
from wrenchsight.models.observers.observer import (
    CTV,
    GRAVITY,
    MOMENTUM,
    NUM_SIGNALS,
    TAU_EXT,
    TAU_F,
    TAU_J,
    TORQUE_SD,
    Q,
    V,
)
from wrenchsight.models.rigid_body.chain_kernels import SCRATCH_COLUMNS, observer_terms
from wrenchsight.models.robot.motors import joint_torque

GAIN, ERROR_SD, MOTOR_RATES = range(3)  # rows of `drives`; the last only of coupled joints
KNOWN_CORRECTION, KNOWN_COUNTS, KNOWN_TAU_F = range(3)  # rows of `known`
NUM_READING = READING  # entries after tau_ext: wrench, covariance, condition number, valid

_BLOCK = 256  # rows a thread takes at a time


def output_size(num_joints: int) -> int:
    """Entries of what `tick_output` writes."""
    return int(counts_entry(num_joints)) + 1


@kernel
def counts_entry(num_joints: int) -> int:
    """Entry of the same that is 1 where tau_ext counts, else 0; the signals and J lie before."""
    return num_joints + NUM_READING + (NUM_SIGNALS + 6) * num_joints


def scratch_size(num_joints: int) -> int:
    """Entries of the memory that a tick works in: one array, as each one more costs time."""
    n = num_joints
    return 12 + n * SCRATCH_COLUMNS + TRUSTED_WORK_ROWS * max(n, 6) + (NUM_SIGNALS + 6) * n


# ----------------------------------------------------------------------------------------------
# The chosen kernels
# ----------------------------------------------------------------------------------------------


def _observe(choice: Any, table: Any, state: Any, signals: Any, J: Any) -> Any:
    """`output` of the chosen observer."""
    raise NotImplementedError


def _take(choice: Any, table: Any, state: Any, signals: Any, J: Any) -> Any:
    """`update` of the chosen observer."""
    raise NotImplementedError


def _add_torque(choice: Any, table: Any, state: Any, q: Any, v: Any, tau_f: Any) -> Any:
    """`add_torque` of the chosen friction law."""
    raise NotImplementedError


def _remember(choice: Any, table: Any, state: Any, q: Any, v: Any, load: Any) -> Any:
    """`update` of the chosen friction law."""
    raise NotImplementedError


def _observe_wrench(
    choice: Any, table: Any, state: Any, signals: Any, J: Any, wrench: Any, covariance: Any
) -> Any:
    """`wrench` of the chosen observer, if it has one; returns whether it has."""
    raise NotImplementedError


@overload(_observe, inline="always")
def _(choice: Any, table: Any, state: Any, signals: Any, J: Any) -> Any:
    output = chosen(choice, 0).output

    def call(choice: Any, table: Any, state: Any, signals: Any, J: Any) -> Any:
        return output(table, state, signals, J)

    return call


@overload(_observe_wrench, inline="always")
def _(
    choice: Any, table: Any, state: Any, signals: Any, J: Any, wrench: Any, covariance: Any
) -> Any:
    own = chosen(choice, 0).wrench

    def call(
        choice: Any, table: Any, state: Any, signals: Any, J: Any, wrench: Any, covariance: Any
    ) -> Any:
        own(table, state, signals, J, wrench, covariance)
        return True

    def leave(
        choice: Any, table: Any, state: Any, signals: Any, J: Any, wrench: Any, covariance: Any
    ) -> Any:
        return False

    return leave if own is None else call


@overload(_take, inline="always")
def _(choice: Any, table: Any, state: Any, signals: Any, J: Any) -> Any:
    update = chosen(choice, 0).update

    def call(choice: Any, table: Any, state: Any, signals: Any, J: Any) -> Any:
        update(table, state, signals, J)

    return call


@overload(_add_torque, inline="always")
def _(choice: Any, table: Any, state: Any, q: Any, v: Any, tau_f: Any) -> Any:
    add_torque = chosen(choice, 1).add_torque

    def call(choice: Any, table: Any, state: Any, q: Any, v: Any, tau_f: Any) -> Any:
        add_torque(table, state, q, v, tau_f)

    return call


@overload(_remember, inline="always")
def _(choice: Any, table: Any, state: Any, q: Any, v: Any, load: Any) -> Any:
    update = chosen(choice, 1).update

    def call(choice: Any, table: Any, state: Any, q: Any, v: Any, load: Any) -> Any:
        update(table, state, q, v, load)

    return call


# ----------------------------------------------------------------------------------------------
# One sample
# ----------------------------------------------------------------------------------------------


@kernel
def _terms(
    chain: Array,
    drives: Array,
    friction: Array,
    q: Array,
    v: Array,
    current: Array,
    known: Array,
    signals: Array,
    J: Array,
    X: Array,
    scratch: Array,
) -> None:
    """What one sample says without memory: into `signals`, and J."""
    observer_terms(
        chain, q, v, signals[MOMENTUM], signals[CTV], signals[GRAVITY], J, X[:3], X[3], scratch
    )
    joint_torque(drives[GAIN], drives[MOTOR_RATES:], current, signals[TAU_J])
    if known.shape[0] <= KNOWN_TAU_F:
        friction_torque(friction, v, signals[TAU_F])
    for i in range(q.shape[0]):
        signals[Q, i] = q[i]
        signals[V, i] = v[i]
        signals[TORQUE_SD, i] = drives[ERROR_SD, i]
        if known.shape[0] > KNOWN_TAU_F:
            signals[TAU_F, i] = known[KNOWN_TAU_F, i]


@kernel
def _output(
    choice: KernelChoice,
    slip: Array,
    observer: Array,
    rows: int,
    state: Array,
    known: Array,
    signals: Array,
    J: Array,
) -> bool:
    """The parts with memory right after a sample; returns whether tau_ext is fresh.

    signals[TAU_F] holds the velocity law's torque before.
    """
    if known.shape[0] <= KNOWN_TAU_F and state.shape[0] > rows:
        _add_torque(choice, slip, state[rows:], signals[Q], signals[V], signals[TAU_F])
    fresh: bool = _observe(choice, observer, state[:rows], signals, J)
    return fresh


@kernel
def _update(
    choice: KernelChoice,
    slip: Array,
    observer: Array,
    rows: int,
    state: Array,
    known: Array,
    signals: Array,
    J: Array,
) -> None:
    """Takes the sample into the parts with memory."""
    _take(choice, observer, state[:rows], signals, J)
    if known.shape[0] <= KNOWN_TAU_F and state.shape[0] > rows:
        load = signals[TAU_J] - signals[TAU_F]
        _remember(choice, slip, state[rows:], signals[Q], signals[V], load)


@kernel
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


@kernel
def _read(
    choice: KernelChoice,
    wrench: Array,
    observer: Array,
    own: Array,
    signals: Array,
    J: Array,
    counts: bool,
    out: Array,
    work: Array,
) -> None:
    """Writes the reading of tau_ext, out[:n], after it; `own` is the observer's state."""
    n = J.shape[1]
    quality = out[n + 42 : n + NUM_READING]
    covariance = out[n + 6 : n + 42].reshape(6, 6)
    reconstruct(wrench, J, out[:n], out[n : n + 6], covariance, quality, work)
    _observe_wrench(choice, observer, own, signals, J, out[n : n + 6], covariance)
    if not counts:
        quality[1] = 0.0


@kernel
def _split(tail: Array, n: int) -> tuple[Array, Array]:
    """The signals (NUM_SIGNALS, n) and J (6, n) that one stretch of memory holds."""
    end = NUM_SIGNALS * n
    return tail[:end].reshape(NUM_SIGNALS, n), tail[end : end + 6 * n].reshape(6, n)


@kernel
def _split_scratch(scratch: Array, n: int) -> tuple[Array, Array, Array, Array]:
    """Memory for a pose (4, 3), the chain, the reconstruction and `_split`."""
    end_of_bodies = 12 + n * SCRATCH_COLUMNS
    end_of_work = end_of_bodies + TRUSTED_WORK_ROWS * max(n, 6)
    return (
        scratch[:12].reshape(4, 3),
        scratch[12:end_of_bodies].reshape(n, SCRATCH_COLUMNS),
        scratch[end_of_bodies:end_of_work].reshape(TRUSTED_WORK_ROWS, max(n, 6)),
        scratch[end_of_work:],
    )


@kernel
def estimate_tick(
    choice: KernelChoice,
    chain: Array,
    drives: Array,
    friction: Array,
    slip: Array,
    observer: Array,
    wrench: Array,
    rows: int,
    state: Array,
    sample: Array,
    out: Array,
    scratch: Array,
) -> None:
    """The chain for one sample.

    Args:
        choice: of the observer's and the friction law's kernels.
        chain: SerialChain.table.
        drives: (2, n) signed gain, N m/A; sd of the torque's error, N m; (2 + n, n) with the
            `motor_rates` of coupled joints behind.
        friction: table of the friction law's velocity_law.
        slip: FrictionLaw.slip_table.
        observer: Observer.table.
        wrench: WrenchReconstruction.table.
        rows: of the state, that are the observer's; the friction law's follow.
        state: (rows + law's rows, n), changed.
        sample: (3, n) q, v, current; (6, n) with `known` below.
        out: (n + 44,), written: tau_ext, wrench, covariance, condition number, valid.
        scratch: (`scratch_size`,), overwritten.
    """
    n = sample.shape[1]
    X, bodies, work, tail = _split_scratch(scratch, n)
    signals, J = _split(tail, n)
    known = sample[3:]
    _terms(chain, drives, friction, sample[0], sample[1], sample[2], known, signals, J, X, bodies)
    fresh = _output(choice, slip, observer, rows, state, known, signals, J)
    counts = _corrected(known, signals, out[:n], fresh)
    _read(choice, wrench, observer, state[:rows], signals, J, counts, out, work)
    _update(choice, slip, observer, rows, state, known, signals, J)


@kernel
def trusted_tick(
    choice: KernelChoice,
    chain: Array,
    drives: Array,
    friction: Array,
    slip: Array,
    observer: Array,
    error: Array,
    lag: Array,
    wrench: Array,
    rows: int,
    tick_rows: int,
    state: Array,
    sample: Array,
    out: Array,
    scratch: Array,
) -> None:
    """The chain for one sample, read by `wrenchsight.models.estimation.trusted_reading`.

    Args:
        error, lag, wrench: TrustedReading.tables.
        tick_rows: of the state, that are the observer's and the friction law's; the reading's
            follow.
        others: as `estimate_tick`.
    """
    n = sample.shape[1]
    X, bodies, work, tail = _split_scratch(scratch, n)
    signals, J = _split(tail, n)
    known, parts = sample[3:], state[:tick_rows]
    _terms(chain, drives, friction, sample[0], sample[1], sample[2], known, signals, J, X, bodies)
    fresh = _output(choice, slip, observer, rows, parts, known, signals, J)
    seen, doubt = work[OBSERVED, :6], work[OBSERVED + 1 : OBSERVED + 7, :6]
    observes = _observe_wrench(choice, observer, parts[:rows], signals, J, seen, doubt)
    _update(choice, slip, observer, rows, parts, known, signals, J)
    counts = _corrected(known, signals, out[:n], fresh)
    transmitted = signals[TAU_J]
    for i in range(n):
        transmitted[i] -= signals[TAU_F, i]
    own = state[tick_rows:]
    trusted_reading_tick(
        *(error, lag, wrench, own, sample[0], sample[1], transmitted, J),
        *(out[:n], counts, observes, out[n:], work),
    )


@kernel
def tick_output(
    choice: KernelChoice,
    chain: Array,
    drives: Array,
    friction: Array,
    slip: Array,
    observer: Array,
    wrench: Array,
    rows: int,
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
        state: flat.
        q, v, current: (n,).
        known: (0, n) or (3, n), see above.
        out: (`output_size`,), written: as `estimate_tick`, then what `tick_update` takes.
        others: as `estimate_tick`.
    """
    n = q.shape[0]
    X, bodies, work, _ = _split_scratch(scratch, n)
    signals, J = _split(out[n + NUM_READING :], n)
    _terms(chain, drives, friction, q, v, current, known, signals, J, X, bodies)
    parts = state.reshape(state.shape[0] // n, n)
    fresh = _output(choice, slip, observer, rows, parts, known, signals, J)
    counts = _corrected(known, signals, out[:n], fresh)
    out[counts_entry(n)] = 1.0 if counts else 0.0
    _read(choice, wrench, observer, parts[:rows], signals, J, counts, out, work)


@kernel
def tick_update(
    choice: KernelChoice,
    drives: Array,
    slip: Array,
    observer: Array,
    rows: int,
    state: Array,
    current: Array,
    known: Array,
    out: Array,
) -> None:
    """The second half of a tick: takes the sample into the state.

    Args:
        state: flat, changed.
        out: what `tick_output` left for the same sample.
        others: as `tick_output`.
    """
    n = current.shape[0]
    signals, J = _split(out[n + NUM_READING :], n)
    joint_torque(drives[GAIN], drives[MOTOR_RATES:], current, signals[TAU_J])
    parts = state.reshape(state.shape[0] // n, n)
    _update(choice, slip, observer, rows, parts, known, signals, J)


@kernel
def trusted_output(
    choice: KernelChoice,
    chain: Array,
    drives: Array,
    friction: Array,
    slip: Array,
    observer: Array,
    error: Array,
    lag: Array,
    wrench: Array,
    rows: int,
    tick_rows: int,
    state: Array,
    q: Array,
    v: Array,
    current: Array,
    known: Array,
    out: Array,
    scratch: Array,
) -> None:
    """`tick_output`, read as in `trusted_tick`.

    Args:
        out: as of `tick_output`, then the reading's rows of the state after the sample, flat.
        others: as `tick_output` and `trusted_tick`.
    """
    n = q.shape[0]
    X, bodies, work, _ = _split_scratch(scratch, n)
    signals, J = _split(out[n + NUM_READING :], n)
    _terms(chain, drives, friction, q, v, current, known, signals, J, X, bodies)
    parts = state.reshape(state.shape[0] // n, n)
    fresh = _output(choice, slip, observer, rows, parts[:tick_rows], known, signals, J)
    seen, doubt = work[OBSERVED, :6], work[OBSERVED + 1 : OBSERVED + 7, :6]
    observes = _observe_wrench(choice, observer, parts[:rows], signals, J, seen, doubt)
    counts = _corrected(known, signals, out[:n], fresh)
    out[counts_entry(n)] = 1.0 if counts else 0.0
    own = out[counts_entry(n) + 1 :]
    for k in range(own.shape[0]):
        own[k] = state[tick_rows * n + k]
    nothing = work[TRUSTED_WORK_ROWS - 1, :n]
    nothing[:] = np.nan
    trusted_reading_tick(
        *(error, lag, wrench, own.reshape(own.shape[0] // n, n), q, v, nothing, J),
        *(out[:n], counts, observes, out[n : n + READING], work),
    )


@kernel
def trusted_update(
    choice: KernelChoice,
    drives: Array,
    slip: Array,
    observer: Array,
    rows: int,
    tick_rows: int,
    state: Array,
    current: Array,
    known: Array,
    out: Array,
) -> None:
    """`tick_update` after `trusted_output`."""
    n = current.shape[0]
    tick_update(choice, drives, slip, observer, rows, state[: tick_rows * n], current, known, out)
    signals, _ = _split(out[n + NUM_READING :], n)
    own = out[counts_entry(n) + 1 :]
    for k in range(own.shape[0]):
        state[tick_rows * n + k] = own[k]
    first = (tick_rows + TRANSMITTED_ROW) * n
    for i in range(n):
        transmitted = signals[TAU_J, i] - signals[TAU_F, i]
        if np.isfinite(transmitted):
            state[first + i] = transmitted


# ----------------------------------------------------------------------------------------------
# A log
# ----------------------------------------------------------------------------------------------


@kernel(parallel=True)
def terms_log(
    chain: Array,
    drives: Array,
    friction: Array,
    q: Array,
    v: Array,
    current: Array,
    known: Array,
    signals: Array,
    J: Array,
) -> None:
    """What N samples say without memory: signals (N, NUM_SIGNALS, n) and J (N, 6, n).

    Args:
        q, v, current: (N, n).
        known: (N, 3, n), or (N, 0, n).
        others: as `estimate_tick`.
    """
    N, n = q.shape
    for block in prange((N + _BLOCK - 1) // _BLOCK):
        X = np.empty((4, 3))
        scratch = np.empty((n, SCRATCH_COLUMNS))
        for k in range(block * _BLOCK, min(N, (block + 1) * _BLOCK)):
            _terms(
                chain,
                drives,
                friction,
                q[k],
                v[k],
                current[k],
                known[k],
                signals[k],
                J[k],
                X,
                scratch,
            )


@kernel
def serial_log(
    choice: KernelChoice,
    slip: Array,
    observer: Array,
    rows: int,
    state: Array,
    known: Array,
    signals: Array,
    J: Array,
    tau_ext: Array,
    counts: Flags,
    observed: Array,
) -> None:
    """Takes N samples of `terms_log` into `state`; writes tau_ext (N, n), and which count (N,).

    `observed` (N, 42) is written by an observer that reads the wrench itself: it and its
    covariance. (N, 0) for others.
    """
    for k in range(signals.shape[0]):
        fresh = _output(choice, slip, observer, rows, state, known[k], signals[k], J[k])
        if observed.shape[1] > 0:
            covariance = observed[k, 6:].reshape(6, 6)
            own = state[:rows]
            _observe_wrench(choice, observer, own, signals[k], J[k], observed[k, :6], covariance)
        _update(choice, slip, observer, rows, state, known[k], signals[k], J[k])
        counts[k] = _corrected(known[k], signals[k], tau_ext[k], fresh)
