"""A log that is too short: told by how much, in numbers that differ and that are enough."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wrenchsight.analyses.methods.identify.identification_config import IdentificationConfig
from wrenchsight.analyses.methods.identify.low_passed_logs import (
    LARGEST_CUTOFF,
    SHORTEST_LOG,
    long_enough,
    low_pass_log,
    low_pass_logs,
    missing_time,
)
from wrenchsight.models.files.input_error import InputError
from wrenchsight.models.recordings.recording import Recording
from wrenchsight.models.robot.robot import Robot

LINE = re.compile(
    r"lasts (\S+) s from .* at a cutoff of (\S+) Hz it must last (\S+) s .*: (\S+) s more; "
    r"record a longer log(?:, or raise --cutoff-hz to (\S+))?"
)


def log_of(samples: int, step: float, begin: float = 0.0) -> Recording:
    t = begin + step * np.arange(samples)
    q = 0.3 * np.sin(t)[:, None] * np.ones(6)
    return Recording(t=t, q=q, v=0.3 * np.cos(t)[:, None] * np.ones(6), current=q, source="a.csv")


def test_stops_count_in_no_log_fitted_or_held_out(ur10e: Robot) -> None:
    """Friction at rest is any torque in its band: 3 s of rest of 12 are left out of both."""
    moving, step = log_of(1200, 0.01), 0.01
    t = moving.t
    turned = np.where(t < 5.0, t, np.where(t < 8.0, 5.0, t - 3.0))  # rests from 5 s to 8 s
    q = 0.3 * np.sin(turned)[:, None] * np.ones(6)
    v = 0.3 * (np.cos(turned) * ((t < 5.0) | (t >= 8.0)))[:, None] * np.ones(6)
    stopping = replace(moving, q=q, v=v, current=q)
    config = IdentificationConfig(time_step=step, cutoff=5.0)
    logs = low_pass_logs([stopping], ur10e, [stopping], config, lambda *_: None)
    (fitted,), (held_out,) = logs.fitted, logs.validation
    assert np.array_equal(fitted.used, held_out.used)
    rests = (fitted.t > 5.5) & (fitted.t < 7.5)
    assert rests.any() and not held_out.used[rests].any()
    assert held_out.used[(fitted.t > 1.0) & (fitted.t < 4.0)].all()


def refusal(recording: Recording, robot: Robot, config: IdentificationConfig) -> str | None:
    try:
        low_pass_log("a", recording, robot, config)
    except InputError as error:
        return str(error)
    return None


def test_five_seconds_at_500_hz_last_one_step_less(ur10e: Robot) -> None:
    config = IdentificationConfig(time_step=0.002, cutoff=5.0)
    line = refusal(log_of(2500, 0.002), ur10e, config)
    assert line == (
        "a.csv: the log lasts 4.998 s from its first sample to its last; at a cutoff of 5 Hz it "
        "must last 5 s (25 periods of the cutoff): 0.002 s more; record a longer log, or raise "
        "--cutoff-hz to 5.01"
    )
    assert refusal(log_of(2501, 0.002), ur10e, config) is None


@settings(max_examples=60, deadline=None)
@given(
    cutoff=st.sampled_from([0.7, 1.0, 3.0, 5.0, 7.5]),
    rate=st.sampled_from([31.0, 100.0, 125.0, 500.0]),
    samples_off=st.integers(-30, 3),
    begin=st.sampled_from([0.0, 288.321, 1.7e9]),
)
def test_the_stated_length_suffices_and_never_prints_equal_to_the_logs_length(
    ur10e: Robot, cutoff: float, rate: float, samples_off: int, begin: float
) -> None:
    step, needed = 1.0 / rate, SHORTEST_LOG / cutoff
    recording = log_of(round(needed * rate) + 1 + samples_off, step, begin)
    config = IdentificationConfig(time_step=step, cutoff=cutoff)
    line = refusal(recording, ur10e, config)
    assert (line is None) == (missing_time(recording, needed) == 0.0)
    if line is None:
        return
    result = LINE.search(line)
    assert result is not None
    length, _, least, short = (float(x) for x in result.groups()[:4])
    assert length < least
    assert short == pytest.approx(least - length, rel=1e-9, abs=1e-12)
    assert length <= recording.duration + 2e-8  # a millionth of its last digit
    assert least >= needed - 2e-8
    # Two digits: no more than a fifth is said too much.
    assert short <= 1.2 * (needed - recording.duration) + 2e-8
    longer = replace(recording, t=recording.t.copy())
    longer.t[-1] += short
    assert missing_time(longer, needed) == 0.0
    if result[5] is not None:
        higher = float(result[5])
        assert higher > cutoff
        assert refusal(recording, ur10e, replace(config, cutoff=higher)) is None
    else:
        assert 1.01 * SHORTEST_LOG / recording.duration * step > LARGEST_CUTOFF


def test_a_slow_log_is_told_of_an_option_only_where_one_sets_the_cutoff(ur10e: Robot) -> None:
    config, log = IdentificationConfig(time_step=0.1, cutoff=5.0), log_of(200, 0.1)
    line = "20 samples a second or more, there are 10; "
    with pytest.raises(InputError, match=rf"{line}add --cutoff-hz 2\.5"):
        low_pass_log("", log, ur10e, config)
    with pytest.raises(InputError, match=f"{line}record with a higher rate"):
        low_pass_log("", log, ur10e, config, 7.5)  # periods of a known model's cutoff


def test_rounding_of_times_is_not_missing_time(ur10e: Robot) -> None:
    config = IdentificationConfig(time_step=0.01, cutoff=5.0)
    recording = log_of(501, 0.01)
    recording.t[-1] -= 2.4e-7  # the grain of UNIX time
    assert recording.duration < 5.0
    assert refusal(recording, ur10e, config) is None
    assert long_enough([recording], config) == ([recording], [])


def test_only_identify_offers_another_cutoff(ur10e: Robot) -> None:
    config = IdentificationConfig(time_step=0.01, cutoff=5.0)
    with pytest.raises(InputError, match=r"record a longer log$"):
        low_pass_log("a", log_of(120, 0.01), ur10e, config, shortest=7.5)
