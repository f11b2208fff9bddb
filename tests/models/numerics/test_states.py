"""States of several arrays in one vector."""

from typing import NamedTuple

import numpy as np

from wrenchsight.models.numerics.arrays import Array, record
from wrenchsight.models.numerics.states import StateLayout, assign_state


class Inner(NamedTuple):
    x: Array
    empty: Array


class Outer(NamedTuple):
    first: Array
    inner: Inner


def test_the_vector_holds_all_arrays_in_their_order_and_gives_views() -> None:
    state = Outer(np.arange(6.0).reshape(2, 3), Inner(np.array([7.0]), np.empty((0, 4))))
    layout = StateLayout(state)
    np.testing.assert_array_equal(layout.initial, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 7.0])
    vector = layout.initial.copy()
    again = layout.state_of(vector)
    assert type(again) is Outer and type(again.inner) is Inner
    np.testing.assert_array_equal(again.first, state.first)
    assert again.inner.empty.shape == (0, 4)
    again.first[1, 2], again.inner.x[0] = -1.0, -2.0
    np.testing.assert_array_equal(vector[5:], [-1.0, -2.0])
    assert state.first[1, 2] == 5.0  # the initial one stays as it is


def test_an_array_alone_is_a_state() -> None:
    layout = StateLayout(np.zeros((2, 2)))
    np.testing.assert_array_equal(layout.state_of(np.arange(4.0)), [[0.0, 1.0], [2.0, 3.0]])


def test_a_record_is_a_part_whose_numbers_have_names() -> None:
    made = record(time=2.0, matrix=np.eye(2))
    layout = StateLayout(Inner(np.array([7.0]), made))
    np.testing.assert_array_equal(layout.initial, [7.0, 2.0, 1.0, 0.0, 0.0, 1.0])
    vector = layout.initial.copy()
    again = layout.state_of(vector).empty
    assert again.dtype == made.dtype
    again["time"], again["matrix"][0, 1, 0] = 3.0, -4.0
    np.testing.assert_array_equal(vector, [7.0, 3.0, 1.0, 0.0, -4.0, 1.0])
    assert made["time"] == 2.0  # the initial one stays as it is


def test_a_state_takes_the_numbers_of_another_in_its_own_memory() -> None:
    state = Outer(np.zeros((2, 3)), Inner(np.zeros(1), np.empty((0, 4))))
    layout = StateLayout(state)
    vector = layout.initial.copy()
    assign_state(
        layout.state_of(vector), Outer(np.ones((2, 3)), Inner(np.array([4.0]), np.empty((0, 4))))
    )
    np.testing.assert_array_equal(vector, [1.0] * 6 + [4.0])


def test_a_record_takes_the_numbers_of_another_in_its_own_memory() -> None:
    vector, made = np.zeros(5), record(time=2.0, matrix=np.arange(4.0).reshape(2, 2))
    own = StateLayout(made).state_of(vector)
    assign_state(own, made)
    np.testing.assert_array_equal(vector, [2.0, 0.0, 1.0, 2.0, 3.0])
    own["time"] = -1.0
    assert made["time"] == 2.0
