"""Cells that hold lists."""

import time

import pytest

from wrenchsight.models.recordings.list_cells import entries, has_lists


@pytest.mark.parametrize(
    ("cell", "expected"),
    [
        ("[0.1, -2e3]", ["0.1", "-2e3"]),
        ("(1, 2,)", ["1", "2"]),
        ("[ 0.1\n  0.2 ]", ["0.1", "0.2"]),
        ("array([1., 2.])", ["1.", "2."]),
        ("['a_joint', \"b\"]", ["a_joint", "b"]),
        ("[]", []),
        ("0.5", None),
        ("[0.5", None),
    ],
)
def test_entries_of_a_cell(cell: str, expected: list[str] | None) -> None:
    assert entries(cell) == expected


@pytest.mark.parametrize(
    "cell", ["[" + " " * 100_000, "[" * 100_000, " " * 100_000 + "x", "[)" * 50_000]
)
def test_a_long_cell_takes_no_longer_than_its_length(cell: str) -> None:
    began = time.process_time()
    has_lists([cell])
    entries(cell)
    assert time.process_time() - began < 0.5  # s; a search that is quadratic takes minutes
