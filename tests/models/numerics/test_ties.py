"""Costs that are equal but for rounding: which of them is taken."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrenchsight.models.numerics.ties import better, first_of_least, in_order, whole_turns

ROUNDING = 1e-12  # a thousand times that of one operation


def moved(costs, seed):
    rng = np.random.default_rng(seed)
    return np.asarray(costs) * (1.0 + ROUNDING * rng.uniform(-1.0, 1.0, np.shape(costs)))


@pytest.mark.parametrize("seed", range(20))
def test_of_equals_the_first_is_taken_whatever_the_last_bits(seed):
    costs = moved([5.0, 3.0, 7.0, 3.0, 3.0], seed)
    assert first_of_least(costs) == 1
    np.testing.assert_array_equal(in_order(costs), [1, 3, 4, 0, 2])
    rows = moved([[2.0, 1.0, 1.0], [4.0, 4.0, 9.0]], seed)
    np.testing.assert_array_equal(first_of_least(rows), [1, 0])
    np.testing.assert_array_equal(first_of_least(rows.T, axis=0), [1, 0])
    assert not better(costs[3], costs[1])
    assert not better(costs[1], costs[3])


def test_a_cost_better_by_more_than_rounding_is_chosen():
    costs = np.array([3.0, 3.0 - 1e-7, 3.0])
    assert first_of_least(costs) == 1
    np.testing.assert_array_equal(in_order(costs), [1, 0, 2])
    assert better(costs[1], costs[0])


def test_infeasible_costs_come_last():
    costs = np.array([np.inf, 2.0, np.inf, 1.0])
    assert first_of_least(costs) == 3
    np.testing.assert_array_equal(in_order(costs), [3, 1, 0, 2])
    assert better(1.0, math.inf)
    assert not better(math.inf, math.inf)
    assert first_of_least([np.inf, np.inf]) == 0
    np.testing.assert_array_equal(in_order([]), [])


@given(st.lists(st.floats(0.0, 1e6, allow_nan=False), min_size=1, max_size=30))
def test_far_apart_costs_are_sorted_as_ever(costs):
    spread = np.unique(np.round(costs))  # whole numbers: never a tie
    rng = np.random.default_rng(len(spread))
    mixed = rng.permutation(spread)
    np.testing.assert_array_equal(mixed[in_order(mixed)], spread)
    assert mixed[first_of_least(mixed)] == spread[0]


@pytest.mark.parametrize("turns", [-2, -1, 0, 1, 3])
@pytest.mark.parametrize("rounding", [-1e-12, 0.0, 1e-12])
@pytest.mark.parametrize("half", [-math.pi, math.pi])
def test_half_a_turn_stays_the_same_half_turn(turns, rounding, half):
    angle = half + 2.0 * math.pi * turns + rounding
    left = angle - 2.0 * math.pi * whole_turns(angle)
    assert left == pytest.approx(math.pi, abs=1e-11)


@given(st.floats(-50.0, 50.0))
def test_an_angle_is_reduced_to_the_equivalent_nearest_to_zero(angle):
    left = angle - 2.0 * math.pi * float(whole_turns(angle))
    assert -math.pi < left <= math.pi + 1e-8
    assert math.cos(left) == pytest.approx(math.cos(angle), abs=1e-13)
    assert math.sin(left) == pytest.approx(math.sin(angle), abs=1e-13)
