import numpy as np
import pytest

from wrenchsight.models.numerics.stretches import stretches


@pytest.mark.parametrize(
    "flag, expected",
    [
        ([], []),
        ([False, False], []),
        ([True, True, True], [slice(0, 3)]),
        ([True, False, True, True, False], [slice(0, 1), slice(2, 4)]),
        ([False, True], [slice(1, 2)]),
    ],
)
def test_stretches_end_with_the_log_or_before_it(flag, expected):
    assert stretches(np.array(flag, dtype=bool)) == expected
