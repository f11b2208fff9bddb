"""What a shift's standard error adds to its evidence; what shifts are found: test_judgement."""

from types import SimpleNamespace

import numpy as np
import pytest

from wrenchsight.models.hypotheses import time_shift
from wrenchsight.models.hypotheses.time_shift import (
    MAX_SHIFT,
    MEAN_SHIFT,
    peak_of_parabola,
    peak_width_share,
)


@pytest.mark.parametrize("shift", [0.0, -0.3, 2.0])
def test_the_share_is_the_density_beforehand_times_the_width_of_the_peak(shift):
    """The peak is narrow: over it the density, whose integral is one, hardly changes."""
    sd = 0.01
    shifts, step = np.linspace(-MAX_SHIFT, MAX_SHIFT, 20001, retstep=True)
    density = np.exp(-np.abs(shifts) / MEAN_SHIFT) / (2.0 * MEAN_SHIFT)
    integral = (density * np.exp(-0.5 * ((shifts - shift) / sd) ** 2)).sum() * step
    # sd / MEAN_SHIFT is the largest relative change of the density within a standard error
    assert peak_width_share(shift, sd) == pytest.approx(integral, rel=sd / MEAN_SHIFT)


def test_a_shift_that_is_not_determined_is_not_rewarded():
    """Its peak is wider than the range: no shift is likelier than the others."""
    assert peak_width_share(0.0, MAX_SHIFT) == 1.0


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


@pytest.mark.parametrize("shift", [-1.05 * MAX_SHIFT, 1.05 * MAX_SHIFT])
def test_a_shift_beyond_what_is_tried_is_none(monkeypatch, shift):
    """A sound slide of a UR10e was said to have currents 3.2 s early."""
    best = time_shift._Shift(shift, log_evidence=50.0, sd=0.05)
    monkeypatch.setattr(time_shift, "_best_shift", lambda case, window, around=None: best)
    assert time_shift.explain(SimpleNamespace(rows=SimpleNamespace(step=0.02))) is None
