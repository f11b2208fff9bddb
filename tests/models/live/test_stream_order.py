"""The grid of live samples against that of logs."""

import numpy as np
import pytest

from wrenchsight.models.live.stream_order import GridSample, SampleGrid
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.recordings.resampling import resampled


@pytest.mark.parametrize("jitter", [0.0, 0.003, 0.3])
@pytest.mark.parametrize("lost", [0.0, 0.2])
def test_it_is_the_grid_of_a_log_bit_by_bit(jitter, lost):
    rng = np.random.default_rng(5)
    T, h = 400, 0.002
    t = 1.7e9 + h * (np.arange(T) + jitter * rng.uniform(-1.0, 1.0, T))
    is_received = rng.uniform(size=T) > lost
    is_received[:20] = True
    t = t[is_received]
    signals = rng.normal(size=(3, len(t), 2))
    dropout = rng.uniform(size=len(t)) < 0.05
    signals[:, dropout] = np.nan
    log = Recording(t=t, q=signals[0], v=signals[1], current=signals[2], source="", dropout=dropout)
    expected = resampled(log, h)

    grid = SampleGrid(h)
    grid_rows = []
    for k in range(len(t)):
        x = signals[:, k].ravel()
        grid_rows += grid.take(GridSample(float(t[k]), x, bool(dropout[k])))

    assert len(grid_rows) == expected.num_samples
    np.testing.assert_array_equal([one.t for one in grid_rows], expected.t)
    np.testing.assert_array_equal([one.dropout for one in grid_rows], expected.dropout)
    together = np.hstack([expected.q, expected.v, expected.current])
    np.testing.assert_array_equal([one.x for one in grid_rows], together)
    assert np.isfinite(together[~expected.dropout]).all()
