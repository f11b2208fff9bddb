"""The uniform grid: identity on uniform logs, exact on linear signals, the same in any chunks."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings import resampling
from wrenchsight.models.recordings.recording import Recording, concatenated
from wrenchsight.models.recordings.resampling import DROPOUT_STEPS, resample_chunks, resampled

_SLOPE = np.array([2.0, -3.0])


def _linear(t: np.ndarray) -> Recording:
    """Signals that are linear in time, so that linear interpolation must be exact."""
    ramp = t[:, None] * _SLOPE
    return Recording(
        t=t,
        q=1 + ramp,
        v=2 + ramp,
        current=3 + ramp,
        tau_J=4 + ramp,
        source="log.csv",
        extra={"matrix": t[:, None, None] * np.arange(6.0).reshape(2, 3)},
        row=np.arange(len(t)) + 2,
        row_word="line",
    )


def _jittery(seed: int, num_samples: int, jitter: float = 0.4, step: float = 0.01) -> Recording:
    noise = np.random.default_rng(seed).uniform(-jitter, jitter, num_samples)
    return _linear(100 + step * np.cumsum(1 + noise))


def _assert_same(a: Recording, b: Recording) -> None:
    for name in ("t", "q", "v", "current", "tau_J", "dropout", "row"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    np.testing.assert_array_equal(a.extra["matrix"], b.extra["matrix"])


def test_a_uniform_log_is_returned_unchanged() -> None:
    noise = np.random.default_rng(0).uniform(-0.004, 0.004, 500)
    log = _linear(5 + 0.001 * (np.arange(500) + noise))  # steps within 0.8 %
    _assert_same(resampled(log), log)
    assert not resampled(log).dropout.any()


def test_a_jittery_log_is_interpolated_on_its_median_step() -> None:
    log = _jittery(1, 400)
    result = resampled(log)
    steps = np.diff(result.t)
    np.testing.assert_allclose(steps, np.median(np.diff(log.t)), rtol=1e-9)
    assert result.t[0] == log.t[0]
    assert log.t[-1] - steps[0] < result.t[-1] <= log.t[-1]
    ramp = result.t[:, None] * _SLOPE
    # 1e-11: rounding of t near 100 s times the slope.
    np.testing.assert_allclose(result.q, 1 + ramp, rtol=0, atol=1e-11)
    np.testing.assert_allclose(result.v, 2 + ramp, rtol=0, atol=1e-11)
    np.testing.assert_allclose(result.current, 3 + ramp, rtol=0, atol=1e-11)
    np.testing.assert_allclose(result.tau_J, 4 + ramp, rtol=0, atol=1e-11)
    expected = result.t[:, None, None] * np.arange(6.0).reshape(2, 3)
    np.testing.assert_allclose(result.extra["matrix"], expected, rtol=0, atol=1e-10)
    assert not result.dropout.any()


def test_a_requested_step_gives_the_grid() -> None:
    log = _linear(np.arange(100) * 0.01)
    result = resampled(log, time_step=0.004)
    np.testing.assert_allclose(result.t, 0.004 * np.arange(248), atol=1e-15)
    np.testing.assert_allclose(result.q, 1 + result.t[:, None] * _SLOPE, atol=1e-14)
    assert not resampled(log, time_step=0.05).dropout.any()


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 1000),
    cuts=st.lists(st.integers(1, 299), max_size=8, unique=True),
    num_regular=st.integers(0, 299),
)
def test_chunks_of_any_size_give_the_samples_of_one_pass(
    seed: int, cuts: list[int], num_regular: int
) -> None:
    log = _jittery(seed, 300, jitter=0.7)
    if num_regular:
        regular = log.t[0] + 0.01 * np.arange(num_regular)
        irregular = log.t[num_regular:] - log.t[num_regular] + regular[-1] + 0.01
        log = _linear(np.r_[regular, irregular])
    edges = [0, *sorted(cuts), 300]
    chunks = [log[a:b] for a, b in itertools.pairwise(edges)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(resampling, "STEP_SAMPLES", 50)  # else the first chunk would be the whole log
        _assert_same(concatenated(list(resample_chunks(chunks))), resampled(log))


def test_a_short_dropout_is_bridged_and_flagged() -> None:
    t = np.delete(np.arange(400) * 0.001, np.arange(120, 150))  # 30 ms are missing
    result = resampled(_linear(t))
    assert result.num_samples == 400
    np.testing.assert_array_equal(np.flatnonzero(result.dropout), np.arange(120, 150))
    np.testing.assert_allclose(result.q, 1 + result.t[:, None] * _SLOPE, atol=1e-12)
    again = resampled(result)  # a flag of the log stays set
    np.testing.assert_array_equal(again.dropout, result.dropout)


def test_a_sample_after_one_that_lacks_a_number_keeps_its_numbers() -> None:
    log = _linear(np.delete(np.arange(300) * 0.01, 20))  # interpolated from there on
    log.q[100::10] = np.nan
    result = resampled(replace(log, dropout=np.isnan(log.q[:, 0])))
    np.testing.assert_array_equal(np.isnan(result.q).any(axis=1), result.dropout & (result.t > 0.5))


def test_jitter_is_no_dropout() -> None:
    steps = np.full(300, 0.01)
    steps[::7] = 0.01 * (DROPOUT_STEPS - 0.05)
    assert not resampled(_linear(np.cumsum(steps))).dropout.any()


def test_one_missing_sample_is_a_dropout() -> None:
    result = resampled(_linear(np.delete(np.arange(300) * 0.01, 77)))
    np.testing.assert_array_equal(np.flatnonzero(result.dropout), [77])


def test_a_long_gap_is_refused_in_one_line() -> None:
    t = np.delete(np.arange(600) * 0.001, np.arange(120, 250))
    with pytest.raises(InputError) as caught:
        resampled(_linear(t))
    line = str(caught.value)
    assert line.startswith("log.csv: line 121 to line 122, column t: a gap of 0.131 s")
    assert line.endswith("split the log there, or let `estimate` bridge it (--max-gap)")
    assert "expected at most 0.1 s" in line
    result = resampled(_linear(t), max_gap=0.2)
    assert result.dropout.sum() == 130
    with pytest.raises(InputError, match=r"expected at most 0\.002 s"):
        resampled(_linear(np.delete(np.arange(600) * 0.001, [50, 51])), max_gap=0.002)


def test_a_slow_log_may_miss_two_samples() -> None:
    t = np.arange(100) * 0.05
    assert resampled(_linear(np.delete(t, [40, 41]))).dropout.sum() == 2
    with pytest.raises(InputError, match=r"a gap of 0\.2 s, expected at most 0\.1515 s"):
        resampled(_linear(np.delete(t, [40, 41, 42])))


def test_a_gap_between_chunks_is_refused() -> None:
    log = _linear(np.delete(np.arange(600) * 0.001, np.arange(120, 250)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(resampling, "STEP_SAMPLES", 50)
        with pytest.raises(InputError, match=r"a gap of 0\.131 s"):
            list(resample_chunks([log[:120], log[120:]]))


def test_implausible_steps_are_refused_in_one_line() -> None:
    with pytest.raises(InputError, match=r"time repeats 0\.02 s"):
        resampled(_linear(np.array([0, 0.01, 0.02, 0.02, 0.03, 0.04])))
    # A column that creeps is no clock: no rate is made of it.
    creeping = np.repeat(1e-8 * np.arange(40), 2)
    with pytest.raises(InputError, match=r"rate_hz=100, with the rate that it was recorded at"):
        resampled(_linear(creeping))
    with pytest.raises(InputError, match=r"median step is 10 s.*looks like ms"):
        resampled(replace(_linear(np.arange(20) * 0.01), t=np.arange(20) * 10.0))
    with pytest.raises(InputError, match="one sample only"):
        resampled(_linear(np.zeros(1)))
    with pytest.raises(InputError, match="expected 1e-05 to 1 s"):
        resampled(_linear(np.arange(20) * 0.01), time_step=0.0)
    with pytest.raises(InputError, match="max gap: -1 s, expected"):
        resampled(_linear(np.arange(20) * 0.01), max_gap=-1.0)
