"""The tables of docs/faults.md name every kind, and metrics that a run has."""

from pathlib import Path

from wrenchsight.analyses.experiments.faults.begun_faults import BEGUN_FAULTS, COURSES
from wrenchsight.analyses.experiments.faults.damages import DAMAGES
from wrenchsight.analyses.experiments.faults.page import (
    BEGUN_WORDS,
    PUSH_WORDS,
    ROWS,
    tables,
)
from wrenchsight.analyses.study.wording import filled


def test_every_kind_has_its_row() -> None:
    kinds = [kind for row in ROWS.values() for kind in row]
    assert sorted(kinds) == sorted(DAMAGES)
    assert set(BEGUN_WORDS) == set(BEGUN_FAULTS)
    assert set(PUSH_WORDS) == {"none", *COURSES, "all"}


def test_cells_are_filled() -> None:
    row = {
        "number": 5,
        "named": 4,
        "recognised_after_s": None,
        "valid_and_wrong_s": 0.25,
        "largest_n": 3.0,
    }
    begun = row | {"checked_valid_and_wrong_s": 0.1, "too_long": 0}
    lost = {"number": 7, "wrong_signal_pct": 0.5, "checked_wrong_signal_pct": 0.4}
    metrics = {
        "rows": dict.fromkeys(ROWS, row),
        "begun": dict.fromkeys(BEGUN_WORDS, begun),
        "pushes": dict.fromkeys(PUSH_WORDS, lost | {"worst_wrong_signal_pct": 9.75}),
    }
    cells = [filled(line, metrics) for table in tables(metrics) for line in table.rows]
    assert cells[0] == ["sign of one current turned", "5", "0.25", "0.10", "0"]
    assert cells[-1] == ["currents without sign", "4 of 5", "–", "0.2", "3.0"]
    assert all(len(line) == 5 for line in cells)


def test_the_page_has_the_places_of_all_tables() -> None:
    page = (Path(__file__).parents[4] / "docs" / "faults.md").read_text(encoding="utf-8")
    for name in ("begun", "pushes", "logs"):
        assert page.count(f"<!-- table {name}: begin -->") == 1
