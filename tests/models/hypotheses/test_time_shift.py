"""What a shift's standard error adds to its evidence; what shifts are found: test_judgement."""

import numpy as np
import pytest

from wrenchsight.models.hypotheses.time_shift import (
    MAX_SHIFT,
    peak_of_parabola,
    peak_width_share,
)


def test_the_share_is_the_integral_of_the_peak_over_the_range():
    sd = 0.1
    shift, step = np.linspace(-MAX_SHIFT, MAX_SHIFT, 20001, retstep=True)
    integral = np.exp(-0.5 * (shift / sd) ** 2).sum() * step
    assert peak_width_share(sd) == pytest.approx(integral / (2.0 * MAX_SHIFT), rel=1e-6)


def test_a_shift_that_is_not_determined_is_not_rewarded():
    """Its peak is wider than the range: no shift is likelier than the others."""
    assert peak_width_share(MAX_SHIFT) == 1.0


@pytest.mark.parametrize("off_s", [0.0, 3e-4, -2e-3, 0.011])
def test_the_peak_of_a_parabola_is_found_between_its_neighbours(off_s):
    best, step, sd = 0.1, 0.02, 5e-3

    def log_evidence(shift):
        return 7.0 - 0.5 * ((shift - best - off_s) / sd) ** 2

    peak = peak_of_parabola(
        best, log_evidence(best), (log_evidence(best - step), log_evidence(best + step))
    )
    assert peak.shift == pytest.approx(best + off_s, abs=1e-12)
    assert peak.sd == pytest.approx(sd)


def test_flat_evidence_leaves_the_shift_as_it_is():
    peak = peak_of_parabola(0.1, 7.0, (7.0, 7.0))
    assert peak.shift == 0.1
    assert peak.sd == MAX_SHIFT
