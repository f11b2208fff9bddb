"""Which logs settle the truth and which judge it; ratios, and what chance takes apart."""

import math

import numpy as np
import pytest

from wrenchsight.analyses.experiments.realism.comparison import (
    CHECKED,
    FIT,
    LOADED,
    PASSES,
    SETTLED,
    SETTLED_LOAD,
    compared,
    told_apart,
    twins,
)

NAN = float("nan")


def test_no_log_settles_and_judges():
    assert not {*FIT, *SETTLED, *SETTLED_LOAD} & {*CHECKED, LOADED, *PASSES}


def test_ratios_are_simulated_over_real():
    found = compared({"a": np.array([2.0, np.nan])}, {"a": np.array([1.0, 3.0])})
    np.testing.assert_allclose(found["a"]["ratio"], [0.5, np.nan])


def test_every_log_has_its_twin_and_checked_ones_further_days(ur10e, swing):
    found, more = twins(dict.fromkeys((*CHECKED, LOADED), swing), ur10e, day_draws=2)
    assert set(found) == {*CHECKED, LOADED} and len(more) == len(CHECKED)
    assert np.any(more[0].current != found[CHECKED[0]].current)
    # 27 N at some .7 m in front of the shoulder
    extra = found[LOADED].current[:, 1] - found[CHECKED[0]].current[:, 1]
    assert abs(extra.mean()) * ur10e.torque_per_ampere[1] > 5.0


def test_the_factor_is_students_of_the_two_simulated_arms():
    # Two joints that lie apart by exp(+-.1): t(2 degrees of freedom, 97.5 %) = 4.3027 (tables)
    found = told_apart(np.array([1.5, 1.6]), np.exp([0.1, -0.1]), 0.25)
    assert found.factor == pytest.approx(math.exp(0.43027), rel=1e-4)  # 1.54
    assert found.joints.tolist() == [False, True]


def test_what_lies_within_the_aim_is_never_told_apart():
    found = told_apart(np.array([1.2, 0.8, 1.3, 0.7]), np.exp([1e-3, -1e-3, 1e-3, 1e-3]), 0.25)
    assert found.joints.tolist() == [False, False, True, True]


def test_joints_without_a_number_say_nothing():
    found = told_apart(np.array([NAN, 3.0]), np.array([NAN, 1.01]), 0.25)
    assert found.joints.tolist() == [False, True]
    nothing = told_apart(np.array([NAN, 3.0]), np.array([NAN, NAN]), 0.25)
    assert math.isnan(nothing.factor) and not nothing.joints.any()


def test_of_equal_arms_few_are_told_apart():
    # Both the real arm and the second simulated one lie off the first by the same chance: 5 % of
    # the numbers are called different at most (fewer: those within the aim are not). 600 x 6
    # numbers: .05 +- .004
    random = np.random.default_rng(1)
    ratios, again = np.exp(0.4 * random.standard_normal((2, 600, 6)))
    share = np.mean([told_apart(r, a, 0.0).joints for r, a in zip(ratios, again, strict=True)])
    assert share == pytest.approx(0.05, abs=0.012)
