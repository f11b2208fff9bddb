"""Shares of the readings that are not valid: they add up, and one line says them."""

import numpy as np
import pytest

from wrenchsight.models.estimation.invalid import (
    HIDDEN_BY_STICTION,
    OTHER_LINK,
    SETTLING,
    UNCERTAIN_FORCE,
)
from wrenchsight.models.estimation.invalid_shares import InvalidShares, invalid_pct
from wrenchsight.models.estimation.wrench import ValidityLimits

LIMITS = ValidityLimits(24.5, 9.81, 61.3, 3.1)


def test_a_reading_with_several_reasons_counts_once():
    shares = InvalidShares()
    invalid = np.zeros(1000, np.int64)
    invalid[:23] |= SETTLING
    invalid[:144] |= UNCERTAIN_FORCE  # 121 of them not settling
    invalid[500:540] |= HIDDEN_BY_STICTION
    for part in (invalid[:100], invalid[100:100], invalid[100:]):
        shares.add(part)
    assert (shares.count, shares.num_valid) == (1000, 816)
    assert shares.metrics() == pytest.approx(
        {"settling_pct": 2.3, "uncertain_force_pct": 12.1, "hidden_by_stiction_pct": 4.0}
    )
    assert invalid_pct(invalid) == shares.metrics()
    line, help_line = shares.sentences(LIMITS)
    assert line == (
        "18.4 % not valid: 12.1 % force sd above 24 N, 4.0 % stiction that could be 9.8 N, "
        "2.3 % settling"
    )
    assert "wrenchsight place" in help_line


def test_without_a_reason_there_is_no_line():
    shares = InvalidShares()
    shares.add(np.zeros(10, np.int64))
    assert shares.sentences(LIMITS) == () and shares.metrics() == {} and not shares.largest


def test_a_share_that_would_read_as_nothing_is_left_out():
    shares = InvalidShares()
    shares.add(np.repeat([0, SETTLING, OTHER_LINK], [99_000, 999, 1]))
    assert shares.sentence(LIMITS) == "1.0 % not valid: 1.0 % settling"
