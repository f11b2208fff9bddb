import numpy as np
import pytest

from wrenchsight.models.control.wrench_script import (
    HandPush,
    WrenchRamp,
    WrenchScript,
    WrenchSine,
    WrenchStep,
)
from wrenchsight.models.files.input_error import InputError


def sampled(script, t):
    """The wrench (T, 6) at times t (T,)."""
    return np.array([script.sample(time) for time in t])


def test_nothing_written_is_no_wrench():
    np.testing.assert_array_equal(WrenchScript([]).sample(1.0), np.zeros(6))


def test_step_is_rotation_first_and_ends():
    script = WrenchScript([WrenchStep(1.0, 2.0, force=[1, 2, 3], moment=[4, 5, 6])])
    for t, gain in ((0.999, 0), (1.0, 1), (2.999, 1), (3.0, 0)):
        np.testing.assert_array_equal(script.sample(t), gain * np.array([4, 5, 6, 1, 2, 3]))


def test_segments_add_up():
    script = WrenchScript(
        [
            WrenchRamp(start=1.0, rise=2.0, force=[0, 0, 8.0]),
            WrenchSine(start=0.5, frequency=3.0, phase=0.2, force=[5.0, 0, 0], moment=[0, 1.0, 0]),
        ]
    )
    t = np.linspace(0, 5, 1001)
    sine = np.where(t >= 0.5, np.sin(6 * np.pi * (t - 0.5) + 0.2), 0.0)
    expected = np.zeros((t.size, 6))
    expected[:, 5] = 8 * np.clip((t - 1) / 2, 0, 1)
    expected[:, 3] = 5 * sine
    expected[:, 1] = sine
    np.testing.assert_allclose(sampled(script, t), expected, atol=1e-13)


def test_hand_push_keeps_its_band_its_size_and_its_seed():
    push = HandPush(start=0.0, duration=400.0, bandwidth=2.0, force=[10.0, 0, 0], seed=3)
    t = np.arange(0, 400, 0.01)
    x = sampled(WrenchScript([push], seed=1), t)
    # 24 tones over 800 periods of the band: the sample sd is the stated one within a few per cent
    assert abs(x[100:-100, 3].std() / 10 - 1) < 0.05
    assert np.all(x[:, [0, 1, 2, 4, 5]] == 0)
    spectrum = np.abs(np.fft.rfft(x[:, 3] * np.hanning(t.size))) ** 2
    outside = np.fft.rfftfreq(t.size, 0.01) > 2.05
    assert spectrum[outside].sum() < 1e-6 * spectrum.sum()
    np.testing.assert_array_equal(x, sampled(WrenchScript([push], seed=1), t))
    assert not np.allclose(x, sampled(WrenchScript([push], seed=2), t))
    assert x[0, 3] == 0  # faded in


def test_pushes_with_pauses_are_a_single_push_that_is_gated():
    pushes = {"start": 1.0, "duration": 11.0, "force": [5.0, 0.0, 0.0], "fade": 0.5}
    t = np.arange(0.0, 13.0, 0.01)
    whole = sampled(WrenchScript([HandPush(**pushes)]), t)[:, 3]
    parts = sampled(WrenchScript([HandPush(**pushes, each=3.0, pause=2.0)]), t)[:, 3]
    since = (t - 1.0) % 5.0
    acts = (t > 1.0) & (t < 12.0) & (since < 3.0)
    assert not parts[~acts].any()
    inner = acts & (since > 0.5) & (since < 2.5) & (t > 1.5) & (t < 11.5)
    np.testing.assert_array_equal(parts[inner], whole[inner])
    # Cut off at the end of the duration, faded there as well; no step anywhere.
    assert np.abs(np.diff(parts)).max() < 2.0 * np.abs(np.diff(whole)).max()


def test_hand_push_axes_differ():
    x = sampled(WrenchScript([HandPush(force=[1.0, 1.0, 1.0])]), np.arange(1, 4, 0.01))
    assert abs(np.corrcoef(x[:, 3], x[:, 4])[0, 1]) < 0.9


@pytest.mark.parametrize(
    ("segment", "words"),
    [
        (WrenchStep(force=[1.0, 2.0]), "force"),
        (WrenchStep(moment=[1.0, 2.0, float("nan")]), "moment"),
        (WrenchStep(duration=0.0), "duration"),
        (WrenchRamp(rise=-1.0), "rise"),
        (WrenchSine(frequency=0.0), "frequency"),
        (HandPush(bandwidth=float("inf")), "bandwidth"),
        (HandPush(start=float("nan")), "start"),
        (HandPush(each=1.0, pause=-1.0), "pause"),
    ],
)
def test_an_invalid_segment_is_one_line(segment, words):
    with pytest.raises(InputError, match=words) as error:
        WrenchScript([WrenchStep(), segment], source="my.yaml")
    assert "my.yaml: wrench segment 2" in str(error.value)
    assert "\n" not in str(error.value)
