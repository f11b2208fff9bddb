"""The prior of the wrench before any log, from the arm's rated payload."""

import pytest

from wrenchsight.models.estimation.wrench_prior import live_prior


def test_live_prior_is_half_the_rated_weight() -> None:
    force_sd, moment_sd = live_prior(10.0)
    assert force_sd == pytest.approx(49.03, abs=0.01)
    assert moment_sd == pytest.approx(0.05 * force_sd)
