"""Reasons why a reading is not valid: each alone, together, in words, and in the documentation."""

import re
from pathlib import Path

import numpy as np
import pytest

from wrenchsight.models.estimation import invalid
from wrenchsight.models.estimation.invalid import (
    FRICTION_DRIFT,
    HIDDEN_BY_STICTION,
    LAGGING,
    NO_CORRECTION,
    OTHER_LINK,
    REASONS,
    SAMPLE_FAULT,
    SAMPLE_MISSING,
    SETTLING,
    SINGULAR,
    UNCERTAIN_FORCE,
    UNEXPLAINED,
    WRONG_SIGNAL,
    Findings,
    first_reason,
    invalid_reasons,
    marked,
)

ROOT = Path(__file__).parents[3]
SOUND = Findings(
    is_fresh=True,
    is_missing=False,
    fault=0,
    is_corrected=True,
    has_reading=True,
    has_full_rank=True,
    force_sd=9.9,
    stiction_force=4.9,
    max_force_sd=10.0,
    max_stiction_force=5.0,
    is_explained=True,
    is_believed=True,
    keeps_pace=True,
)


@pytest.mark.parametrize(
    ("changes", "reasons"),
    [
        ({}, 0),
        ({"is_fresh": False}, SETTLING),
        ({"is_fresh": False, "is_missing": True}, SAMPLE_MISSING),
        ({"is_fresh": False, "is_missing": True, "fault": 2}, SAMPLE_FAULT),
        ({"has_reading": False, "force_sd": np.nan}, SAMPLE_MISSING),
        ({"is_corrected": False}, NO_CORRECTION),
        ({"has_full_rank": False}, SINGULAR),
        ({"force_sd": 10.1}, UNCERTAIN_FORCE),
        ({"force_sd": np.inf}, UNCERTAIN_FORCE),
        ({"stiction_force": 5.1}, HIDDEN_BY_STICTION),
        ({"is_explained": False}, UNEXPLAINED),
        ({"is_believed": False}, WRONG_SIGNAL),
        ({"keeps_pace": False}, LAGGING),
        ({"force_sd": 10.1, "is_believed": False}, UNCERTAIN_FORCE + WRONG_SIGNAL),
        # A fault of the sample before leaves the torque fresh: it is reported, not held against it.
        ({"fault": 4}, 0),
    ],
)
def test_each_finding_is_its_reason(changes, reasons):
    assert invalid_reasons(SOUND._replace(**changes)) == reasons


def test_a_later_reason_is_added_where_it_holds():
    before = np.array([0, SETTLING, SETTLING, OTHER_LINK])
    after = marked(before, OTHER_LINK, np.array([True, True, False, True]))
    assert after.tolist() == [OTHER_LINK, SETTLING | OTHER_LINK, SETTLING, OTHER_LINK]
    assert marked(before, FRICTION_DRIFT, False).tolist() == before.tolist()


def test_the_reason_that_explains_most_is_the_first():
    assert first_reason(0) is None
    assert first_reason(UNCERTAIN_FORCE | SETTLING) is REASONS[SETTLING]
    assert first_reason(UNCERTAIN_FORCE) is REASONS[UNCERTAIN_FORCE]


def test_every_code_is_a_bit_of_its_own_with_its_words():
    codes = {name: value for name, value in vars(invalid).items() if name.isupper()}
    del codes["REASONS"]
    assert sorted(codes.values()) == sorted(REASONS) == [1 << k for k in range(len(REASONS))]
    for name, code in codes.items():
        assert REASONS[code].key == name.lower()


def test_the_documentation_lists_every_reason():
    """One row each, with its code: the table is written by hand."""
    text = (ROOT / "docs" / "concepts.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| (\d+) \| `(\w+)` \|", text, re.MULTILINE))
    assert {int(code): key for code, key in rows.items()} == {
        code: words.key for code, words in REASONS.items()
    }
