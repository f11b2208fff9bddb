"""Which logs settle the truth and which judge it; ratios of what is compared."""

import numpy as np

from wrenchsight.analyses.experiments.realism.comparison import (
    CHECKED,
    FIT,
    LOADED,
    PASSES,
    SETTLED,
    SETTLED_LOAD,
    compared,
    twins,
)


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
