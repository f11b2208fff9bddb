"""Streams of unknown length: what is kept is what numpy finds in the whole."""

import numpy as np
import pytest

from wrenchsight.analyses.output.stream_summary import Envelope, EvenSample


@pytest.mark.parametrize("chunk", [1, 3, 64, 1000])
def test_an_even_sample(chunk: int) -> None:
    rows = np.arange(1000.0)[:, None]
    sample = EvenSample(100)
    for begin in range(0, 1000, chunk):
        sample.add(rows[begin : begin + chunk])
    np.testing.assert_array_equal(sample.values()[:, 0], np.arange(0, 1000, 16))
    short = EvenSample(100)
    short.add(rows[:100])
    np.testing.assert_array_equal(short.values(), rows[:100])


@pytest.mark.parametrize("chunk", [1, 7, 50, 999])
def test_an_envelope_holds_every_peak(chunk: int) -> None:
    x = np.random.default_rng(8).normal(size=(999, 2))
    envelope = Envelope(20)
    for begin in range(0, 999, chunk):
        part = x[begin : begin + chunk]
        envelope.add(part, part, part)
    low, high, mean = envelope.values()
    assert 20 <= len(low) <= 41
    size = 32
    starts = np.arange(0, 999, size)
    np.testing.assert_array_equal(low, np.minimum.reduceat(x, starts))
    np.testing.assert_array_equal(high, np.maximum.reduceat(x, starts))
    counts = np.diff(np.r_[starts, 999])[:, None]
    np.testing.assert_allclose(mean, np.add.reduceat(x, starts) / counts, rtol=1e-12, atol=1e-13)
    short = Envelope(20)
    short.add(x[:10], x[:10], x[:10])
    np.testing.assert_array_equal(short.values()[0], x[:10])
