"""Logs whose rows are of other moments than they say."""

import numpy as np

from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.truth_config import ClockConfig
from wrenchsight.models.truth.log_clock import clocked

T = 1e-3 * np.arange(5000)
RAMPS = np.stack([T, 2.0 * T], axis=1)
LOG = Recording(t=T, q=RAMPS, v=3.0 * RAMPS, current=4.0 * RAMPS, source="ramps")


def test_an_exact_clock_leaves_the_log_alone():
    assert clocked(LOG, None, 0) is LOG
    assert clocked(LOG, ClockConfig(), 0) is LOG


def test_currents_are_older_by_the_latency():
    stamped = clocked(LOG, ClockConfig(latency=2.5e-3), 0)
    np.testing.assert_allclose(stamped.q, LOG.q, atol=1e-12)
    np.testing.assert_allclose(
        stamped.current[10:], 4.0 * (RAMPS - [2.5e-3, 5e-3])[10:], atol=1e-12
    )


def test_jitter_moves_a_whole_row_by_the_stated_sd():
    stamped = clocked(LOG, ClockConfig(jitter_sd=2e-4), 7)
    inner = slice(10, -10)
    moved = (stamped.q - LOG.q)[inner, 0]
    assert abs(moved.std() / 2e-4 - 1.0) < 0.05  # of 5000 draws: 1 %
    np.testing.assert_allclose((stamped.v - LOG.v)[inner, 0], 3.0 * moved, atol=1e-12)
    np.testing.assert_allclose((stamped.current - LOG.current)[inner, 1], 8.0 * moved, atol=1e-12)
    np.testing.assert_array_equal(stamped.t, LOG.t)
    np.testing.assert_array_equal(clocked(LOG, ClockConfig(jitter_sd=2e-4), 7).q, stamped.q)


def test_rows_are_interpolated_as_numpy_does_it_to_the_bit():
    rng = np.random.default_rng(3)
    signal = rng.standard_normal((len(T), 3)).cumsum(axis=0)
    log = Recording(t=T, q=signal, v=signal, current=signal, source="walk")
    jitter = np.random.default_rng([5, 23]).standard_normal(len(T))
    stamped = clocked(log, ClockConfig(latency=2.5e-3, jitter_sd=4e-4), 5)
    for times, read_signal in (
        (T + 4e-4 * jitter, stamped.q),
        (T + 4e-4 * jitter - 2.5e-3, stamped.current),
    ):
        expected = [np.interp(times, T, column) for column in signal.T]
        np.testing.assert_array_equal(read_signal, np.stack(expected, axis=1))
