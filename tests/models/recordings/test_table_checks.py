import numpy as np
import pytest

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.table_checks import first_missing, rows_within


def test_rows_beyond_the_file_are_refused_with_its_own_count(tmp_path):
    assert rows_within(tmp_path, None, 7, "rows") == (1, 7)
    assert rows_within(tmp_path, (2, 7), 7, "rows") == (2, 7)
    with pytest.raises(InputError, match="has 7 messages on /arm, but rows 2 to 8"):
        rows_within(tmp_path, (2, 8), 7, "messages on /arm")


def test_the_first_missing_value_is_named_and_what_may_be_empty_is_not():
    values = np.array([[1.0, np.nan], [np.inf, 2.0], [np.nan, 3.0]])
    assert first_missing(values, np.array([False, False])) == (0, 1)
    assert first_missing(values, np.array([False, True])) == (1, 0)
    assert first_missing(values, np.array([True, True])) == (1, 0)  # inf is nothing that is missing
    assert first_missing(values[2:], np.array([True, True])) is None
