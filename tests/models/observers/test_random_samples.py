"""Doubles of any bits among sound samples, in every observer and method."""

import pytest
from fuzzing.random_samples import estimators, faults

_TICKS = 5000  # of each here; `make fuzz` takes a million


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, _ in estimators()])
def test_outputs_are_finite_and_recover_after_bad_samples(name: str) -> None:
    assert faults(dict(estimators())[name], _TICKS, seed=1) == []
