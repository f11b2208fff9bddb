from types import SimpleNamespace

import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.table_checks import refuse_missing, rows_within


def test_rows_beyond_the_file_are_refused_with_its_number_of_rows(tmp_path):
    assert rows_within(tmp_path, None, 7, "rows") == (1, 7)
    assert rows_within(tmp_path, (2, 7), 7, "rows") == (2, 7)
    with pytest.raises(
        InputError, match="has 7 messages on /arm, but the description selects rows 2 to 8"
    ):
        rows_within(tmp_path, (2, 8), 7, "messages on /arm")


def test_the_first_missing_value_is_named_unless_it_may_be_empty(tmp_path):
    values, rows = np.array([[1.0, np.nan], [np.inf, 2.0], [np.nan, 3.0]]), np.array([5, 6, 7])
    table = SimpleNamespace(row_word="row", names=("a", "b", "c"))
    for may_be_empty, place in (
        ((), "row 5, column c"),
        ((2,), "row 6, column a"),
        ((0, 2), "row 6, column a"),  # inf is nothing that is missing
    ):
        with pytest.raises(InputError, match=place):
            refuse_missing(table, tmp_path, values, rows, [0, 2], may_be_empty)
    refuse_missing(table, tmp_path, values[2:], rows[2:], [0, 2], [0, 2])
