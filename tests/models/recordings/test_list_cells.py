"""Cells that hold lists."""

import time
from pathlib import Path

import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.list_cells import UnfoldedFile, entries, has_lists


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


def test_rows_keep_the_numbers_of_their_lines(tmp_path: Path) -> None:
    """Also where blank lines stand before the first row and a cell has line breaks."""
    log = tmp_path / "log.csv"
    log.write_text('# made by a robot\nt,q\n\n0,"[1,\n2]"\n\n1,"[3, 4]"\n')
    table = UnfoldedFile(log, ",", ("t", "q"), num_lines=3)
    lines = table.path.read_text().split("\n")
    assert lines == ["", "", "", "t,q.1,q.2", "0,1,2", "", "1,3,4", ""]
    log.write_text('# made by a robot\nt,q\n\n0,"[1, 2]"\n1,"[3]"\n')
    with pytest.raises(InputError, match="line 5, column q: holds a list of 1 entries"):
        UnfoldedFile(log, ",", ("t", "q"), num_lines=3)
