import numpy as np
import pytest

from wrenchsight.models.numerics.finite import all_below


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e9, -2e9])
def test_one_number_that_is_not_below_decides(bad):
    values = np.array([0.0, -9e8, 3.0])
    assert all_below(values, 1e9)
    for k in range(3):
        changed = values.copy()
        changed[k] = bad
        assert not all_below(changed, 1e9)
