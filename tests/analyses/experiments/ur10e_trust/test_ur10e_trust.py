"""What counts as rest, reversal and sliding."""

import numpy as np

from wrenchsight.analyses.experiments.ur10e_trust.experiment import TIME_STEP, regimes


def test_each_sample_has_one_regime() -> None:
    t = TIME_STEP * np.arange(1000)
    v = np.stack([np.where(t < 6.0, np.cos(t), 0.0), np.where(t < 6.0, 0.5, 0.0)], axis=1)
    rows = regimes(v)
    parts = np.stack([rows[name] for name in ("rest", "reversal", "sliding")])
    np.testing.assert_array_equal(parts.sum(axis=0), 1)
    assert rows["all"].all()
    # Joint 1 turns at pi / 2 and 3 pi / 2; both stop at 6 s, and rest .3 s later.
    assert rows["reversal"][round(1.57 / TIME_STEP)]
    assert rows["reversal"][round(4.71 / TIME_STEP)]
    assert rows["sliding"][round(3.0 / TIME_STEP)]
    np.testing.assert_array_equal(rows["rest"], t >= 6.0 + 0.29 - 1e-9)
