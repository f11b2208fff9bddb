"""What `place` prints of a placement."""

import pytest

from wrenchsight.analyses.commands.place import _vector


@pytest.mark.parametrize("last_bits", [-4e-17, 0.0, 4e-17])
def test_a_number_that_is_rounded_to_zero_has_no_sign(last_bits: float) -> None:
    assert _vector([0.1391, last_bits, -0.0001]) == "0.1391 0.0000 -0.0001"
