"""Which logs show one motion."""

from dataclasses import replace

import numpy as np
import pytest
from sample_models import harmonic_motion

from wrenchsight.analyses.methods.identify.low_passed_logs import LowPassedLog
from wrenchsight.analyses.methods.identify.repeated_motion import (
    motion_groups,
    repeated_motion_notes,
)
from wrenchsight.models.identification.identified_model import LogSource
from wrenchsight.models.signals.zero_phase import ZeroPhaseLowPass

STEP = 0.02


def run(seed: int, duration: float = 20.0, pace: float = 1.0, start: float = 0.0) -> LowPassedLog:
    """A motion, begun at `start` s, at its own pace."""
    t = np.arange(0.0, duration, STEP)
    rng, rates = np.random.default_rng(seed), 0.6 * np.arange(1, 5)
    q, v, _ = harmonic_motion(rng, pace * (t + start), rates, 0.6, least=1.0 / 3.0)
    v *= pace
    used = np.ones(len(t), bool)
    low_pass = ZeroPhaseLowPass(5.0, STEP, 5)
    return LowPassedLog(f"run_{seed}", LogSource(), t, q, v, v, q, used, low_pass, True)


def test_the_same_motion_with_other_noise_begun_elsewhere() -> None:
    rng = np.random.default_rng(9)
    first, other = run(1), run(2)
    again = run(1, duration=15.0, start=3.21)
    again = replace(
        again,
        q=again.q + 1e-3 * rng.normal(size=again.q.shape),
        v=again.v + 5e-3 * rng.normal(size=again.v.shape),
    )
    assert motion_groups([first, other, again]) == (0, 1, 0)
    assert motion_groups([other, again, first]) == (0, 1, 1)


def test_other_motions_and_the_same_path_at_another_pace() -> None:
    assert motion_groups([run(1), run(2), run(3)]) == (0, 1, 2)
    assert motion_groups([run(1), run(1, pace=1.5)]) == (0, 1)
    assert motion_groups([run(1)]) == (0,)


def test_a_common_place_to_rest_is_no_common_motion() -> None:
    def resting(low_passed: LowPassedLog) -> LowPassedLog:
        q, v = low_passed.q.copy(), low_passed.v.copy()
        q[200:], v[200:] = 0.3, 0.0
        return replace(low_passed, q=q, v=v)

    assert motion_groups([resting(run(1)), resting(run(2))]) == (0, 1)


def test_a_log_that_holds_another_repeats_it() -> None:
    assert motion_groups([run(1, duration=5.0, start=2.0), run(1)]) == (0, 0)


@pytest.mark.parametrize(
    ("groups", "expected"),
    [
        ((0, 1, 2), []),
        ((0, 1, 0), ["a, c repeat one motion: they are held out together"]),
        ((0, 0, 0), ["a, b, c repeat one motion: there is no other motion"]),
    ],
)
def test_what_is_said_of_it(groups: tuple[int, ...], expected: list[str]) -> None:
    notes = repeated_motion_notes(["a", "b", "c"], groups)
    assert len(notes) == len(expected)
    assert all(note.startswith(start) for note, start in zip(notes, expected, strict=True))
