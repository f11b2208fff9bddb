"""What a shift's standard error adds to its evidence; what shifts are found: test_judgement."""

import numpy as np
import pytest

from wrenchsight.models.hypotheses.time_shift import MAX_SHIFT, peak_width_share


def test_the_share_is_the_integral_of_the_peak_over_the_range():
    sd = 0.1
    shift, step = np.linspace(-MAX_SHIFT, MAX_SHIFT, 20001, retstep=True)
    integral = np.exp(-0.5 * (shift / sd) ** 2).sum() * step
    assert peak_width_share(sd) == pytest.approx(integral / (2.0 * MAX_SHIFT), rel=1e-6)


def test_a_shift_that_is_not_determined_is_not_rewarded():
    """Its peak is wider than the range: no shift is likelier than the others."""
    assert peak_width_share(MAX_SHIFT) == 1.0
