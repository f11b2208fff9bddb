"""Constants, state and memory of a tick: flat for Python, named for kernels."""

import numpy as np

from wrenchsight.models.estimation.estimator_arrays import (
    Parameters,
    packed,
    parameters_of,
    state_of,
    state_size,
    tick_of,
    tick_sizes,
    workspace_of,
    workspace_size,
)
from wrenchsight.models.observers.observer import NUM_SIGNALS, TORQUE_SD

N = 3


def test_every_parameter_keeps_its_place_and_shape() -> None:
    shapes = [(k + 1, 4) if k % 3 else (0, N) for k in range(len(Parameters._fields))]
    given = Parameters._make(np.full(shape, float(k)) for k, shape in enumerate(shapes))
    constants = packed(given, np.arange(5.0), 3, 2)
    parameters = parameters_of(constants.values, constants.layout)
    for name, value in given._asdict().items():
        np.testing.assert_array_equal(getattr(parameters, name), value)
        np.testing.assert_array_equal(constants.part(name), value)


def test_the_parts_of_a_state_do_not_meet() -> None:
    zeros = Parameters._make(np.zeros((1, N)) for _ in Parameters._fields)
    constants = packed(zeros, np.empty(0), 2, 4)
    state = np.zeros(state_size(N, 2, 4))
    for value, part in enumerate(state_of(state, constants.layout, N), 1):
        assert (part == 0.0).all()
        part[:] = value  # a view
    assert (state > 0.0).all()


def test_the_parts_of_a_tick_are_those_that_its_sizes_state() -> None:
    sizes = tick_sizes(N)
    out = np.arange(float(sum(sizes.values())))
    ends = np.cumsum(list(sizes.values()))
    first = dict(zip(sizes, (0, *ends[:-1].tolist()), strict=True))
    tick = tick_of(out, N)
    assert tick.tau_ext[0] == first["tau_ext"]
    assert tick.reading[0] == first["wrench"]
    assert tick.reading[42] == first["condition_number"]
    assert tick.flags[0] == first["fault"]
    assert tick.J[0, 0] == first["J"]
    assert tick.signals.shape == (NUM_SIGNALS, N)
    assert tick.signals[TORQUE_SD, 0] == tick.error.sd[0] == first["torque_error"]
    assert tick.error_state[0, 0] == first["rest"]
    assert tick.observed[-1] == out[-1]


def test_the_parts_of_the_workspace_fill_it() -> None:
    scratch = np.zeros(workspace_size(N))
    for part in workspace_of(scratch, N):
        assert (part == 0.0).all()
        part[:] = 1.0
    assert (scratch == 1.0).all()
