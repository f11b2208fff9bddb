"""The memory of the estimator's kernels: flat arrays to Python, named parts inside a kernel.

An argument that is an array costs half a microsecond for each call of a kernel. So constants, state
and result of a tick are passed as flat arrays. Inside, `parameters_of`, `state_of` and `tick_of`
name their parts, as pinocchio's Model and Data do.
"""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.estimation.torque_error_stage import (
    ERROR_ROWS,
    STAGE_ROWS,
    TorqueError,
    torque_error_views,
)
from wrenchsight.models.estimation.wrench_reading import (
    OBSERVED,
    READING,
    READING_NUMBERS,
    READING_ROWS,
    READING_WORK_ROWS,
)
from wrenchsight.models.numerics.arrays import Array
from wrenchsight.models.numerics.kernel import kernel
from wrenchsight.models.numerics.views import Layout, joined, part, view_2d
from wrenchsight.models.observers.observer import NUM_SIGNALS, TORQUE_SD
from wrenchsight.models.observers.sample_check import CHECK_ROWS
from wrenchsight.models.rigid_body.chain_kernels import SCRATCH_COLUMNS


class Parameters(NamedTuple):
    """The constants of the stages, (rows, columns) each.

    Attributes:
        chain: SerialChain.table.
        drives: signed gain, N m/A; behind it the `motor_rates` of coupled joints.
        friction: table of the friction law's velocity_law.
        slip: FrictionLaw.slip_table.
        error, poles: of TorqueErrorStage; poles in one row.
        read_load, lag, explained, faults, wrench: WrenchReading.tables; in one row, but the last.
        check: SampleCheck.table; without rows samples are not checked.
        period: (1, 1) s between samples.
    """

    chain: Array
    drives: Array
    friction: Array
    slip: Array
    error: Array
    poles: Array
    read_load: Array
    lag: Array
    explained: Array
    faults: Array
    wrench: Array
    check: Array
    period: Array


class Packed(NamedTuple):
    """Parameters as kernels take them.

    Attributes:
        values: all numbers, flat.
        layout: (parts + 1, 3) first entry, rows and columns of each part. The last row: rows of the
            observer's and of the friction law's state, and 0.
        observer: Observer.table, in its shape.
    """

    values: Array
    layout: Layout
    observer: Array

    def part(self, name: str) -> Array:
        """One of the Parameters, as a view."""
        start, rows, columns = self.layout[Parameters._fields.index(name)]
        return self.values[start : start + rows * columns].reshape(rows, columns)


PackedArrays = tuple[Array, Layout, Array]
"""A Packed for a call from Python, `packed[:]`: a NamedTuple costs numba .5 us more per call."""


def packed(
    parameters: Parameters, observer: Array, observer_rows: int, friction_rows: int
) -> Packed:
    """Returns parameters as kernels take them.

    Args:
        parameters: of the stages.
        observer: Observer.table.
        observer_rows, friction_rows: rows of the observer's and of the friction law's state.
    """
    values, layout = joined(parameters)
    layout = np.vstack([layout, [observer_rows, friction_rows, 0]])
    return Packed(values, layout, np.ascontiguousarray(observer))


@kernel(inline="always")
def parameters_of(values: Array, layout: Layout) -> Parameters:
    """The parts of `packed`."""
    return Parameters(
        part(values, layout, 0),
        part(values, layout, 1),
        part(values, layout, 2),
        part(values, layout, 3),
        part(values, layout, 4),
        part(values, layout, 5),
        part(values, layout, 6),
        part(values, layout, 7),
        part(values, layout, 8),
        part(values, layout, 9),
        part(values, layout, 10),
        part(values, layout, 11),
        part(values, layout, 12),
    )


class State(NamedTuple):
    """The state of the stages.

    Attributes:
        observer, friction: (rows, n) of the observer and of the friction law.
        error: (STAGE_ROWS, n) of the torque error.
        reading: of `WrenchReading.initial_state`.
        check: (CHECK_ROWS, n) of the check of samples.
    """

    observer: Array
    friction: Array
    error: Array
    reading: Array
    check: Array


def state_size(num_joints: int, observer_rows: int, friction_rows: int) -> int:
    """Entries of the state."""
    rows = observer_rows + friction_rows + STAGE_ROWS + CHECK_ROWS + READING_ROWS
    return rows * num_joints + READING_NUMBERS


@kernel(inline="always")
def state_of(state: Array, layout: Layout, n: int) -> State:
    """The parts of a flat state."""
    rows = layout[layout.shape[0] - 1]
    friction = rows[0] * n
    error = friction + rows[1] * n
    check = error + STAGE_ROWS * n
    reading = check + CHECK_ROWS * n
    return State(
        view_2d(state, 0, rows[0], n),
        view_2d(state, friction, rows[1], n),
        view_2d(state, error, STAGE_ROWS, n),
        state[reading : reading + READING_NUMBERS + READING_ROWS * n],
        view_2d(state, check, CHECK_ROWS, n),
    )


class Tick(NamedTuple):
    """The result of a tick's first half, which the second half takes.

    Attributes:
        tau_ext: (n,) N m.
        reading: (READING,) wrench, covariance, condition number, valid, invalid.
        flags: (2,) fault codes of the sample; 1 where tau_ext counts, else 0.
        J: (6, n), rows [angular; linear], at E in axes of W.
        signals: (NUM_SIGNALS, n), see `models.observers.observer`.
        error: of the sample; its sds are rows of `signals`.
        error_state: (STAGE_ROWS, n) after the sample.
        reading_state: of the reading, after the sample.
        observed: (OBSERVED,) wrench that the observer estimates itself, and its covariance.
    """

    tau_ext: Array
    reading: Array
    flags: Array
    J: Array
    signals: Array
    error: TorqueError
    error_state: Array
    reading_state: Array
    observed: Array


def tick_sizes(num_joints: int) -> dict[str, int]:
    """Entries of a tick's memory, part by part.

    `signals` are the rows up to those of the torque error; "rest" are the states after the sample.
    """
    n = num_joints
    return {
        "tau_ext": n,
        "wrench": 6,
        "covariance": 36,
        "condition_number": 1,
        "valid": 1,
        "invalid": 1,
        "fault": 1,
        "counts": 1,
        "J": 6 * n,
        "signals": TORQUE_SD * n,
        "torque_error": ERROR_ROWS * n,
        "rest": (STAGE_ROWS + READING_ROWS) * n + READING_NUMBERS + OBSERVED,
    }


@kernel(inline="always")
def tick_of(out: Array, n: int) -> Tick:
    """The parts of a tick's memory."""
    flags = n + READING
    J = flags + 2
    signals = J + 6 * n
    error = signals + TORQUE_SD * n
    error_state = error + ERROR_ROWS * n
    reading_state = error_state + STAGE_ROWS * n
    observed = reading_state + READING_NUMBERS + READING_ROWS * n
    return Tick(
        out[:n],
        out[n:flags],
        out[flags:J],
        view_2d(out, J, 6, n),
        view_2d(out, signals, NUM_SIGNALS, n),
        torque_error_views(out[error:error_state], n),
        view_2d(out, error_state, STAGE_ROWS, n),
        out[reading_state:observed],
        out[observed : observed + OBSERVED],
    )


class Workspace(NamedTuple):
    """Scratch memory of a tick; nothing in it outlives a call.

    Attributes:
        X: (4, 3) a pose.
        bodies: (n, SCRATCH_COLUMNS) of the chain.
        reading: (READING_WORK_ROWS, max(n, 6)).
        checked: (3, n) a sample.
    """

    X: Array
    bodies: Array
    reading: Array
    checked: Array


def workspace_size(num_joints: int) -> int:
    """Entries of a tick's scratch memory."""
    n = num_joints
    return 12 + n * SCRATCH_COLUMNS + READING_WORK_ROWS * max(n, 6) + 3 * n


@kernel(inline="always")
def workspace_of(scratch: Array, n: int) -> Workspace:
    """The parts of a tick's scratch memory."""
    reading = 12 + n * SCRATCH_COLUMNS
    checked = reading + READING_WORK_ROWS * max(n, 6)
    return Workspace(
        view_2d(scratch, 0, 4, 3),
        view_2d(scratch, 12, n, SCRATCH_COLUMNS),
        view_2d(scratch, reading, READING_WORK_ROWS, max(n, 6)),
        view_2d(scratch, checked, 3, n),
    )
